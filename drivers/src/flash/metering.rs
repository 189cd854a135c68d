//! Pre-flash metering: one exposure at which neither the flash frame nor the ambient frame clips.

use crate::frame::ColorFrame;

/// Where the brightest light that counts should come to lie, as a fraction of white.
const AIM: f32 = 0.75;
/// Between these it is left as it is.
const GOOD: std::ops::RangeInclusive<f32> = 0.5..=0.9;
/// Samples brighter than this part of all are lamps and glints, which may clip.
const GLINTS: f32 = 0.005;
/// What is clipped tells only that it is too much; exposure is then cut to this part.
const CUT: f32 = 0.3;
/// Exposure grows at most by this factor from one look to the next.
const GROW: f32 = 8.0;

/// The brightest light of a picture that counts, as a fraction of white, 1 when it clips; `None` for a
/// JPEG picture that is not what the frame says.
pub fn highlight(frame: &ColorFrame) -> Option<f32> {
    let mut light = frame.sampled_light()?;
    if light.is_empty() {
        return None;
    }
    let rank = ((light.len() - 1) as f32 * (1.0 - GLINTS)) as usize;
    Some(*light.select_nth_unstable_by(rank, f32::total_cmp).1)
}

/// The exposure time to try next, after one of `seconds` gave highlights of `flash` and `ambient`;
/// `None` when it is right, or as near as `least` and `most` allow.
///
/// Above `flicker_seconds`, the period of the lamps' flicker, times are whole multiples of it.
pub fn next_seconds(
    seconds: f32,
    (flash, ambient): (f32, f32),
    (least, most): (f32, f32),
    flicker_seconds: Option<f32>,
) -> Option<f32> {
    let brightest = flash.max(ambient);
    if GOOD.contains(&brightest) {
        return None;
    }
    // 0.98: what is this near to white may have been cut there.
    let factor = if brightest >= 0.98 {
        CUT
    } else {
        (AIM / brightest.max(1e-6)).min(GROW)
    };
    let mut wanted = (seconds * factor).clamp(least, most);
    if let Some(period) = flicker_seconds.filter(|period| wanted >= *period) {
        // A thousandth, so that rounding does not take a whole period away.
        wanted = (wanted / period + 1e-3).floor() * period;
    }
    // Less than a hundredth is no change that a camera makes.
    ((wanted / seconds - 1.0).abs() > 0.01).then_some(wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        frame::{Exposure, Illumination, Pixels, Timestamp, Transfer},
        plane::Plane,
    };
    use proptest::prelude::*;

    fn picture(light: f32, glints: usize) -> ColorFrame {
        ColorFrame {
            at: Timestamp::from_nanos(1),
            sequence: 0,
            light: Illumination::Flash,
            exposure: Exposure::UNIT,
            pixels: Pixels::RgbF32(Plane::from_fn(100, 100, |x, y| {
                [if 100 * y + x < glints {
                    1.0
                } else {
                    light.min(1.0)
                }; 3]
            })),
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        }
    }

    #[test]
    fn a_few_glints_do_not_count_and_many_do() {
        assert_eq!(highlight(&picture(0.4, 30)), Some(0.4));
        assert_eq!(highlight(&picture(0.4, 300)), Some(1.0));
    }

    #[test]
    fn times_are_multiples_of_the_flicker_where_there_is_room() {
        let next = |flash| next_seconds(0.01, (flash, 0.1), (0.0001, 0.1), Some(0.01));
        assert!((next(0.25).unwrap() - 0.03).abs() < 1e-6);
        assert!(
            (next(0.2).unwrap() - 0.03).abs() < 1e-6,
            "37.5 ms are cut to 30"
        );
        assert!(next(1.0).unwrap() < 0.01, "too bright for a whole period");
        assert_eq!(next(0.75), None);
    }

    proptest! {
        /// From whatever exposure, in whatever light, a few looks end where nothing clips, or at
        /// the end of what the camera can do.
        #[test]
        fn metering_ends_without_clipping(
            flash in -4.0f32..6.0, ambient in -6.0f32..5.0, begin in 0.0001f32..0.1,
            flicker in prop::option::of(Just(0.01f32)),
        ) {
            let range = (0.0001, 0.1);
            let (flash, ambient) = (10f32.powf(flash), 10f32.powf(ambient));
            let mut seconds = begin;
            let look = |seconds: f32| ((seconds * (flash + ambient)).min(1.0), (seconds * ambient).min(1.0));
            let mut looks = 0;
            while let Some(next) = next_seconds(seconds, look(seconds), range, flicker) {
                prop_assert!((range.0..=range.1).contains(&next));
                seconds = next;
                looks += 1;
                prop_assert!(looks <= 12, "it does not settle");
            }
            let (lit, _) = look(seconds);
            prop_assert!(lit <= 0.9 || seconds <= range.0 * 1.02, "{lit} at {seconds} s");
            // Dark is only what more time cannot mend.
            let step = if flicker.is_some() { 0.01 } else { 0.0 };
            prop_assert!(lit >= 0.25 || seconds + step >= range.1 * 0.98 || lit * 2.0 < 0.5 && step > 0.0,
                "{lit} at {seconds} s");
        }
    }
}
