//! Karis' microfacet model for a row of pixels and one lamp.
//!
//! Karis, "Real Shading in Unreal Engine 4" (2013), as in Qiu et al. 2020 with the misprints
//! corrected; [`crate::scene::karis`] is the same formula for one point, kept as the reference.
//! Outgoing light under a lamp of color c: `c · (albedo · n·l + π f n·l) · visibility`.

use super::emitter::{Emitter, LEAST_SQUARE, Origin};
use crate::scene::{F0, ROUGHNESS_FLOOR};
use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*, u32x16};

/// Pixels shaded side by side.
pub(super) const LANES: usize = 16;

/// What a row of pixels is made of. All slices have the length of the row; unit normals and rays
/// in camera axes; a pixel whose albedo is NaN comes out NaN.
#[derive(Debug, Clone, Copy)]
#[expect(missing_docs, reason = "one slice per component")]
pub struct SurfaceRow<'a> {
    pub normal: [&'a [f32]; 3],
    pub albedo: [&'a [f32]; 3],
    pub roughness: &'a [f32],
    /// Share of the hemisphere that the scene itself blocks, in [0, 1].
    pub obscurance: &'a [f32],
    /// x/z of the ray through each pixel.
    pub ray_x: &'a [f32],
    /// y/z of the ray through each pixel.
    pub ray_y: &'a [f32],
    /// z in metres; NaN = unknown, and dark under a near lamp with it. May be empty where all lamps are distant.
    pub metres: &'a [f32],
}

/// One lamp as the shader sees it.
#[derive(Debug, Clone, Copy)]
pub struct ShaderLamp {
    /// Where its light comes from, and how much.
    pub emitter: Emitter,
    /// Mean light the scene sends out, per channel; it arrives from the directions the scene
    /// itself blocks.
    pub indirect: [f32; 3],
    /// False leaves highlights out.
    pub shines: bool,
}

/// 2^x for x in [−100, 100], relative error under 5e-6.
#[inline(always)]
fn exp2<S: Simd>(x: f32x16<S>) -> f32x16<S> {
    // Adding 1.5·2²³ rounds to the nearest integer and leaves it in the low mantissa bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    // Taylor of 2^f around 0, |f| ≤ 1/2.
    let p = f.mul_add(0.001_333_355_8, 0.009_618_129);
    let p = f.mul_add(p, 0.055_504_11);
    let p = f.mul_add(p, 0.240_226_5);
    let p = f.mul_add(p, std::f32::consts::LN_2);
    let p = f.mul_add(p, 1.0);
    let (p, exponent): (u32x16<S>, u32x16<S>) = (p.bitcast(), rounded.bitcast());
    (p + (exponent << 23)).bitcast()
}

/// What of a block of pixels does not depend on the lamp.
#[derive(Clone, Copy)]
pub(super) struct Facet<S: Simd> {
    normal: [f32x16<S>; 3],
    /// Unit vectors to the camera.
    to_camera: [f32x16<S>; 3],
    n_dot_v: f32x16<S>,
    /// α², α = roughness².
    alpha2: f32x16<S>,
    /// Karis' k = (roughness + 1)² / 8.
    k: f32x16<S>,
    /// n·v (1 − k) + k.
    masking: f32x16<S>,
}

impl<S: Simd> Facet<S> {
    /// Of the block of pixels from `start`.
    #[inline(always)]
    pub(super) fn new(simd: S, row: &SurfaceRow<'_>, start: usize) -> Self {
        let (rx, ry) = (block(simd, row.ray_x, start), block(simd, row.ray_y, start));
        let per_length = rx.mul_add(rx, ry.mul_add(ry, 1.0)).sqrt();
        let per_length = f32x16::splat(simd, -1.0) / per_length;
        let (vx, vy, vz) = (rx * per_length, ry * per_length, per_length);
        let nx = block(simd, row.normal[0], start);
        let ny = block(simd, row.normal[1], start);
        let nz = block(simd, row.normal[2], start);
        let n_dot_v = nx.mul_add(vx, ny.mul_add(vy, nz * vz)).max(1e-3);
        let roughness = block(simd, row.roughness, start).max(ROUGHNESS_FLOOR);
        let alpha = roughness * roughness;
        let rough_one = roughness + 1.0;
        let k = rough_one * rough_one * 0.125;
        let alpha2 = alpha * alpha;
        let masking = n_dot_v.mul_add(f32x16::splat(simd, 1.0) - k, k);
        Self {
            normal: [nx, ny, nz],
            to_camera: [vx, vy, vz],
            n_dot_v,
            alpha2,
            k,
            masking,
        }
    }

    /// n·l under a lamp in direction `toward`.
    #[inline(always)]
    fn cosine(&self, [lx, ly, lz]: [f32x16<S>; 3]) -> f32x16<S> {
        let [nx, ny, nz] = self.normal;
        nx.mul_add(lx, ny.mul_add(ly, nz * lz))
    }

    /// `[n·l, π f n·l]` under a lamp in direction `toward`, both zero where it is turned away, and
    /// the second everywhere where nothing `shines`.
    #[inline(always)]
    pub(super) fn reflected(
        &self,
        simd: S,
        toward: [f32x16<S>; 3],
        shines: bool,
    ) -> [f32x16<S>; 2] {
        if shines {
            self.lobes(simd, toward)
        } else {
            let zero = f32x16::splat(simd, 0.0);
            [self.cosine(toward).max(0.0), zero]
        }
    }

    #[inline(always)]
    fn lobes(&self, simd: S, toward: [f32x16<S>; 3]) -> [f32x16<S>; 2] {
        let one = f32x16::splat(simd, 1.0);
        let ([lx, ly, lz], [vx, vy, vz]) = (toward, self.to_camera);
        let n_dot_l = self.cosine(toward);
        let l_dot_v = vx.mul_add(lx, vy.mul_add(ly, vz * lz));
        // h is the half vector: |l + v|² = 2 (1 + l·v), n·h = (n·l + n·v) / |l + v|.
        let length2 = (l_dot_v * 2.0 + 2.0).max(0.0);
        let v_dot_h = length2.sqrt() * 0.5;
        let sum = n_dot_l + self.n_dot_v;
        let sum2 = sum * sum;
        let lit = n_dot_l.max(0.0);
        // |l + v|² ((n·h)² (α² − 1) + 1)
        let spread = sum2.mul_add(self.alpha2, (length2 - sum2).max(0.0));
        let exponent = v_dot_h.mul_add(-5.55473, -6.98316) * v_dot_h;
        let fresnel = exp2(exponent).mul_add(1.0 - F0, F0);
        // π D F G / (4 n·v), one division for all: n·l of the cosine cancels against the
        // denominator's.
        let masking = lit.mul_add(one - self.k, self.k) * self.masking;
        let denominator = (spread * spread * masking).max(1e-30);
        let peak = self.alpha2 * 0.25 * length2 * length2;
        let specular = peak * fresnel * lit / denominator;
        [lit, specular]
    }
}

/// Shades one row. `visibility` is replaced by the shadow value: visibility where the surface
/// faces the lamp, 0 where it is turned away, NaN where it is unknown.
///
/// # Panics
/// When slices differ in length: a bug of the caller.
pub fn shade_row(
    surface: &SurfaceRow<'_>,
    lamp: &ShaderLamp,
    visibility: &mut [f32],
    out: &mut [[f32; 3]],
) {
    let level = Level::new();
    match lamp.emitter.origin {
        Origin::Distant(toward) => {
            let toward = toward.to_array();
            dispatch!(level, simd => {
                let arrives = |_: usize| (toward.map(|axis| f32x16::splat(simd, axis)), None);
                shade_blocks(simd, surface, lamp, arrives, visibility, out);
            });
        }
        Origin::Near(position) => {
            let near = Near {
                position: position.to_array(),
                facing: lamp.emitter.facing.map(|facing| facing.to_array()),
            };
            dispatch!(level, simd => {
                let arrives = |start: usize| near.arrives(simd, surface, start);
                shade_blocks(simd, surface, lamp, arrives, visibility, out);
            });
        }
    }
}

/// The unit vectors toward a lamp, and how much of its light arrives where that is not all of it.
type Arrival<S> = ([f32x16<S>; 3], Option<f32x16<S>>);

/// A near lamp; as [`Emitter`] has it.
#[derive(Clone, Copy)]
struct Near {
    position: [f32; 3],
    facing: Option<[f32; 3]>,
}

impl Near {
    /// At the block of pixels from `start`; [`Emitter::seen_from`] is the same for one point.
    #[inline(always)]
    fn arrives<S: Simd>(&self, simd: S, surface: &SurfaceRow<'_>, start: usize) -> Arrival<S> {
        let z = block(simd, surface.metres, start);
        let [px, py, pz] = self.position.map(|axis| f32x16::splat(simd, axis));
        let (wx, wy, wz) = (
            px - block(simd, surface.ray_x, start) * z,
            py - block(simd, surface.ray_y, start) * z,
            pz - z,
        );
        let squared = wx.mul_add(wx, wy.mul_add(wy, wz * wz));
        // Not a number stays one.
        let nearest = f32x16::splat(simd, LEAST_SQUARE);
        let squared = squared.simd_lt(nearest).select(nearest, squared);
        let per_metre = f32x16::splat(simd, 1.0) / squared.sqrt();
        let toward = [wx * per_metre, wy * per_metre, wz * per_metre];
        let mut light = per_metre * per_metre;
        if let Some([fx, fy, fz]) = self.facing {
            let turned = toward[0].mul_add(fx, toward[1].mul_add(fy, toward[2] * fz));
            light *= (turned * -1.0).max(0.0);
        }
        (toward, Some(light))
    }
}

/// [`LANES`] samples from `start`, or fewer at the end of a row.
#[inline(always)]
pub(super) fn block<S: Simd>(simd: S, row: &[f32], start: usize) -> f32x16<S> {
    if let Some(whole) = row.get(start..start + LANES) {
        return f32x16::from_slice(simd, whole);
    }
    let mut lanes = [0.0; LANES];
    lanes[..row.len() - start].copy_from_slice(&row[start..]);
    f32x16::load_array(simd, lanes)
}

/// Stores the pixels of a block, or as many as `out` has room for, one vector per channel.
#[inline(always)]
pub(super) fn store<S: Simd>(channels: &[f32x16<S>; 3], out: &mut [[f32; 3]]) {
    let [red, green, blue] = channels.each_ref().map(SimdBase::as_slice);
    for (((pixel, red), green), blue) in out.iter_mut().zip(red).zip(green).zip(blue) {
        *pixel = [*red, *green, *blue];
    }
}

#[inline(always)]
fn shade_blocks<S: Simd>(
    simd: S,
    surface: &SurfaceRow<'_>,
    lamp: &ShaderLamp,
    arrives: impl Fn(usize) -> Arrival<S>,
    visibility: &mut [f32],
    out: &mut [[f32; 3]],
) {
    let color = lamp.emitter.color;
    let zero = f32x16::splat(simd, 0.0);
    for start in (0..out.len()).step_by(LANES) {
        let end = (start + LANES).min(out.len());
        let facet = Facet::new(simd, surface, start);
        let (toward, light) = arrives(start);
        let [lit, specular] = facet.reflected(simd, toward, lamp.shines);
        let seen = block(simd, visibility, start);
        let (mut cosine, mut shine) = (lit * seen, specular * seen);
        let mut unknown = block(simd, surface.albedo[0], start) * zero;
        if let Some(light) = light {
            (cosine, shine) = (cosine * light, shine * light);
            unknown = light.mul_add(zero, unknown);
        }
        let blocked = block(simd, surface.obscurance, start);
        let mut channels = [zero; 3];
        for (c, channel) in channels.iter_mut().enumerate() {
            let diffuse = cosine.mul_add(color[c], blocked * lamp.indirect[c]);
            let albedo = block(simd, surface.albedo[c], start);
            *channel = albedo.mul_add(diffuse, shine * color[c]);
        }
        store(&channels, &mut out[start..]);
        // What is unknown makes the sum unknown: zero times it is NaN again.
        let shadow = lit.simd_gt(0.0).select(seen, zero) + unknown;
        visibility[start..end].copy_from_slice(&shadow.as_slice()[..end - start]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::karis;
    use glam::Vec3;
    use proptest::prelude::*;

    fn direction() -> impl Strategy<Value = Vec3> {
        (-1.0f32..1.0, -1.0f32..1.0, 0.05f32..1.0)
            .prop_map(|(x, y, z)| Vec3::new(x, y, -z).normalize())
    }

    proptest! {
        #[test]
        fn the_row_shader_equals_the_formula_for_one_point(
            normal in direction(),
            toward in direction(),
            ray in (-0.6f32..0.6, -0.6f32..0.6),
            roughness in 0.05f32..1.0,
            visibility in 0.0f32..1.0,
            metres in 0.3f32..4.0,
            lamp_metres in prop::option::of(0.1f32..3.0),
            facing in prop::option::of(direction()),
        ) {
            let point = metres * Vec3::new(ray.0, ray.1, 1.0);
            let emitter = Emitter {
                origin: match lamp_metres {
                    Some(away) => Origin::Near(point + away * toward),
                    None => Origin::Distant(toward),
                },
                facing: facing.map(|facing| -facing),
                color: [1.0; 3],
            };
            let (toward, arriving) = emitter.seen_from(point);
            let to_camera = -Vec3::new(ray.0, ray.1, 1.0).normalize();
            prop_assume!(normal.dot(to_camera) > 0.02);
            let half = (toward + to_camera).normalize();
            let n_dot_l = normal.dot(toward);
            let lobe = karis(
                n_dot_l,
                normal.dot(to_camera),
                normal.dot(half),
                to_camera.dot(half),
                roughness,
            );
            let albedo = [0.2f32, 0.5, 0.9];
            let expected = albedo
                .map(|a| (a + std::f32::consts::PI * lobe) * n_dot_l.max(0.0) * visibility * arriving);
            let mut shadow = [visibility];
            let mut out = [[0.0; 3]];
            shade_row(
                &SurfaceRow {
                    normal: [&[normal.x], &[normal.y], &[normal.z]],
                    albedo: [&albedo[..1], &albedo[1..2], &albedo[2..]],
                    roughness: &[roughness],
                    obscurance: &[0.0],
                    ray_x: &[ray.0],
                    ray_y: &[ray.1],
                    metres: &[metres],
                },
                &ShaderLamp {
                    emitter,
                    indirect: [0.0; 3],
                    shines: true,
                },
                &mut shadow,
                &mut out,
            );
            for (found, expected) in out[0].iter().zip(expected) {
                // Single precision near a narrow peak; both sides round differently.
                prop_assert!((found - expected).abs() <= 2e-3 * expected.abs() + 2e-5,
                    "{found} {expected}");
            }
        }
    }

    #[test]
    fn powers_of_two_are_right_to_five_digits() {
        for step in 0..2000 {
            let x = -13.0 + step as f32 * 0.0075;
            let found = dispatch!(Level::new(), simd => exp2(f32x16::splat(simd, x)).as_slice()[0]);
            assert!((found / x.exp2() - 1.0).abs() < 5e-6, "2^{x}");
        }
    }
}
