//! What a stage or a relit picture cost: median and 95th percentile of its runs.

use serde::{Deserialize, Serialize};

/// Milliseconds of wall-clock time over several runs of the same work.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Half of the runs took no longer.
    pub median_ms: f64,
    /// 19 of 20 runs took no longer.
    pub p95_ms: f64,
    /// All runs together, divided by their number.
    pub mean_ms: f64,
    /// Runs measured.
    pub runs: usize,
}

impl Cost {
    /// Of runs given in milliseconds; `None` without a run.
    pub fn of(mut runs_ms: Vec<f64>) -> Option<Self> {
        let runs = runs_ms.len();
        let median_ms = percentile(&mut runs_ms, 0.5)?;
        let p95_ms = percentile(&mut runs_ms, 0.95)?;
        let mean_ms = runs_ms.iter().sum::<f64>() / runs as f64;
        Some(Self {
            median_ms,
            p95_ms,
            mean_ms,
            runs,
        })
    }
}

/// The value below which `fraction` of the values lie, interpolated between its two neighbours
/// (numpy's `linear`); `None` without a value. Sorts what it is given.
pub(super) fn percentile(values: &mut [f64], fraction: f64) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let place = fraction.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = place.ceil() as usize;
    Some(values[below] + (values[above] - values[below]) * (place - below as f64))
}
