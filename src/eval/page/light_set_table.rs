//! The table of the sets of lights.

use super::sheet::{Cell, Sheet};
use crate::eval::light_sets::{COUNTS, LightSetRun, SetFigures};

/// One line per way to choose a set, over all runs.
pub(super) fn light_sets(runs: &[LightSetRun]) -> Sheet {
    let line = |asked: String, of: &dyn Fn(&LightSetRun) -> SetFigures| {
        let spread = |value: &dyn Fn(SetFigures) -> Option<f64>| {
            let mut values: Vec<f64> = runs.iter().filter_map(|run| value(of(run))).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| {
                values.get(((values.len().max(1) - 1) as f64 * share).round() as usize)
            };
            [0.5, 0.95].map(|share| at(share).copied())
        };
        let lights = spread(&|set| Some(set.lights as f64));
        let steps = spread(&|set| Some(set.change_steps));
        vec![
            Cell::text(asked),
            Cell::number(lights[0], 0),
            Cell::number(lights[1], 0),
            Cell::number(spread(&|set| Some(set.milliseconds))[0], 1),
            Cell::number(steps[0], 2),
            Cell::number(steps[1], 2),
            Cell::number(spread(&|set| Some(set.dense_psnr_db))[0], 1),
            Cell::number(spread(&|set| set.truth_psnr_db)[0], 1),
        ]
    };
    let fixed = COUNTS.iter().enumerate();
    let fixed = fixed.map(|(place, count)| line(count.to_string(), &|run| run.fixed[place]));
    let within = |run: &&LightSetRun| run.chosen.change_steps <= run.noise_steps().max(1e-9);
    let columns = [
        "lights asked for",
        "lights",
        "lights, 95 %",
        "ms",
        "change, steps of 255",
        "change, 95 %",
        "PSNR to one light per pixel, dB",
        "PSNR to truth, dB",
    ];
    Sheet {
        stem: "light_sets",
        caption: format!(
            "Scenes under environment maps, {} runs: medians, and where nine in ten and half of the rest lie. A chosen set is split until the picture changes by less than its noise; {} of the chosen sets do so against all lights, {} were cut off at the most there are.",
            runs.len(),
            runs.iter().filter(within).count(),
            runs.iter().filter(|run| run.found.capped).count(),
        ),
        columns: columns.map(str::to_owned).to_vec(),
        rows: std::iter::once(line("chosen".to_owned(), &|run| run.chosen))
            .chain(fixed)
            .collect(),
    }
}
