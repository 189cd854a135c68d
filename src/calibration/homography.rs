//! From the plane of the board to a picture: the map, and what it says of focal length and pose.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::DMatrix;

/// The homography that takes `from` to `to` in the least squares sense (direct linear transform with
/// Hartley's normalisation, 1997); `None` for fewer than four pairs or pairs on one line.
pub(super) fn homography(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    if pairs.len() < 4 {
        return None;
    }
    let (from, to) = (
        normaliser(pairs.iter().map(|pair| pair.0))?,
        normaliser(pairs.iter().map(|pair| pair.1))?,
    );
    let mut rows = DMatrix::<f64>::zeros((2 * pairs.len()).max(9), 9);
    for (k, (a, b)) in pairs.iter().enumerate() {
        let a = from * a.extend(1.0);
        let b = to * b.extend(1.0);
        let x = [a.x, a.y, 1.0, 0.0, 0.0, 0.0, -b.x * a.x, -b.x * a.y, -b.x];
        let y = [0.0, 0.0, 0.0, a.x, a.y, 1.0, -b.y * a.x, -b.y * a.y, -b.y];
        for column in 0..9 {
            rows[(2 * k, column)] = x[column];
            rows[(2 * k + 1, column)] = y[column];
        }
    }
    let svd = rows.svd(false, true);
    let values = &svd.singular_values;
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
    // The second smallest vanishes too when the points do not span a plane.
    if values[order[7]] < 1e-9 * values[order[0]] {
        return None;
    }
    let row = svd.v_t?.row(order[8]).into_owned();
    let at = |k: usize| row[k];
    let normalised = DMat3::from_cols(
        DVec3::new(at(0), at(3), at(6)),
        DVec3::new(at(1), at(4), at(7)),
        DVec3::new(at(2), at(5), at(8)),
    );
    let found = to.inverse() * normalised * from;
    found.is_finite().then_some(found)
}

/// Moves points to mean 0 and mean distance √2.
fn normaliser(points: impl Iterator<Item = DVec2> + Clone) -> Option<DMat3> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec2>() / count;
    let spread = points.map(|point| point.distance(mean)).sum::<f64>() / count;
    let scale = std::f64::consts::SQRT_2 / spread;
    scale.is_finite().then(|| {
        DMat3::from_cols(
            DVec3::new(scale, 0.0, 0.0),
            DVec3::new(0.0, scale, 0.0),
            DVec3::new(-scale * mean.x, -scale * mean.y, 1.0),
        )
    })
}

/// Where a homography takes a point.
pub(super) fn apply(map: &DMat3, point: DVec2) -> DVec2 {
    let there = *map * point.extend(1.0);
    there.truncate() / there.z
}

/// Focal length of a camera with square pixels and its principal point at `centre`, from what it saw
/// of the board in several poses (Zhang, "A flexible new technique for camera calibration", TPAMI
/// 2000); `None` where no pose was tilted enough to tell.
pub(super) fn focal_length(maps: &[DMat3], centre: DVec2) -> Option<f64> {
    // Each pose gives two equations in w = 1/f²: the board's axes are at right angles and of one length.
    let (mut top, mut bottom) = (0.0, 0.0);
    for map in maps {
        let seen = |column: DVec3| column - (centre * column.z).extend(0.0);
        let (x, y) = (seen(map.x_axis), seen(map.y_axis));
        let scale = x.length() * y.length();
        let dot = |a: DVec3, b: DVec3| a.x * b.x + a.y * b.y;
        for (flat, deep) in [
            (dot(x, y), x.z * y.z),
            (dot(x, x) - dot(y, y), x.z * x.z - y.z * y.z),
        ] {
            let (flat, deep) = (flat / scale, deep / scale);
            top -= flat * deep;
            bottom += flat * flat;
        }
    }
    let focal = (top / bottom).sqrt().recip();
    focal.is_finite().then_some(focal)
}

/// Pose of the board, as rotation and translation into the camera's axes, from the map onto ideal
/// image points (x/z, y/z).
pub(super) fn pose(map: &DMat3) -> Option<(DMat3, DVec3)> {
    let scale = 2.0 / (map.x_axis.length() + map.y_axis.length());
    // The board lies in front of the camera.
    let scale = if map.z_axis.z < 0.0 { -scale } else { scale };
    let x = (map.x_axis * scale).normalize();
    let y = map.y_axis * scale;
    let y = (y - x * x.dot(y)).normalize();
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    let translation = map.z_axis * scale;
    (rotation.is_finite() && translation.is_finite()).then_some((rotation, translation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn seen(rotation: DMat3, translation: DVec3, focal: f64, centre: DVec2) -> DMat3 {
        let pairs: Vec<(DVec2, DVec2)> = (0..12)
            .map(|k| {
                let place = DVec2::new((k % 4) as f64, (k / 4) as f64) * 0.05;
                let point = rotation * place.extend(0.0) + translation;
                (place, point.truncate() / point.z * focal + centre)
            })
            .collect();
        homography(&pairs).unwrap()
    }

    #[test]
    fn focal_length_and_pose_come_back_from_tilted_boards() {
        let centre = DVec2::new(319.5, 239.5);
        let translation = DVec3::new(-0.1, 0.02, 0.6);
        let rotations: Vec<DMat3> = [(0.4, 0.1), (-0.3, 0.5), (0.1, -0.6)]
            .map(|(x, y)| DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(x, y, 0.1))))
            .to_vec();
        let maps: Vec<DMat3> = rotations
            .iter()
            .map(|rotation| seen(*rotation, translation, 525.0, centre))
            .collect();
        let focal = focal_length(&maps, centre).unwrap();
        assert!((focal - 525.0).abs() < 1e-6, "{focal}");
        let ideal = seen(rotations[1], translation, 1.0, DVec2::ZERO);
        let (rotation, there) = pose(&ideal).unwrap();
        assert!(there.distance(translation) < 1e-9);
        assert!((rotation - rotations[1]).x_axis.length() < 1e-9);
    }

    #[test]
    fn boards_that_face_the_camera_tell_no_focal_length() {
        let map = seen(DMat3::IDENTITY, DVec3::Z, 500.0, DVec2::ZERO);
        let found = focal_length(&[map], DVec2::ZERO);
        assert!(
            found.is_none_or(|focal| !(100.0..1e5).contains(&focal)),
            "{found:?}"
        );
    }

    #[test]
    fn points_on_one_line_are_no_plane() {
        let line: Vec<(DVec2, DVec2)> = (0..8)
            .map(|k| (DVec2::new(f64::from(k), 1.0), DVec2::new(f64::from(k), 2.0)))
            .collect();
        assert!(homography(&line).is_none());
        assert!(homography(&line[..3]).is_none());
    }
}
