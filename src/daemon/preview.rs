//! What a camera sees now, for those who look through it: small, and only the newest.

use super::{counted::Counted, picture::Picture};
use drivers::{ColorFrame, Plane};
use std::sync::{
    Arc,
    atomic::{AtomicU64, AtomicUsize, Ordering},
};
use tokio::sync::watch;

/// Most pixels of a preview: 640 × 360 and a little.
const PIXELS: usize = 240_000;

/// One frame, as it came; it is made a picture of when somebody asks.
#[derive(Debug, Clone)]
pub(super) enum Preview {
    /// None yet.
    Nothing,
    /// The newest.
    Frame {
        /// Counts from 1.
        number: u64,
        /// As it came.
        frame: Arc<ColorFrame>,
    },
    /// Why there is none.
    Refused(String),
}

impl Preview {
    pub fn of(frame: ColorFrame) -> Self {
        Self::Frame {
            number: 0,
            frame: Arc::new(frame),
        }
    }
}

/// Where previews go: one slot, so that the oldest is dropped and memory holds one.
#[derive(Clone)]
pub(super) struct Previews {
    newest: Arc<watch::Sender<Preview>>,
    /// How many look.
    looking: Arc<AtomicUsize>,
    /// Shots that wait for the camera.
    waiting: Arc<AtomicUsize>,
    shown: Arc<AtomicU64>,
}

impl Previews {
    pub fn new() -> Self {
        Self {
            newest: Arc::new(watch::Sender::new(Preview::Nothing)),
            looking: Arc::default(),
            waiting: Arc::default(),
            shown: Arc::default(),
        }
    }

    /// True while somebody looks.
    pub fn wanted(&self) -> bool {
        self.looking.load(Ordering::SeqCst) > 0
    }

    /// True when the camera is needed for a shot.
    pub fn shot_waits(&self) -> bool {
        self.waiting.load(Ordering::SeqCst) > 0
    }

    /// Counts a shot that waits, until what is returned is dropped.
    pub fn claim(&self) -> Counted {
        Counted::new(&self.waiting)
    }

    /// Counts somebody who looks, until what is returned is dropped.
    pub fn look(&self) -> (Counted, watch::Receiver<Preview>) {
        (Counted::new(&self.looking), self.newest.subscribe())
    }

    /// Replaces the newest preview.
    pub fn show(&self, preview: Preview) {
        let number = self.shown.fetch_add(1, Ordering::Relaxed) + 1;
        let numbered = match preview {
            Preview::Frame { frame, .. } => Preview::Frame { number, frame },
            other => other,
        };
        self.newest.send_replace(numbered);
    }

    /// Says why there is none.
    pub fn refuse(&self, problem: String) {
        self.newest.send_replace(Preview::Refused(problem));
    }

    /// Previews so far.
    pub fn shown(&self) -> u64 {
        self.shown.load(Ordering::Relaxed)
    }
}

/// The picture of a frame, small, with what is clipped marked.
pub(super) fn picture(frame: &ColorFrame) -> Result<Picture, String> {
    let light = crate::radiometry::linearise(frame).map_err(|error| error.to_string())?;
    let light = &light.0;
    let (width, height) = light.size();
    let factor = (1..)
        .find(|factor| (width / factor) * (height / factor) <= PIXELS)
        .unwrap_or(1);
    // Numbers as the sensor gave them: light at unit exposure times the exposure.
    let exposure = frame.exposure.factor();
    let small = Plane::from_fn(width / factor, height / factor, |x, y| {
        let (mut sum, mut clipped) = ([0.0; 3], false);
        for v in 0..factor {
            for pixel in &light.row(y * factor + v)[x * factor..(x + 1) * factor] {
                clipped |= pixel[0].is_nan();
                for (sum, value) in sum.iter_mut().zip(pixel) {
                    *sum += if value.is_nan() {
                        1.0
                    } else {
                        value * exposure
                    };
                }
            }
        }
        let count = (factor * factor) as f32;
        (sum.map(|sum| sum / count), clipped)
    });
    Ok(Picture::previewed(&small))
}
