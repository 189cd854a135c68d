//! Webcams of any system, through the crate nokhwa: color without depth, for trying things out. Which
//! frames a person's flash lit, brightness tells.
//!
//! What nokhwa does not tell is not made up: it has no exposure in units of time, so all frames count as
//! equally exposed, which holds only while a camera's automatic exposure rests; where it dates no frame,
//! a frame's time is that of its arrival. Its reads cannot be bounded in time and its cameras do not
//! move between threads; so each session has a thread of its own.

mod options;
mod picture;

use crate::{
    admission,
    calibration::Rig,
    device::{Device, DeviceInfo, DriverError, Losses, Settings, Stream},
    frame::{ColorFrame, Exposure, Frame, Illumination, Timestamp, Transfer},
    witness::Witness,
};
use ::nokhwa::{
    Buffer, Camera, NokhwaError, query,
    utils::{
        ApiBackend, CameraFormat, CameraIndex, FrameFormat, RequestedFormat, RequestedFormatType,
    },
};
use options::NAMES;
pub use options::Options;
use picture::pixels;
use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel},
    },
    time::{Duration, Instant, SystemTime},
};

/// Formats that are read, those first that need no decoding.
const FORMATS: [FrameFormat; 4] = [
    FrameFormat::YUYV,
    FrameFormat::NV12,
    FrameFormat::RAWRGB,
    FrameFormat::MJPEG,
];
/// Frames that wait; a later one is lost, as it is in a camera whose owner is slow.
const WAITING: usize = 2;
/// Longest time a camera may take to come up.
const OPENING: Duration = Duration::from_secs(10);
/// Longest wait for a session to let go of its camera: a read ends with the next frame only.
const CLOSING: Duration = Duration::from_secs(2);
/// Longest time that a flash shines; light that stays longer is the room's.
const LONGEST_FLASH: Duration = Duration::from_millis(500);
/// A frame that says it is older than this has a clock of its own.
const OLDEST: Duration = Duration::from_secs(1);
/// Frames in a row that are not what was granted, after which that is told.
const MOST_BROKEN: u32 = 8;

/// The webcams of this computer.
pub fn list() -> Vec<DeviceInfo> {
    let found = query(ApiBackend::Auto).unwrap_or_default();
    let info = |camera: &::nokhwa::utils::CameraInfo| DeviceInfo {
        address: format!("nokhwa:{}", camera.index()),
        driver: "nokhwa".into(),
        model: camera.human_name(),
        finite: false,
    };
    found.iter().map(info).collect()
}

/// A webcam.
pub struct Webcam {
    options: Options,
    model: String,
    size: (usize, usize),
}

impl Webcam {
    /// Looks at the camera that `options` name and closes it again: it runs in a session only.
    ///
    /// # Errors
    /// [`DriverError::NoDevice`] without it, or where it is busy; [`DriverError::Setting`] for a size
    /// that it does not offer in a format that is read, with those that it does;
    /// [`DriverError::Timeout`] where it does not come up.
    pub fn open(options: Options) -> Result<Self, DriverError> {
        let session = Session::start(options)?;
        let (width, height) = session.size;
        Ok(Self {
            options,
            model: session.model.clone(),
            size: (width as usize, height as usize),
        })
    }
}

impl Device for Webcam {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            address: self.options.address(),
            driver: "nokhwa".into(),
            model: self.model.clone(),
            finite: false,
        }
    }

    fn rig(&self) -> Rig {
        Rig::assumed(self.size, None)
    }

    fn presence(&mut self) -> Result<(), DriverError> {
        match is_there(self.options.index) {
            true => Ok(()),
            false => Err(DriverError::Unplugged {
                device: self.options.address(),
            }),
        }
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        let asked = [
            ("exposure_seconds", settings.exposure_seconds.is_some()),
            ("gain", settings.gain.is_some()),
        ];
        if let Some((setting, _)) = asked.into_iter().find(|(_, asked)| *asked) {
            return Err(DriverError::Setting {
                device: self.options.address(),
                setting,
                reason: "nokhwa knows no unit for it; leave it to the camera".into(),
            });
        }
        let session = Session::start(self.options)?;
        let (width, height) = session.size;
        if (width as usize, height as usize) != self.size {
            return Err(DriverError::Setting {
                device: self.options.address(),
                setting: "width",
                reason: "another size was granted than when the device was opened; open it again"
                    .into(),
            });
        }
        Ok(Box::new(Running {
            session,
            rig: self.rig(),
            settings: settings.clone(),
            options: self.options,
            last: None,
            witness: (settings.flash_every > 0).then(|| Witness::new(LONGEST_FLASH)),
            ready: VecDeque::new(),
            losses: Losses::default(),
            broken: 0,
        }))
    }
}

/// Whether the system lists a camera of this number.
fn is_there(index: u32) -> bool {
    let found = query(ApiBackend::Auto).unwrap_or_default();
    found
        .iter()
        .any(|camera| *camera.index() == CameraIndex::Index(index))
}

/// Why a session has no camera.
#[derive(Debug)]
enum Refused {
    Camera(NokhwaError),
    /// No such size; what there is, in words.
    Size(String),
}

impl From<NokhwaError> for Refused {
    fn from(error: NokhwaError) -> Self {
        Self::Camera(error)
    }
}

/// What the thread sends.
enum Said {
    Open {
        model: String,
        size: (u32, u32),
    },
    Frame {
        frame: Buffer,
        at: Timestamp,
        sequence: u64,
    },
    Refused(Refused),
}

/// A thread that owns a streaming camera; dropping this ends both, with the next frame.
struct Session {
    said: Receiver<Said>,
    over: Arc<AtomicBool>,
    model: String,
    size: (u32, u32),
}

impl Session {
    fn start(options: Options) -> Result<Self, DriverError> {
        let (says, said) = sync_channel(WAITING);
        let over = Arc::new(AtomicBool::new(false));
        let watched = Arc::clone(&over);
        std::thread::Builder::new()
            .name("nokhwa".into())
            .spawn(move || {
                // Whoever waits hears of it, unless nobody waits.
                if let Err(refused) = run(options, &says, &watched) {
                    drop(says.send(Said::Refused(refused)));
                }
            })
            .map_err(|source| DriverError::Io {
                path: options.address().into(),
                source,
            })?;
        let mut session = Self {
            said,
            over,
            model: String::new(),
            size: (0, 0),
        };
        match session.said.recv_timeout(OPENING) {
            Ok(Said::Open { model, size }) => {
                (session.model, session.size) = (model, size);
                Ok(session)
            }
            Ok(Said::Refused(Refused::Size(reason))) => Err(DriverError::Setting {
                device: options.address(),
                setting: "width",
                reason,
            }),
            Ok(Said::Refused(Refused::Camera(error))) => Err(DriverError::NoDevice {
                address: options.address(),
                reason: advice(options, &error),
            }),
            Err(RecvTimeoutError::Timeout) => Err(DriverError::Timeout {
                device: options.address(),
                patience: OPENING,
            }),
            Ok(Said::Frame { .. }) | Err(RecvTimeoutError::Disconnected) => Err(ended(options)),
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        // The next session finds the camera busy until this one has let go of it.
        let deadline = Instant::now() + CLOSING;
        while let Some(left) = deadline.checked_duration_since(Instant::now()) {
            if let Err(RecvTimeoutError::Disconnected) = self.said.recv_timeout(left) {
                break;
            }
        }
    }
}

/// What to do about a camera that does not open.
fn advice(options: Options, error: &NokhwaError) -> String {
    let words = error.to_string();
    let remedy = if !is_there(options.index) {
        let found = query(ApiBackend::Auto).unwrap_or_default();
        let mut there: Vec<String> = found
            .iter()
            .map(|camera| format!("nokhwa:{} ({})", camera.index(), camera.human_name()))
            .collect();
        there.sort();
        match there.len() {
            0 => "no camera is plugged in, or none may be opened".to_owned(),
            _ => format!("cameras are {}", there.join(", ")),
        }
    } else if words.contains("os error 13") {
        "join the group video (`sudo usermod -aG video $USER`, then log in again)".to_owned()
    } else if words.contains("os error 16") {
        "it is busy; close the program that uses it".to_owned()
    } else {
        "it must be free, and this program be allowed to use cameras".to_owned()
    };
    format!("{words}; {remedy}")
}

/// The thread has gone without a word: a panic within nokhwa.
fn ended(options: Options) -> DriverError {
    DriverError::Hardware {
        device: options.address(),
        problem: "the thread that reads the camera has ended".into(),
        remedy: "start again; if it comes back, use another driver (on Linux v4l:)",
    }
}

fn run(options: Options, says: &SyncSender<Said>, over: &AtomicBool) -> Result<(), Refused> {
    let index = CameraIndex::Index(options.index);
    let any = RequestedFormat::with_formats(RequestedFormatType::None, &FORMATS);
    let mut camera = Camera::new(index, any)?;
    let offered = camera.compatible_camera_formats()?;
    let chosen = choose(&offered, options).map_err(Refused::Size)?;
    let exact = RequestedFormatType::Exact(chosen);
    camera.set_camera_requset(RequestedFormat::with_formats(exact, &FORMATS))?;
    camera.open_stream()?;
    let granted = camera.resolution();
    let open = Said::Open {
        model: camera.info().human_name(),
        size: (granted.width(), granted.height()),
    };
    drop(says.send(open));
    let mut sequence = 0;
    while !over.load(Ordering::Relaxed) {
        let frame = camera.frame()?;
        let at = dated(&frame);
        let frame = Said::Frame {
            frame,
            at,
            sequence,
        };
        sequence += 1;
        if let Err(TrySendError::Disconnected(_)) = says.try_send(frame) {
            break;
        }
    }
    Ok(camera.stop_stream()?)
}

/// The format of the wanted size, the most readily read, and of the nearest rate.
fn choose(offered: &[CameraFormat], options: Options) -> Result<CameraFormat, String> {
    let wanted = (options.width, options.height);
    let wanted_format = |format: &FrameFormat| options.format.is_none_or(|only| only == *format);
    let place = |format: &CameraFormat| {
        let mut known = FORMATS.iter();
        known.position(|known| *known == format.format() && wanted_format(known))
    };
    let best = offered
        .iter()
        .filter(|format| (format.width(), format.height()) == wanted)
        .filter_map(|format| Some((place(format)?, format)))
        .min_by_key(|(place, format)| (*place, format.frame_rate().abs_diff(options.rate)));
    best.map(|(_, format)| *format).ok_or_else(|| {
        let mut sizes: Vec<(u32, u32)> = offered
            .iter()
            .filter(|format| place(format).is_some())
            .map(|format| (format.width(), format.height()))
            .collect();
        sizes.sort_unstable();
        sizes.dedup();
        let sizes: Vec<String> = sizes.iter().map(|(w, h)| format!("{w}×{h}")).collect();
        format!(
            "{}×{} is not offered in {}; there are {}",
            options.width,
            options.height,
            NAMES
                .iter()
                .find(|(_, named)| Some(*named) == options.format)
                .map_or(
                    "a format that is read (YUYV, NV12, RGB, MJPG)",
                    |(name, _)| name
                ),
            if sizes.is_empty() {
                "none".to_owned()
            } else {
                sizes.join(", ")
            }
        )
    })
}

/// When a frame that has just arrived was taken: nokhwa tells it by the wall clock, if at all.
fn dated(frame: &Buffer) -> Timestamp {
    let arrival = Timestamp::now();
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let age = since_1970
        .ok()
        .zip(frame.capture_timestamp())
        .and_then(|(now, taken)| now.checked_sub(taken));
    match age {
        Some(age) if age <= OLDEST => arrival.before(age),
        _ => arrival,
    }
}

struct Running {
    session: Session,
    rig: Rig,
    settings: Settings,
    options: Options,
    last: Option<(Timestamp, u64)>,
    /// Tells the light; `None` for somebody who only looks through the camera.
    witness: Option<Witness>,
    ready: VecDeque<ColorFrame>,
    losses: Losses,
    /// Broken frames since the last good one.
    broken: u32,
}

impl Running {
    /// Waits for what the camera delivers next; `None` for a frame that is broken.
    fn take(&mut self, patience: Duration) -> Result<Option<ColorFrame>, DriverError> {
        let device = || self.options.address();
        let (buffer, at, sequence) = match self.session.said.recv_timeout(patience) {
            Ok(Said::Frame {
                frame,
                at,
                sequence,
            }) => (frame, at, sequence),
            Ok(Said::Open { .. }) | Err(RecvTimeoutError::Timeout) => {
                return Err(DriverError::Timeout {
                    device: device(),
                    patience,
                });
            }
            Ok(Said::Refused(_)) if !is_there(self.options.index) => {
                return Err(DriverError::Unplugged { device: device() });
            }
            Ok(Said::Refused(refused)) => {
                return Err(DriverError::Hardware {
                    device: device(),
                    problem: match refused {
                        Refused::Camera(error) => error.to_string(),
                        Refused::Size(sizes) => sizes,
                    },
                    remedy: "start again; if it comes back, check its cable",
                });
            }
            Err(RecvTimeoutError::Disconnected) => return Err(ended(self.options)),
        };
        let mut at = at;
        if let Some((last, count)) = self.last {
            self.losses.missed += sequence.saturating_sub(count + 1);
            // A clock too coarse to tell two frames apart tells them apart by a nanosecond.
            at = at.max(last.after(Duration::from_nanos(1)));
        }
        self.last = Some((at, sequence));
        let picture = pixels(&buffer).and_then(|pixels| {
            let frame = ColorFrame {
                at,
                sequence,
                light: Illumination::Ambient,
                exposure: Exposure::UNIT,
                pixels,
                transfer: Transfer::Srgb,
                black_level: 0.0,
                white_level: 1.0,
            };
            let admitted = admission::admit_color(&frame, &self.rig);
            admitted.map_err(|refusal| refusal.to_string())?;
            Ok(frame)
        });
        match picture {
            Ok(frame) => {
                self.broken = 0;
                Ok(Some(frame))
            }
            Err(problem) => {
                self.losses.broken += 1;
                self.broken += 1;
                if self.broken < MOST_BROKEN {
                    return Ok(None);
                }
                Err(DriverError::Malformed {
                    path: device().into(),
                    problem,
                    remedy: "try another width, height or rate",
                })
            }
        }
    }
}

impl Stream for Running {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let deadline = Timestamp::now().after(patience);
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Ok(Frame::Color(frame));
            }
            let Some(frame) = self.take(deadline.since(Timestamp::now()))? else {
                continue;
            };
            match &mut self.witness {
                None => self.ready.push_back(frame),
                Some(witness) => self.ready.extend(witness.tell(frame)),
            }
        }
    }

    fn losses(&self) -> Losses {
        Losses {
            unlit: self.witness.as_ref().map_or(0, |witness| witness.unlit),
            ..self.losses
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::nokhwa::utils::Resolution;

    #[test]
    fn the_wanted_size_comes_in_the_format_that_is_read_most_readily() {
        let format = |width, format, rate| {
            CameraFormat::new(Resolution::new(width, width * 3 / 4), format, rate)
        };
        let offered = [
            format(640, FrameFormat::MJPEG, 30),
            format(640, FrameFormat::YUYV, 5),
            format(640, FrameFormat::YUYV, 25),
            format(640, FrameFormat::GRAY, 30),
            format(1280, FrameFormat::MJPEG, 30),
            format(1600, FrameFormat::GRAY, 30),
        ];
        let wanted = |width: u32| Options {
            index: 0,
            width,
            height: width * 3 / 4,
            rate: 30,
            format: None,
        };
        assert_eq!(choose(&offered, wanted(640)), Ok(offered[2]));
        assert_eq!(choose(&offered, wanted(1280)), Ok(offered[4]));
        let jpeg = Options {
            format: Some(FrameFormat::MJPEG),
            ..wanted(640)
        };
        assert_eq!(choose(&offered, jpeg), Ok(offered[0]));
        let refused = choose(&offered, wanted(1600)).unwrap_err();
        assert!(
            refused.ends_with("there are 640×480, 1280×960"),
            "{refused}"
        );
    }

    #[test]
    fn a_camera_that_is_not_there_is_refused_by_name() {
        let refused = Webcam::open(Options::parse("250").unwrap()).err().unwrap();
        assert!(refused.to_string().contains("nokhwa:250"), "{refused}");
    }
}
