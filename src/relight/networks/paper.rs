//! DecomposeNet, ShadowNet and SynthesisNet in their order.

use super::{
    Channels, Network, NetworkError, NetworkRecord, Variant,
    feed::Feed,
    frame::seen_from,
    render::{Surfaces, one_bounce},
};
use crate::{
    radiometry::LinearImage,
    relight::{Lamp, Relit},
};
use drivers::{Intrinsics, Plane};
use glam::Vec3;

/// The three networks of one variant.
pub struct Paper {
    /// What they were trained on, and so what they are fed.
    pub variant: Variant,
    /// flash, near → albedo, normal, roughness.
    pub decompose: Box<dyn Network>,
    /// cloud → shadow.
    pub shadow: Box<dyn Network>,
    /// shadow, render, flash, albedo, normal, roughness, cloud → relit.
    pub synthesis: Box<dyn Network>,
}

/// What DecomposeNet, in one of its variants, says of a scene; on the networks' grid.
#[derive(Debug, Clone)]
pub struct Decomposed {
    albedo: Channels,
    normal: Channels,
    roughness: Channels,
}

impl Decomposed {
    const PARTS: [(&'static str, usize); 3] = [("albedo", 3), ("normal", 3), ("roughness", 1)];

    /// Asks a network of that kind; `given` is what its variant takes.
    ///
    /// # Errors
    /// [`NetworkError`] of the network.
    pub fn ask(network: &dyn Network, given: &[(&str, &Channels)]) -> Result<Self, NetworkError> {
        let [albedo, normal, roughness] = answers(network, given, &Self::PARTS)?;
        Ok(Self {
            albedo,
            normal,
            roughness,
        })
    }

    /// Linear albedo, in [0, 1].
    pub fn albedo(&self) -> Plane<[f32; 3]> {
        plane(&self.albedo).map(|albedo| albedo.map(|value| value.clamp(0.0, 1.0)))
    }

    /// Unit normals in camera axes (x right, y down, z forward).
    pub fn normal(&self) -> Plane<Vec3> {
        plane(&self.normal).map(|[x, y, z]| Vec3::new(*x, -y, -z).normalize_or(Vec3::NEG_Z))
    }

    /// Karis' roughness.
    pub fn roughness(&self) -> Plane<f32> {
        plane(&self.roughness).map(|[value]| *value)
    }

    fn surfaces(&self) -> Surfaces<'_> {
        Surfaces {
            albedo: &self.albedo,
            normal: &self.normal,
            roughness: &self.roughness,
        }
    }

    /// The scene under a lamp by closed-form shading of these surfaces alone, no shadow cast.
    pub fn shaded(&self, camera: &Intrinsics, lamp: &Lamp) -> Relit {
        let light = one_bounce(self.surfaces(), camera, lamp.toward().to_array());
        let facing = self.normal().map(|normal| {
            let lit = normal.dot(lamp.toward()) > 0.0;
            f32::from(u8::from(lit))
        });
        relit(&light, facing, lamp)
    }
}

impl Paper {
    /// What the scene is made of.
    ///
    /// # Errors
    /// [`NetworkError`] of DecomposeNet.
    pub fn decompose(&self, feed: &Feed) -> Result<Decomposed, NetworkError> {
        let given = [("flash", &feed.flash), ("near", &feed.near)];
        Decomposed::ask(self.decompose.as_ref(), &given)
    }

    /// The scene under one lamp, on the networks' grid.
    ///
    /// # Errors
    /// [`NetworkError`] of ShadowNet or SynthesisNet.
    pub fn relight(
        &self,
        feed: &Feed,
        scene: &Decomposed,
        lamp: &Lamp,
    ) -> Result<Relit, NetworkError> {
        let cloud = seen_from(lamp.person_direction(), &feed.cloud);
        let [shadow] = answers(self.shadow.as_ref(), &[("cloud", &cloud)], &[("shadow", 1)])?;
        let render = one_bounce(scene.surfaces(), &feed.camera, lamp.toward().to_array());
        let given = [
            ("shadow", &shadow),
            ("render", &render),
            ("flash", &feed.flash),
            ("albedo", &scene.albedo),
            ("normal", &scene.normal),
            ("roughness", &scene.roughness),
            ("cloud", &cloud),
        ];
        let [light] = answers(self.synthesis.as_ref(), &given, &[("relit", 3)])?;
        Ok(relit(&light, plane(&shadow).map(|[value]| *value), lamp))
    }

    /// The scene under many lamps at once: the sum of the answers for each, its shadow their mean
    /// by the lamps' light. `begins` is told each lamp's number.
    ///
    /// # Errors
    /// As [`Self::relight`].
    pub fn superposed<'a>(
        &self,
        feed: &Feed,
        scene: &Decomposed,
        lamps: impl Iterator<Item = &'a Lamp>,
        begins: &mut dyn FnMut(usize),
    ) -> Result<Relit, NetworkError> {
        let (width, height) = feed.size();
        let mut light = Plane::filled(width, height, [0.0f32; 3]);
        let mut shadow = Plane::filled(width, height, 0.0f32);
        let mut total = 0.0;
        for (number, lamp) in lamps.enumerate() {
            begins(number);
            let one = self.relight(feed, scene, lamp)?;
            let weight: f32 = lamp.color.iter().sum();
            total += weight;
            for (sum, value) in light.samples_mut().iter_mut().zip(one.light.0.samples()) {
                *sum = std::array::from_fn(|channel| sum[channel] + value[channel]);
            }
            for (sum, value) in shadow.samples_mut().iter_mut().zip(one.shadow.samples()) {
                *sum += weight * value;
            }
        }
        Ok(Relit {
            light: LinearImage(light),
            shadow: shadow.map(|sum| sum / total.max(1e-12)),
            unseen_path_fraction: 0.0,
        })
    }

    /// Where the networks come from and what they have cost so far.
    pub fn records(&self) -> [NetworkRecord; 3] {
        [&self.decompose, &self.shadow, &self.synthesis].map(|network| network.record())
    }
}

/// The answers of these names and channels, each of the inputs' size.
pub(super) fn answers<const N: usize>(
    network: &dyn Network,
    given: &[(&str, &Channels)],
    wanted: &[(&str, usize); N],
) -> Result<[Channels; N], NetworkError> {
    let names = wanted.map(|(name, _)| name);
    let found = network.answer(given, &names)?;
    let wrong = |output: &str, problem: String| NetworkError::Output {
        network: network.record().name,
        output: output.to_owned(),
        problem,
    };
    for (answer, (name, count)) in found.iter().zip(wanted) {
        let expected = (given.first().map(|(_, input)| input.size), *count);
        if (Some(answer.size), answer.count) != expected {
            let (width, height) = answer.size;
            let problem = format!(
                "is {width}×{height} of {} channels, not of the inputs' size and {count} channels",
                answer.count
            );
            return Err(wrong(name, problem));
        }
    }
    let count = found.len();
    found
        .try_into()
        .map_err(|_| wrong(names[0], format!("is one of {count} answers, not {N}")))
}

/// Interleaved pixels.
pub(super) fn plane<const N: usize>(channels: &Channels) -> Plane<[f32; N]> {
    let (width, height) = channels.size;
    Plane::from_fn(width, height, |x, y| {
        std::array::from_fn(|channel| channels.channel(channel)[y * width + x])
    })
}

/// An answer for a white lamp in the color of `lamp`; light is never negative.
fn relit(light: &Channels, shadow: Plane<f32>, lamp: &Lamp) -> Relit {
    let light =
        plane::<3>(light).map(|pixel| std::array::from_fn(|c| pixel[c].max(0.0) * lamp.color[c]));
    Relit {
        light: LinearImage(light),
        shadow,
        unseen_path_fraction: 0.0,
    }
}
