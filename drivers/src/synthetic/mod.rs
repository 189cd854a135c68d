//! A rig that photographs a small analytic world: a pure function of options and time, with truth.
//!
//! The world is ray cast, one ray per pixel, lit by one bounce: the flash beside the lens (inverse
//! square), the room's lamp with cast shadows and mains flicker, and light from everywhere. The ToF
//! camera sits 3 cm aside behind a lens of its own. Shading is
//! `strength · (albedo + π f_karis) · (n·l)`, so that a white Lambertian facing a lamp of
//! strength 1 has value 1.

mod layout;
mod material;
mod sensor;
mod shape;
mod world;

pub use layout::Layout;
pub use sensor::PixelKind;
pub use world::{FLASH_INTENSITY, Relit, Truth, World};

use crate::{
    address,
    calibration::Rig,
    chance::Chance,
    device::{Device, DeviceInfo, DriverError, Settings, Stream},
    frame::{ColorFrame, DepthFrame, Exposure, Frame, Illumination, Timestamp},
    plane::Plane,
};
use std::time::Duration;

/// Everything that can be chosen about a synthetic device.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The world.
    pub layout: Layout,
    /// Moves its solids a little, changes its colors and its noise.
    pub seed: u64,
    /// Color camera, pixels; even.
    pub width: usize,
    /// Color camera, pixels; even.
    pub height: usize,
    /// Depth camera, pixels; three quarters as high.
    pub depth_width: usize,
    /// Form of the color pictures.
    pub pixels: PixelKind,
    /// Color and depth frames per second.
    pub rate: f64,
    /// Standard deviation of a frame's start, seconds; at most a fifth of the frame time is applied.
    pub jitter_seconds: f64,
    /// Probability that the cameras lose a frame.
    pub drop: f64,
    /// Noise of both cameras, as a multiple of the real one; 0 = none.
    pub noise: f32,
    /// Strength of the room's light.
    pub ambient: f32,
    /// Modulation of the room's light at 100 Hz, 0 (steady) to 1.
    pub flicker: f64,
    /// Whether frames come when their time has come (true) or at once.
    pub real_time: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            layout: Layout::Desk,
            seed: 0,
            width: 320,
            height: 240,
            depth_width: 160,
            pixels: PixelKind::Rgb8,
            rate: 30.0,
            jitter_seconds: 0.0002,
            drop: 0.0,
            noise: 1.0,
            ambient: 1.0,
            flicker: 0.3,
            real_time: false,
        }
    }
}

const KNOWN: [address::Known; 12] = [
    ("seed", "whole number, 0"),
    ("width", "even pixels, 320"),
    ("height", "even pixels, 3/4 of width"),
    ("depth_width", "pixels, 160"),
    (
        "pixels",
        "bayer, yuyv, nv12, mjpg, rgb8, rgb16 or rgbf32; rgb8",
    ),
    ("rate", "frames per second, 30"),
    ("jitter", "seconds, 0.0002"),
    ("drop", "probability, 0"),
    ("noise", "multiple, 1"),
    ("ambient", "multiple, 1"),
    ("flicker", "modulation, 0.3"),
    ("pace", "instant or real; instant"),
];

impl Options {
    /// Reads `LAYOUT` or `LAYOUT?key=value&key=value`.
    ///
    /// # Errors
    /// A sentence that says what is valid.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (name, rest) = text.split_once('?').unwrap_or((text, ""));
        let layouts = Layout::ALL.map(|layout| (layout.name(), layout));
        let mut options = Self {
            layout: address::choice("layout", name, &layouts)?,
            ..Self::default()
        };
        let mut height = None;
        for (key, value) in address::pairs(rest, '&', &KNOWN)? {
            match key {
                "seed" => options.seed = address::number(key, value, 0..=u64::MAX)?,
                "width" => options.width = even(key, value)?,
                "height" => height = Some(even(key, value)?),
                "depth_width" => options.depth_width = address::number(key, value, 16..=2048)?,
                "pixels" => options.pixels = address::choice(key, value, &PixelKind::NAMES)?,
                "rate" => options.rate = address::number(key, value, 0.1..=1000.0)?,
                "jitter" => options.jitter_seconds = address::number(key, value, 0.0..=1.0)?,
                "drop" => options.drop = address::number(key, value, 0.0..=0.99)?,
                "noise" => options.noise = address::number(key, value, 0.0..=100.0)?,
                "ambient" => options.ambient = address::number(key, value, 0.0..=1000.0)?,
                "flicker" => options.flicker = address::number(key, value, 0.0..=1.0)?,
                _ => {
                    options.real_time =
                        address::choice(key, value, &[("instant", false), ("real", true)])?;
                }
            }
        }
        options.height = height.unwrap_or(options.width * 3 / 8 * 2);
        Ok(options)
    }

    fn address(&self) -> String {
        let Self {
            layout,
            seed,
            width,
            height,
            depth_width,
            rate,
            drop,
            noise,
            ambient,
            flicker,
            ..
        } = self;
        let pixels = PixelKind::NAMES
            .iter()
            .find(|(_, kind)| *kind == self.pixels);
        let pixels = pixels.map_or("rgb8", |(name, _)| name);
        let pace = if self.real_time { "real" } else { "instant" };
        format!(
            "synthetic:{}?seed={seed}&width={width}&height={height}&depth_width={depth_width}\
             &pixels={pixels}&rate={rate}&jitter={}&drop={drop}&noise={noise}&ambient={ambient}\
             &flicker={flicker}&pace={pace}",
            layout.name(),
            self.jitter_seconds,
        )
    }
}

fn even(key: &str, value: &str) -> Result<usize, String> {
    let pixels = address::number(key, value, 16..=8192)?;
    if pixels % 2 == 0 {
        Ok(pixels)
    } else {
        Err(format!("{key}={value}: must be even"))
    }
}

/// The rig.
pub struct Synthetic {
    options: Options,
    world: World,
    /// Light without noise, worked out when first needed.
    layers: Option<Layers>,
}

struct Layers {
    flash: Plane<[f32; 3]>,
    room: Plane<[f32; 3]>,
    tof: world::TimeOfFlight,
}

impl Synthetic {
    /// A device that sees `World::new(&options)`.
    pub fn new(options: Options) -> Self {
        let world = World::new(&options);
        Self {
            options,
            world,
            layers: None,
        }
    }

    /// What it photographs.
    pub fn world(&self) -> &World {
        &self.world
    }
}

/// Exposure and gain it can grant; the mains period is the default, which hides flicker.
const EXPOSURE_SECONDS: (f32, f32, f32) = (0.0001, 0.01, 0.03);
const GAIN: (f32, f32, f32) = (1.0, 1.0, 16.0);

impl Device for Synthetic {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            address: self.options.address(),
            driver: "synthetic".into(),
            model: format!("ray-cast {}", self.options.layout.name()),
            finite: false,
        }
    }

    fn rig(&self) -> Rig {
        self.world.rig()
    }

    fn start(&mut self, settings: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        let device = self.options.address();
        let granted = |setting, asked: Option<f32>, (low, usual, high): (f32, f32, f32)| match asked
        {
            None => Ok(usual),
            Some(value) if value.is_finite() && value > 0.0 => Ok(value.clamp(low, high)),
            Some(value) => Err(DriverError::Setting {
                device: device.clone(),
                setting,
                reason: format!("{value}; possible is {low} to {high}"),
            }),
        };
        let exposure = Exposure {
            seconds: granted(
                "exposure_seconds",
                settings.exposure_seconds,
                EXPOSURE_SECONDS,
            )?,
            gain: granted("gain", settings.gain, GAIN)?,
        };
        settings.check_pattern(&device)?;
        let world = &self.world;
        let layers = self.layers.get_or_insert_with(|| Layers {
            flash: world.flash_light(),
            room: world.room_light(),
            tof: world.time_of_flight(),
        });
        // One second of virtual time: no frame starts before the clock does.
        let started = if self.options.real_time {
            Timestamp::now()
        } else {
            Timestamp::from_nanos(1_000_000_000)
        };
        Ok(Box::new(Running {
            options: &self.options,
            layers,
            settings: settings.clone(),
            exposure,
            device,
            started,
            next: 0,
        }))
    }
}

struct Running<'a> {
    options: &'a Options,
    layers: &'a Layers,
    settings: Settings,
    exposure: Exposure,
    device: String,
    started: Timestamp,
    /// Counts color and depth frames alternately.
    next: u64,
}

/// Where in the frame time the depth camera takes its picture.
const DEPTH_PHASE: f64 = 0.3;

impl Running<'_> {
    fn chance(&self, kind: u64) -> Chance {
        Chance::new(self.options.seed).of(kind)
    }

    /// When the `k`-th frame of a camera starts.
    fn start_of(&self, camera: u64, k: u64) -> Timestamp {
        let period = 1.0 / self.options.rate;
        let jitter = self.options.jitter_seconds * f64::from(self.chance(10 + camera).normal(k));
        let phase = if camera == 0 {
            0.0
        } else {
            DEPTH_PHASE * period
        };
        let offset = k as f64 * period + phase + jitter.clamp(-0.2 * period, 0.2 * period);
        // The first frame comes one frame time after the start, so jitter cannot precede it.
        self.started.after(Duration::from_secs_f64(period + offset))
    }

    fn color(&self, k: u64, at: Timestamp) -> ColorFrame {
        let every = u64::from(self.settings.flash_every);
        let run = u64::from(self.settings.flash_run);
        let light = if every > 0 && (1..=run).contains(&(k % every)) {
            Illumination::Flash
        } else {
            Illumination::Ambient
        };
        let factor = self.exposure.factor();
        let room = self.flicker(at) as f32 * factor;
        let flash = if light == Illumination::Flash {
            factor
        } else {
            0.0
        };
        let mut picture = self.layers.room.clone();
        for (value, lit) in picture
            .samples_mut()
            .iter_mut()
            .zip(self.layers.flash.samples())
        {
            *value = std::array::from_fn(|c| value[c] * room + lit[c] * flash);
        }
        sensor::noisy(
            &mut picture,
            self.exposure.gain,
            self.options.noise,
            self.chance(20).of(k),
        );
        ColorFrame {
            at,
            sequence: k,
            light,
            exposure: self.exposure,
            pixels: sensor::pack(&picture, self.options.pixels),
            transfer: self.options.pixels.transfer(),
            black_level: self.options.pixels.black_level(),
            white_level: 1.0,
        }
    }

    /// Mean of `1 + m cos(2π 100 t)` over the exposure.
    fn flicker(&self, at: Timestamp) -> f64 {
        const TURN: f64 = std::f64::consts::TAU * 100.0;
        // Whole seconds are whole mains periods; leaving them out keeps the phase precise.
        let from = (at.as_nanos() % 1_000_000_000) as f64 * 1e-9;
        let open = f64::from(self.exposure.seconds);
        let wave = ((TURN * (from + open)).sin() - (TURN * from).sin()) / (TURN * open);
        1.0 + self.options.flicker * wave
    }

    fn depth(&self, k: u64, at: Timestamp) -> DepthFrame {
        let tof = &self.layers.tof;
        let (chance, dim) = (self.chance(21).of(k), self.chance(22).of(k));
        let mut metres = tof.metres.clone();
        for ((counter, z), sigma) in (0..).zip(metres.samples_mut()).zip(tof.sigma.samples()) {
            // NaN stays NaN; a wild draw must not pass behind the camera.
            if !z.is_nan() {
                *z = (*z + self.options.noise * sigma * chance.normal(counter)).max(0.001);
            }
        }
        let mut amplitude = tof.amplitude.clone();
        for (counter, value) in (0..).zip(amplitude.samples_mut()) {
            *value =
                (*value + self.options.noise * value.sqrt() * 0.5 * dim.normal(counter)).max(0.0);
        }
        DepthFrame {
            at,
            sequence: k,
            metres,
            amplitude: Some(amplitude),
            sigma: Some(tof.sigma.clone()),
        }
    }
}

impl Stream for Running<'_> {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, patience: Duration) -> Result<Frame, DriverError> {
        let mut left = patience;
        loop {
            let (camera, k) = (self.next % 2, self.next / 2);
            let at = self.start_of(camera, k);
            if self.options.real_time {
                // A frame is there once it has been exposed.
                let there = at.after(Duration::from_secs_f32(self.exposure.seconds));
                let wait = Duration::from_nanos(
                    there.as_nanos().saturating_sub(Timestamp::now().as_nanos()),
                );
                if wait > left {
                    std::thread::sleep(left);
                    return Err(DriverError::Timeout {
                        device: self.device.clone(),
                        patience,
                    });
                }
                left -= wait;
                std::thread::sleep(wait);
            }
            self.next += 1;
            if self.options.drop > 0.0 && self.chance(30 + camera).unit(k) < self.options.drop {
                continue;
            }
            return Ok(if camera == 0 {
                Frame::Color(self.color(k, at))
            } else {
                Frame::Depth(self.depth(k, at))
            });
        }
    }
}
