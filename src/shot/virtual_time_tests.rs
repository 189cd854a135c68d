//! Flashes that obey late, over 100 000 shots, and shutters that roll while they do.

use super::{Assembler, Limits, Shot};
use drivers::{
    ColorFrame, DepthFrame, Device, DeviceInfo, Distortion, DriverError, Exposure, FlashLamp,
    Frame, Illumination, Intrinsics, Pixels, Plane, Rig, Settings, Stream, Timestamp, Transfer,
    chance::Chance,
    flaky::{Faults, Flaky},
    trigger::{Open, Switched},
};
use glam::DVec3;
use std::{collections::HashMap, time::Duration};

const SHOTS: u32 = 100_000;
const SIZE: usize = 16;
const MS: u64 = 1_000_000;
const PERIOD: u64 = 33_333_333;
const EXPOSURE: Exposure = Exposure {
    seconds: 0.01,
    gain: 1.0,
};

fn rig() -> Rig {
    Rig {
        color: Intrinsics {
            width: SIZE,
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
            beam: drivers::Beam::default(),
        },
    }
}

/// A room of which `flash(y)` of the flash's light reached row `y`; `wall(y)` multiplies the room's.
fn photograph(
    k: u64,
    light: Illumination,
    flash: impl Fn(usize) -> f32 + Sync,
    wall: impl Fn(usize) -> f32 + Sync,
) -> ColorFrame {
    let chance = Chance::new(17).of(k);
    let pixels = Plane::from_fn(SIZE, SIZE, |x, y| {
        let seen = 60.0 * wall(y) + flash(y) * (40.0 + 3.0 * x as f32);
        let noise = 0.4 * chance.normal((y * SIZE + x) as u64);
        [(seen + noise).round() as u8; 3]
    });
    ColorFrame {
        at: Timestamp::from_nanos(1000 * MS + k * PERIOD),
        sequence: k,
        light,
        exposure: EXPOSURE,
        pixels: Pixels::Rgb8(pixels),
        transfer: Transfer::Linear,
        black_level: 0.0,
        white_level: 1.0,
    }
}

fn depth(k: u64) -> DepthFrame {
    DepthFrame {
        at: Timestamp::from_nanos(1000 * MS + k * PERIOD + 5 * MS),
        sequence: k,
        metres: Plane::filled(SIZE, SIZE, 1.0),
        amplitude: None,
        sigma: None,
    }
}

/// A camera whose flash really fires on every third frame, in no time at all.
struct Carousel {
    settings: Settings,
    pictures: Vec<Frame>,
    next: u64,
}

fn fires(k: u64) -> bool {
    k % 3 == 1
}

impl Carousel {
    fn new() -> Self {
        let picture = |k: u64| {
            let (light, flash) = if fires(k) {
                (Illumination::Flash, 1.0)
            } else {
                (Illumination::Ambient, 0.0)
            };
            Frame::Color(photograph(k, light, |_| flash, |_| 1.0))
        };
        Self {
            settings: Settings::default(),
            pictures: (0..60).map(picture).collect(),
            next: 0,
        }
    }
}

impl Device for Carousel {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            address: "carousel:".into(),
            driver: "carousel".into(),
            model: "sixty pictures over and over".into(),
            finite: false,
        }
    }

    fn rig(&self) -> Rig {
        rig()
    }

    fn start(&mut self, _: &Settings) -> Result<Box<dyn Stream + '_>, DriverError> {
        Ok(Box::new(self))
    }
}

impl Stream for &mut Carousel {
    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn next_frame(&mut self, _: Duration) -> Result<Frame, DriverError> {
        let k = self.next / 2;
        self.next += 1;
        if self.next.is_multiple_of(2) {
            return Ok(Frame::Depth(depth(k)));
        }
        let mut frame = self.pictures[k as usize % self.pictures.len()].clone();
        if let Frame::Color(color) = &mut frame {
            color.sequence = k;
            color.at = Timestamp::from_nanos(1000 * MS + k * PERIOD);
        }
        Ok(frame)
    }
}

#[test]
fn of_100_000_shots_by_a_driver_that_trusts_late_commands_none_is_mislabelled() {
    let faults = "latency=6,drop=0.05,duplicate=0.05,delay=0.02,swap=0.05,jitter=0.002,seed=3";
    let mut device = Flaky::new(Box::new(Carousel::new()), Faults::parse(faults).unwrap());
    let mut stream = device.start(&Settings::default()).unwrap();
    let mut assembler = Assembler::new(rig(), Limits::default());
    let (mut shots, mut wrong) = (0, 0);
    while shots < SHOTS {
        let Some(shot) = assembler.push(stream.next_frame(Duration::ZERO).unwrap()) else {
            continue;
        };
        shots += 1;
        let lies = shot.ambient.iter().any(|frame| fires(frame.sequence));
        wrong += u32::from(lies || !fires(shot.flash.sequence));
    }
    let drops = assembler.drops();
    eprintln!(
        "figure | shots of a driver that trusts commands which land 0 to 6 frames late, with drops, duplicates and jitter | \
         {shots}, {wrong} mislabelled; {} frames whose pixels contradicted their label left out",
        drops.contradicted
    );
    // The driver did lie, and often.
    assert!(drops.contradicted > u64::from(SHOTS), "{drops:?}");
    assert!(drops.duplicate > u64::from(SHOTS) / 20, "{drops:?}");
    assert_eq!(wrong, 0, "{drops:?}");
}

/// A rolling shutter under a flash that is switched by commands, each of which lands 0 to 6 frames
/// late, on a clock of its own.
struct Rolling {
    chance: Chance,
    k: u64,
    /// When the flash changed, and to what.
    changes: Vec<(u64, bool)>,
    commands: u64,
}

/// From the first row to the last.
const READOUT: u64 = 20 * MS;
/// Times are off by this at most.
const JITTER: u64 = 3 * MS;

impl Rolling {
    fn command(&mut self, on: bool, now: u64) {
        let late = (self.chance.of(1).unit(self.commands) * 6.0 * PERIOD as f64) as u64;
        self.commands += 1;
        // Commands are obeyed in their order.
        let after = self.changes.last().map_or(0, |change| change.0);
        self.changes.push(((now + late).max(after), on));
        if self.changes.len() > 8 {
            self.changes.remove(0);
        }
    }

    /// Share of the exposure of row `y` of frame `k` in which the flash burned.
    fn lit(&self, k: u64, y: usize) -> f32 {
        let from = 1000 * MS + k * PERIOD + READOUT * y as u64 / (SIZE as u64 - 1);
        let until = from + 10 * MS;
        let mut burned = 0;
        for (place, (at, on)) in self.changes.iter().enumerate() {
            let end = self.changes.get(place + 1).map_or(u64::MAX, |next| next.0);
            if *on {
                burned += end.min(until).saturating_sub((*at).max(from));
            }
        }
        burned as f32 / (until - from) as f32
    }

    /// Stated time of frame `k`.
    fn stated(&self, k: u64) -> u64 {
        let off = self.chance.of(2).unit(k) * 2.0 * JITTER as f64;
        1000 * MS + k * PERIOD - JITTER + off as u64
    }

    fn happens(&self, kind: u64, probability: f64) -> bool {
        self.chance.of(kind).unit(self.k) < probability
    }
}

#[test]
fn of_100_000_shots_with_a_flash_switched_in_software_none_is_mislabelled_or_partly_lit() {
    let mut camera = Rolling {
        chance: Chance::new(8),
        k: 0,
        changes: Vec::new(),
        commands: 0,
    };
    // What the driver knows of the device: the longest latency, the readout, and how far off times are.
    let latency = Duration::from_nanos(6 * PERIOD + 2 * JITTER);
    let readout = Duration::from_nanos(READOUT + 2 * JITTER);
    let mut flash = Switched::new(latency, (1, 3), Timestamp::from_nanos(900 * MS));
    let mut assembler = Assembler::new(
        rig(),
        Limits {
            // Frames of known light lie up to 14 frames apart.
            bracket_seconds: 0.6,
            ..Limits::default()
        },
    );
    let mut truth: HashMap<u64, (f32, f32)> = HashMap::new();
    let mut held: Vec<(u64, Frame)> = Vec::new();
    let (mut shots, mut wrong, mut of_no_light, mut partly) = (0, 0, 0u64, 0u64);
    let judge = |shot: &Shot, truth: &HashMap<u64, (f32, f32)>| {
        let whole = |k: u64, share: f32| truth[&k] == (share, share);
        !whole(shot.flash.sequence, 1.0)
            || shot.ambient.iter().any(|frame| !whole(frame.sequence, 0.0))
    };
    while shots < SHOTS {
        let k = camera.k;
        camera.k += 1;
        let rows: Vec<f32> = (0..SIZE).map(|y| camera.lit(k, y)).collect();
        let least = rows.iter().copied().fold(1.0, f32::min);
        let most = rows.iter().copied().fold(0.0, f32::max);
        partly += u64::from(least < most);
        let at = Timestamp::from_nanos(camera.stated(k));
        let light = flash.light(Open::new(at, EXPOSURE, readout));
        // A frame is there once it was read, and may wait in a queue.
        let queue = (camera.chance.of(3).unit(k) * 20.0 * MS as f64) as u64;
        let now = 1000 * MS + k * PERIOD + 10 * MS + READOUT + queue;
        if camera.happens(4, 0.05) {
            continue;
        }
        if let Some(on) = flash.next_command(light) {
            flash.commanded(on, Timestamp::from_nanos(now));
            camera.command(on, now);
        }
        let mut arrivals = Vec::new();
        match light {
            Some(light) => {
                truth.insert(k, (least, most));
                truth.retain(|old, _| old + 200 > k);
                let mut frame = photograph(k, light, |y| rows[y], |_| 1.0);
                frame.at = at;
                arrivals = vec![Frame::Color(frame), Frame::Depth(depth(k))];
            }
            None => of_no_light += 1,
        }
        for frame in arrivals {
            let late = (camera.chance.of(5).unit(k) * 3.0) as u64;
            if camera.happens(6, 0.05) {
                held.push((k + 4, frame.clone()));
            }
            held.push((k + late, frame));
        }
        let (due, waiting) = held.into_iter().partition(|(when, _)| *when <= k);
        held = waiting;
        for (_, frame) in due {
            if let Some(shot) = assembler.push(frame) {
                shots += 1;
                wrong += u32::from(judge(&shot, &truth));
            }
        }
    }
    let drops = assembler.drops();
    eprintln!(
        "figure | shots of a rolling shutter, its flash switched by commands that land 0 to 6 frames late | {shots}, {wrong} \
         mislabelled or lit in part; {of_no_light} frames of unknown light left out, {partly} of them lit in part"
    );
    assert_eq!(wrong, 0, "{drops:?}");
    // Frames of no known light were many, and those that the flash lit in part were among them.
    assert!(
        partly > u64::from(SHOTS) && of_no_light > partly,
        "{partly} of {of_no_light}"
    );
    assert_eq!((drops.contradicted, drops.partly_lit), (0, 0), "{drops:?}");
    assert!(drops.duplicate > u64::from(SHOTS) / 20, "{drops:?}");
}

#[test]
fn a_flash_that_lit_a_part_of_the_rows_is_refused_but_a_far_background_is_not() {
    struct Case {
        name: &'static str,
        flash: fn(usize) -> f32,
        wall: fn(usize) -> f32,
        shots: usize,
        partly_lit: u64,
    }
    const LIT: fn(usize) -> f32 = |_| 1.0;
    for case in [
        Case {
            name: "whole",
            flash: LIT,
            wall: LIT,
            shots: 1,
            partly_lit: 0,
        },
        Case {
            name: "came too late for the upper rows",
            flash: |y| f32::from(y >= 5),
            wall: LIT,
            shots: 0,
            partly_lit: 1,
        },
        Case {
            name: "ended before the lower rows",
            flash: |y| f32::from(y < 12),
            wall: LIT,
            shots: 0,
            partly_lit: 1,
        },
        Case {
            name: "shorter than the readout",
            flash: |y| f32::from((4..9).contains(&y)),
            wall: LIT,
            shots: 0,
            partly_lit: 1,
        },
        Case {
            name: "a table before a room that is too far and darker",
            flash: |y| f32::from(y >= 6),
            wall: |y| if y >= 6 { 1.0 } else { 0.7 },
            shots: 1,
            partly_lit: 0,
        },
        Case {
            name: "a floor that runs away from the camera",
            flash: |y| (y as f32 / 15.0).powi(2),
            wall: LIT,
            shots: 1,
            partly_lit: 0,
        },
    ] {
        let mut assembler = Assembler::new(rig(), Limits::default());
        let ambient = |k| photograph(k, Illumination::Ambient, |_| 0.0, case.wall);
        let frames = [
            Frame::Color(ambient(0)),
            Frame::Color(photograph(1, Illumination::Flash, case.flash, case.wall)),
            Frame::Depth(depth(1)),
            Frame::Color(ambient(2)),
        ];
        let shots = frames
            .into_iter()
            .filter_map(|frame| assembler.push(frame))
            .count();
        let found = (shots, assembler.drops().partly_lit);
        assert_eq!(found, (case.shots, case.partly_lit), "{}", case.name);
    }
}
