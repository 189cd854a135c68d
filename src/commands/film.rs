//! `film`: a capture folder or a recording under a light that moves.

mod interrupt;
mod path;

use super::{
    Answer, CommandError,
    error::ResultError,
    inference::TierArguments,
    input,
    lights::{LightArguments, TurningMap},
    progress::Progress,
};
use crate::{
    api::LightError,
    config::Config,
    darkroom::{Moment, Order, Reel, Source},
    output::{self, FilmFormat, Tone},
    relight::{Luminaire, Relit},
    session::SessionError,
};
use clap::Args;
use drivers::Plane;
use image::{ImageBuffer, Rgb, imageops};
use interrupt::Interrupt;
use path::LightPath;
use std::path::PathBuf;

/// Moments of a film by which what is the same in all of its frames is chosen.
const PROBES: usize = 5;

/// Arguments of `film`.
#[derive(Debug, Args)]
pub struct Film {
    /// A capture folder, or a recording (.mcap), of which the first shot is taken.
    #[arg(value_name = "FOLDER|RECORDING")]
    input: PathBuf,
    /// How the light moves: orbit[:DEGREES] (a distant light around the camera's axis, so far off it [45]),
    /// arc[:DEGREES] (from so far left [75] over straight ahead to the right), turn (the --environment once
    /// around), or a TOML file of [[key]] tables, each with seconds = s, what a [[light]] of --lights has, and
    /// rotate_environment = degrees where there is one.
    #[arg(long, value_name = "PATH")]
    path: LightPath,
    /// Lights that shine in all frames besides.
    #[command(flatten)]
    lights: LightArguments,
    /// Length [default: that of the keys, else 4].
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Frames per second.
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u16).range(1..=60))]
    fps: u16,
    /// Most pixels across; a larger photograph is made smaller.
    #[arg(long, value_name = "PIXELS", default_value_t = 960, value_parser = clap::value_parser!(u16).range(16..))]
    width: u16,
    #[command(flatten)]
    tier: TierArguments,
    /// The file to write, which must not exist yet: .webp (animated, small), or .apng or .png (animated,
    /// without loss).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Film {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let extension = self.out.extension().unwrap_or_default().to_string_lossy();
        let format: FilmFormat = extension.parse().map_err(|problem| {
            CommandError::Arguments(format!("--out {}: {problem}", self.out.display()))
        })?;
        if self.tier.asked()?.budget.is_some() {
            return Err(CommandError::Arguments(
                "--budget is for one light, not for a film; leave it out".to_owned(),
            ));
        }
        let progress = Progress::of_unknown("reading");
        let light = Lights::read(&self)?;
        let seconds = self.seconds.or(self.path.seconds()).unwrap_or(4.0);
        let frames = (seconds * f64::from(self.fps)).round();
        // A cast from float saturates and takes NaN to 0: the film refuses both.
        let frames = frames as usize;
        if !(1..=output::film::MOST_FRAMES).contains(&frames) {
            return Err(CommandError::Arguments(format!(
                "{seconds} s at {} frames per second are {frames} frames; a film has 1 to {}",
                self.fps,
                output::film::MOST_FRAMES
            )));
        }
        let moments = |of: usize| {
            (0..of)
                .map(move |frame| (frame as f64 + 0.5) / of as f64)
                .map(|at| light.at(at))
        };
        let probes = moments(PROBES.min(frames)).collect::<Result<Vec<Moment>, _>>()?;
        let lamps: Vec<Luminaire> = probes
            .iter()
            .flat_map(|probe| probe.lamps.clone())
            .collect();
        let (answering, said) = self.tier.ready(config)?;
        let capture = input::read(&self.input, config)?.capture;
        let order = Order {
            shot: &capture.shot,
            source: Source {
                name: &self.input.display().to_string(),
                drops: None,
                burst: None,
            },
            lamps: &lamps,
            environment: None,
            answering: &answering,
            warnings: Vec::new(),
            attachments: &[],
        };
        let size = self.size(capture.shot.flash.pixels.size());
        let mut film = output::Film::begin(&self.out, format, size, frames, self.fps)?;
        let undeveloped = |error| CommandError::from(SessionError::from(error));
        let mut reel =
            Reel::new(&order, &mut |stage| progress.doing(stage)).map_err(undeveloped)?;
        progress.doing("choosing the exposure");
        let tone = reel.tone(&probes).map_err(undeveloped)?;
        drop(progress);
        let progress = Progress::of(frames, "frames");
        let mut interrupt = Interrupt::listen();
        for frame in 0..frames {
            if interrupt.came() {
                return Err(ResultError {
                    path: self.out,
                    problem: format!(
                        "interrupted after {frame} of {frames} frames; nothing is left"
                    ),
                    remedy: "make it again, shorter (--seconds) or smaller (--width)",
                }
                .into());
            }
            let moment = light.at(frame as f64 / frames as f64)?;
            let relit = reel.lit(&moment).map_err(undeveloped)?;
            film.push(&shown(&relit, &tone, size))?;
            progress.step();
        }
        let bytes = film.finish()?;
        drop(progress);
        let (width, height) = size;
        let terms = reel.terms();
        let text = format!(
            "{}: {frames} frames of {width}×{height}, {seconds:.1} s, {:.1} MB\n  {terms}",
            self.out.display(),
            bytes as f64 / 1e6
        );
        let large = lamps.iter().any(|lamp| matches!(lamp, Luminaire::Area(_)));
        let json = serde_json::json!({
            "out": self.out, "frames": frames, "width": width, "height": height, "seconds": seconds,
            "bytes": bytes, "terms": terms, "white": tone.white(),
            "small_lights_of_a_large_one": large.then(|| reel.lamps_of_large()),
        });
        Ok(Answer::new(text, &json).with_warnings(said))
    }

    /// Of the frames of a photograph so large.
    fn size(&self, (width, height): (usize, usize)) -> (usize, usize) {
        let most = usize::from(self.width);
        if width <= most {
            return (width, height);
        }
        (most, (height * most).div_ceil(width))
    }
}

/// What shines in a film.
struct Lights {
    path: LightPath,
    fixed: Vec<Luminaire>,
    environment: Option<TurningMap>,
}

impl Lights {
    fn read(film: &Film) -> Result<Self, CommandError> {
        let fixed = film.lights.read()?.into_iter().enumerate();
        let fixed = fixed.map(|(index, light)| {
            let lamp = light.luminaire();
            lamp.map_err(|fault| LightError::Lamp { index, fault })
        });
        let environment = film.lights.read_map()?;
        if film.path.turns() && environment.is_none() {
            return Err(CommandError::Arguments(
                "--path turns the environment, but there is none; add --environment MAP".to_owned(),
            ));
        }
        Ok(Self {
            path: film.path.clone(),
            fixed: fixed.collect::<Result<_, _>>()?,
            environment,
        })
    }

    /// After a share of the film, 0 to 1.
    fn at(&self, share: f64) -> Result<Moment, CommandError> {
        let (light, degrees) = self.path.at(share);
        let mut lamps = self.fixed.clone();
        if let Some(light) = light {
            let lamp = light.luminaire();
            lamps.push(lamp.map_err(|fault| LightError::Lamp {
                index: lamps.len(),
                fault,
            })?);
        }
        let environment = self.environment.as_ref();
        Ok(Moment {
            lamps,
            environment: environment.map(|map| map.turned(degrees)).transpose()?,
        })
    }
}

/// A frame, as bright as its tone has it; what is unknown is black.
fn shown(relit: &Relit, tone: &Tone, size: (usize, usize)) -> Plane<[u8; 3]> {
    let srgb = |light: &[f32; 3]| tone.srgb8(*light).unwrap_or_default();
    let light = &relit.light.0;
    if light.size() == size {
        return light.map(srgb);
    }
    // Light is averaged, not what is shown of it.
    let known = light.map(|light| light.map(|value| if value.is_nan() { 0.0 } else { value }));
    let (width, height) = known.size();
    let samples = known.samples().as_flattened().to_vec();
    let picture: ImageBuffer<Rgb<f32>, Vec<f32>> =
        ImageBuffer::from_raw(width as u32, height as u32, samples).expect("three to a pixel");
    let (width, height) = size;
    let small = imageops::resize(
        &picture,
        width as u32,
        height as u32,
        imageops::FilterType::Triangle,
    );
    Plane::from_fn(width, height, |x, y| {
        srgb(&small.get_pixel(x as u32, y as u32).0)
    })
}
