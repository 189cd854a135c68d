//! The figures that the authors of the reference method printed (Qiu et al. 2020), of their own
//! data: something to look at, nothing to compare with.

use serde::Serialize;

/// One printed row, mean squared errors. The paper does not state their value ranges.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Published {
    /// What the paper calls it.
    pub name: &'static str,
    /// With depth as it is; for rows without depth, the only figures.
    pub clean: PublishedErrors,
    /// Trained on noisy depth, with noisy depth.
    pub noisy: Option<PublishedErrors>,
}

/// Mean squared errors of one printed row; `None` where the paper prints none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[expect(missing_docs, reason = "each is what it is called")]
pub struct PublishedErrors {
    pub albedo: f64,
    pub normal: f64,
    pub roughness: f64,
    pub shadow: Option<f64>,
    pub relit: Option<f64>,
}

const fn surfaces(albedo: f64, normal: f64, roughness: f64) -> PublishedErrors {
    PublishedErrors {
        albedo,
        normal,
        roughness,
        shadow: None,
        relit: None,
    }
}

const fn all(errors: PublishedErrors, shadow: f64, relit: f64) -> PublishedErrors {
    PublishedErrors {
        shadow: Some(shadow),
        relit: Some(relit),
        ..errors
    }
}

/// The paper's table of errors.
pub(super) const PUBLISHED: [Published; 4] = [
    Published {
        name: "three networks",
        clean: all(surfaces(0.72e-2, 1.53e-2, 4.18e-2), 1.26e-2, 0.40e-2),
        noisy: Some(all(surfaces(0.48e-2, 1.85e-2, 4.23e-2), 5.53e-2, 0.54e-2)),
    },
    Published {
        name: "Env",
        clean: surfaces(0.99e-2, 1.60e-2, 4.47e-2),
        noisy: None,
    },
    Published {
        name: "SIPS (Li 2018), final",
        clean: surfaces(4.84e-2, 3.81e-2, 19.3e-2),
        noisy: None,
    },
    Published {
        name: "SIPS (Li 2018), initial",
        clean: surfaces(5.64e-2, 4.51e-2, 20.6e-2),
        noisy: None,
    },
];
