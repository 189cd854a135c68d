//! What should lower the trust in an answer, in words.

use crate::{develop::Development, radiometry::AlignmentOutcome, relight::Relit, verdict::Verdict};
use drivers::Plane;

/// Fraction of pixels from which something is worth a warning.
const WORTH_SAYING: f32 = 0.25;
/// Fraction of pixels whose way to the light leaves the picture from which that is worth a warning:
/// under a slanted light it does so for half of any picture.
const UNSEEN: f32 = 0.75;

/// All doubts: what the verdict calls harmful, worst first, then what it does not judge or has not
/// said. `labels` name the lights of `relit`.
pub(super) fn doubts(
    labels: &[String],
    development: &Development,
    verdict: Option<&Verdict>,
    relit: &[Relit],
) -> Vec<String> {
    let harmful = verdict.map_or_else(Vec::new, Verdict::harmful);
    let said = |mode: &str| harmful.iter().any(|finding| finding.mode == mode);
    let mut doubts: Vec<String> = harmful.iter().filter_map(|f| f.words.clone()).collect();
    let found = &development.flash_only.report;
    let known = fraction(&development.registered.metres, |metres| !metres.is_nan());
    let confidence = mean_confidence(development);
    let mut doubt = |applies: bool, words: String| {
        if applies {
            doubts.push(words);
        }
    };
    let percent = |fraction: f32| format!("{:.0} %", 100.0 * fraction);
    doubt(
        found.weak_fraction > WORTH_SAYING && !said("bright-ambient") && !said("sensor-noise"),
        format!(
            "the flash is weak: {} of its light is within the noise (median {:.1} dB); go nearer or darken the room",
            percent(found.weak_fraction),
            found.snr_db
        ),
    );
    doubt(
        !development.scene.flash_lit,
        "the photograph does not look lit by a flash at the lens (its light does not fall off with distance and slant): it is taken as evenly lit, and its own shading stays in the albedo; take one photograph with the flash and one without"
            .into(),
    );
    doubt(
        found.clipped_fraction > WORTH_SAYING && !said("flash-saturation"),
        format!(
            "{} of the photograph is clipped and has no answer; shorten the exposure or step back",
            percent(found.clipped_fraction)
        ),
    );
    doubt(
        found.alignment == AlignmentOutcome::NotAsked,
        "the photographs were subtracted as they lie: the budget has no time to align them; if the camera is held by hand, give more"
            .into(),
    );
    doubt(
        found.moved_fraction > WORTH_SAYING && !said("motion"),
        format!(
            "{} of the picture moved between the frames and has no answer",
            percent(found.moved_fraction)
        ),
    );
    doubt(
        known < 1.0 - WORTH_SAYING,
        format!(
            "depth is known for only {} of the photograph",
            percent(known)
        ),
    );
    doubt(
        confidence < WORTH_SAYING,
        format!("low confidence: {confidence:.2} of 1 on average over the known pixels"),
    );
    for (label, relit) in labels.iter().zip(relit) {
        doubt(
            relit.unseen_path_fraction > UNSEEN,
            format!(
                "light {}: for {} of the pixels the way to the light leaves the picture; what stands there is unknown",
                label,
                percent(relit.unseen_path_fraction)
            ),
        );
    }
    doubts
}

/// Mean over the pixels of which something is known.
pub(super) fn mean_confidence(development: &Development) -> f32 {
    let known = development
        .scene
        .confidence
        .samples()
        .iter()
        .filter(|value| value.is_finite());
    let (sum, count) = known.fold((0.0f64, 0u32), |(sum, count), value| {
        (sum + f64::from(*value), count + 1)
    });
    (sum / f64::from(count.max(1))) as f32
}

/// Share of the samples that count.
pub(super) fn fraction<T>(plane: &Plane<T>, counts: impl Fn(&T) -> bool) -> f32 {
    let counted = plane
        .samples()
        .iter()
        .filter(|sample| counts(sample))
        .count();
    counted as f32 / plane.len().max(1) as f32
}
