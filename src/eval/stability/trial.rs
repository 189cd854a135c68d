//! One capture through all its states.

use super::{CaptureCells, Cell, CellFinding, CellRow, Spoiling};
use crate::corruption::Corruption;
use crate::develop;
use crate::eval::bench::Bench;
use crate::eval::capture_run::studied;
use crate::eval::evaluation::{EvalError, EvalOptions, chance_of};
use crate::eval::ledger::Ledger;
use crate::eval::light_error::{Decibel, LinearError};
use crate::eval::methods::{DepthGiven, Subject};
use crate::eval::report::SilentRow;
use crate::eval::roster::Roster;
use crate::eval::row_run::RowRun;
use crate::eval::summary::mean;
use crate::folder::{Capture, Truth};
use crate::verdict;
use drivers::Plane;

/// What is asked of a capture.
pub(in crate::eval) struct Asked<'a> {
    pub(in crate::eval) roster: &'a Roster,
    pub(in crate::eval) options: &'a EvalOptions,
    pub(in crate::eval) spoiling: &'a Spoiling,
}

/// Measures one capture as it came and in every state that is asked for; what `ledger` holds
/// of it, the capture at that place of the run,
/// is taken over. `tell` is told the corruption in work and the fraction done.
///
/// # Errors
/// [`EvalError`] where the capture cannot be measured as it came.
pub(in crate::eval) fn measure(
    capture: &Capture,
    truth: &Truth,
    asked: &Asked<'_>,
    (ledger, place): (&Ledger, usize),
    tell: &mut dyn FnMut(&str, f32),
) -> Result<CaptureCells, EvalError> {
    let Spoiling {
        ways, severities, ..
    } = asked.spoiling;
    let lights = chosen(truth, asked.spoiling.lights);
    let cells = 1 + ways.len() * severities.len();
    let mut trial = None;
    let mut measured = |way: Option<(&Corruption, u8)>| -> Result<Cell, EvalError> {
        let trial = match &mut trial {
            Some(trial) => trial,
            none => none.insert(Trial::new(capture, truth, asked, &lights)?),
        };
        trial.cell(way)
    };
    let kept = |name: &str, what: &mut dyn FnMut() -> Result<Vec<Cell>, EvalError>| {
        let name = format!("spoiled/{name}");
        if let Some(cells) = ledger.found(place, &name) {
            return Ok(cells);
        }
        let cells = what()?;
        ledger.keep(place, &name, &cells);
        Ok::<_, EvalError>(cells)
    };
    let mut clean = kept("", &mut || Ok(vec![measured(None)?]))?;
    let mut spoiled: Vec<Cell> = Vec::with_capacity(cells);
    for way in ways {
        let done = spoiled.len();
        spoiled.extend(kept(way.name, &mut || {
            let states = severities.iter().enumerate();
            let cells = states.map(|(state, severity)| {
                let doing = format!("{}:{severity}", way.name);
                tell(&doing, (1 + done + state) as f32 / cells as f32);
                measured(Some((way, *severity)))
            });
            cells.collect()
        })?);
    }
    Ok(CaptureCells {
        capture: capture.name.clone(),
        lights,
        clean: clean.remove(0),
        spoiled,
    })
}

/// Up to `most` lights: the middle one of each of as many equal parts, by angle off the axis.
fn chosen(truth: &Truth, most: usize) -> Vec<usize> {
    let mut lights: Vec<usize> = (0..truth.lights.len()).collect();
    lights.sort_by(|a, b| {
        let height = |light: &usize| truth.lights[*light].toward_person[2];
        height(b).total_cmp(&height(a))
    });
    let parts = most.min(lights.len());
    let middle = |part: usize| (2 * part + 1) * lights.len() / (2 * parts);
    (0..parts).map(|part| lights[middle(part)]).collect()
}

/// A capture with its true pictures laid out once for all its states.
struct Trial<'a> {
    capture: &'a Capture,
    truth: &'a Truth,
    asked: &'a Asked<'a>,
    bench: Bench<'a>,
    counts: Plane<bool>,
    /// Index of the light, its true picture at the bench's exposure.
    lights: Vec<(usize, Plane<[f32; 3]>)>,
}

impl<'a> Trial<'a> {
    fn new(
        capture: &'a Capture,
        truth: &'a Truth,
        asked: &'a Asked<'a>,
        lights: &[usize],
    ) -> Result<Self, EvalError> {
        let (width, height) = capture.shot.flash.pixels.size();
        let mask = capture.shot.mask.clone();
        let counts = mask.unwrap_or_else(|| Plane::filled(width, height, true));
        let development = develop::develop(&capture.shot, &asked.options.develop, &mut |_| {})
            .map_err(|source| EvalError::Develop {
                capture: capture.name.clone(),
                source,
            })?;
        let bench = Bench::new(capture, truth, &development, counts.clone())?;
        let pictures = lights
            .iter()
            .map(|light| Ok((*light, bench.truth(*light)?.picture)))
            .collect::<Result<_, EvalError>>()?;
        Ok(Self {
            capture,
            truth,
            asked,
            bench,
            counts,
            lights: pictures,
        })
    }

    /// The capture made worse (`None` = as it came), developed once, and every row's error.
    fn cell(&self, way: Option<(&Corruption, u8)>) -> Result<Cell, EvalError> {
        let mut cell = Cell {
            way: way.map_or_else(String::new, |(way, _)| way.name.to_owned()),
            severity: way.map_or(0, |(_, severity)| severity),
            rows: Vec::new(),
            silent: Vec::new(),
            findings: Vec::new(),
            refused: None,
        };
        let name = &self.capture.name;
        let shot = match way {
            None => Ok(self.capture.shot.clone()),
            Some((way, severity)) => {
                let seed = chance_of(self.asked.spoiling.seed, name).bits(0);
                way.on_shot(&self.capture.shot, severity, seed)
            }
        };
        let shot = match shot {
            Ok(shot) => shot,
            Err(error) => {
                cell.refused = Some(error.to_string());
                return Ok(cell);
            }
        };
        let development = match develop::develop(&shot, &self.asked.options.develop, &mut |_| {}) {
            Ok(development) => development,
            Err(error) => {
                cell.refused = Some(error.to_string());
                return Ok(cell);
            }
        };
        let findings = verdict::judge(&shot, &development).findings;
        cell.findings = findings
            .into_iter()
            .map(|finding| CellFinding {
                mode: finding.mode.to_owned(),
                score: finding.score,
            })
            .collect();
        let capture = Capture {
            name: name.clone(),
            shot,
            truth: None,
        };
        let subject = Subject {
            capture: &capture,
            development: &development,
            depth: DepthGiven::Spoiled,
        };
        let scale_known = self.truth.scale_known && development.scene.scale_known;
        let (runs, silent) = studied(self.asked.roster, subject)?;
        cell.silent = silent;
        for mut run in runs {
            match self.row(&mut run, scale_known) {
                Ok(row) => cell.rows.push(row),
                Err(reason) => cell.silent.push(SilentRow {
                    label: run.row.label.clone(),
                    reason,
                }),
            }
        }
        Ok(cell)
    }

    /// One row under every light, after its best scale where that is its due; why there is none.
    fn row(&self, run: &mut RowRun<'_>, scale_known: bool) -> Result<CellRow, String> {
        let mut answers = Vec::new();
        for (light, truth) in &self.lights {
            let answer = self.bench.answer(*light, run);
            if let Some(answer) = answer.map_err(|error| error.to_string())? {
                run.fit.add_picture(&answer.light, truth, &self.counts);
                answers.push((answer.light, truth));
            }
        }
        let scale = run.scale(scale_known);
        let errors = answers
            .iter()
            .map(|(found, truth)| LinearError::of(found, scale, truth, &self.counts));
        let errors: Vec<LinearError> = errors.collect();
        let mses = || errors.iter().filter_map(LinearError::mse);
        let linear_mse = mean(mses()).ok_or("answered no pixel that counts")?;
        let answered: usize = errors.iter().map(|error| error.pixels).sum();
        let unanswered: usize = errors.iter().map(|error| error.unanswered).sum();
        Ok(CellRow {
            label: run.row.label.clone(),
            linear_mse,
            linear_psnr_db: Decibel(
                mean(mses().map(|mse| Decibel::from_mse(mse).0)).unwrap_or(f64::INFINITY),
            ),
            lights: mses().count(),
            answered_fraction: answered as f64 / (answered + unanswered) as f64,
        })
    }
}
