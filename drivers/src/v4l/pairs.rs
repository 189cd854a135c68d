//! Depth pictures and the amplitude pictures of the same exposures, from two nodes of one ToF camera.

use crate::{
    frame::{DepthFrame, Timestamp},
    plane::Plane,
};
use std::{collections::VecDeque, time::Duration};

/// Pictures of either kind that wait for the other; a depth picture goes on without after that.
const WAITING: usize = 3;

/// Pictures that have not found each other yet, each kind in the order of its times.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    depth: VecDeque<DepthFrame>,
    amplitude: VecDeque<(Timestamp, Plane<f32>)>,
}

impl Pairs {
    pub fn add_depth(&mut self, frame: DepthFrame) {
        self.depth.push_back(frame);
    }

    pub fn add_amplitude(&mut self, at: Timestamp, amplitude: Plane<f32>) {
        if self.amplitude.len() == WAITING {
            self.amplitude.pop_front();
        }
        self.amplitude.push_back((at, amplitude));
    }

    /// The next depth picture, with the amplitude of the same exposure: one whose time is at most
    /// `apart` from its own. Without, where a later one has come instead, or too many wait.
    pub fn next(&mut self, apart: Duration) -> Option<DepthFrame> {
        let at = self.depth.front()?.at;
        let before = |other: Timestamp| other.after(apart) < at;
        while self
            .amplitude
            .front()
            .is_some_and(|(other, _)| before(*other))
        {
            self.amplitude.pop_front();
        }
        let own = match self.amplitude.front() {
            Some((other, _)) if other.distance(at) <= apart => self.amplitude.pop_front(),
            None if self.depth.len() <= WAITING => return None,
            _ => None,
        };
        let frame = self.depth.pop_front()?;
        Some(DepthFrame {
            amplitude: own.map(|(_, amplitude)| amplitude),
            ..frame
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const APART: Duration = Duration::from_millis(20);

    fn at(milliseconds: u64) -> Timestamp {
        Timestamp::from_nanos(milliseconds * 1_000_000)
    }

    fn depth(milliseconds: u64) -> DepthFrame {
        DepthFrame {
            at: at(milliseconds),
            sequence: 0,
            metres: Plane::filled(1, 1, 1.0),
            amplitude: None,
            sigma: None,
        }
    }

    /// The amplitude says in its one sample when it was taken.
    fn taken(frame: &DepthFrame) -> Option<f32> {
        frame.amplitude.as_ref().map(|plane| plane[(0, 0)])
    }

    #[test]
    fn a_lost_amplitude_holds_nothing_up() {
        let mut pairs = Pairs::default();
        pairs.add_depth(depth(100));
        assert!(pairs.next(APART).is_none(), "it may still come");
        pairs.add_amplitude(at(141), Plane::filled(1, 1, 141.0));
        let first = pairs.next(APART).unwrap();
        assert_eq!((first.at, taken(&first)), (at(100), None));
        pairs.add_depth(depth(140));
        assert_eq!(taken(&pairs.next(APART).unwrap()), Some(141.0));
        // A node that has fallen silent.
        for n in 0..=WAITING as u64 {
            assert!(pairs.next(APART).is_none());
            pairs.add_depth(depth(180 + 40 * n));
        }
        assert_eq!(taken(&pairs.next(APART).unwrap()), None);
    }

    proptest! {
        /// Whatever is lost and in whatever order the rest comes, no depth picture is lost or delivered
        /// twice, and none has an amplitude of another exposure.
        #[test]
        fn only_pictures_of_one_exposure_are_paired(
            lost in prop::collection::vec((any::<bool>(), any::<bool>(), any::<bool>()), 1..40),
            skew in 0u64..19,
        ) {
            let mut pairs = Pairs::default();
            let (mut given, mut got) = (Vec::new(), Vec::new());
            for (n, (no_depth, no_amplitude, amplitude_first)) in lost.iter().enumerate() {
                let time = 100 + 40 * n as u64;
                let amplitude = |pairs: &mut Pairs| if !no_amplitude {
                    let time = time + skew;
                    pairs.add_amplitude(at(time), Plane::filled(1, 1, time as f32));
                };
                if *amplitude_first {
                    amplitude(&mut pairs);
                }
                if !no_depth {
                    pairs.add_depth(depth(time));
                    given.push(at(time));
                }
                if !amplitude_first {
                    amplitude(&mut pairs);
                }
                got.extend(std::iter::from_fn(|| pairs.next(APART)));
            }
            for frame in &got {
                let own = frame.at.as_nanos() / 1_000_000 + skew;
                prop_assert!(taken(frame).is_none_or(|taken| taken == own as f32));
            }
            let times: Vec<Timestamp> = got.iter().map(|frame| frame.at).collect();
            prop_assert_eq!(&times[..], &given[..times.len()]);
            prop_assert!(given.len() - times.len() <= WAITING);
        }
    }
}
