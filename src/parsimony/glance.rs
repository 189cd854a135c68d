//! A look at a small copy of the shot: what each term would change, and what the shot says for it.

use super::{depth::depth_scores, rule::Scores, terms::Terms};
use crate::{
    develop::{DevelopError, Options, Working, work_out},
    radiometry::FlashOnly,
    relight::{
        Blocked, Indirect, Lamp, Prepared, RelightOptions, Relit, Shadows,
        enlarge::enlarge_relit,
        networks::{Doubt, NETWORK_ERROR},
    },
    scene::{Material, Shine},
    shot::Shot,
};
use rayon::prelude::*;
use serde::Serialize;

/// Pixels of the small copy.
pub(super) const PIXELS: usize = 4_096;

/// Lamps that the small copy is looked at under: around the camera, aslant and grazing.
const PROBES: [[f32; 3]; 6] = [
    [0.5, 0.3, 0.81],
    [-0.5, 0.4, 0.77],
    [0.1, 0.75, 0.65],
    [0.8, -0.2, 0.56],
    [-0.85, -0.1, 0.51],
    [-0.2, -0.7, 0.68],
];

/// Smallest change that a picture of 8 bits shows, linear light of white = 1.
const LEAST_CHANGE: f32 = 1.0 / 256.0;

/// What a term changes in the relit pictures when it is left out, root mean square over the probes'
/// pixels, linear light of white = 1.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Changes {
    /// One plane; half the grid.
    pub geometry: [f32; 2],
    /// Matte; one roughness.
    pub material: [f32; 2],
    /// No cast shadow; no network, as what it is expected to correct.
    pub shadow: [f32; 2],
    /// No bounced light; an even one.
    pub indirect: [f32; 2],
}

/// What a look at the small copy found.
#[derive(Debug, Clone, Serialize)]
pub struct Glance {
    /// Noise of a relit picture that the photograph's own noise makes, root mean square, with what
    /// a picture of 8 bits can show; linear light of white = 1.
    pub noise: f32,
    /// What leaving terms out changes.
    pub changes: Changes,
    /// What the depth's samples say: plane, smooth, full.
    pub depth: Scores,
    /// What the photograph says: matte, one roughness, varying.
    pub material: Scores,
    /// Mean share of the hemisphere that the scene blocks, [0, 1].
    pub blocked: f32,
}

impl Glance {
    /// Looks at the shot. `flash_only` is its light.
    ///
    /// # Errors
    /// [`DevelopError`] when it cannot be developed at all.
    pub fn at(shot: &Shot, flash_only: &FlashOnly, base: &Options) -> Result<Self, DevelopError> {
        let everything = small_copy(shot, flash_only, base, Terms::CLOSED, PIXELS)?;
        let lamps = PROBES.map(|toward| Lamp::from_person(toward).expect("a direction"));
        let pictures = |prepared: &Prepared, options: RelightOptions| -> Vec<Relit> {
            let one = |lamp| prepared.relight(lamp, options);
            lamps.par_iter().map(one).collect()
        };
        let all = RelightOptions::default();
        let reference = pictures(&everything.prepared, all);
        let blocked = everything.prepared.mean_blocked();
        let depth = depth_scores(shot);
        let without = |terms: Terms, pixels: usize| -> Result<f32, DevelopError> {
            let copy = small_copy(shot, flash_only, base, terms, pixels)?;
            let mut relit = pictures(&copy.prepared, all);
            if let (Some(small), Some(full)) = (&copy.light, &everything.light)
                && small.0.size() != full.0.size()
            {
                let enlarged = relit.iter().map(|relit| enlarge_relit(relit, small, full));
                relit = enlarged.collect();
            }
            Ok(change(&reference, &relit))
        };
        let of_material = |material: Material| {
            without(
                Terms {
                    material,
                    ..Terms::CLOSED
                },
                PIXELS,
            )
        };
        let of_options = |options| {
            let relit = pictures(&everything.prepared, options);
            change(&reference, &relit)
        };
        let even = everything.prepared.evenly_blocked(blocked);
        let shine = everything.scene.shine.clone().unwrap_or_default();
        Ok(Self {
            noise: noise(flash_only, &everything),
            changes: Changes {
                geometry: [
                    without(Terms::FEWEST, PIXELS)?,
                    without(Terms::CLOSED, PIXELS / 4)?,
                ],
                material: [
                    of_material(Material::Matte)?,
                    of_material(Material::OneRoughness)?,
                ],
                shadow: [
                    of_options(RelightOptions {
                        shadows: Shadows::None,
                        ..all
                    }),
                    correctable(&everything.prepared, &reference, &lamps),
                ],
                indirect: [
                    of_options(RelightOptions {
                        indirect: Indirect::None,
                        ..all
                    }),
                    change(&reference, &pictures(&even, all)),
                ],
            },
            depth,
            material: material_scores(&shine),
            blocked,
        })
    }
}

fn small_copy(
    shot: &Shot,
    flash_only: &FlashOnly,
    base: &Options,
    terms: Terms,
    pixels: usize,
) -> Result<Working, DevelopError> {
    let mut options = terms.options(base, usize::MAX, 0.0);
    options.working_pixels = pixels;
    options.scene.weigh_materials = terms == Terms::CLOSED;
    if terms != Terms::CLOSED {
        // What is bounced is weighed by itself.
        options.prepare.blocked = Blocked::Nothing;
    }
    work_out(shot, flash_only, &options, &mut |_| ())
}

fn material_scores(shine: &Shine) -> Scores {
    Scores::new(
        &shine.held_out,
        shine.deviance,
        shine.parameters,
        shine.samples,
    )
}

/// Light as a picture shows it.
fn shown(value: f32) -> f32 {
    value.clamp(0.0, 1.0)
}

/// Root mean square difference over the pixels known in both, all pictures together.
fn change(reference: &[Relit], relit: &[Relit]) -> f32 {
    let (mut sum, mut count) = (0.0f64, 0u32);
    for (a, b) in reference.iter().zip(relit) {
        for (a, b) in a.light.0.samples().iter().zip(b.light.0.samples()) {
            let squares: f32 = (0..3).map(|c| (shown(a[c]) - shown(b[c])).powi(2)).sum();
            if squares.is_finite() {
                sum += f64::from(squares) / 3.0;
                count += 1;
            }
        }
    }
    (sum / f64::from(count.max(1))).sqrt() as f32
}

/// What a network is expected to correct in swept shadows: where bodies half and twice as thick
/// would answer differently, and where the depth's noise leaves it open, its answer and that of the
/// slabs are weighed by their errors, and the error that goes is what it is worth.
fn correctable(prepared: &Prepared, reference: &[Relit], lamps: &[Lamp]) -> f32 {
    let doubt = Doubt::of(prepared);
    let sums = lamps.par_iter().zip(reference).map(|(lamp, reference)| {
        let options = RelightOptions {
            shadows: Shadows::None,
            indirect: Indirect::None,
        };
        let direct = prepared.relight(lamp, options);
        let errors = doubt.swept_errors(lamp, &reference.shadow);
        let mut sum = 0.0f64;
        let mut count = 0.0f64;
        for (light, error) in direct.light.0.samples().iter().zip(errors.samples()) {
            let goes = error * error / (error + NETWORK_ERROR);
            let brightness = (shown(light[0]) + shown(light[1]) + shown(light[2])) / 3.0;
            let worth = goes * brightness * brightness;
            if worth.is_finite() {
                sum += f64::from(worth);
                count += 1.0;
            }
        }
        (sum, count)
    });
    let (sum, count) = sums.reduce(|| (0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    (sum / count.max(1.0)).sqrt() as f32
}

/// Noise of a relit picture: as large a share of it as that of the photograph is.
fn noise(flash_only: &FlashOnly, everything: &Working) -> f32 {
    let light = flash_only.light.0.samples();
    let stride = light.len().div_ceil(20_000).max(1);
    let albedo = mean_albedo(everything);
    let (mut sum, mut count) = (0.0f64, 0u32);
    for (light, variance) in light
        .iter()
        .zip(flash_only.variance.samples())
        .step_by(stride)
    {
        let level = (light[0] + light[1] + light[2]) / 3.0;
        let share = variance / (level * level).max(1e-6);
        if share.is_finite() {
            sum += f64::from(share.min(1.0));
            count += 1;
        }
    }
    let share = (sum / f64::from(count.max(1))) as f32;
    (share * albedo * albedo + LEAST_CHANGE * LEAST_CHANGE).sqrt()
}

fn mean_albedo(everything: &Working) -> f32 {
    let known = everything
        .scene
        .albedo
        .samples()
        .iter()
        .filter(|a| a[0].is_finite());
    let (sum, count) = known.fold((0.0f64, 0u32), |(sum, count), albedo| {
        (
            sum + f64::from(albedo[0] + albedo[1] + albedo[2]) / 3.0,
            count + 1,
        )
    });
    (sum / f64::from(count.max(1))) as f32
}
