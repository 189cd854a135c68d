//! One clock told by another: a line with drift through pairs of readings, some of them late or wrong.
//!
//! A line is found in two robust steps: the slope by medians (Theil 1950; Sen 1968) over the
//! representatives of blocks, the height by the median of what is left. Of a block the median counts
//! where readings scatter both ways, the earliest where they can only be late: a message is never
//! delivered before it was sent (Moon, Skelly & Towsley, "Estimation and removal of clock skew",
//! INFOCOM 1999).

use crate::frame::Timestamp;
use serde::{Deserialize, Serialize};
use std::{collections::VecDeque, time::Duration};
use thiserror::Error;

/// Now, on the clock of all timestamps.
pub fn monotonic() -> Timestamp {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    let seconds = u64::try_from(now.tv_sec).unwrap_or(0);
    Timestamp::from_nanos(seconds * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0))
}

/// How readings lie about the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scatter {
    /// Both ways, as those of two cameras on one trigger.
    Even,
    /// Only late, as times of arrival.
    Late,
}

/// `y = height + slope · (x − x0)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Where it is anchored: the first reading's `x`.
    pub x0: f64,
    /// Value at `x0`.
    pub height: f64,
    /// Growth of `y` per `x`.
    pub slope: f64,
}

/// Blocks that readings are gathered in; their pairs, at most 2016, vote for the slope.
const BLOCKS: usize = 64;
/// The same where only the earliest of a block counts: more of them make it more prompt.
const LATE_BLOCKS: usize = 24;

impl Line {
    /// The line through `points`, which need no order; half of them may be wrong under
    /// [`Scatter::Even`]. `None` for fewer than two different `x` or anything not finite.
    pub fn fit(points: &[(f64, f64)], scatter: Scatter) -> Option<Self> {
        let mut points = points.to_vec();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (x0, y0) = *points.first()?;
        // Offsets keep nanoseconds of an old clock exact.
        let offsets: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x - x0, y - y0)).collect();
        let half = offsets.len() / 2;
        let mut crude: Vec<f64> = offsets[..offsets.len() - half]
            .iter()
            .zip(&offsets[half..])
            .filter(|(a, b)| b.0 > a.0)
            .map(|(a, b)| (b.1 - a.1) / (b.0 - a.0))
            .collect();
        let crude = median(&mut crude)?;
        let rest = |point: &(f64, f64), slope: f64| point.1 - slope * point.0;
        let count = match scatter {
            Scatter::Even => BLOCKS,
            Scatter::Late => LATE_BLOCKS,
        };
        let size = offsets.len().div_ceil(count);
        let blocks: Vec<(f64, f64)> = offsets
            .chunks(size)
            .filter_map(|block| {
                let mut order: Vec<&(f64, f64)> = block.iter().collect();
                order.sort_by(|a, b| rest(a, crude).total_cmp(&rest(b, crude)));
                let place = match scatter {
                    Scatter::Even => order.len() / 2,
                    Scatter::Late => 0,
                };
                order.get(place).map(|point| **point)
            })
            .collect();
        let mut slopes = Vec::with_capacity(BLOCKS * BLOCKS / 2);
        for (place, a) in blocks.iter().enumerate() {
            let later = blocks[place + 1..].iter().filter(|b| b.0 > a.0);
            slopes.extend(later.map(|b| (b.1 - a.1) / (b.0 - a.0)));
        }
        let slope = median(&mut slopes)?;
        let mut heights: Vec<f64> = blocks.iter().map(|point| rest(point, slope)).collect();
        let height = y0 + median(&mut heights)?;
        (height.is_finite() && slope.is_finite()).then_some(Self { x0, height, slope })
    }

    /// `y` at `x`.
    pub fn at(&self, x: f64) -> f64 {
        self.height + self.slope * (x - self.x0)
    }
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// A clock that went where no drift takes it: set back, set forward, or its device restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the device's clock jumped by {by_nanoseconds} ns against ours; its times start afresh")]
pub struct ClockJump {
    /// How far the device's clock is ahead of where it should be; negative = behind.
    pub by_nanoseconds: i64,
}

/// Readings that are remembered: 20 s of a camera at 25 frames a second.
const WINDOW: usize = 512;
/// Readings, and time between the first and the last, from which on a drift is believed: less time
/// would turn a delivery late by a millisecond into hundreds of parts per million.
const ENOUGH: usize = 16;
const SPAN: f64 = 1e9;
/// Greatest drift of a sound oscillator, a fraction; crystals stay within 1e-4.
const DRIFT: f64 = 1e-3;
/// A reading this early cannot be: the device's clock went ahead. Nanoseconds.
const EARLY: f64 = 20e6;
/// Readings in a row, all later than [`STALLED`], after which the clock, not the delivery, is late.
const LATE_ONES: u32 = 8;
const STALLED: f64 = 250e6;

/// Follows a device's clock by the arrival of its messages.
///
/// Knows no clock of its own: both times are handed in.
#[derive(Debug, Clone)]
pub struct Tracker {
    delay: f64,
    readings: VecDeque<(u64, u64)>,
    line: Option<Line>,
    /// Readings since the line was found.
    fresh: usize,
    late: u32,
}

impl Tracker {
    /// A tracker of a clock whose messages take at least `delay` from exposure to arrival.
    pub fn new(delay: Duration) -> Self {
        Self {
            delay: delay.as_nanos() as f64,
            readings: VecDeque::new(),
            line: None,
            fresh: 0,
            late: 0,
        }
    }

    /// Takes a message stamped `device` by its own clock, in nanoseconds, that arrived at `arrival`,
    /// and gives the stamp on our clock.
    ///
    /// # Errors
    /// [`ClockJump`] when the device's clock was set or started again. The message's time is then
    /// unknown, and the next one begins a new relation.
    pub fn note(&mut self, device: u64, arrival: Timestamp) -> Result<Timestamp, ClockJump> {
        let arrival = arrival.as_nanos();
        let last = self.readings.back().map(|reading| reading.0);
        if let Some(last) = last.filter(|last| device < *last) {
            return Err(self.jump(-(last.saturating_sub(device) as f64)));
        }
        if let Some(first) = self.readings.front().copied() {
            let late = offset(arrival, first.1) - self.ours(device, first);
            if late < -EARLY {
                return Err(self.jump(-late));
            }
            self.late = if late > STALLED { self.late + 1 } else { 0 };
            if self.late >= LATE_ONES {
                return Err(self.jump(-late));
            }
        }
        self.readings.push_back((device, arrival));
        self.fresh += 1;
        if self.readings.len() > WINDOW {
            self.readings.drain(..ENOUGH);
            // Anchored at a reading that is gone.
            self.line = None;
        }
        if self.line.is_none() || self.fresh >= ENOUGH {
            self.refit();
        }
        let first = self.readings.front().copied().unwrap_or((device, arrival));
        let ours = first.1 as f64 + self.ours(device, first) - self.delay;
        Ok(Timestamp::from_nanos(ours.max(0.0).round() as u64))
    }

    /// How much faster our clock runs than the device's, in parts per million; `None` until known.
    pub fn drift_ppm(&self) -> Option<f64> {
        self.line.map(|line| (line.slope - 1.0) * 1e6)
    }

    /// Earliest arrival of a message stamped `device`, from the first reading on.
    fn ours(&self, device: u64, first: (u64, u64)) -> f64 {
        let since = offset(device, first.0);
        match self.line {
            Some(line) => line.at(since),
            // Both clocks run alike until more is known; the promptest message tells where.
            None => {
                let lead = |(d, a): &(u64, u64)| offset(*a, first.1) - offset(*d, first.0);
                since + self.readings.iter().map(lead).fold(0.0, f64::min)
            }
        }
    }

    fn refit(&mut self) {
        let (Some(first), Some(last)) = (self.readings.front(), self.readings.back()) else {
            return;
        };
        if self.readings.len() < ENOUGH || offset(last.0, first.0) < SPAN {
            return;
        }
        let points: Vec<(f64, f64)> = self
            .readings
            .iter()
            .map(|(device, arrival)| (offset(*device, first.0), offset(*arrival, first.1)))
            .collect();
        if let Some(line) = Line::fit(&points, Scatter::Late)
            && (line.slope - 1.0).abs() <= DRIFT
        {
            self.line = Some(line);
            self.fresh = 0;
        }
    }

    fn jump(&mut self, by: f64) -> ClockJump {
        *self = Self::new(Duration::from_nanos(self.delay as u64));
        ClockJump {
            by_nanoseconds: by as i64,
        }
    }
}

/// `later − earlier`, exact for what lies within weeks of each other.
fn offset(later: u64, earlier: u64) -> f64 {
    if later >= earlier {
        (later - earlier) as f64
    } else {
        -((earlier - later) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::Chance;

    const MS: f64 = 1e6;
    /// A device's clock that is days ahead and runs fast by `ppm`.
    struct Case {
        ppm: f64,
        stalls: f64,
        seed: u64,
    }

    impl Case {
        /// True moment, stamp of the device, arrival: every 33.3 ms, 4 ms on the way at least, an
        /// exponential queue of 2 ms behind that, and now and then a stall of up to 100 ms.
        fn reading(&self, k: u64) -> (f64, u64, Timestamp) {
            let chance = Chance::new(self.seed);
            let truth = 50e9 + k as f64 * 33.333e6;
            let stamp = 4e14 + truth * (1.0 + self.ppm * 1e-6);
            let mut way = 4.0 * MS - 2.0 * MS * (1.0 - chance.of(1).unit(k)).ln();
            if chance.of(2).unit(k) < self.stalls {
                way += 100.0 * MS * chance.of(3).unit(k);
            }
            (
                truth,
                stamp as u64,
                Timestamp::from_nanos((truth + way) as u64),
            )
        }
    }

    #[test]
    fn a_drifting_clock_is_told_to_half_a_millisecond_through_late_deliveries() {
        for case in [
            Case {
                ppm: 0.0,
                stalls: 0.0,
                seed: 1,
            },
            Case {
                ppm: 80.0,
                stalls: 0.05,
                seed: 2,
            },
            Case {
                ppm: -200.0,
                stalls: 0.3,
                seed: 3,
            },
        ] {
            let mut tracker = Tracker::new(Duration::from_millis(4));
            let mut worst = 0.0f64;
            for k in 0..3000 {
                let (truth, stamp, arrival) = case.reading(k);
                let at = tracker.note(stamp, arrival).unwrap();
                // The first seconds hold few prompt messages.
                if k >= 300 {
                    worst = worst.max((at.as_nanos() as f64 - truth).abs());
                }
            }
            let drift = tracker.drift_ppm().unwrap();
            assert!(worst < 0.5 * MS, "{} ms at {} ppm", worst / MS, case.ppm);
            assert!((drift + case.ppm).abs() < 20.0, "{drift} for {}", case.ppm);
        }
    }

    #[test]
    fn times_never_run_backwards_by_more_than_the_relation_was_improved() {
        let case = Case {
            ppm: 150.0,
            stalls: 0.2,
            seed: 9,
        };
        let mut tracker = Tracker::new(Duration::from_millis(4));
        let mut before = 0;
        for k in 0..3000 {
            let (_, stamp, arrival) = case.reading(k);
            let at = tracker.note(stamp, arrival).unwrap().as_nanos();
            assert!(at > before, "reading {k}");
            before = at;
        }
    }

    #[test]
    fn a_clock_that_is_set_is_noticed_at_once_or_after_a_few_messages() {
        for (by, within) in [(-5e9, 1), (1e9, 1), (30e6, 1), (-400e6, LATE_ONES)] {
            let case = Case {
                ppm: 40.0,
                stalls: 0.0,
                seed: 4,
            };
            let mut tracker = Tracker::new(Duration::from_millis(4));
            for k in 0..300 {
                let (_, stamp, arrival) = case.reading(k);
                tracker.note(stamp, arrival).unwrap();
            }
            let noticed = (0..20).find(|k| {
                // Messages go on behind the step, so that only a step back over several of them shows
                // as time running backwards.
                let (_, stamp, arrival) = case.reading(320 + k);
                tracker.note((stamp as f64 + by) as u64, arrival).is_err()
            });
            let noticed = noticed.expect("never noticed");
            assert!(noticed < u64::from(within), "{by}: after {noticed}");
            // The next ones are told by the new relation.
            for k in 400..700 {
                let (truth, stamp, arrival) = case.reading(k);
                let at = tracker.note((stamp as f64 + by) as u64, arrival).unwrap();
                let off = at.as_nanos() as f64 - truth;
                assert!(k < 550 || off.abs() < 0.5 * MS, "{off} ns");
            }
        }
    }

    #[test]
    fn a_line_stands_although_two_in_five_points_are_wrong() {
        let chance = Chance::new(5);
        let points: Vec<(f64, f64)> = (0..500)
            .map(|k| {
                let x = k as f64;
                let wild = 1e6 * (chance.of(2).unit(k) - 0.5);
                let noise = f64::from(chance.of(1).normal(k));
                let wrong = chance.of(3).unit(k) < 0.4;
                (x, 7.0 + 33.0 * x + if wrong { wild } else { noise })
            })
            .collect();
        let line = Line::fit(&points, Scatter::Even).unwrap();
        assert!((line.slope - 33.0).abs() < 0.02, "{line:?}");
        assert!((line.at(250.0) - 8257.0).abs() < 3.0, "{line:?}");
    }

    #[test]
    fn no_line_without_two_different_places() {
        assert_eq!(Line::fit(&[], Scatter::Even), None);
        assert_eq!(Line::fit(&[(1.0, 2.0)], Scatter::Even), None);
        assert_eq!(Line::fit(&[(1.0, 2.0), (1.0, 3.0)], Scatter::Late), None);
        assert_eq!(
            Line::fit(&[(1.0, f64::NAN), (2.0, 3.0)], Scatter::Even),
            None
        );
    }
}
