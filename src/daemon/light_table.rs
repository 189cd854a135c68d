//! Kept shots in memory, ready for any light: what a dragged light asks.

use super::picture::Picture;
use crate::{
    api::{CheckedLights, Detail, Fault, FaultKind, Layer},
    config::Capture,
    develop::{Development, Options, develop},
    output::{FRAMES, Tone},
    radiometry::{LinearImage, linearise},
    relight::{Lamp, LightSet, RelightOptions, Relit, summed, visibility::VisibilityMap},
    session,
    shot::Shot,
};
use drivers::{Plane, replay::Replay};
use std::{convert::Infallible, path::PathBuf, sync::mpsc::Receiver};
use tokio::sync::oneshot;

/// Shots that stay developed: the one that is looked at, and the one before.
const SHOTS: usize = 2;
/// Pixels of a view that must be quick.
const QUICK_PIXELS: usize = 512 * 512;

/// A view that is asked for.
pub(super) struct Look {
    /// The shot.
    pub id: String,
    /// Where it lies.
    pub folder: PathBuf,
    /// What to show.
    pub layer: Layer,
    /// How fine.
    pub detail: Detail,
    /// Under which lights.
    pub lights: CheckedLights,
    /// Hears of the picture. It is packed elsewhere, while the table turns to the next light.
    pub reply: oneshot::Sender<Result<Picture, Fault>>,
}

/// A shot on the table.
struct Lying {
    id: String,
    detail: Detail,
    shot: Shot,
    development: Development,
    /// Which directions every pixel sees, once somebody asked for an environment.
    map: Option<VisibilityMap>,
    /// One exposure for all lights, so that a light that moves does not make the picture flicker.
    tone: Tone,
}

/// Answers until nobody can ask any more. The table is this thread's alone.
pub(super) fn run(looks: &Receiver<Look>) {
    let mut table: Vec<Lying> = Vec::new();
    while let Ok(look) = looks.recv() {
        if look.reply.is_closed() {
            continue;
        }
        let found =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| answer(&mut table, &look)));
        let answered = found.unwrap_or_else(|_| {
            table.clear();
            Err(Fault {
                kind: FaultKind::Daemon,
                message: format!("{}: the view failed in the daemon", look.id),
                remedy: Some("report this as a bug, with the daemon's log".to_owned()),
            })
        });
        // Whoever asked may have gone on to the next light.
        drop(look.reply.send(answered));
    }
}

fn answer(table: &mut Vec<Lying>, look: &Look) -> Result<Picture, Fault> {
    let at = table
        .iter()
        .position(|lying| lying.id == look.id && lying.detail == look.detail);
    let mut lying = match at {
        Some(at) => table.remove(at),
        None => {
            table.truncate(SHOTS - 1);
            lay(look)?
        }
    };
    let picture = lying.picture(look);
    table.insert(0, lying);
    picture
}

/// Reads a shot's frames and develops them.
fn lay(look: &Look) -> Result<Lying, Fault> {
    let fault = |kind, problem: String| Fault {
        kind,
        message: format!("{}: {problem}", look.id),
        remedy: None,
    };
    let path = look.folder.join(FRAMES);
    let mut replay = Replay::open(&path).map_err(|error| {
        let problem = format!("its frames cannot be read: {error}");
        fault(session::kind_of(&error), problem)
    })?;
    let taken =
        session::take(&mut replay, &Capture::default(), None).map_err(|error| error.fault())?;
    let working_pixels = match look.detail {
        Detail::Quick => QUICK_PIXELS,
        Detail::Full => Options::default().working_pixels,
    };
    let options = Options {
        working_pixels,
        ..Options::default()
    };
    let development = develop(&taken.shot, &options, &mut |_| {})
        .map_err(|error| fault(FaultKind::Shot, error.to_string()))?;
    let tone = if development.scene.scale_known {
        Tone::absolute()
    } else {
        let front = Lamp::from_person([0.0, 0.0, 1.0])
            .map_err(|error| fault(FaultKind::Daemon, error.to_string()))?;
        let lit = development
            .prepared
            .relight(&front, RelightOptions::default());
        Tone::robust([&lit.light.0])
    };
    Ok(Lying {
        id: look.id.clone(),
        detail: look.detail,
        shot: taken.shot,
        development,
        map: None,
        tone,
    })
}

impl Lying {
    fn picture(&mut self, look: &Look) -> Result<Picture, Fault> {
        let scene = &self.development.scene;
        Ok(match look.layer {
            Layer::Relit => Picture::light(&self.lit(&look.lights).0.0, &self.tone),
            Layer::Shadow => Picture::fraction(&self.lit(&look.lights).1),
            Layer::Flash => self.photograph(Some(&self.shot.flash))?,
            Layer::Ambient => self.photograph(self.shot.ambient.first())?,
            Layer::Albedo => {
                let tone = if scene.scale_known {
                    Tone::absolute()
                } else {
                    Tone::robust([&scene.albedo])
                };
                Picture::light(&scene.albedo, &tone)
            }
            Layer::Normals => Picture::normals(&scene.normal),
            Layer::Roughness => Picture::fraction(&scene.roughness),
            Layer::Depth => Picture::distance(&scene.depth_metres),
            Layer::Confidence => Picture::fraction(&scene.confidence),
        })
    }

    /// The sum of all lights, and what share of them arrives.
    fn lit(&mut self, lights: &CheckedLights) -> (LinearImage, Plane<f32>) {
        let prepared = &self.development.prepared;
        let lamps = lights.lamps.iter();
        let lamps = lamps.flat_map(|lamp| self.development.emitters(lamp).0);
        let mut answers: Vec<Relit> = lamps
            .map(|lamp| prepared.relight(lamp, RelightOptions::default()))
            .collect();
        if let Some((_, environment)) = &lights.environment {
            // Of all directions, so that an environment that is turned needs no other.
            let map = self
                .map
                .get_or_insert_with(|| prepared.visibility_map(&LightSet::everywhere()));
            let few = self.development.light_set(environment, map).0;
            answers.push(prepared.environment(map, &few, RelightOptions::default()));
        }
        let sum = summed(answers.into_iter().map(Ok::<_, Infallible>));
        let sum = sum.unwrap_or_else(|never| match never {});
        let sum = sum.unwrap_or_else(|| prepared.dark());
        (sum.light, sum.shadow)
    }

    /// A photograph as it was taken, on the table's own grid.
    fn photograph(&self, frame: Option<&drivers::ColorFrame>) -> Result<Picture, Fault> {
        let frame = frame.ok_or_else(|| Fault {
            kind: FaultKind::Shot,
            message: format!("{}: holds no photograph without flash", self.id),
            remedy: None,
        })?;
        let light = linearise(frame).map_err(|error| Fault {
            kind: FaultKind::Shot,
            message: format!("{}: {error}", self.id),
            remedy: None,
        })?;
        let (width, height) = self.development.prepared.size();
        let full = light.0.size();
        let factor = (full.0 / width.max(1)).max(1);
        let small = Plane::from_fn(width, height, |x, y| {
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for v in (y * factor)..((y + 1) * factor).min(full.1) {
                for u in (x * factor)..((x + 1) * factor).min(full.0) {
                    let pixel = light.0[(u, v)];
                    // Clipped light is at least white.
                    let known = !pixel[0].is_nan();
                    let brightest = 1.0 / frame.exposure.factor();
                    for (sum, value) in sum.iter_mut().zip(pixel) {
                        *sum += if known { value } else { brightest };
                    }
                    count += 1.0;
                }
            }
            sum.map(|sum| sum / f32::max(count, 1.0))
        });
        Ok(Picture::light(&small, &Tone::robust([&small])))
    }
}
