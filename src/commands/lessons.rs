//! `lessons`: what the compact networks learn from, made by the very code that feeds them.

use super::{Answer, CommandError, error::InputError, input, progress::Progress};
use crate::{
    config::Config,
    corruption::{Corruption, DepthNoise},
    darkroom::DarkroomError,
    develop::{Development, Options, Stage, develop},
    folder::{Capture, FolderError},
    relight::{
        Lamp, RelightOptions, Shadows,
        networks::{
            Channels,
            compact::{Correction, toward_camera},
        },
    },
    session::SessionError,
    shot::Shot,
};
use clap::Args;
use drivers::{Plane, chance::Chance};
use half::f16;
use safetensors::{Dtype, tensor::TensorView};
use std::path::{Path, PathBuf};

/// What is done to a capture for a lesson, by shares: nothing, the paper's noise, else one or two of these.
const CLEAN: f64 = 0.3;
const PAPER_NOISE: f64 = 0.25;
/// What happens to depth and light in life.
const WAYS: [&str; 7] = [
    "tof-noise",
    "depth-holes",
    "flying-pixels",
    "misalignment",
    "low-depth-resolution",
    "sensor-noise",
    "bright-ambient",
];

/// Arguments of `lessons`.
#[derive(Debug, Args)]
pub struct Lessons {
    /// Capture folders with truth.
    #[arg(value_name = "CAPTURE", required = true)]
    captures: Vec<PathBuf>,
    /// Folder that receives NAME.safetensors, one a capture; those that are there are kept.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Spoil 70 % of the captures: the paper's noise, or what happens to depth and light in life.
    #[arg(long)]
    spoil: bool,
    /// Put the paper's noise on every capture.
    #[arg(long, conflicts_with = "spoil")]
    noisy: bool,
    /// Other dice.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

impl Lessons {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let progress = Progress::of(self.captures.len(), "reading");
        std::fs::create_dir_all(&self.out).map_err(|error| self.unwritten(&self.out, error))?;
        let mut made = 0;
        for path in &self.captures {
            let capture = input::read(path, config)?.capture;
            progress.doing(&capture.name);
            let file = self.out.join(format!("{}.safetensors", capture.name));
            if !file.exists() {
                let lesson = self.lesson(path, &capture)?;
                lesson
                    .write(&file)
                    .map_err(|error| self.unwritten(&file, error))?;
                made += 1;
            }
            progress.step();
        }
        drop(progress);
        let text = format!("{}: {made} lessons", self.out.display());
        Ok(Answer::new(
            text,
            &serde_json::json!({ "out": self.out, "made": made }),
        ))
    }

    fn unwritten(&self, path: &Path, source: std::io::Error) -> CommandError {
        CommandError::Unwritten(FolderError::Io {
            path: path.to_owned(),
            source,
        })
    }

    /// The capture as it may come out of a camera.
    fn spoiled(&self, capture: &Capture) -> Result<Shot, CommandError> {
        let name = blake3::hash(capture.name.as_bytes());
        let key = u64::from_le_bytes(name.as_bytes()[..8].try_into().expect("eight of 32"));
        let dice = Chance::new(self.seed).of(key);
        let shot = &capture.shot;
        let fate = dice.unit(0);
        if self.noisy || (self.spoil && (CLEAN..CLEAN + PAPER_NOISE).contains(&fate)) {
            return Ok(DepthNoise::PAPER.on_shot(shot, dice));
        }
        let mut spoiled = shot.clone();
        if self.spoil && fate >= CLEAN {
            for draw in 0..1 + (dice.unit(1) < 0.5) as u64 {
                let way = (dice.unit(2 + draw) * WAYS.len() as f64) as usize;
                let severity = 1 + (dice.unit(4 + draw) * 4.0) as u8;
                let way = Corruption::named(WAYS[way.min(WAYS.len() - 1)])?;
                spoiled = way.on_shot(&spoiled, severity, dice.bits(6 + draw))?;
            }
        }
        Ok(spoiled)
    }

    fn lesson(&self, path: &Path, capture: &Capture) -> Result<Lesson, CommandError> {
        let lacking = |what: &str| -> CommandError {
            InputError {
                path: path.to_owned(),
                problem: format!("its truth has no {what}"),
                remedy: "name rendered captures, whose truth is whole",
            }
            .into()
        };
        let shot = self.spoiled(capture)?;
        let mut begins = |_: Stage| ();
        let development = develop(&shot, &Options::default(), &mut begins)
            .map_err(|error| SessionError::from(DarkroomError::from(error)))?;
        let truth = capture.truth.as_ref().ok_or_else(|| lacking("pictures"))?;
        let (albedo, normal) = (truth.albedo()?, truth.normal()?);
        let (roughness, depth) = (truth.roughness()?, truth.depth()?);
        let albedo = albedo.ok_or_else(|| lacking("albedo"))?;
        let normal = normal.ok_or_else(|| lacking("normal"))?;
        let roughness = roughness.ok_or_else(|| lacking("roughness"))?;
        let depth = depth.ok_or_else(|| lacking("depth"))?;
        let mut lesson = Lesson::default();
        let given = development.sight(&shot).given();
        if given.size != albedo.0.size() {
            return Err(InputError {
                path: path.to_owned(),
                problem: format!(
                    "is larger than the networks' grid of {}×{}",
                    given.size.0, given.size.1
                ),
                remedy: "render captures of at most 65,536 pixels, sides in steps of 16",
            }
            .into());
        }
        lesson.channels("sight", &given);
        lesson.channels("view", &toward_camera(&development.scene));
        lesson.colors("truth.albedo", &[&albedo.0]);
        lesson.colors("truth.normal", &[&normal.map(|n| [n.x, -n.y, -n.z])]);
        lesson.plane("truth.roughness", &roughness);
        let metres = development.scene.depth_metres.samples().iter();
        let steps = metres
            .zip(depth.samples())
            .map(|(z, truth)| truth / z - 1.0);
        let steps = Plane::new(depth.width(), depth.height(), steps.collect());
        lesson.plane("truth.depth", &steps.expect("one per pixel"));
        lesson.lamps(&development, truth)?;
        Ok(lesson)
    }
}

/// Named arrays of one capture.
#[derive(Default)]
struct Lesson(Vec<(String, Dtype, Vec<usize>, Vec<u8>)>);

impl Lesson {
    fn add(&mut self, name: &str, dtype: Dtype, shape: Vec<usize>, bytes: Vec<u8>) {
        self.0.push((name.to_owned(), dtype, shape, bytes));
    }

    fn halves(&mut self, name: &str, shape: Vec<usize>, values: impl Iterator<Item = f32>) {
        let bytes = values.flat_map(|value| f16::from_f32(value).to_le_bytes());
        self.add(name, Dtype::F16, shape, bytes.collect());
    }

    /// Channels × height × width.
    fn channels(&mut self, name: &str, channels: &Channels) {
        let shape = vec![channels.count, channels.size.1, channels.size.0];
        self.halves(name, shape, channels.samples.iter().copied());
    }

    /// 1 × height × width.
    fn plane(&mut self, name: &str, plane: &Plane<f32>) {
        let shape = vec![1, plane.height(), plane.width()];
        self.halves(name, shape, plane.samples().iter().copied());
    }

    /// Pictures × 3 × height × width.
    fn colors(&mut self, name: &str, pictures: &[&Plane<[f32; 3]>]) {
        let Some((width, height)) = pictures.first().map(|plane| plane.size()) else {
            return;
        };
        let values = pictures.iter().flat_map(|picture| {
            (0..3).flat_map(move |c| picture.samples().iter().map(move |pixel| pixel[c]))
        });
        self.halves(name, vec![pictures.len(), 3, height, width], values);
    }

    /// Shares as bytes: pictures × height × width.
    fn shares(&mut self, name: &str, pictures: &[&Plane<f32>]) {
        let Some((width, height)) = pictures.first().map(|plane| plane.size()) else {
            return;
        };
        let samples = pictures.iter().flat_map(|picture| picture.samples());
        // Unknown is 0, like all that networks are fed.
        let bytes = samples.map(|share| (255.0 * share).round() as u8).collect();
        self.add(name, Dtype::U8, vec![pictures.len(), height, width], bytes);
    }

    /// The closed form under every true lamp, and the truth.
    fn lamps(
        &mut self,
        development: &Development,
        truth: &crate::folder::Truth,
    ) -> Result<(), CommandError> {
        let Development {
            scene, prepared, ..
        } = development;
        let correction = Correction::of(scene, prepared);
        self.channels("ground", &correction.ground().planes);
        self.colors("albedo", &[&scene.albedo]);
        // What the network corrects.
        let corrected = RelightOptions {
            shadows: Shadows::Guessed,
            ..RelightOptions::default()
        };
        let (mut toward, mut told) = (Vec::new(), Vec::new());
        let (mut closed, mut swept) = (Vec::new(), Vec::new());
        for light in &truth.lights {
            let (picture, Some(shadow)) = light.load()? else {
                continue;
            };
            let lamp = Lamp::from_person(light.toward_person).map_err(|error| InputError {
                path: light.image.clone(),
                problem: error.to_string(),
                remedy: "mend truth/lights.toml",
            })?;
            toward.extend(lamp.person_direction());
            closed.push(prepared.relight(&lamp, corrected));
            swept.push(correction.swept(prepared, &lamp));
            told.push((picture.0, shadow));
        }
        let bytes = toward.iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
        self.add("toward", Dtype::F32, vec![closed.len(), 3], bytes);
        self.colors(
            "closed",
            &closed.iter().map(|one| &one.light.0).collect::<Vec<_>>(),
        );
        self.colors(
            "direct",
            &swept.iter().map(|one| &one.direct).collect::<Vec<_>>(),
        );
        self.colors(
            "truth.relit",
            &told.iter().map(|(light, _)| light).collect::<Vec<_>>(),
        );
        let seen: Vec<_> = closed.iter().map(|one| &one.shadow).collect();
        self.shares("seen", &seen);
        self.shares(
            "thin",
            &swept.iter().map(|one| &one.doubted[1]).collect::<Vec<_>>(),
        );
        self.shares(
            "thick",
            &swept.iter().map(|one| &one.doubted[2]).collect::<Vec<_>>(),
        );
        self.shares(
            "truth.shadow",
            &told.iter().map(|(_, shadow)| shadow).collect::<Vec<_>>(),
        );
        Ok(())
    }

    /// The file appears whole or not at all.
    fn write(&self, file: &Path) -> std::io::Result<()> {
        let views = self.0.iter().map(|(name, dtype, shape, bytes)| {
            let view = TensorView::new(*dtype, shape.clone(), bytes);
            (
                name.as_str(),
                view.expect("as many bytes as the shape says"),
            )
        });
        let folder = file.parent().unwrap_or(Path::new("."));
        let part = tempfile::NamedTempFile::new_in(folder)?;
        let bytes = safetensors::serialize(views, None).map_err(std::io::Error::other)?;
        std::fs::write(part.path(), bytes)?;
        part.persist(file)?;
        Ok(())
    }
}
