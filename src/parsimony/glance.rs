//! A look at a small copy of the shot: what each term would change, and what the shot says for it.

use super::{
    depth::depth_scores,
    rule::{Rule, Scores},
    terms::{Bounced, Terms},
};
use crate::{
    develop::{DevelopError, Grid, Options},
    radiometry::FlashOnly,
    relight::{
        Indirect, Lamp, Prepared, RelightOptions, Relit, Shadows, enlarge::enlarge_relit,
        networks::compact::doubtful,
    },
    scene::{Material, Scene, Shine},
    shot::Shot,
};
use rayon::prelude::*;
use serde::Serialize;

/// What the compact networks mend where depth is wholly in doubt, of the same unit as [`Changes`] (rendered validation
/// captures, with the paper's noise and without). What they change in a small copy foretells nothing.
const CORRECTED: f32 = 0.025;
/// …and of what cast shadows change, the share they mend whatever the depth: what stands behind what is seen is unknown
/// to all. Of 51 rendered captures of validation and training 0.12 saves 56 % of the time and loses 0.104 dB, 0.15 54 % and
/// 0.085.
const UNSEEN_SHARE: f32 = 0.15;

/// Depth is as good as exact up to here: what the network of surfaces says would count for a fiftieth. Rendered validation
/// captures without noise have 0.002.
const NO_DOUBT: f32 = 0.02;

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

/// Smallest change worth making, linear light of white = 1: just visible in middle tones.
const LEAST_CHANGE: f32 = 0.007;
/// A change of this share of the noise lowers the signal-to-noise ratio by a tenth of a decibel.
const SHARE_OF_NOISE: f32 = 0.15;
/// Largest change that noise excuses: grain goes, a wrong model stays.
const MOST_CHANGE: f32 = 0.015;

/// A small copy's pixels are wider than highlights: what they change in the picture is so much more
/// (rendered validation captures).
const HIGHLIGHTS: f32 = 2.5;
/// Halving the grid of a small copy loses more than halving that of the picture: what it loses in the
/// picture is this share (rendered validation captures).
const COARSER: f32 = 0.5;

/// What a term changes in the relit pictures when it is left out, root mean square over the probes'
/// pixels, linear light of white = 1; infinite where it is out of the question.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Changes {
    /// One plane; half the grid.
    pub geometry: [f32; 2],
    /// Matte; one roughness.
    pub material: [f32; 2],
    /// No cast shadow; no networks, as what they are expected to mend.
    pub shadow: [f32; 2],
    /// No bounced light; an even one.
    pub indirect: [f32; 2],
}

/// What a look at the small copy found.
#[derive(Debug, Clone, Serialize)]
pub struct Glance {
    /// What leaving terms out may change, root mean square, linear light of white = 1: what is not
    /// seen, or drowns in the photograph's noise.
    pub tolerance: f32,
    /// What leaving terms out changes.
    pub changes: Changes,
    /// What the depth's samples say: plane, smooth, full.
    pub depth: Scores,
    /// What the photograph says: matte, one roughness, varying.
    pub material: Scores,
    /// Mean share of the hemisphere that the scene blocks, [0, 1].
    pub blocked: f32,
    /// How far depth is in doubt, [0, 1], the mean over what is known.
    pub doubt: f32,
}

impl Glance {
    /// What is typical, for when there is no time to look: medians over the rendered validation
    /// captures.
    pub fn typical() -> Self {
        Self {
            tolerance: LEAST_CHANGE,
            changes: Changes {
                geometry: [0.1, 0.02],
                material: [0.04, 0.016],
                shadow: [0.045, 0.008],
                indirect: [0.0023, 0.0016],
            },
            depth: Scores::default(),
            material: Scores::default(),
            blocked: 0.08,
            doubt: 1.0,
        }
    }

    /// Nothing left out can be excused.
    pub fn nothing_known() -> Self {
        let all = [f32::INFINITY; 2];
        Self {
            tolerance: 0.0,
            changes: Changes {
                geometry: all,
                material: all,
                shadow: all,
                indirect: all,
            },
            depth: Scores::default(),
            material: Scores::default(),
            blocked: 0.0,
            doubt: 1.0,
        }
    }

    /// Whether the compact network of surfaces has anything to say: its answer counts as far as depth is in doubt.
    pub fn asks_for_surfaces(&self) -> bool {
        self.doubt > NO_DOUBT
    }

    /// Looks at the shot. `flash_only` is its light.
    ///
    /// # Errors
    /// [`DevelopError`] when it cannot be developed at all.
    pub fn at(shot: &Shot, flash_only: &FlashOnly, base: &Options) -> Result<Self, DevelopError> {
        let grid = Grid::of(shot, flash_only, PIXELS)?;
        let depth = depth_scores(shot);
        let lamps = PROBES.map(|toward| Lamp::from_person(toward).expect("a direction"));
        let pictures = |prepared: &Prepared, options: RelightOptions| -> Vec<Relit> {
            let one = |lamp| prepared.relight(lamp, options);
            lamps.par_iter().map(one).collect()
        };
        let all = RelightOptions::default();
        let without = |grid: &Grid<'_>, terms: Terms| -> Result<Vec<Relit>, DevelopError> {
            let (_, prepared) = modelled(shot, grid, base, terms)?;
            Ok(pictures(&prepared, all))
        };
        let without_material = |material: Material| {
            // What is bounced is weighed by itself.
            let terms = Terms {
                material,
                indirect: Bounced::None,
                ..Terms::CLOSED
            };
            without(&grid, terms)
        };
        // Grids so small keep no second core busy, so the models are made side by side.
        let ((everything, one_roughness), (coarser, plane)) = rayon::join(
            || {
                rayon::join(
                    || modelled(shot, &grid, base, Terms::CLOSED),
                    || without_material(Material::OneRoughness),
                )
            },
            || {
                rayon::join(
                    || -> Result<Vec<Relit>, DevelopError> {
                        let coarse = grid.coarser(shot, 2)?;
                        let (small, full) = (&coarse.light.light, &grid.light.light);
                        let relit = without(&coarse, Terms::CLOSED)?;
                        let enlarged = relit.iter().map(|relit| enlarge_relit(relit, small, full));
                        Ok(enlarged.collect())
                    },
                    // Many planes are none: what the depth's samples refute is not looked at.
                    || {
                        let likely = depth.pick(Rule::OneStandardError) == 0;
                        likely.then(|| without(&grid, Terms::FEWEST)).transpose()
                    },
                )
            },
        );
        let (scene, prepared) = everything?;
        let reference = pictures(&prepared, all);
        let unbounced = RelightOptions {
            indirect: Indirect::None,
            ..all
        };
        let direct = pictures(&prepared, unbounced);
        let changed = |relit: &[Relit]| change(&reference, relit);
        let unshadowed = RelightOptions {
            shadows: Shadows::None,
            ..all
        };
        let tolerance = tolerance(flash_only, &scene);
        let geometry = [
            plane?.map_or(f32::INFINITY, |relit| changed(&relit)),
            COARSER * changed(&coarser?),
        ];
        let shines = |relit: &[Relit]| HIGHLIGHTS * change(&direct, relit);
        let one = shines(&one_roughness?);
        let material = [
            // Where one roughness will not do, none will not.
            if one <= tolerance {
                shines(&without_material(Material::Matte)?)
            } else {
                f32::INFINITY
            },
            one,
        ];
        let blocked = prepared.mean_blocked();
        let even = prepared.evenly_blocked(blocked);
        let shine = scene.shine.clone().unwrap_or_default();
        let shadows = changed(&pictures(&prepared, unshadowed));
        let doubt = doubtful(&scene);
        Ok(Self {
            tolerance,
            changes: Changes {
                geometry,
                material,
                shadow: [shadows, (CORRECTED * doubt).hypot(UNSEEN_SHARE * shadows)],
                indirect: [changed(&direct), changed(&pictures(&even, all))],
            },
            depth,
            material: material_scores(&shine),
            blocked,
            doubt,
        })
    }
}

/// The small copy with some terms.
fn modelled(
    shot: &Shot,
    grid: &Grid<'_>,
    base: &Options,
    terms: Terms,
) -> Result<(Scene, Prepared), DevelopError> {
    let mut options = terms.options(base, 0.0);
    options.scene.weigh_materials = terms == Terms::CLOSED;
    let scene = grid.scene(shot, &options.scene)?;
    let prepared = Prepared::new(&scene, options.prepare);
    Ok((scene, prepared))
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

/// What may change: the noise of a relit picture is as large a share of it as that of the photograph is.
fn tolerance(flash_only: &FlashOnly, scene: &Scene) -> f32 {
    let light = flash_only.light.0.samples();
    let stride = light.len().div_ceil(20_000).max(1);
    let albedo = mean_albedo(scene);
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
    LEAST_CHANGE
        .hypot(SHARE_OF_NOISE * albedo * share.sqrt())
        .min(MOST_CHANGE)
}

fn mean_albedo(scene: &Scene) -> f32 {
    let known = scene.albedo.samples().iter().filter(|a| a[0].is_finite());
    let (sum, count) = known.fold((0.0f64, 0u32), |(sum, count), albedo| {
        (
            sum + f64::from(albedo[0] + albedo[1] + albedo[2]) / 3.0,
            count + 1,
        )
    });
    (sum / f64::from(count.max(1))) as f32
}
