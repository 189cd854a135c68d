//! Lamps that a driver lights for a frame, and what is known of when they were lit.

use crate::{
    device::DriverError,
    frame::{Illumination, Timestamp},
};
use std::{collections::VecDeque, time::Duration};

/// A moment known to lie between two others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// Not before.
    pub earliest: Timestamp,
    /// Not after.
    pub latest: Timestamp,
}

/// Once that a lamp was lit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lit {
    /// When light began.
    pub from: Moment,
    /// When it ends by itself, at the bound of hardware, kernel or driver.
    pub until: Moment,
}

/// What a lamp can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Longest time it stays lit at once.
    pub longest: Duration,
    /// Whether hardware or kernel put it out at the end of that time. Without, a thread of the driver
    /// does, and a process that watches over this one.
    pub bounded_by_kernel: bool,
    /// From the command until light may still be changing.
    pub latency: Duration,
}

/// Something that lights the scene on command; dropping it puts it out.
pub trait Lamp: Send {
    /// What it can do.
    fn reach(&self) -> Reach;

    /// When it has cooled down enough for a flash this long; a time in the past = now.
    fn ready_at(&self, _flash: Duration) -> Timestamp {
        Timestamp::from_nanos(0)
    }

    /// Lights up, for `flash` and no longer than its reach.
    ///
    /// # Errors
    /// [`DriverError::Hardware`] for a refusal or a fault, and then it is dark;
    /// [`DriverError::Unplugged`] when it is gone.
    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError>;

    /// Goes dark now, lit or not; answers when light ended.
    ///
    /// # Errors
    /// As [`Self::fire`]; what bounds the lamp still does.
    fn put_out(&mut self) -> Result<Moment, DriverError>;
}

/// What a lamp did lately, from which a frame's light is known.
///
/// A frame is lit when light was certain over its whole exposure, from the first row's start to the
/// last row's end; ambient when no light was possible in any of it; else its light is unknown, as
/// that of a rolling shutter's picture with a bright and a dark part.
#[derive(Debug, Default)]
pub struct Timeline {
    lit: VecDeque<Lit>,
}

impl Timeline {
    /// Flashes remembered; older than any frame still on its way.
    const REMEMBERED: usize = 64;

    /// Notes a flash.
    pub fn add(&mut self, lit: Lit) {
        if self.lit.len() == Self::REMEMBERED {
            self.lit.pop_front();
        }
        self.lit.push_back(lit);
    }

    /// Notes that the latest flash was put out before its time.
    pub fn put_out(&mut self, at: Moment) {
        if let Some(lit) = self.lit.back_mut() {
            lit.until.earliest = lit.until.earliest.min(at.earliest);
            lit.until.latest = lit.until.latest.min(at.latest);
        }
    }

    /// The light of a frame exposed from `start` to `end`; `None` = unknown.
    pub fn light(&self, start: Timestamp, end: Timestamp) -> Option<Illumination> {
        let touches = |lit: &Lit| lit.from.earliest <= end && start <= lit.until.latest;
        let covers = |lit: &Lit| lit.from.latest <= start && end <= lit.until.earliest;
        if self.lit.iter().any(covers) {
            Some(Illumination::Flash)
        } else if self.lit.iter().any(touches) {
            None
        } else {
            Some(Illumination::Ambient)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(nanoseconds: u64) -> Timestamp {
        Timestamp::from_nanos(nanoseconds)
    }

    fn moment(earliest: u64, latest: u64) -> Moment {
        Moment {
            earliest: at(earliest),
            latest: at(latest),
        }
    }

    #[test]
    fn only_whole_exposures_have_a_known_light() {
        let mut timeline = Timeline::default();
        timeline.add(Lit {
            from: moment(100, 110),
            until: moment(200, 220),
        });
        let cases = [
            (0, 99, Some(Illumination::Ambient)),
            (0, 100, None),
            (105, 150, None),
            (110, 200, Some(Illumination::Flash)),
            (150, 201, None),
            (210, 300, None),
            (221, 300, Some(Illumination::Ambient)),
            (50, 300, None),
        ];
        for (start, end, light) in cases {
            assert_eq!(timeline.light(at(start), at(end)), light, "{start}..{end}");
        }
        timeline.put_out(moment(140, 145));
        assert_eq!(
            timeline.light(at(110), at(140)),
            Some(Illumination::Flash),
            "lit until it was put out"
        );
        assert_eq!(timeline.light(at(110), at(150)), None);
        assert_eq!(
            timeline.light(at(146), at(180)),
            Some(Illumination::Ambient)
        );
    }

    proptest! {
        /// Whatever the true moments within what is known, a named light is the true light.
        #[test]
        fn a_light_that_is_named_is_true(
            from in 0u64..1000, from_slack in 0u64..50, length in 0u64..300, until_slack in 0u64..50,
            on in 0.0f64..=1.0, off in 0.0f64..=1.0, start in 0u64..1500, exposure in 0u64..400,
        ) {
            let lit = Lit {
                from: moment(from, from + from_slack),
                until: moment(from + from_slack + length, from + from_slack + length + until_slack),
            };
            let true_on = from + (from_slack as f64 * on) as u64;
            let true_off = from + from_slack + length + (until_slack as f64 * off) as u64;
            let mut timeline = Timeline::default();
            timeline.add(lit);
            let end = start + exposure;
            match timeline.light(at(start), at(end)) {
                Some(Illumination::Flash) => prop_assert!(true_on <= start && end <= true_off),
                Some(Illumination::Ambient) => prop_assert!(end < true_on || start > true_off),
                None => {}
            }
        }
    }
}
