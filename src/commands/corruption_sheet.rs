//! `corrupt --sheet`: every corruption at every severity on one page.

use super::{CommandError, progress::Progress};
use crate::{
    corruption::{CORRUPTIONS, Corruption, CorruptionError, MOST_SEVERE},
    output::{
        Tone, png,
        sheet::{self, Layout, Panel},
    },
    radiometry,
    shot::Shot,
};
use drivers::Plane;

/// Longer side of a panel, pixels.
const PANEL: usize = 104;
/// Height of a panel's words, pixels.
const WORDS: f32 = 13.0;
/// Shares of a photograph's sides that are shown: its middle.
const SHOWN: usize = 2;

/// The page as PNG. Corruptions of depth show the depth, those of light the light that is left of
/// the flash (middle of the photograph); what cannot be made worse or subtracted is an empty panel.
pub(super) fn drawn(
    name: &str,
    shot: &Shot,
    seed: u64,
    progress: &Progress,
) -> Result<Vec<u8>, CommandError> {
    let clean = Look::of(shot);
    let tone = Tone::robust(clean.light.as_ref());
    let range = sheet::range(&shot.depth.metres);
    let mut panels = Vec::new();
    for (done, corruption) in CORRUPTIONS.iter().enumerate() {
        progress.doing(corruption.name);
        for severity in 0..=MOST_SEVERE {
            let (words, spoiled) = match level(corruption, severity) {
                None => (corruption.name.to_owned(), Ok(shot.clone())),
                Some(level) => (
                    format!("{severity}: {level}"),
                    corruption.on_shot(shot, severity, seed),
                ),
            };
            panels.push(panel(&words, spoiled, corruption, &tone, range).fitted(PANEL));
        }
        progress.reach((done + 1) as f32 / CORRUPTIONS.len() as f32);
    }
    let title = format!(
        "{name}: as it came, then severity 1 to {MOST_SEVERE} of eighteen corruptions, with its level"
    );
    let layout = Layout {
        columns: 1 + usize::from(MOST_SEVERE),
        label: WORDS,
    };
    let page = sheet::lay_out_as(&title, &panels, layout);
    png::rgb8(&page).map_err(|error| CommandError::Damaged(error.to_string()))
}

fn level(corruption: &Corruption, severity: u8) -> Option<f32> {
    let step = usize::from(severity).checked_sub(1)?;
    corruption.levels.get(step).copied()
}

/// What is shown of a shot.
struct Look {
    /// The flash's light in the middle of the photograph, where it can be worked out.
    light: Option<Plane<[f32; 3]>>,
}

impl Look {
    fn of(shot: &Shot) -> Self {
        let light = radiometry::subtract(&shot.flash, &shot.ambient, &Default::default()).ok();
        Self {
            light: light.map(|flash| middle(&flash.light.0)),
        }
    }
}

fn panel(
    words: &str,
    spoiled: Result<Shot, CorruptionError>,
    corruption: &Corruption,
    tone: &Tone,
    range: Option<(f32, f32)>,
) -> Panel {
    let unknown = || {
        Panel::fraction(
            format!("{words}, cannot be"),
            &Plane::filled(PANEL, PANEL, f32::NAN),
        )
    };
    let Ok(spoiled) = spoiled else {
        return unknown();
    };
    if corruption.spoils_depth() {
        return match range {
            Some(range) => Panel::distance_within(words, &spoiled.depth.metres, range),
            None => unknown(),
        };
    }
    match Look::of(&spoiled).light {
        Some(light) => Panel::light(words, &light, tone),
        None => unknown(),
    }
}

/// The middle of a picture, half as wide and as high.
fn middle(plane: &Plane<[f32; 3]>) -> Plane<[f32; 3]> {
    let (width, height) = plane.size();
    let (left, top) = ((width - width / SHOWN) / 2, (height - height / SHOWN) / 2);
    Plane::from_fn((width / SHOWN).max(1), (height / SHOWN).max(1), |x, y| {
        plane[(left + x, top + y)]
    })
}
