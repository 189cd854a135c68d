//! Least squares by Levenberg–Marquardt, with the standard errors of what was found.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, storage::Owned};

/// What was found.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub parameters: Vec<f64>,
    /// Standard error of each parameter, from the scatter of the residuals; infinite where they do not
    /// tell it.
    pub errors: Vec<f64>,
    pub residuals: Vec<f64>,
}

struct Problem<F> {
    parameters: DVector<f64>,
    residuals: F,
}

impl<F: Fn(&[f64]) -> Vec<f64>> LeastSquaresProblem<f64, Dyn, Dyn> for Problem<F> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(DVector::from_vec((self.residuals)(
            self.parameters.as_slice(),
        )))
    }

    /// By central differences.
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        const STEP: f64 = 1e-6;
        let mut at = self.parameters.as_slice().to_vec();
        let mut columns = Vec::with_capacity(at.len());
        for k in 0..at.len() {
            let here = at[k];
            let step = STEP * here.abs().max(1.0);
            at[k] = here + step;
            let ahead = DVector::from_vec((self.residuals)(&at));
            at[k] = here - step;
            let behind = DVector::from_vec((self.residuals)(&at));
            at[k] = here;
            columns.push((ahead - behind) / (2.0 * step));
        }
        Some(DMatrix::from_columns(&columns))
    }
}

/// Looks for the least sum of squared residuals from `start` on; `None` where it leads to no finite
/// answer. Residuals must always be as many.
pub(super) fn minimize(start: Vec<f64>, residuals: impl Fn(&[f64]) -> Vec<f64>) -> Option<Found> {
    let problem = Problem {
        parameters: DVector::from_vec(start),
        residuals,
    };
    let solver = LevenbergMarquardt::new().with_tol(1e-10).with_patience(40);
    let (problem, report) = solver.minimize(problem);
    if !report.objective_function.is_finite() || report.termination.was_usage_issue() {
        return None;
    }
    let residuals = problem.residuals()?;
    let (count, unknown) = (residuals.len(), problem.parameters.len());
    let variance = residuals.norm_squared() / count.saturating_sub(unknown).max(1) as f64;
    let jacobian = problem.jacobian()?;
    let errors = match (jacobian.transpose() * &jacobian).try_inverse() {
        Some(inverse) => inverse
            .diagonal()
            .iter()
            .map(|value| (value * variance).max(0.0).sqrt())
            .collect(),
        None => vec![f64::INFINITY; unknown],
    };
    let parameters = problem.parameters.as_slice().to_vec();
    let finite = parameters.iter().all(|value| value.is_finite());
    finite.then(|| Found {
        parameters,
        errors,
        residuals: residuals.as_slice().to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_and_its_standard_errors_come_back() {
        // y = 3 exp(−0.5 x), every second sample 0.01 high, the others 0.01 low.
        let samples: Vec<(f64, f64)> = (0..100)
            .map(|k| {
                let x = 0.05 * f64::from(k);
                let off = if k % 2 == 0 { 0.01 } else { -0.01 };
                (x, 3.0 * (-0.5 * x).exp() + off)
            })
            .collect();
        let found = minimize(vec![1.0, 0.0], |p| {
            let value = |(x, y): &(f64, f64)| p[0] * (p[1] * x).exp() - y;
            samples.iter().map(value).collect()
        })
        .unwrap();
        for (value, (truth, error)) in found
            .parameters
            .iter()
            .zip([3.0, -0.5].iter().zip(&found.errors))
        {
            assert!((value - truth).abs() < 3.0 * error, "{found:?}");
            assert!((1e-4..0.01).contains(error), "{found:?}");
        }
    }
}
