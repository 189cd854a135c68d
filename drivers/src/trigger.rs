//! Which frames a switched flash lit, when a command takes its time to land.
//!
//! A command to a camera or a lamp takes effect at some moment between its sending and a longest
//! latency (three to four frames on most cameras). A frame is of known light only when no such moment
//! can lie between the start of its first row and the end of its last: a rolling shutter would then
//! show the flash in a part of the rows.

use crate::frame::{Exposure, Illumination, Timestamp};
use std::{collections::VecDeque, time::Duration};

/// When a frame gathered light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Open {
    /// First row starts to expose.
    pub from: Timestamp,
    /// Last row ends.
    pub until: Timestamp,
}

impl Open {
    /// Of a rolling shutter that takes `readout` from the first row to the last; zero for a global
    /// shutter.
    pub fn new(from: Timestamp, exposure: Exposure, readout: Duration) -> Self {
        let open = Duration::try_from_secs_f32(exposure.seconds).unwrap_or(Duration::ZERO);
        Self {
            from,
            until: from.after(open).after(readout),
        }
    }
}

/// Commands remembered; far more than can be under way.
const REMEMBERED: usize = 64;

/// Switches a flash on and off so that brackets ambient–flash–ambient come about, and says of every
/// frame which light it was taken in.
///
/// The flash stays on until `run` frames have surely been lit whole, and off until `every − run` frames
/// have surely not been. Pure: times are handed in, commands are handed out.
#[derive(Debug, Clone)]
pub struct Switched {
    latency: Duration,
    run: u32,
    every: u32,
    /// When each command was sent, and what it asked for.
    sent: VecDeque<(Timestamp, bool)>,
    wanted: bool,
    /// Frames of the wanted light since the last command.
    seen: u32,
}

impl Switched {
    /// A flash that was surely off before `now`, to be lit for `run` ≥ 1 color frames in `every` > `run` at
    /// most.
    pub fn new(latency: Duration, (run, every): (u32, u32), now: Timestamp) -> Self {
        Self {
            latency,
            run: run.max(1),
            every: every.max(run.max(1) + 1),
            sent: VecDeque::from([(now, false)]),
            wanted: false,
            seen: 0,
        }
    }

    /// The light of a frame; `None` where the flash may have changed while it was open, or where the
    /// frame is older than what is remembered.
    pub fn light(&self, open: Open) -> Option<Illumination> {
        let mut light = None;
        for (sent, on) in &self.sent {
            if *sent > open.until {
                break;
            }
            // A command that changed nothing is remembered too: it may have been repeated because the
            // one before was lost.
            light = (sent.after(self.latency) <= open.from).then_some(if *on {
                Illumination::Flash
            } else {
                Illumination::Ambient
            });
        }
        light
    }

    /// Counts a frame that came, and says what to command now: `Some(true)` = flash on. Tell
    /// [`Self::commanded`] when that was done.
    pub fn next_command(&mut self, light: Option<Illumination>) -> Option<bool> {
        let wanted = if self.wanted {
            Illumination::Flash
        } else {
            Illumination::Ambient
        };
        self.seen += u32::from(light == Some(wanted));
        let enough = if self.wanted {
            self.run
        } else {
            self.every - self.run
        };
        (self.seen >= enough).then_some(!self.wanted)
    }

    /// Remembers a command that is being sent at `now`; call it before sending.
    pub fn commanded(&mut self, on: bool, now: Timestamp) {
        self.sent.push_back((now, on));
        if self.sent.len() > REMEMBERED {
            self.sent.pop_front();
        }
        self.wanted = on;
        self.seen = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(at: u64) -> Timestamp {
        Timestamp::from_nanos(at * 1_000_000)
    }

    const fn open(from: u64, until: u64) -> Open {
        Open {
            from: ms(from),
            until: ms(until),
        }
    }

    #[test]
    fn a_frame_open_while_the_flash_may_have_changed_is_of_no_light() {
        let mut flash = Switched::new(Duration::from_millis(100), (1, 3), ms(0));
        flash.commanded(true, ms(1000));
        flash.commanded(false, ms(2000));
        struct Case(Open, Option<Illumination>);
        for Case(open, light) in [
            Case(open(50, 90), None),
            Case(open(100, 140), Some(Illumination::Ambient)),
            Case(open(950, 999), Some(Illumination::Ambient)),
            // The last row ends when the command is out: the flash may be in it.
            Case(open(960, 1000), None),
            Case(open(1099, 1130), None),
            Case(open(1100, 1140), Some(Illumination::Flash)),
            Case(open(1960, 1999), Some(Illumination::Flash)),
            Case(open(1960, 2001), None),
            Case(open(2100, 2140), Some(Illumination::Ambient)),
            // On and off again while it was open.
            Case(open(900, 2200), None),
        ] {
            assert_eq!(flash.light(open), light, "{open:?}");
        }
    }

    #[test]
    fn the_rows_that_are_read_last_count_too() {
        let exposure = Exposure {
            seconds: 0.01,
            gain: 1.0,
        };
        let open = Open::new(ms(5), exposure, Duration::from_millis(30));
        // A float holds 10 ms to a nanosecond.
        assert!(open.until.distance(ms(45)) < Duration::from_nanos(2));
    }

    #[test]
    fn the_flash_is_off_again_after_one_frame_it_surely_lit() {
        let mut flash = Switched::new(Duration::from_millis(100), (1, 3), ms(0));
        let mut pattern = String::new();
        for k in 1..40 {
            let now = 33 * k;
            let light = flash.light(open(now - 33, now - 10));
            pattern.push(match light {
                Some(Illumination::Flash) => 'F',
                Some(Illumination::Ambient) => 'a',
                None => '-',
            });
            if let Some(on) = flash.next_command(light) {
                flash.commanded(on, ms(now));
            }
        }
        assert_eq!(&pattern[..24], "----aa----F----aa----F--");
    }
}
