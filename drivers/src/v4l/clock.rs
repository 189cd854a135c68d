//! The kernel's time and count of a buffer → when its first row started to expose, and which frame
//! it is.

use super::plan::Stamp;
use crate::{frame::Timestamp, node::Filled};
use std::time::Duration;

/// Follows the frames of one camera.
#[derive(Debug)]
pub(super) struct Clock {
    stamp: Stamp,
    /// Added to every time, nanoseconds.
    offset: i64,
    readout: Duration,
    started: Timestamp,
    last: Option<(Timestamp, u32, u64)>,
    /// Seconds from frame to frame, as measured.
    period: Option<f64>,
    /// Frames the device lost.
    pub missed: u64,
    /// Frames whose time the clock cannot have had.
    pub misdated: u64,
}

/// A time of the kernel may lie this far after the moment at which we ask: some drivers hand a
/// picture over early and date it by its end, up to a frame ahead.
const AHEAD: Duration = Duration::from_secs(1);
/// Weight of a new frame in the measured period.
const NEW: f64 = 0.2;

impl Clock {
    /// For a stream that starts now.
    pub fn new(stamp: Stamp, offset_seconds: f64, readout: Duration) -> Self {
        Self {
            stamp,
            offset: (offset_seconds * 1e9).round() as i64,
            readout,
            started: Timestamp::now(),
            last: None,
            period: None,
            missed: 0,
            misdated: 0,
        }
    }

    /// Start of the exposure and number of a frame exposed for `exposure`, taken at `now`.
    ///
    /// A time of another clock than `CLOCK_MONOTONIC`, before the stream began, or well after now, is
    /// replaced by that of arrival, taken for the moment when the picture was whole. Numbers and times
    /// rise whatever the device does; `None` = a frame no later than one before.
    pub fn place(
        &mut self,
        filled: &Filled,
        exposure: Duration,
        now: Timestamp,
    ) -> Option<(Timestamp, u64)> {
        let stamped = Timestamp::from_nanos(filled.nanoseconds);
        let plausible =
            filled.flags.monotonic && stamped <= now.after(AHEAD) && stamped >= self.started;
        let at_start = match self.stamp {
            Stamp::Flag => filled.flags.start_of_exposure,
            Stamp::Start => true,
            Stamp::End => false,
        };
        let length = exposure + self.readout;
        let at = match (plausible, at_start) {
            (true, true) => stamped,
            (true, false) => stamped.before(length),
            (false, _) => now.before(length),
        };
        let at = if self.offset >= 0 {
            at.after(Duration::from_nanos(self.offset.unsigned_abs()))
        } else {
            at.before(Duration::from_nanos(self.offset.unsigned_abs()))
        };
        self.misdated += u64::from(!plausible);
        let Some((last, before, count)) = self.last else {
            self.last = Some((at, filled.sequence, u64::from(filled.sequence)));
            return Some((at, u64::from(filled.sequence)));
        };
        // The device's count wraps at 32 bits; a step back is a restart of the count.
        let step = match filled.sequence.wrapping_sub(before) {
            step @ 1..=0x7fff_ffff => u64::from(step),
            _ => 1,
        };
        if at <= last {
            self.last = Some((last, filled.sequence, count + step));
            return None;
        }
        self.missed += step - 1;
        let period = at.since(last).as_secs_f64() / step as f64;
        self.period = Some(match self.period {
            Some(known) => known + NEW * (period - known),
            None => period,
        });
        self.last = Some((at, filled.sequence, count + step));
        Some((at, count + step))
    }

    /// When the next exposure that begins at `earliest` or later is expected; `None` before two
    /// frames have come.
    pub fn next_start(&self, earliest: Timestamp) -> Option<Timestamp> {
        let (last, ..) = self.last?;
        let period = self.period.filter(|period| *period > 0.0)?;
        let ahead = earliest.since(last).as_secs_f64();
        let frames = (ahead / period).ceil().max(1.0);
        Some(last.after(Duration::from_secs_f64(frames * period)))
    }

    /// Seconds from frame to frame as measured.
    pub fn period(&self) -> Option<f64> {
        self.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::Flags;

    const EXPOSURE: Duration = Duration::from_millis(10);

    fn filled(sequence: u32, at: Timestamp, monotonic: bool, start: bool) -> Filled {
        Filled {
            index: 0,
            used: vec![],
            flags: Flags {
                error: false,
                monotonic,
                start_of_exposure: start,
            },
            sequence,
            nanoseconds: at.as_nanos(),
        }
    }

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    #[test]
    fn the_flag_says_which_end_of_the_exposure_was_stamped() {
        let mut clock = Clock::new(Stamp::Flag, 0.0, ms(5));
        let at = clock.started.after(ms(100));
        let now = at.after(ms(20));
        let start = clock.place(&filled(0, at, true, true), EXPOSURE, now);
        assert_eq!(start, Some((at, 0)));
        let end = clock.place(
            &filled(1, at.after(ms(40)), true, false),
            EXPOSURE,
            now.after(ms(40)),
        );
        assert_eq!(end, Some((at.after(ms(25)), 1)));
    }

    #[test]
    fn a_time_that_cannot_be_is_replaced_by_arrival() {
        let mut clock = Clock::new(Stamp::Flag, 0.0, Duration::ZERO);
        let now = clock.started.after(ms(100));
        for (n, wrong) in [
            filled(0, Timestamp::from_nanos(5), true, true),
            filled(1, now.after(ms(5000)), true, true),
            filled(2, now, false, true),
        ]
        .into_iter()
        .enumerate()
        {
            let now = now.after(ms(40 * n as u64));
            let placed = clock.place(&wrong, EXPOSURE, now);
            assert_eq!(placed, Some((now.before(EXPOSURE), n as u64)));
        }
        assert_eq!(clock.misdated, 3);
    }

    #[test]
    fn counts_go_on_over_a_wrap_and_a_restart_and_gaps_are_counted() {
        let mut clock = Clock::new(Stamp::Flag, 0.0, Duration::ZERO);
        let mut at = clock.started;
        let mut place = |sequence| {
            at = at.after(ms(40));
            let placed = clock.place(&filled(sequence, at, true, true), EXPOSURE, at);
            placed.unwrap().1
        };
        let numbers: Vec<u64> = [u32::MAX - 1, u32::MAX, 0, 3, 0, 1].map(&mut place).into();
        let first = u64::from(u32::MAX) - 1;
        assert_eq!(
            numbers,
            [0, 1, 2, 5, 6, 7].map(|n| first + n),
            "two frames were missed"
        );
        assert_eq!(clock.missed, 2);
    }

    #[test]
    fn a_frame_no_later_than_the_last_is_left_out() {
        let mut clock = Clock::new(Stamp::Flag, 0.0, Duration::ZERO);
        let at = clock.started.after(ms(40));
        assert!(
            clock
                .place(&filled(0, at, true, true), EXPOSURE, at)
                .is_some()
        );
        assert_eq!(clock.place(&filled(1, at, true, true), EXPOSURE, at), None);
    }

    #[test]
    fn the_next_exposure_is_foretold_from_those_that_came() {
        let mut clock = Clock::new(Stamp::Flag, 0.0, Duration::ZERO);
        let first = clock.started.after(ms(40));
        for n in 0..5 {
            let at = first.after(ms(40 * n));
            clock.place(&filled(n as u32, at, true, true), EXPOSURE, at);
        }
        let next = clock.next_start(first.after(ms(205))).unwrap();
        assert!(next.distance(first.after(ms(240))) < Duration::from_micros(10));
    }
}
