//! A camera on strings: what it shows is known, and so is what goes wrong with it.

use super::time::Time;
use crate::{daemon::clock::Clock, session::SessionError};
use drivers::{
    Beam, ColorFrame, DepthFrame, Device, DeviceInfo, Distortion, DriverError, Exposure, FlashLamp,
    Frame, Illumination, Intrinsics, Pixels, Plane, Rig, Settings, Stream, Timestamp, Transfer,
    replay::Replay,
};
use glam::DVec3;
use std::{
    collections::VecDeque,
    io,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicI64, AtomicU64, AtomicUsize, Ordering::SeqCst},
    },
    time::Duration,
};

const SIZE: usize = 16;
/// Half the time between two pictures; a depth frame lies between them.
const HALF_PERIOD: Duration = Duration::from_micros(16_667);
/// Pictures that can be told apart.
const COUNTED: u64 = 64;

/// A way to fail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Way {
    Timeout,
    Unplugged,
    Ended,
    Setting,
    Malformed,
    NoDevice,
    Hardware,
    Io(i32),
    Panic,
}

/// What goes wrong.
#[derive(Debug, Clone, Copy)]
pub(super) enum Fault {
    /// It cannot be opened again.
    Open(Way),
    /// The driver panics when it is asked what it has opened, or where its lenses are.
    Info,
    Rig,
    /// It does not start.
    Start(Way),
    /// It gives an error in place of frames.
    Frame(Way),
    /// The driver panics when it stops, or when it is closed.
    Stop,
    Close,
    /// Every wait for a frame takes so long, and ends in one.
    Blocks(Duration),
    /// It delivers nothing; the driver keeps its patience.
    Silent,
    /// Frames are not what they should be.
    Spoil(fn(&mut Frame)),
    /// Frames come as this says, which may hold some back.
    Order(fn(&mut VecDeque<Frame>, Frame) -> Vec<Frame>),
    /// It is pulled out, and put back when the fault ends.
    Gone,
    /// It is pulled out, and another one, of another size, put back.
    Foreign,
}

/// When a fault strikes a session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Moment {
    /// At once.
    Now,
    /// Once a frame with flash was delivered.
    AfterFlash,
}

/// One camera as it is moved; only while no other thread has its turn.
#[derive(Default)]
pub(super) struct Strings {
    faults: &'static [(&'static str, Fault)],
    /// Which of them, from 1; 0 = none.
    fault: AtomicUsize,
    after_flash: AtomicBool,
    away: AtomicBool,
    /// How often it was put in; whoever opened an earlier one has lost it.
    times: AtomicU64,
    wide: AtomicBool,
    /// Pictures so far.
    pictures: AtomicU64,
    /// Flashes so far.
    pub flashes: AtomicU64,
    /// How far off its clock is, nanoseconds.
    pub clock_ahead: AtomicI64,
    /// Whether it streams now.
    pub streams: AtomicBool,
}

impl Strings {
    pub fn new(faults: &'static [(&'static str, Fault)]) -> Arc<Self> {
        Arc::new(Self {
            faults,
            ..Self::default()
        })
    }

    fn fault(&self) -> Option<Fault> {
        let place = self.fault.load(SeqCst).checked_sub(1)?;
        self.faults.get(place).map(|(_, fault)| *fault)
    }

    /// Lets a fault strike.
    pub fn strike(&self, place: usize, moment: Moment) {
        self.after_flash.store(moment == Moment::AfterFlash, SeqCst);
        self.fault.store(place + 1, SeqCst);
        match self.fault() {
            Some(Fault::Foreign) if moment == Moment::Now => {
                self.wide.store(true, SeqCst);
                self.replug();
            }
            Some(Fault::Gone) if moment == Moment::Now => self.pull(),
            Some(Fault::Open(_) | Fault::Info | Fault::Rig) if moment == Moment::Now => {
                self.replug();
            }
            _ => {}
        }
    }

    /// All is well again.
    pub fn mend(&self) {
        self.fault.store(0, SeqCst);
        if self.wide.swap(false, SeqCst) {
            self.replug();
        }
        if self.away.load(SeqCst) {
            self.put_back();
        }
    }

    pub fn pull(&self) {
        self.away.store(true, SeqCst);
        self.times.fetch_add(1, SeqCst);
    }

    pub fn put_back(&self) {
        self.away.store(false, SeqCst);
    }

    fn replug(&self) {
        self.times.fetch_add(1, SeqCst);
    }
}

fn fail(way: Way) -> DriverError {
    let device = "staged".to_owned();
    let remedy = "mend it";
    match way {
        Way::Timeout => DriverError::Timeout {
            device,
            patience: Duration::from_millis(1),
        },
        Way::Unplugged => DriverError::Unplugged { device },
        Way::Ended => DriverError::Ended { device },
        Way::Setting => DriverError::Setting {
            device,
            setting: "exposure",
            reason: "it is out of sorts".into(),
        },
        Way::Malformed => DriverError::Malformed {
            path: device.into(),
            problem: "a byte too few".into(),
            remedy,
        },
        Way::NoDevice => DriverError::NoDevice {
            address: device,
            reason: "nothing there".into(),
        },
        Way::Hardware => DriverError::Hardware {
            device,
            problem: "its sensor is too hot".into(),
            remedy,
        },
        Way::Io(errno) => DriverError::Io {
            path: device.into(),
            source: io::Error::from_raw_os_error(errno),
        },
        // Unwinds without a word to standard error.
        Way::Panic => std::panic::resume_unwind(Box::new("staged")),
    }
}

/// The camera as the daemon opened it.
#[derive(Clone)]
pub(super) struct Camera {
    number: u64,
    strings: Arc<Strings>,
    time: Arc<Time>,
    times: u64,
    wide: bool,
}

impl Camera {
    /// Opens camera `number`.
    pub fn open(
        number: u64,
        strings: &Arc<Strings>,
        time: &Arc<Time>,
    ) -> Result<Self, SessionError> {
        if strings.away.load(SeqCst) {
            return Err(fail(Way::NoDevice).into());
        }
        if let Some(Fault::Open(way)) = strings.fault() {
            return Err(fail(way).into());
        }
        Ok(Self {
            number,
            strings: Arc::clone(strings),
            time: Arc::clone(time),
            times: strings.times.load(SeqCst),
            wide: strings.wide.load(SeqCst),
        })
    }

    fn is_lost(&self) -> bool {
        self.strings.away.load(SeqCst) || self.strings.times.load(SeqCst) != self.times
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        if matches!(self.strings.fault(), Some(Fault::Close)) && !std::thread::panicking() {
            fail(Way::Panic);
        }
    }
}

impl Device for Camera {
    fn info(&self) -> DeviceInfo {
        if matches!(self.strings.fault(), Some(Fault::Info)) {
            fail(Way::Panic);
        }
        DeviceInfo {
            address: format!("staged:{}", self.number),
            driver: "staged".into(),
            model: "a camera on strings".into(),
            finite: false,
        }
    }

    fn rig(&self) -> Rig {
        if matches!(self.strings.fault(), Some(Fault::Rig)) {
            fail(Way::Panic);
        }
        Rig {
            color: Intrinsics {
                width: if self.wide { 2 * SIZE } else { SIZE },
                height: SIZE,
                fx: 16.0,
                fy: 16.0,
                cx: 7.5,
                cy: 7.5,
                distortion: Distortion::None {},
            },
            depth: None,
            flash: FlashLamp {
                position_metres: DVec3::ZERO,
                intensity: None,
                beam: Beam::default(),
            },
        }
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        if self.is_lost() {
            return Err(fail(Way::Unplugged));
        }
        if let Some(Fault::Start(way)) = self.strings.fault() {
            return Err(fail(way));
        }
        self.strings.streams.store(true, SeqCst);
        Ok(Box::new(Streaming {
            camera: self,
            settings: settings.clone(),
            taken: 0,
            flashed: false,
            held: VecDeque::new(),
            waiting: VecDeque::new(),
        }))
    }
}

struct Streaming<'a> {
    camera: &'a Camera,
    settings: Settings,
    /// Pictures and depth frames of this session.
    taken: u64,
    flashed: bool,
    held: VecDeque<Frame>,
    waiting: VecDeque<Frame>,
}

impl Drop for Streaming<'_> {
    fn drop(&mut self) {
        self.camera.strings.streams.store(false, SeqCst);
        if matches!(self.struck(), Some(Fault::Stop)) && !std::thread::panicking() {
            fail(Way::Panic);
        }
    }
}

impl Streaming<'_> {
    fn struck(&self) -> Option<Fault> {
        let strings = &self.camera.strings;
        let fault = strings.fault()?;
        (self.flashed || !strings.after_flash.load(SeqCst)).then_some(fault)
    }

    /// The next frame as the world is.
    fn take(&mut self) -> Frame {
        let camera = self.camera;
        let (strings, n) = (&camera.strings, self.taken);
        self.taken += 1;
        let at = camera
            .time
            .nanos()
            .saturating_add_signed(strings.clock_ahead.load(SeqCst));
        let at = Timestamp::from_nanos(at);
        let width = if camera.wide { 2 * SIZE } else { SIZE };
        if n % 2 == 1 {
            let picture = strings.pictures.load(SeqCst);
            return Frame::Depth(DepthFrame {
                at,
                sequence: picture,
                metres: Plane::filled(width, SIZE, distance(camera.number, picture)),
                amplitude: None,
                sigma: None,
            });
        }
        let picture = strings.pictures.fetch_add(1, SeqCst) + 1;
        let every = u64::from(self.settings.flash_every);
        let fires = every > 0 && (n / 2) % every == 1;
        strings.flashes.fetch_add(u64::from(fires), SeqCst);
        let wall = wall(camera.number);
        let pixels = Plane::from_fn(width, SIZE, |x, y| match (x, y) {
            // Which picture it is, where it weighs nothing.
            (0, 0) => numbered(wall, picture),
            _ if fires => [wall + 40 + 3 * (x % SIZE) as u8; 3],
            _ => [wall; 3],
        });
        Frame::Color(ColorFrame {
            at,
            sequence: picture,
            light: match fires {
                true => Illumination::Flash,
                false => Illumination::Ambient,
            },
            exposure: Exposure {
                seconds: 0.01,
                gain: 1.0,
            },
            pixels: Pixels::Rgb8(pixels),
            transfer: Transfer::Linear,
            black_level: 0.0,
            white_level: 1.0,
        })
    }
}

impl Stream for Streaming<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let camera = self.camera;
        if let Some(frame) = self.waiting.pop_front() {
            return Ok(frame);
        }
        let until = camera.time.nanos() + super::time::nanos(patience);
        loop {
            match self.struck() {
                Some(Fault::Frame(way)) => {
                    camera.time.sleep(HALF_PERIOD);
                    return Err(fail(way));
                }
                Some(Fault::Blocks(time)) => camera.time.sleep(time),
                Some(Fault::Silent) => {
                    camera.time.sleep(patience);
                    return Err(fail(Way::Timeout));
                }
                Some(Fault::Gone) => camera.strings.pull(),
                Some(Fault::Foreign) if !camera.wide => {
                    camera.strings.wide.store(true, SeqCst);
                    camera.strings.replug();
                }
                Some(
                    Fault::Open(_) | Fault::Info | Fault::Rig | Fault::Start(_) | Fault::Close,
                ) => {
                    camera.strings.replug();
                }
                _ => {}
            }
            camera.time.sleep(HALF_PERIOD);
            if camera.is_lost() {
                return Err(fail(Way::Unplugged));
            }
            let mut frame = self.take();
            self.flashed |=
                matches!(&frame, Frame::Color(frame) if frame.light == Illumination::Flash);
            match self.struck() {
                Some(Fault::Order(order)) => self.waiting.extend(order(&mut self.held, frame)),
                Some(Fault::Spoil(spoil)) => {
                    spoil(&mut frame);
                    return Ok(frame);
                }
                _ => return Ok(frame),
            }
            if let Some(frame) = self.waiting.pop_front() {
                return Ok(frame);
            }
            if camera.time.nanos() >= until {
                return Err(fail(Way::Timeout));
            }
        }
    }
}

/// The room's light in front of a camera, in codes; a multiple of four.
fn wall(number: u64) -> u8 {
    60 + 32 * (number % 3) as u8
}

/// The wall with the number of a picture in it, so faint that it is no light.
fn numbered(wall: u8, picture: u64) -> [u8; 3] {
    [0, 2, 4].map(|shift| wall + ((picture % COUNTED) >> shift & 3) as u8)
}

/// The distance that a camera's depth frame shows after so many pictures, metres.
fn distance(number: u64, picture: u64) -> f32 {
    (1 + number) as f32 + (picture % COUNTED) as f32 / 128.0
}

/// Judges a kept shot by what its pixels say, whatever its labels and times do.
pub(super) fn judge(folder: &Path, number: u64) -> Result<(), String> {
    let mut replay = Replay::open(folder.join("shot.mcap")).map_err(|error| error.to_string())?;
    let mut stream = replay
        .start(&Settings::default())
        .map_err(|error| error.to_string())?;
    let (mut flash, mut ambient, mut depth) = (Vec::new(), Vec::new(), Vec::new());
    let wall = wall(number);
    loop {
        match stream.next_frame(Duration::ZERO) {
            Ok(Frame::Color(frame)) => {
                let Pixels::Rgb8(pixels) = &frame.pixels else {
                    return Err("another kind of pixels".into());
                };
                let digits = pixels[(0, 0)].map(|code| u64::from(code.wrapping_sub(wall)));
                let picture = digits[0] + 4 * digits[1] + 16 * digits[2];
                let (right, row) = (pixels.width() - 1, pixels.height() - 1);
                let lit = [pixels[(right, 0)][0] > wall, pixels[(right, row)][0] > wall];
                match (frame.light, lit) {
                    (Illumination::Flash, [true, true]) => flash.push(picture),
                    (Illumination::Ambient, [false, false]) => ambient.push(picture),
                    said => return Err(format!("picture {picture} is {said:?}")),
                }
            }
            Ok(Frame::Depth(frame)) => {
                let counted = (frame.metres[(0, 0)] - (1 + number) as f32) * 128.0;
                depth.push(counted as u64);
            }
            Err(DriverError::Ended { .. }) => break,
            Err(error) => return Err(error.to_string()),
        }
    }
    let near = |other: &u64, flash: u64, most: u64| {
        let apart = (other + COUNTED - flash) % COUNTED;
        apart.min(COUNTED - apart) <= most
    };
    let right = match (&flash[..], &depth[..]) {
        ([flash], [depth]) => {
            near(depth, *flash, 2)
                && !ambient.is_empty()
                && ambient.iter().all(|other| near(other, *flash, 8))
        }
        _ => false,
    };
    match right {
        true => Ok(()),
        false => Err(format!(
            "flash {flash:?}, ambient {ambient:?}, depth {depth:?}"
        )),
    }
}
