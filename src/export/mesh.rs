//! The front of a scene as triangles.

use crate::scene::Scene;
use glam::{DVec2, Vec2, Vec3};

/// Neighbours belong to one surface while it is tilted no more than this tangent between them.
const STEEPEST_TANGENT: f32 = 8.0;

/// Vertices on a grid of the picture, and the triangles between those on one surface.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    /// Pixels from one vertex to the next, along either axis.
    pub step: usize,
    /// Vertices along either axis, and for each its number or `u32::MAX`.
    pub columns: usize,
    pub rows: usize,
    pub numbers: Vec<u32>,
    /// Pixel of each vertex.
    pub pixels: Vec<(usize, usize)>,
    /// Metres, people's axes.
    pub positions: Vec<Vec3>,
    /// Unit vectors, people's axes.
    pub normals: Vec<Vec3>,
    /// Anticlockwise as the camera sees them.
    pub triangles: Vec<[u32; 3]>,
}

/// From camera axes (x right, y down, z forward) to people's.
pub(super) fn person(v: Vec3) -> Vec3 {
    Vec3::new(v.x, -v.y, -v.z)
}

impl Mesh {
    /// At most `most` vertices. A vertex takes its pixel's depth and the mean normal of the pixels around it.
    pub(super) fn of(scene: &Scene, most: usize) -> Self {
        let (width, height) = scene.albedo.size();
        let mut step = 1;
        while (width.div_ceil(step)) * (height.div_ceil(step)) > most {
            step += 1;
        }
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        let mut mesh = Self {
            step,
            columns,
            rows,
            numbers: vec![u32::MAX; columns * rows],
            pixels: Vec::new(),
            positions: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
        };
        for row in 0..rows {
            for column in 0..columns {
                let at = |index: usize, side: usize| (index * step + step / 2).min(side - 1);
                let pixel = (at(column, width), at(row, height));
                if let Some((position, normal)) = vertex(scene, pixel, step) {
                    mesh.numbers[row * columns + column] = mesh.positions.len() as u32;
                    mesh.pixels.push(pixel);
                    mesh.positions.push(position);
                    mesh.normals.push(normal);
                }
            }
        }
        let focal = scene.camera.fx.min(scene.camera.fy) as f32;
        let steepest = STEEPEST_TANGENT * step as f32 / focal;
        for row in 1..rows {
            for column in 1..columns {
                let number =
                    |dx: usize, dy: usize| mesh.numbers[(row - 1 + dy) * columns + column - 1 + dx];
                let [a, b, c, d] = [number(0, 0), number(1, 0), number(0, 1), number(1, 1)];
                for triangle in [[a, c, b], [b, c, d]] {
                    if mesh.joined(triangle, steepest) {
                        mesh.triangles.push(triangle);
                    }
                }
            }
        }
        mesh
    }

    /// Whether three vertices are known and lie on one surface.
    fn joined(&self, triangle: [u32; 3], steepest: f32) -> bool {
        let depth = |number: u32| self.positions.get(number as usize).map(|p| -p.z);
        let [Some(a), Some(b), Some(c)] = triangle.map(depth) else {
            return false;
        };
        let (near, far) = (a.min(b).min(c), a.max(b).max(c));
        far - near <= steepest * near
    }

    /// Between four vertices around a pixel: their unit normals, mixed as a renderer mixes them.
    pub(super) fn normal_at(&self, pixel: (usize, usize)) -> Option<Vec3> {
        let at = Vec2::new(pixel.0 as f32, pixel.1 as f32) - (self.step / 2) as f32;
        let place = (at / self.step as f32).max(Vec2::ZERO);
        let (column, row) = (place.x as usize, place.y as usize);
        let (fx, fy) = (place.x.fract(), place.y.fract());
        let mut sum = Vec3::ZERO;
        for (dx, dy, weight) in [
            (0, 0, (1.0 - fx) * (1.0 - fy)),
            (1, 0, fx * (1.0 - fy)),
            (0, 1, (1.0 - fx) * fy),
            (1, 1, fx * fy),
        ] {
            let (column, row) = (
                (column + dx).min(self.columns - 1),
                (row + dy).min(self.rows - 1),
            );
            let number = self.numbers[row * self.columns + column] as usize;
            if let Some(normal) = self.normals.get(number) {
                sum += weight * *normal;
            }
        }
        sum.try_normalize()
    }
}

fn vertex(scene: &Scene, pixel: (usize, usize), step: usize) -> Option<(Vec3, Vec3)> {
    let z = scene.depth_metres[pixel];
    let ray = scene
        .camera
        .ray(DVec2::new(pixel.0 as f64, pixel.1 as f64))?;
    let (width, height) = scene.normal.size();
    let reach = step / 2;
    let mut normal = Vec3::ZERO;
    for y in pixel.1.saturating_sub(reach)..(pixel.1 + reach + 1).min(height) {
        for x in pixel.0.saturating_sub(reach)..(pixel.0 + reach + 1).min(width) {
            // Of the same surface alone.
            if (scene.depth_metres[(x, y)] - z).abs() < 0.02 * z && scene.normal[(x, y)].is_finite()
            {
                normal += scene.normal[(x, y)];
            }
        }
    }
    let known = z.is_finite() && scene.albedo[pixel][0].is_finite();
    let normal = person(normal).try_normalize().filter(|_| known)?;
    Some((person(z * ray.as_vec3()), normal))
}
