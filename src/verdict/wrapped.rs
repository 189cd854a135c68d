//! Distances beyond the depth camera's range, which come back as what is left of them.

use super::{
    contradicted::pieces_of,
    look::{Look, quantile},
    steps::{Sent, Steps},
};
use drivers::Plane;
use glam::DVec2;

/// Share of a piece that must send too little light for its depth: the deeper parts of a wrapped
/// surface are less clear a case than its near edge.
const TELLING: f32 = 0.1;
/// The range lies at this quantile of the distances that are not contradicted.
const RANGE_QUANTILE: f32 = 0.999;

/// Depth that lies one range further away than it says.
#[derive(Debug, Clone)]
pub struct Wrapped {
    /// Where, on the working grid.
    pub pixels: Plane<bool>,
    /// The camera's range along a ray, metres: that of the farthest surface seen.
    pub range_metres: f32,
}

/// What a piece of depth would send, were it as near as it says, and were it a range further.
#[derive(Debug, Clone, Copy, Default)]
struct Piece {
    pixels: f32,
    contradicted: f32,
    as_said: f32,
    further: f32,
}

/// Pieces whose light fits a range further away; `None` without any.
pub(super) fn of(look: &Look<'_>, steps: &Steps) -> Option<Wrapped> {
    let sent = Sent::of(look)?;
    let (width, height) = look.size();
    let step = f64::from(look.photograph_pixels());
    let distance = Plane::from_fn(width, height, |x, y| {
        let at = (DVec2::new(x as f64, y as f64) + 0.5) * step - 0.5;
        let ray = look.shot.rig.color.ray(at);
        ray.map_or(f32::NAN, |ray| ray.length() as f32 * look.metres[(x, y)])
    });
    let pixels = || look.light.samples().iter().zip(look.metres.samples());
    let believed = pixels().zip(distance.samples());
    let believed = believed.filter(|((light, metres), _)| !sent.contradicts(**light, **metres));
    let range_metres = quantile(believed.map(|(_, one)| *one).collect(), RANGE_QUANTILE)?;
    let usual = quantile(pixels().map(|(l, z)| Sent::by(*l, *z)).collect(), 0.5)?;

    let piece = pieces_of(look, steps);
    let mut pieces = vec![Piece::default(); piece.len()];
    for (((light, metres), distance), index) in
        pixels().zip(distance.samples()).zip(piece.samples())
    {
        let as_said = Sent::by(*light, *metres);
        if as_said.is_finite() {
            let one = &mut pieces[*index as usize];
            one.pixels += 1.0;
            one.contradicted += f32::from(u8::from(sent.contradicts(*light, *metres)));
            one.as_said += as_said;
            one.further += as_said + 2.0 * (1.0 + range_metres / distance).ln();
        }
    }
    let wrapped = |piece: &Piece| {
        let off = |sum: f32| (sum / piece.pixels - usual).abs();
        piece.contradicted > TELLING * piece.pixels && off(piece.further) < off(piece.as_said)
    };
    let wrapped: Vec<bool> = pieces.iter().map(wrapped).collect();
    let found = look.on_working_grid(|at| wrapped[piece[at] as usize]);
    found.samples().contains(&true).then_some(Wrapped {
        pixels: found,
        range_metres,
    })
}
