//! Heat: how much a lamp may be lit in any stretch of time.

use super::Plan;
use crate::{
    device::DriverError,
    frame::Timestamp,
    lamp::{Lamp, Lit, Moment, Reach},
};
use std::{collections::VecDeque, time::Duration};

/// A lamp that refuses a flash longer than allowed, or before it has cooled down.
pub(super) struct Budget {
    lamp: Box<dyn Lamp>,
    longest: Duration,
    spent: Spent,
}

/// Lit time within a moving window.
#[derive(Debug)]
struct Spent {
    allowance: Duration,
    window: Duration,
    /// When each flash ended, and how long it was at most.
    flashes: VecDeque<(Timestamp, Duration)>,
}

impl Spent {
    /// The first moment at which a flash this long fits.
    fn ready_at(&self, flash: Duration) -> Timestamp {
        let mut lit: Duration = self.flashes.iter().map(|(_, length)| *length).sum();
        let mut ready = Timestamp::from_nanos(0);
        for (ended, length) in &self.flashes {
            if lit + flash <= self.allowance {
                break;
            }
            ready = ended.after(self.window);
            lit = lit.saturating_sub(*length);
        }
        ready
    }

    fn forget(&mut self, now: Timestamp) {
        while let Some((ended, _)) = self.flashes.front()
            && ended.after(self.window) <= now
        {
            self.flashes.pop_front();
        }
    }
}

impl Budget {
    pub fn new(lamp: Box<dyn Lamp>, plan: &Plan) -> Self {
        let window = Duration::from_secs_f64(plan.window_seconds);
        Self {
            longest: super::longest(plan).min(lamp.reach().longest),
            lamp,
            spent: Spent {
                allowance: window.mul_f64(plan.duty),
                window,
                flashes: VecDeque::new(),
            },
        }
    }
}

impl Lamp for Budget {
    fn reach(&self) -> Reach {
        Reach {
            longest: self.longest,
            ..self.lamp.reach()
        }
    }

    fn ready_at(&self, flash: Duration) -> Timestamp {
        self.spent.ready_at(flash)
    }

    fn fire(&mut self, flash: Duration) -> Result<Lit, DriverError> {
        let now = Timestamp::now();
        self.spent.forget(now);
        let ready = self.spent.ready_at(flash);
        let refuse = |problem: String, remedy| DriverError::Hardware {
            device: "flash".into(),
            problem,
            remedy,
        };
        if flash > self.longest {
            return Err(refuse(
                format!("a flash of {flash:?} is longer than {:?}", self.longest),
                "shorten the exposure or raise flash.longest_seconds",
            ));
        }
        if ready > now {
            return Err(refuse(
                format!("too hot for {:?} more", ready.since(now)),
                "wait, shoot less often, or raise flash.duty",
            ));
        }
        let lit = self.lamp.fire(flash)?;
        let length = lit.until.latest.since(lit.from.earliest);
        self.spent.flashes.push_back((lit.until.latest, length));
        Ok(lit)
    }

    fn put_out(&mut self) -> Result<Moment, DriverError> {
        let out = self.lamp.put_out()?;
        // Counted with the time it was really lit.
        if let Some((ended, length)) = self.spent.flashes.back_mut()
            && out.latest < *ended
        {
            *length = length.saturating_sub(ended.since(out.latest));
            *ended = out.latest;
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_lamp_waits_until_enough_has_left_the_window() {
        let at = |ms: u64| Timestamp::from_nanos(ms * 1_000_000);
        let ms = Duration::from_millis;
        let spent = Spent {
            allowance: ms(300),
            window: ms(1000),
            flashes: VecDeque::from([(at(100), ms(100)), (at(400), ms(150))]),
        };
        assert_eq!(spent.ready_at(ms(50)), at(0), "fits at once");
        assert_eq!(spent.ready_at(ms(51)), at(1100), "after the first has left");
        assert_eq!(spent.ready_at(ms(151)), at(1400), "after both have left");
    }

    proptest! {
        /// Fired whenever allowed, however long, a lamp is never lit longer than its allowance
        /// in a window.
        #[test]
        fn no_window_holds_more_light_than_allowed(
            lengths in prop::collection::vec((1u64..300, 0u64..400), 1..60),
        ) {
            let ms = Duration::from_millis;
            let mut spent = Spent { allowance: ms(300), window: ms(1000), flashes: VecDeque::new() };
            let mut now = Timestamp::from_nanos(1);
            let mut all: Vec<(Timestamp, Timestamp)> = Vec::new();
            for (length, pause) in lengths {
                now = now.after(ms(pause)).max(spent.ready_at(ms(length)));
                spent.forget(now);
                prop_assert!(spent.ready_at(ms(length)) <= now);
                let end = now.after(ms(length));
                spent.flashes.push_back((end, ms(length)));
                all.push((now, end));
                now = end;
            }
            for (_, end) in &all {
                let begin = end.before(ms(1000));
                let lit: Duration = all.iter()
                    .filter(|(_, e)| e <= end)
                    .map(|(from, until)| until.since((*from).max(begin)))
                    .sum();
                prop_assert!(lit <= ms(300), "{lit:?} before {end:?}");
            }
        }
    }
}
