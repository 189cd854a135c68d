//! When the lamp fires and goes dark, so that `flash_run` of `flash_every` frames are lit from end to end.

use super::clock::Clock;
use crate::{
    device::DriverError,
    frame::{Illumination, Timestamp},
    lamp::{Lamp, Timeline},
};
use std::time::Duration;

/// The lamp of a stream and what it is doing.
pub(super) struct Bracket {
    lamp: Option<Box<dyn Lamp>>,
    timeline: Timeline,
    every: u32,
    /// Frames in a row that are lit each time.
    run: u32,
    /// Flash frames of the run that has begun.
    lit: u32,
    /// Ambient frames since the last flash frame.
    ambient: u32,
    /// Until when a lit frame may still arrive, while one is waited for.
    burning: Option<Timestamp>,
    /// When the next flash is due, once that has been worked out.
    planned: Option<Timestamp>,
    /// Flashes in a row without a frame that was lit throughout.
    vain: u32,
    /// Flashes that were due while nobody asked.
    missed: u32,
    device: String,
}

/// Light before and after an exposure for which it is timed: what timers and buses may be late.
const LEAD: Duration = Duration::from_millis(3);
/// Flashes in a row without a lit frame after which something is wrong.
const MOST_VAIN: u32 = 8;
/// Flashes that were due while whoever asks for frames was busy with the last, after which none is timed
/// any more: light then lasts for whichever frame comes.
const MOST_MISSED: u32 = 2;

impl Bracket {
    /// Lights `run` of `every` frames, which are one after the other.
    pub fn new(lamp: Option<Box<dyn Lamp>>, (run, every): (u32, u32), device: String) -> Self {
        Self {
            lamp,
            timeline: Timeline::default(),
            every,
            run,
            lit: 0,
            ambient: 0,
            burning: None,
            planned: None,
            vain: 0,
            missed: 0,
            device,
        }
    }

    /// Longest exposure with readout that the lamp can light; `None` without a lamp.
    pub fn longest_exposure(&self, period: Duration) -> Option<Duration> {
        let reach = self.lamp.as_ref()?.reach();
        let around = length_of(&reach, reach.bounded_by_kernel, Duration::ZERO, period);
        Some(reach.longest.saturating_sub(around))
    }

    /// The light of a frame exposed from `start` for `length`; `None` = unknown.
    pub fn light(&self, start: Timestamp, length: Duration) -> Option<Illumination> {
        self.timeline.light(start, start.after(length))
    }

    /// Notes a frame that was delivered; a flash frame puts the lamp out.
    pub fn delivered(&mut self, light: Illumination) -> Result<(), DriverError> {
        match light {
            Illumination::Ambient => self.ambient += 1,
            Illumination::Flash => {
                self.ambient = 0;
                self.lit = (self.lit + 1) % self.run;
                self.vain = 0;
                self.burning = None;
                self.darken()?;
            }
        }
        Ok(())
    }

    /// Puts the lamp out.
    pub fn darken(&mut self) -> Result<(), DriverError> {
        if let Some(lamp) = &mut self.lamp {
            let out = lamp.put_out()?;
            self.timeline.put_out(out);
        }
        Ok(())
    }

    /// Fires when its time has come; answers when to ask again. `length` is that of an exposure
    /// with readout, `period` that from frame to frame.
    pub fn act(
        &mut self,
        now: Timestamp,
        clock: &Clock,
        length: Duration,
        period: Duration,
    ) -> Result<Option<Timestamp>, DriverError> {
        let Some(lamp) = &mut self.lamp else {
            return Ok(None);
        };
        // Somebody only looks through the camera.
        if self.every == 0 {
            return Ok(None);
        }
        if let Some(until) = self.burning {
            if now <= until {
                return Ok(Some(until));
            }
            self.burning = None;
            self.vain += 1;
            if self.vain >= MOST_VAIN {
                return Err(DriverError::Hardware {
                    device: self.device.clone(),
                    problem: format!(
                        "the flash fired {MOST_VAIN} times, and no frame was lit from end to end"
                    ),
                    remedy: "give color.readout_seconds and flash.latency_seconds as they are, or \
                             shorten the exposure",
                });
            }
        }
        if self.lit == 0 && self.ambient + self.run < self.every {
            return Ok(None);
        }
        let reach = lamp.reach();
        let steady = length_of(&reach, false, length, period);
        let timed =
            reach.bounded_by_kernel && (self.missed < MOST_MISSED || steady > reach.longest);
        let flash = length_of(&reach, timed, length, period);
        let soonest = lamp.ready_at(flash).max(now);
        let due = match self.planned {
            // A poll wakes up a little late; what was missed by more is for the next frame.
            Some(planned) if now <= planned.after(LEAD / 2) => planned,
            _ if !timed => soonest,
            planned => {
                self.missed += u32::from(planned.is_some());
                let lead = LEAD + reach.latency;
                match clock.next_start(soonest.after(lead)) {
                    Some(start) => start.before(lead),
                    // Without two frames there is nothing to foretell from.
                    None => return Ok(None),
                }
            }
        };
        self.planned = Some(due);
        if due > now {
            return Ok(Some(due));
        }
        self.planned = None;
        let lit = lamp.fire(flash)?;
        self.timeline.add(lit);
        // The last lit frame is on its way for a few frames' time.
        self.burning = Some(lit.until.latest.after(4 * period));
        Ok(self.burning)
    }

    /// Whether the lamp can light a frame of this length at all.
    pub fn check(&self, length: Duration, period: Duration) -> Result<(), DriverError> {
        let Some(lamp) = &self.lamp else {
            return Ok(());
        };
        let reach = lamp.reach();
        let needed = length_of(&reach, reach.bounded_by_kernel, length, period);
        if needed <= reach.longest {
            return Ok(());
        }
        Err(DriverError::Setting {
            device: self.device.clone(),
            setting: "flash.longest_seconds",
            reason: format!(
                "a frame of {length:?} needs light for {needed:?}, and {:?} is the lamp's bound; \
                 shorten the exposure, raise the bound, or give color.readout_seconds",
                reach.longest
            ),
        })
    }
}

/// How long light is needed: for one exposure for which it is timed, or for whichever comes first.
fn length_of(
    reach: &crate::lamp::Reach,
    timed: bool,
    length: Duration,
    period: Duration,
) -> Duration {
    if timed {
        length + 2 * (LEAD + reach.latency)
    } else {
        length + 2 * period + 2 * reach.latency + LEAD
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        lamp::{Lit, Moment, Reach},
        node::{Filled, Flags},
        v4l::plan::Stamp,
    };
    use std::sync::{Arc, Mutex};

    /// Notes how long each flash was to last.
    struct Noting(Arc<Mutex<Vec<Duration>>>);

    impl Lamp for Noting {
        fn reach(&self) -> Reach {
            Reach {
                longest: ms(300),
                bounded_by_kernel: true,
                latency: ms(1),
            }
        }

        fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
            self.0.lock().unwrap().push(flash);
            let moment = |at| Moment {
                earliest: at,
                latest: at,
            };
            let now = Timestamp::now();
            Ok(Lit {
                from: moment(now),
                until: moment(now.after(flash)),
            })
        }

        fn put_out(&mut self) -> Result<Moment, DriverError> {
            let now = Timestamp::now();
            Ok(Moment {
                earliest: now,
                latest: now,
            })
        }
    }

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    /// Asks for every frame of 40 ms, each time so long after its arrival, and answers how long the
    /// first flash was to last.
    fn first_flash(busy: Duration) -> Option<Duration> {
        let fired = Arc::new(Mutex::new(Vec::new()));
        let lamp = Box::new(Noting(Arc::clone(&fired)));
        let mut bracket = Bracket::new(Some(lamp), (1, 3), "test".into());
        let mut clock = Clock::new(Stamp::Start, 0.0, Duration::ZERO);
        let (length, period) = (ms(10), ms(40));
        let mut at = Timestamp::now().after(ms(1));
        for number in 0..12 {
            let filled = Filled {
                index: 0,
                used: vec![],
                flags: Flags {
                    error: false,
                    monotonic: true,
                    start_of_exposure: true,
                },
                sequence: number,
                nanoseconds: at.as_nanos(),
            };
            let arrival = at.after(length);
            clock.place(&filled, length, arrival).unwrap();
            bracket.delivered(Illumination::Ambient).unwrap();
            // Whoever asks works on the frame, and then waits until it is told to ask again or the next
            // frame is there.
            let next = at.after(period).after(length);
            let mut now = arrival.after(busy);
            while let Some(again) = bracket.act(now, &clock, length, period).unwrap() {
                if let Some(flash) = fired.lock().unwrap().first() {
                    return Some(*flash);
                }
                if again >= next {
                    break;
                }
                now = again.max(now.after(Duration::from_micros(100)));
            }
            at = at.after(period);
        }
        None
    }

    #[test]
    fn a_flash_is_timed_for_one_exposure_where_frames_are_taken_in_time() {
        // Its 10 ms, and 3 ms and the lamp's latency on each side.
        assert_eq!(first_flash(ms(2)), Some(ms(18)));
    }

    #[test]
    fn whoever_takes_frames_too_slowly_to_time_a_flash_gets_a_longer_one() {
        // 38 of 40 ms: each due time has passed when the next frame is asked for. Light then lasts for
        // whichever frame comes, and for one that has begun before it.
        assert_eq!(first_flash(ms(38)), Some(ms(95)));
    }
}
