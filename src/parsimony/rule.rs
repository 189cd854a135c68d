//! Which of several nested models a measurement supports.

use serde::{Deserialize, Serialize};

/// How to weigh what a model explains against what it costs to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// The simplest model whose error on held-out samples lies within one standard error of the
    /// best one's (Breiman, Friedman, Olshen & Stone 1984).
    #[default]
    OneStandardError,
    /// The model of the least Bayesian information criterion (Schwarz 1978).
    Bic,
}

/// What nested models, the simplest first, make of the same measurement.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Scores {
    /// Mean loss of each model on samples it was not fitted to, in any unit.
    pub held_out: Vec<f64>,
    /// Standard error of the difference between each model's loss and the most complex one's.
    pub standard_error: Vec<f64>,
    /// BIC of each.
    pub bic: Vec<f64>,
}

impl Scores {
    /// From the loss of each model in independent groups of samples, and from each model's deviance
    /// (−2 ln likelihood), parameters and the number of samples.
    pub fn new<const N: usize>(
        groups: &[[f32; N]],
        deviance: [f64; N],
        parameters: [usize; N],
        samples: usize,
    ) -> Self {
        let count = groups.len().max(1) as f64;
        let mean = |model: usize| {
            let losses = groups.iter().map(|losses| f64::from(losses[model]));
            losses.sum::<f64>() / count
        };
        let deviation = |model: usize| {
            let worse = groups
                .iter()
                .map(|losses| f64::from(losses[model] - losses[N - 1]));
            let average = worse.clone().sum::<f64>() / count;
            let squares = worse.map(|one| (one - average).powi(2)).sum::<f64>();
            (squares / (count - 1.0).max(1.0) / count).sqrt()
        };
        let price = (samples.max(1) as f64).ln();
        Self {
            held_out: (0..N).map(mean).collect(),
            standard_error: (0..N).map(deviation).collect(),
            bic: (0..N)
                .map(|model| deviance[model] + parameters[model] as f64 * price)
                .collect(),
        }
    }

    /// Number of the model that `rule` picks; the simplest where nothing was measured.
    pub fn pick(&self, rule: Rule) -> usize {
        let last = self.held_out.len().saturating_sub(1);
        match rule {
            Rule::OneStandardError => (0..last)
                .find(|&model| {
                    self.held_out[model] <= self.held_out[last] + self.standard_error[model]
                })
                .unwrap_or(last),
            Rule::Bic => (0..=last)
                .min_by(|&a, &b| self.bic[a].total_cmp(&self.bic[b]))
                .unwrap_or(last),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line through noisy samples, or their mean: held out pairs, and Gaussian deviance.
    fn scores(slope: f32) -> Scores {
        // Uniform noise of variance 1 from a fixed sequence.
        let noise = |i: usize| (((i * 7919 + 13) % 101) as f32 / 100.0 - 0.5) * 12f32.sqrt();
        let value = |i: usize| slope * (i as f32 - 49.5) / 50.0 + noise(i);
        let groups: Vec<[f32; 2]> = (0..100)
            .map(|i| {
                let line = slope * (i as f32 - 49.5) / 50.0;
                [value(i).powi(2), (value(i) - line).powi(2) + 0.02]
            })
            .collect();
        let sum = |model: usize| groups.iter().map(|g| f64::from(g[model])).sum::<f64>();
        Scores::new(&groups, [sum(0), sum(1) - 2.0], [1, 2], 100)
    }

    #[test]
    fn a_slope_is_kept_where_it_shows_and_dropped_where_it_does_not() {
        for rule in [Rule::OneStandardError, Rule::Bic] {
            assert_eq!(scores(0.0).pick(rule), 0, "{rule:?}");
            assert_eq!(scores(3.0).pick(rule), 1, "{rule:?}");
        }
    }

    #[test]
    fn without_groups_nothing_is_said_for_the_simpler_model_but_its_price() {
        let none = Scores::new::<3>(&[], [0.0; 3], [0, 1, 9], 0);
        assert_eq!(none.pick(Rule::OneStandardError), 0);
    }
}
