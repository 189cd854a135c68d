//! How well the cameras of a rig keep time, alone and together: cadence, jitter, offsets, drift.

use drivers::{
    Frame, Illumination, Timestamp,
    clock::{Line, Scatter},
};
use serde::Serialize;

/// What is remembered of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Whether the color camera took it, else the depth camera.
    pub color: bool,
    /// Whether the flash lit it.
    pub flash: bool,
    /// When its first row started to expose.
    pub at: Timestamp,
    /// The camera's own count.
    pub sequence: u64,
    /// When it came out of the driver; `None` where frames are not waited for.
    pub arrival: Option<Timestamp>,
}

impl Sighting {
    /// Of a frame that came at `arrival`.
    pub fn of(frame: &Frame, arrival: Option<Timestamp>) -> Self {
        let light = match frame {
            Frame::Color(frame) => Some(frame.light),
            Frame::Depth(_) => None,
        };
        Self {
            color: light.is_some(),
            flash: light == Some(Illumination::Flash),
            at: frame.at(),
            sequence: frame.sequence(),
            arrival,
        }
    }
}

/// How values lie, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the values lie below.
    pub median_ms: f64,
    /// Nine in ten and five lie within this distance of the median.
    pub p95_ms: f64,
    /// Greatest distance from the median.
    pub worst_ms: f64,
}

impl Spread {
    /// `None` without values.
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let median_ms = *values.get(values.len() / 2)?;
        let mut off: Vec<f64> = values.iter().map(|v| (v - median_ms).abs()).collect();
        off.sort_by(f64::total_cmp);
        Some(Self {
            median_ms,
            p95_ms: off[(off.len() - 1) * 95 / 100],
            worst_ms: off[off.len() - 1],
        })
    }
}

/// A value at a moment of the session.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    /// Since the first frame of the session, seconds.
    pub seconds: f64,
    /// The value, milliseconds.
    pub ms: f64,
}

/// One camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cadence {
    /// Frames that came.
    pub frames: usize,
    /// Frames of which the camera's count speaks and that did not come.
    pub missing: u64,
    /// Frames whose time or count did not grow.
    pub disordered: usize,
    /// Between frames that follow each other, milliseconds.
    pub period_ms: f64,
    /// Distance of the start of exposures from an even cadence.
    pub jitter: Spread,
    /// From the start of the exposure to arrival; `None` where frames are not waited for.
    pub delay: Option<Spread>,
    /// Distance of each frame from the even cadence.
    #[serde(skip)]
    pub residuals: Vec<Point>,
    /// Delay of each frame.
    #[serde(skip)]
    pub delays: Vec<Point>,
}

/// Both cameras and the flash.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timing {
    /// From the first frame to the last.
    pub seconds: f64,
    /// The color camera; `None` with fewer than two frames.
    pub color: Option<Cadence>,
    /// The depth camera; `None` with fewer than two frames.
    pub depth: Option<Cadence>,
    /// From the nearest color frame to each depth frame; positive = depth later.
    pub depth_offset: Option<Spread>,
    /// By how much the depth camera runs faster than the color camera, where both have one cadence:
    /// parts per million.
    pub drift_ppm: Option<f64>,
    /// From a flash frame to its nearest ambient frame; always positive.
    pub bracket: Option<Spread>,
    /// Offset of each depth frame.
    #[serde(skip)]
    pub offsets: Vec<Point>,
}

/// Cadences that differ by more than this part are not meant to be one.
const ONE_CADENCE: f64 = 0.01;
/// A delay beyond this is no delay: the times are of another clock. Milliseconds.
const NO_DELAY_MS: f64 = 60_000.0;

impl Timing {
    /// Sums a session up; in the order the frames came.
    pub fn of(sightings: &[Sighting]) -> Self {
        let start = sightings.iter().map(|s| s.at).min();
        let end = sightings.iter().map(|s| s.at).max();
        let since = |at: Timestamp| ms_between(start.unwrap_or(at), at) * 1e-3;
        let color: Vec<&Sighting> = sightings.iter().filter(|s| s.color).collect();
        let depth: Vec<&Sighting> = sightings.iter().filter(|s| !s.color).collect();
        let mut ambient: Vec<Timestamp> = color.iter().filter(|s| !s.flash).map(|s| s.at).collect();
        ambient.sort_unstable();
        let mut times: Vec<Timestamp> = color.iter().map(|s| s.at).collect();
        times.sort_unstable();
        let offset = |s: &&Sighting| {
            let nearest = nearest(&times, s.at)?;
            Some(Point {
                seconds: since(s.at),
                ms: ms_between(nearest, s.at),
            })
        };
        let offsets: Vec<Point> = depth.iter().filter_map(offset).collect();
        let flashes = color.iter().filter(|s| s.flash);
        let brackets =
            flashes.filter_map(|s| Some(ms_between(nearest(&ambient, s.at)?, s.at).abs()));
        let bracket = Spread::of(brackets);
        let (color, depth) = (cadence(&color, since), cadence(&depth, since));
        let drift_ppm = color
            .as_ref()
            .zip(depth.as_ref())
            .and_then(|(color, depth)| {
                let faster = color.period_ms / depth.period_ms - 1.0;
                (faster.abs() <= ONE_CADENCE).then_some(faster * 1e6)
            });
        Self {
            seconds: end.map_or(0.0, since),
            depth_offset: Spread::of(offsets.iter().map(|point| point.ms)),
            drift_ppm,
            bracket,
            offsets,
            color,
            depth,
        }
    }
}

fn cadence(frames: &[&Sighting], since: impl Fn(Timestamp) -> f64) -> Option<Cadence> {
    let points: Vec<(f64, f64)> = frames
        .iter()
        .map(|s| (s.sequence as f64, since(s.at) * 1e3))
        .collect();
    let line = Line::fit(&points, Scatter::Even)?;
    let mut counts: Vec<u64> = frames.iter().map(|s| s.sequence).collect();
    counts.sort_unstable();
    counts.dedup();
    let missing = (counts.last()? - counts.first()?) + 1 - counts.len() as u64;
    let disordered = frames
        .windows(2)
        .filter(|pair| pair[1].at <= pair[0].at || pair[1].sequence <= pair[0].sequence)
        .count();
    let track = |value: &dyn Fn(&Sighting) -> Option<f64>| -> Vec<Point> {
        let point = |s: &&Sighting| {
            Some(Point {
                seconds: since(s.at),
                ms: value(s)?,
            })
        };
        frames.iter().filter_map(point).collect()
    };
    let residuals = track(&|s| Some(since(s.at) * 1e3 - line.at(s.sequence as f64)));
    let delays = track(&|s| {
        let delay = ms_between(s.at, s.arrival?);
        (0.0..NO_DELAY_MS).contains(&delay).then_some(delay)
    });
    Some(Cadence {
        frames: frames.len(),
        missing,
        disordered,
        period_ms: line.slope,
        jitter: Spread::of(residuals.iter().map(|point| point.ms))?,
        delay: Spread::of(delays.iter().map(|point| point.ms)),
        residuals,
        delays,
    })
}

/// From `a` to `b`, milliseconds; negative when `b` comes first.
fn ms_between(a: Timestamp, b: Timestamp) -> f64 {
    let apart = a.distance(b).as_secs_f64() * 1e3;
    if b < a { -apart } else { apart }
}

/// The nearest of sorted times.
fn nearest(times: &[Timestamp], at: Timestamp) -> Option<Timestamp> {
    let after = times.partition_point(|time| *time < at);
    let around = [after.checked_sub(1), Some(after)];
    let found = around
        .into_iter()
        .flatten()
        .filter_map(|place| times.get(place));
    found.min_by_key(|time| time.distance(at)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use drivers::chance::Chance;

    /// Color at 30 Hz, depth `late_ms` behind it and faster by `ppm`, both jittering by 0.2 ms.
    fn session(late_ms: f64, ppm: f64, lost: &[u64]) -> Vec<Sighting> {
        let chance = Chance::new(11);
        let at = |ms: f64| Timestamp::from_nanos((5e12 + ms * 1e6) as u64);
        let mut seen = Vec::new();
        for k in 0..900u64 {
            let noise = |kind: u64| 0.2 * f64::from(chance.of(kind).normal(k));
            let (t, period) = (k as f64, 1000.0 / 30.0);
            let color = t * period + noise(1);
            let depth = late_ms + t * period / (1.0 + ppm * 1e-6) + noise(2);
            for (is_color, ms) in [(true, color), (false, depth)] {
                if is_color && lost.contains(&k) {
                    continue;
                }
                seen.push(Sighting {
                    color: is_color,
                    flash: is_color && k % 3 == 1,
                    at: at(ms),
                    sequence: k,
                    arrival: Some(at(ms + 15.0 + 3.0 * chance.of(3).unit(k))),
                });
            }
        }
        seen
    }

    #[test]
    fn offset_drift_jitter_and_delay_are_those_that_were_put_in() {
        let timing = Timing::of(&session(2.0, 50.0, &[]));
        let offset = timing.depth_offset.unwrap();
        // 30 s at 50 ppm move the depth camera forward by 1.5 ms, by 0.75 ms in the middle.
        assert!((offset.median_ms - 1.25).abs() < 0.1, "{offset:?}");
        let drift = timing.drift_ppm.unwrap();
        assert!((drift - 50.0).abs() < 3.0, "{drift} ppm");
        let color = timing.color.unwrap();
        assert!((color.period_ms - 1000.0 / 30.0).abs() < 1e-4);
        // Of a normal, 95 % lie within 1.96 standard deviations.
        assert!(
            (color.jitter.p95_ms - 0.39).abs() < 0.05,
            "{:?}",
            color.jitter
        );
        let delay = color.delay.unwrap();
        assert!((delay.median_ms - 16.5).abs() < 0.2, "{delay:?}");
        assert_eq!((color.frames, color.missing, color.disordered), (900, 0, 0));
        let bracket = timing.bracket.unwrap();
        assert!((bracket.median_ms - 33.2).abs() < 0.3, "{bracket:?}");
    }

    #[test]
    fn lost_frames_are_counted_and_leave_cadence_and_offset_alone() {
        let lost: Vec<u64> = (100..130).chain([500, 502]).collect();
        let timing = Timing::of(&session(-3.0, 0.0, &lost));
        let color = timing.color.unwrap();
        assert_eq!(color.missing, 32);
        assert!((color.period_ms - 1000.0 / 30.0).abs() < 1e-3, "{color:?}");
        let offset = timing.depth_offset.unwrap();
        assert!((offset.median_ms + 3.0).abs() < 0.1, "{offset:?}");
    }

    #[test]
    fn cameras_of_two_cadences_have_no_drift() {
        let mut seen = session(2.0, 0.0, &[]);
        seen.retain(|s| s.color || s.sequence % 2 == 0);
        for s in seen.iter_mut().filter(|s| !s.color) {
            s.sequence /= 2;
        }
        assert_eq!(Timing::of(&seen).drift_ppm, None);
    }

    #[test]
    fn too_few_frames_are_no_cadence() {
        let timing = Timing::of(&[]);
        assert!(timing.color.is_none() && timing.depth_offset.is_none());
        let one = session(2.0, 0.0, &[]);
        assert!(Timing::of(&one[..1]).color.is_none());
    }
}
