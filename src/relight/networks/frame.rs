//! The light's own view of the scene: T(p) = Rᵀ p + (0, 0, 1), the third column of R being the
//! light's direction. Axes: x right, y up, z toward the camera.

use super::Channels;

/// Columns of an orthonormal R whose third is `light`, a unit vector.
///
/// The shortest turn of the z axis onto the light, so that neighbouring lights have neighbouring
/// bases over the whole hemisphere z ≥ 0 (Frisvad 2012; Duff et al. 2017); beyond it no network was
/// trained, and near z = −1 the columns are no basis.
pub fn basis([x, y, z]: [f32; 3]) -> [[f32; 3]; 3] {
    let a = -1.0 / (1.0 + z).max(1e-3);
    let b = x * y * a;
    [
        [1.0 + x * x * a, b, -x],
        [b, 1.0 + y * y * a, -y],
        [x, y, z],
    ]
}

/// T(ω, P) of every point of `cloud` (x, y, z).
pub fn seen_from(light: [f32; 3], cloud: &Channels) -> Channels {
    let columns = basis(light);
    let [px, py, pz] = [0, 1, 2].map(|axis| cloud.channel(axis));
    Channels::from_pixels(cloud.size, |i| {
        let along = |[x, y, z]: [f32; 3]| x * px[i] + y * py[i] + z * pz[i];
        let [first, second, third] = columns.map(along);
        [first, second, third + 1.0]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    fn hemisphere() -> impl Strategy<Value = Vec3> {
        (-1.0f32..1.0, -1.0f32..1.0, 0.0f32..1.0)
            .prop_map(|(x, y, z)| Vec3::new(x, y, z))
            .prop_filter("a direction", |v| v.length() > 0.1)
            .prop_map(Vec3::normalize)
    }

    proptest! {
        #[test]
        fn the_basis_is_orthonormal_and_its_third_column_is_the_light(light in hemisphere()) {
            let [a, b, c] = basis(light.to_array()).map(Vec3::from);
            prop_assert!((a.cross(b) - c).length() < 1e-5);
            prop_assert!((a.length() - 1.0).abs() < 1e-5 && a.dot(b).abs() < 1e-5);
            prop_assert_eq!(c, light);
        }

        #[test]
        fn neighbouring_lights_have_neighbouring_bases(
            light in hemisphere(),
            step in (-1e-3f32..1e-3, -1e-3f32..1e-3, 0.0f32..1e-3),
        ) {
            let moved = (light + Vec3::from(step)).normalize();
            let turn: f32 = basis(light.to_array())
                .into_iter()
                .zip(basis(moved.to_array()))
                .map(|(a, b)| (Vec3::from(a) - Vec3::from(b)).length())
                .sum();
            prop_assert!(turn < 8.0 * (moved - light).length() + 1e-5);
        }
    }

    #[test]
    fn the_frontal_light_only_shifts_and_a_light_from_the_right_sees_depth_as_width() {
        let cloud = Channels::from_pixels((1, 1), |_| [0.3, -0.2, 0.7]);
        let seen = |light| seen_from(light, &cloud).samples;
        assert_eq!(seen([0.0, 0.0, 1.0]), [0.3, -0.2, 1.7]);
        // R = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], so Rᵀp = (-z, y, x).
        assert_eq!(seen([1.0, 0.0, 0.0]), [-0.7, -0.2, 1.3]);
    }
}
