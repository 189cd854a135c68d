//! Karis' microfacet model for a row of pixels and one lamp.
//!
//! Karis, "Real Shading in Unreal Engine 4" (2013), as in Qiu et al. 2020 with the misprints
//! corrected; [`crate::scene::karis`] is the same formula for one point, kept as the reference.
//! Outgoing light under a lamp of color c: `c · (albedo · n·l + π f n·l) · visibility`.

use crate::scene::{F0, ROUGHNESS_FLOOR};

/// Pixels shaded side by side.
const LANES: usize = 8;

/// What a row of pixels is made of. All slices have the length of the row; unit normals and rays
/// in camera axes; a pixel whose albedo is NaN comes out NaN.
#[derive(Debug, Clone, Copy)]
#[expect(missing_docs, reason = "one slice per component")]
pub struct SurfaceRow<'a> {
    pub normal: [&'a [f32]; 3],
    pub albedo: [&'a [f32]; 3],
    pub roughness: &'a [f32],
    /// x/z of the ray through each pixel.
    pub ray_x: &'a [f32],
    /// y/z of the ray through each pixel.
    pub ray_y: &'a [f32],
}

/// One lamp as the shader sees it.
#[derive(Debug, Clone, Copy)]
pub struct ShaderLamp {
    /// Unit vector toward the lamp, camera axes.
    pub toward: [f32; 3],
    /// Linear color.
    pub color: [f32; 3],
    /// Light arriving after more than one bounce, per channel; multiplied by albedo only.
    pub indirect: [f32; 3],
}

#[inline(always)]
fn each(value: impl Fn(usize) -> f32) -> [f32; LANES] {
    std::array::from_fn(value)
}

/// 2^x for x in [−100, 100], relative error under 5e-6.
#[inline(always)]
fn exp2(x: f32) -> f32 {
    // Adding 1.5·2²³ rounds to the nearest integer and leaves it in the low mantissa bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    // Taylor of 2^f around 0, |f| ≤ 1/2.
    let p = 1.0
        + f * (std::f32::consts::LN_2
            + f * (0.240_226_51 + f * (0.055_504_11 + f * (0.009_618_129 + f * 0.001_333_355_8))));
    f32::from_bits(p.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// `[n·l, π f n·l]` for eight pixels, both clamped to the lit side.
#[inline(always)]
pub(super) fn lobes(
    normal: [[f32; LANES]; 3],
    roughness: [f32; LANES],
    ray: [[f32; LANES]; 2],
    toward: [f32; 3],
) -> [[f32; LANES]; 2] {
    let [nx, ny, nz] = normal;
    let [lx, ly, lz] = toward;
    let [rx, ry] = ray;
    // The direction to the camera is −ray / |ray|.
    let per_length = each(|i| 1.0 / (rx[i] * rx[i] + ry[i] * ry[i] + 1.0).sqrt());
    let n_dot_l = each(|i| nx[i] * lx + ny[i] * ly + nz[i] * lz);
    let n_dot_v =
        each(|i| (-(nx[i] * rx[i] + ny[i] * ry[i] + nz[i]) * per_length[i]).max(1e-3));
    let l_dot_v = each(|i| -(lx * rx[i] + ly * ry[i] + lz) * per_length[i]);
    let per_half = each(|i| 1.0 / (2.0 + 2.0 * l_dot_v[i]).max(1e-8).sqrt());
    let n_dot_h = each(|i| ((n_dot_l[i] + n_dot_v[i]) * per_half[i]).max(0.0).min(1.0));
    let v_dot_h = each(|i| ((1.0 + l_dot_v[i]) * per_half[i]).max(0.0).min(1.0));
    let lit = each(|i| n_dot_l[i].max(0.0));
    let specular = each(|i| {
        let roughness = roughness[i].max(ROUGHNESS_FLOOR);
        let alpha = roughness * roughness;
        let alpha2 = alpha * alpha;
        // (n·h)²(α² − 1) + 1 without the cancellation near the peak of a narrow lobe.
        let spread =
            (1.0 - n_dot_h[i]) * (1.0 + n_dot_h[i]) + n_dot_h[i] * n_dot_h[i] * alpha2;
        let k = (roughness + 1.0) * (roughness + 1.0) * 0.125;
        let fresnel = F0 + (1.0 - F0) * exp2((-5.55473 * v_dot_h[i] - 6.98316) * v_dot_h[i]);
        // π D F G / (4 n·v): n·l of the cosine cancels against the denominator's.
        let denominator = 4.0
            * spread
            * spread
            * (lit[i] * (1.0 - k) + k)
            * (n_dot_v[i] * (1.0 - k) + k);
        alpha2 * fresnel * lit[i] / denominator.max(1e-12)
    });
    [lit, specular]
}

/// Shades one row. `visibility` is replaced by the shadow value: visibility where the surface
/// faces the lamp, 0 where it is turned away, NaN where it is unknown.
///
/// # Panics
/// When slices differ in length: a bug of the caller.
#[inline(always)]
pub fn shade_row(
    surface: &SurfaceRow<'_>,
    lamp: &ShaderLamp,
    visibility: &mut [f32],
    out: &mut [[f32; 3]],
) {
    let width = out.len();
    let mut start = 0;
    while start < width {
        // The last block steps back so that it is whole; rows shorter than a block are padded.
        let here = LANES.min(width - start);
        let take = |row: &[f32]| {
            let mut lanes = [0.5f32; LANES];
            lanes[..here].copy_from_slice(&row[start..start + here]);
            lanes
        };
        let normal = surface.normal.map(take);
        let albedo = surface.albedo.map(take);
        let [lit, specular] = lobes(
            normal,
            take(surface.roughness),
            [take(surface.ray_x), take(surface.ray_y)],
            lamp.toward,
        );
        let seen = take(visibility);
        let shine = each(|i| specular[i] * seen[i]);
        let cosine = each(|i| lit[i] * seen[i]);
        let channels: [[f32; LANES]; 3] = std::array::from_fn(|c| {
            each(|i| {
                albedo[c][i] * (cosine[i] * lamp.color[c] + lamp.indirect[c])
                    + shine[i] * lamp.color[c]
            })
        });
        let shadow = each(|i| {
            let shadow = if lit[i] > 0.0 { seen[i] } else { 0.0 };
            if albedo[0][i].is_nan() { f32::NAN } else { shadow }
        });
        visibility[start..start + here].copy_from_slice(&shadow[..here]);
        for (i, pixel) in out[start..start + here].iter_mut().enumerate() {
            *pixel = [channels[0][i], channels[1][i], channels[2][i]];
        }
        start += here;
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
        ) {
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
                .map(|a| (a + std::f32::consts::PI * lobe) * n_dot_l.max(0.0) * visibility);
            let mut shadow = [visibility];
            let mut out = [[0.0; 3]];
            shade_row(
                &SurfaceRow {
                    normal: [&[normal.x], &[normal.y], &[normal.z]],
                    albedo: [&albedo[..1], &albedo[1..2], &albedo[2..]],
                    roughness: &[roughness],
                    ray_x: &[ray.0],
                    ray_y: &[ray.1],
                },
                &ShaderLamp {
                    toward: toward.to_array(),
                    color: [1.0; 3],
                    indirect: [0.0; 3],
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
            assert!((exp2(x) / x.exp2() - 1.0).abs() < 5e-6, "2^{x}");
        }
    }
}
