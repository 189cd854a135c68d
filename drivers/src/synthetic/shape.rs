//! Solids that a ray can be held against in closed form. Camera axes, metres.

use glam::{DMat3, DVec3};

/// A solid.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// Unbounded, seen from both sides.
    Plane {
        point: DVec3,
        normal: DVec3,
    },
    Sphere {
        centre: DVec3,
        radius: f64,
    },
    /// Columns of `axes` are the unit directions of its edges.
    Box {
        centre: DVec3,
        half: DVec3,
        axes: DMat3,
    },
    /// All points within `radius` of the segment.
    Capsule {
        from: DVec3,
        to: DVec3,
        radius: f64,
    },
}

impl Shape {
    /// First hit of the ray `origin + t · direction` (unit length) with t > 0: `t` and the unit
    /// normal on the side the ray comes from.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        match *self {
            Self::Plane { point, normal } => {
                let slope = direction.dot(normal);
                let t = (point - origin).dot(normal) / slope;
                // A parallel ray gives an infinite or undefined t.
                (t.is_finite() && t > 0.0).then(|| (t, normal * -slope.signum()))
            }
            Self::Sphere { centre, radius } => sphere(origin, direction, centre, radius),
            Self::Box { centre, half, axes } => cuboid(origin, direction, centre, half, axes),
            Self::Capsule { from, to, radius } => capsule(origin, direction, from, to, radius),
        }
    }
}

fn sphere(origin: DVec3, direction: DVec3, centre: DVec3, radius: f64) -> Option<(f64, DVec3)> {
    let offset = origin - centre;
    let b = offset.dot(direction);
    let h = b * b - offset.length_squared() + radius * radius;
    if h < 0.0 {
        return None;
    }
    let t = -b - h.sqrt();
    (t > 0.0).then(|| (t, (offset + t * direction) / radius))
}

/// The slab test (Kay & Kajiya 1986) in the box's own axes.
fn cuboid(
    origin: DVec3,
    direction: DVec3,
    centre: DVec3,
    half: DVec3,
    axes: DMat3,
) -> Option<(f64, DVec3)> {
    let o = axes.transpose() * (origin - centre);
    let d = axes.transpose() * direction;
    let (mut near, mut far, mut face) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for axis in 0..3 {
        if d[axis].abs() < 1e-12 {
            if o[axis].abs() > half[axis] {
                return None;
            }
            continue;
        }
        let a = (-half[axis] - o[axis]) / d[axis];
        let b = (half[axis] - o[axis]) / d[axis];
        if a.min(b) > near {
            near = a.min(b);
            face = axis;
        }
        far = far.min(a.max(b));
    }
    (near > 0.0 && near <= far).then(|| (near, axes.col(face) * -d[face].signum()))
}

fn capsule(
    origin: DVec3,
    direction: DVec3,
    from: DVec3,
    to: DVec3,
    radius: f64,
) -> Option<(f64, DVec3)> {
    let axis = to - from;
    let offset = origin - from;
    let length2 = axis.length_squared();
    let (along_ray, along_offset) = (axis.dot(direction), axis.dot(offset));
    // The endless cylinder first.
    let a = length2 - along_ray * along_ray;
    let b = length2 * direction.dot(offset) - along_offset * along_ray;
    let c = length2 * (offset.length_squared() - radius * radius) - along_offset * along_offset;
    let h = b * b - a * c;
    if h < 0.0 {
        return None;
    }
    let mut end = from;
    if a > 1e-15 {
        let t = (-b - h.sqrt()) / a;
        let place = along_offset + t * along_ray;
        if place > 0.0 && place < length2 {
            let foot = axis * (place / length2);
            return (t > 0.0).then(|| (t, (offset + t * direction - foot) / radius));
        }
        if place >= length2 {
            end = to;
        }
    } else if along_ray < 0.0 {
        end = to;
    }
    sphere(origin, direction, end, radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cases() -> Vec<(&'static str, Shape)> {
        let axes = DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.3);
        vec![
            (
                "sphere",
                Shape::Sphere {
                    centre: DVec3::new(0.1, 0.0, 1.0),
                    radius: 0.2,
                },
            ),
            (
                "box",
                Shape::Box {
                    centre: DVec3::new(0.0, 0.05, 1.0),
                    half: DVec3::new(0.1, 0.2, 0.15),
                    axes,
                },
            ),
            (
                "capsule",
                Shape::Capsule {
                    from: DVec3::new(-0.2, 0.1, 0.9),
                    to: DVec3::new(0.2, -0.1, 1.2),
                    radius: 0.08,
                },
            ),
        ]
    }

    /// How far a point is outside a solid, from its definition rather than from ray equations.
    fn outside(shape: &Shape, p: DVec3) -> f64 {
        match *shape {
            Shape::Plane { point, normal } => (p - point).dot(normal).abs(),
            Shape::Sphere { centre, radius } => p.distance(centre) - radius,
            Shape::Box { centre, half, axes } => {
                let q = (axes.transpose() * (p - centre)).abs() - half;
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
            }
            Shape::Capsule { from, to, radius } => {
                let axis = to - from;
                let t = ((p - from).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
                p.distance(from + t * axis) - radius
            }
        }
    }

    #[test]
    fn rays_stop_where_a_march_along_the_distance_does() {
        for (name, shape) in cases() {
            for i in 0..400 {
                let (x, y) = (
                    f64::from(i % 20) / 20.0 - 0.5,
                    f64::from(i / 20) / 20.0 - 0.5,
                );
                let direction = DVec3::new(x, y, 1.0).normalize();
                let mut t = 0.0;
                while t < 3.0 && outside(&shape, t * direction) > 1e-9 {
                    t += outside(&shape, t * direction);
                }
                match shape.hit(DVec3::ZERO, direction) {
                    Some((hit, normal)) => {
                        assert!((hit - t).abs() < 1e-4, "{name} {i}: {hit} against {t}");
                        assert!(
                            (normal.length() - 1.0).abs() < 1e-9 && normal.dot(direction) <= 1e-9
                        );
                    }
                    None => assert!(
                        t >= 3.0 || outside(&shape, t * direction) > -1e-4,
                        "{name} {i}: missed"
                    ),
                }
            }
        }
    }
}
