//! Progress on standard error, where that is a terminal.

use indicatif::{ProgressBar, ProgressStyle};
use std::time::Duration;

/// Steps that work of known share is counted in.
const SHARES: u64 = 10_000;

/// Progress of one command; vanishes when dropped.
pub(super) struct Progress(ProgressBar);

impl Progress {
    /// For work of unknown length.
    pub fn of_unknown(doing: &str) -> Self {
        let bar = ProgressBar::new_spinner();
        bar.enable_steady_tick(Duration::from_millis(120));
        bar.set_message(doing.to_owned());
        Self(bar)
    }

    /// For `steps` steps.
    pub fn of(steps: usize, doing: &str) -> Self {
        let bar = ProgressBar::new(steps as u64);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        bar.set_message(doing.to_owned());
        Self(bar)
    }

    /// For work whose share done is known.
    pub fn of_share(doing: &str) -> Self {
        let bar = ProgressBar::new(SHARES);
        let template = "{bar:30} {percent:>3} %, {eta} left: {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        bar.set_message(doing.to_owned());
        Self(bar)
    }

    /// Says what is being done now.
    pub fn doing(&self, what: &str) {
        self.0.set_message(what.to_owned());
    }

    /// The fraction of the work that is done.
    pub fn reach(&self, share: f32) {
        self.0.set_position((share * SHARES as f32) as u64);
    }

    /// One step is done.
    pub fn step(&self) {
        self.0.inc(1);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
