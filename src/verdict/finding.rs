//! One way a shot can fail, and how badly it does.

use serde::Serialize;

/// Highest score told: beyond it nothing gets worse.
const MOST: f32 = 1000.0;

/// What was found about one failure mode.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Name of the failure, as in the table of corruptions.
    pub mode: &'static str,
    /// How strong it is, as a share of what does harm; 0 to 1000, 1 and more = harmful.
    pub score: f32,
    /// Share of the picture that it touches, where that can be told.
    pub affected_fraction: Option<f32>,
    /// What it is and what to do about it; only of a harmful one.
    pub words: Option<String>,
}

impl Finding {
    /// A finding whose words are asked for only when it is harmful. A score that is no number, such as
    /// that of an empty picture, is 0: nothing was found.
    pub(super) fn new(
        mode: &'static str,
        score: f32,
        affected_fraction: Option<f32>,
        words: impl FnOnce() -> String,
    ) -> Self {
        let score = if score.is_nan() {
            0.0
        } else {
            score.clamp(0.0, MOST)
        };
        Self {
            mode,
            score,
            affected_fraction: affected_fraction.filter(|fraction| fraction.is_finite()),
            words: (score >= 1.0).then(words),
        }
    }

    /// True where it does harm.
    pub fn is_harmful(&self) -> bool {
        self.score >= 1.0
    }
}

/// A share as people say it.
pub(super) fn percent(fraction: f32) -> String {
    let percent = 100.0 * fraction;
    if percent < 1.0 {
        format!("{percent:.1} %")
    } else {
        format!("{percent:.0} %")
    }
}
