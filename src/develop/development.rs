//! A shot, understood: what [`super::develop`] hands on.

use crate::{
    radiometry::{FlashOnly, LinearImage},
    registration::RegisteredDepth,
    relight::{
        Emitter, Environment, Found, LightSet, Luminaire, Prepared, Relit,
        enlarge::enlarge_relit,
        networks::{
            Feed, Network, NetworkError, Photograph, Variant,
            compact::{Sight, corrected},
        },
        visibility::VisibilityMap,
    },
    scene::{Scene, variance_left},
    shot::Shot,
};
use glam::DVec2;

/// A shot, understood.
#[derive(Debug, Clone)]
pub struct Development {
    /// The light of the flash alone, on the photograph's own grid.
    pub flash_only: FlashOnly,
    /// The same on the working grid, where that is smaller.
    pub working_light: Option<LinearImage>,
    /// Depth on the working grid.
    pub registered: RegisteredDepth,
    /// Surfaces on the working grid.
    pub scene: Scene,
    /// The scene made ready for lights.
    pub prepared: Prepared,
}

impl Development {
    /// Brings a relit picture to the photograph's own size.
    pub fn finish(&self, relit: Relit) -> Relit {
        match &self.working_light {
            None => relit,
            Some(small) => enlarge_relit(&relit, small, &self.flash_only.light),
        }
    }

    /// The fewest lights under which the picture is that of the whole environment within its noise:
    /// what of the flash photograph's own noise is left in the albedo, or in the photograph where the
    /// picture is enlarged to it again. `map` as in [`Prepared::light_set`].
    pub fn light_set(&self, environment: &Environment, map: &VisibilityMap) -> (LightSet, Found) {
        let noise = self.relative_noise();
        self.prepared.light_set(environment, map, &noise)
    }

    /// The points that stand for a lamp: itself, or for a large one as few as the picture needs within
    /// its noise, as in [`Self::light_set`], and what they were chosen by.
    pub fn emitters(&self, lamp: &Luminaire) -> (Vec<Emitter>, Option<Found>) {
        match lamp {
            Luminaire::Distant(lamp) => (vec![lamp.into()], None),
            Luminaire::Near(lamp) => (vec![*lamp], None),
            Luminaire::Area(lamp) => {
                let noise = self.relative_noise();
                let (emitters, found) = self.prepared.area_set(lamp, &noise);
                (emitters, Some(found))
            }
        }
    }

    /// Standard deviation of the light of a pixel of the working grid, divided by that light.
    fn relative_noise(&self) -> impl Fn(usize, usize) -> f32 + '_ {
        let flash = &self.flash_only;
        let (width, height) = self.prepared.size();
        let full = flash.light.0.size();
        move |x: usize, y: usize| {
            let at = (x * full.0 / width, y * full.1 / height);
            let level = flash.light.0[at].iter().sum::<f32>() / 3.0;
            let variance = if full == (width, height) {
                variance_left(flash, at)
            } else {
                flash.variance[at]
            };
            // Of light that is all noise, all of it is noise.
            (variance.sqrt() / level.max(0.0)).min(1.0)
        }
    }

    /// What the paper's networks are fed: clean ones the smoothed depth; noisy ones the depth as it
    /// came where it came on the photograph's grid, else as it was registered. `shot` is the one
    /// that was developed.
    pub fn feed(&self, shot: &Shot, variant: Variant) -> Feed {
        self.feed_light(shot, variant, self.light())
    }

    /// [`Self::feed`] of another light than the flash's alone, such as with the room's.
    pub fn feed_light(&self, shot: &Shot, variant: Variant, light: &LinearImage) -> Feed {
        Feed::new(&Photograph {
            light,
            depth_metres: match (variant, shot.rig.depth) {
                (Variant::Clean, _) => &self.scene.depth_metres,
                (Variant::Noisy, None) => &shot.depth.metres,
                (Variant::Noisy, Some(_)) => &self.registered.metres,
            },
            mask: shot.mask.as_ref(),
            camera: &self.scene.camera,
            intensity: shot
                .rig
                .flash
                .intensity
                .unwrap_or_else(|| likely_intensity(&self.scene, self.light())),
        })
    }

    /// What the compact network of surfaces is fed of; `shot` is the one that was developed.
    pub fn sight(&self, shot: &Shot) -> Sight<'_> {
        let stated = shot.rig.flash.intensity;
        Sight {
            scene: &self.scene,
            light: self.light(),
            registered: &self.registered,
            intensity: stated.unwrap_or_else(|| likely_intensity(&self.scene, self.light())),
        }
    }

    /// Corrects the surfaces by the compact network of surfaces and makes them ready; what they cast shadows on and
    /// what they block stays. `shot` is the one that was developed.
    ///
    /// # Errors
    /// [`NetworkError`] of the network; then nothing has changed.
    pub fn refine(&mut self, shot: &Shot, surfaces: &dyn Network) -> Result<(), NetworkError> {
        self.scene = corrected(&self.scene, &self.sight(shot).given(), surfaces)?;
        self.prepared.resurface(&self.scene);
        Ok(())
    }

    /// Brings a picture that networks relit to the photograph's own size; one of that size stays as
    /// it is.
    pub fn finish_fed(&self, feed: &Feed, relit: Relit) -> Relit {
        let full = &self.flash_only.light;
        if relit.light.0.size() == full.0.size() {
            return relit;
        }
        enlarge_relit(&relit, &feed.light, full)
    }

    /// The light of the flash alone on the working grid.
    fn light(&self) -> &LinearImage {
        self.working_light
            .as_ref()
            .unwrap_or(&self.flash_only.light)
    }
}

/// The flash's intensity that makes the scene's albedo of its light: the median over some pixels.
fn likely_intensity(scene: &Scene, light: &LinearImage) -> f32 {
    let width = scene.albedo.width();
    let stride = scene.albedo.len().div_ceil(60_000).max(1);
    let mut likely: Vec<f32> = (0..scene.albedo.len())
        .step_by(stride)
        .filter_map(|index| {
            let pixel = DVec2::new((index % width) as f64, (index / width) as f64);
            let ray = scene.camera.ray(pixel)?.as_vec3();
            let point = scene.depth_metres.samples()[index] * ray;
            let facing = -scene.normal.samples()[index].dot(ray.normalize());
            let sent = scene.albedo.samples()[index][1] * facing;
            let intensity = light.0.samples()[index][1] * point.length_squared() / sent;
            (sent > 1e-3 && intensity > 0.0 && intensity.is_finite()).then_some(intensity)
        })
        .collect();
    if likely.is_empty() {
        return 1.0;
    }
    let middle = likely.len() / 2;
    *likely.select_nth_unstable_by(middle, f32::total_cmp).1
}
