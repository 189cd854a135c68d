//! `eval`: captures with truth, measured.

use super::{
    Answer, CommandError, contents, error::InputError, inference::BackendArguments, input,
    lights::linear_picture, progress::Progress, spoiling::SpoilingArguments,
};
use crate::{
    config::Config,
    corruption::DepthNoise,
    costs,
    darkroom::DarkroomError,
    develop::develop,
    eval::{
        EvalOptions, Extent, ForeignRow, Ledger, NoisyDepth, ReportFolder, Roster, evaluate,
        learned::{ThreeNetworks, WithRoomLight, WithoutDepth},
        light_sets::{LightSetRun, compare},
        methods::Method,
        other_backends,
        ours::{Choice, Ours},
        roster,
        without_flash::{Infrared, RoomPhotograph},
    },
    folder::{Capture, mask_beside, truth_beside},
    inference::{self, InferenceError, Settings},
    relight::{RelightOptions, networks::Variant},
    session::SessionError,
};
use clap::Args;
use std::{
    path::{Path, PathBuf},
    rc::Rc,
};

/// The last row that this program answers itself; answers from elsewhere have later numbers.
const OWN_ROWS: u8 = 3;
/// Why the rows of networks are missing under `--no-networks`.
const LEFT_OUT: &str = "left out (--no-networks)";
/// Why a row's network is missing where no weights of it come with the program.
const NOT_SHIPPED: &str = "models/manifest.toml lists no weights of it";
/// Captures that a report's command names all of.
const NAMED_CAPTURES: usize = 6;
/// Longest name of a row, letters.
const NAME_LETTERS: usize = 40;

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct Eval {
    /// Capture folders, or recordings with their truth beside them (NAME.truth beside NAME.mcap).
    #[arg(value_name = "CAPTURE", required = true)]
    captures: Vec<PathBuf>,
    /// Folder for the report, the table and the charts; an earlier report in it is replaced.
    #[arg(long, value_name = "OUT")]
    report: Option<PathBuf>,
    /// Measure every capture once more with noise on its depth: that of the reference method
    /// (6.25e-2 of the span of depth, blurred by a pixel at 256×256) [default seed: 0].
    #[arg(long, value_name = "paper[:SEED]", value_parser = noise)]
    depth_noise: Option<NoisyDepth>,
    /// Add a row that was answered elsewhere: DIR holds one folder per capture, of the capture's
    /// name, as `relight` writes them (relit_NNN.exr, shadow_NNN.png, albedo.exr, normal.exr,
    /// roughness.exr), and optionally times.json ({"milliseconds": [12.5, null, …]}, one entry
    /// per light). ROW is its number in the table, 4 to 99.
    #[arg(long, value_name = "ROW[:NAME]=DIR", value_parser = answers)]
    answers: Vec<RowFolder>,
    /// The same for noisy depth: answers made from captures with noise on their depth (or, for a
    /// row that uses no depth, the same folder again).
    #[arg(long, value_name = "ROW[:NAME]=DIR", value_parser = answers, requires = "depth_noise")]
    noisy_answers: Vec<RowFolder>,
    /// An earlier report of some of the captures, made with another backend: its rows of networks join the
    /// chart of speed and accuracy.
    #[arg(long, value_name = "REPORT", requires = "report")]
    beside: Option<PathBuf>,
    /// Write the page, its charts and tables alone, without the figures light by light.
    #[arg(long, requires = "report")]
    summary: bool,
    /// Leave out the rows of networks, which take seconds per light where tract runs them.
    #[arg(long)]
    no_networks: bool,
    /// Add rows of what can be had without the flash: the room's photograph as it is, and with the depth camera's
    /// infrared light in the flash's place.
    #[arg(long)]
    no_flash: bool,
    /// Compare sets of lights on the first N captures, under the environment maps of their truth
    /// (environment_NNN.hdr, and beside it the true picture, .exr).
    #[arg(long, value_name = "N", default_value_t = 0)]
    light_sets: usize,
    #[command(flatten)]
    spoiling: SpoilingArguments,
    #[command(flatten)]
    backend: BackendArguments,
}

/// One `ROW[:NAME]=DIR`.
#[derive(Debug, Clone, PartialEq, Eq)]
struct RowFolder {
    number: u8,
    name: Option<String>,
    folder: PathBuf,
}

impl Eval {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        let mut roster = Roster::standing(RelightOptions::default());
        let mut warnings = Vec::new();
        if self.no_networks {
            leave_out_networks(&mut roster);
        } else {
            warnings.extend(fill_networks(&mut roster, &self.backend.settings(config)));
        }
        warnings.extend(fill_ours(&mut roster, &self, config)?);
        if self.no_flash {
            let rows: [Box<dyn Method>; 2] =
                [Box::new(RoomPhotograph), Box::new(Infrared::default())];
            for row in rows {
                roster
                    .fill(row)
                    .map_err(|twice| CommandError::Arguments(twice.to_string()))?;
            }
        }
        for row in self.foreign_rows(&roster)? {
            roster
                .fill(Box::new(row))
                .map_err(|twice| CommandError::Arguments(format!("--answers: {twice}")))?;
        }
        let folder = self
            .report
            .as_deref()
            .map(ReportFolder::begin)
            .transpose()?;
        let progress = Progress::of_share("reading");
        let captures = self
            .captures
            .iter()
            .map(|path| input::read(path, config).map(|input| input.capture))
            .collect::<Result<Vec<_>, _>>()?;
        let options = EvalOptions {
            noisy: self.depth_noise,
            spoiling: self.spoiling.asked(),
            ..EvalOptions::default()
        };
        let ledger = self.ledger(&captures, &roster, &options, config)?;
        let mut report = evaluate(&captures, &roster, &options, &ledger, |now| {
            progress.doing(&format!("{} {}", now.capture, now.state));
            progress.reach(now.done);
        })?;
        report.made.command = self.command();
        for (path, capture) in self.captures.iter().zip(&captures).take(self.light_sets) {
            progress.doing(&format!("{} under environment maps", capture.name));
            report.light_sets.extend(light_sets(path, capture)?);
        }
        if let Some(other) = &self.beside {
            report.other_backends = other_backends(other, &report)?;
        }
        if let Some(folder) = folder {
            progress.doing("writing");
            let extent = match self.summary {
                true => Extent::Summary,
                false => Extent::Everything,
            };
            folder.write(&report, extent)?;
        }
        let taken_over = ledger.taken_over();
        ledger.close();
        drop(progress);
        let mut text = report.to_string().trim_end().to_owned();
        if let Some(folder) = &self.report {
            text.push_str(&format!(
                "\nreport in {}: index.html shows it, with every table as JSON and CSV and every chart as SVG and PNG",
                folder.display()
            ));
        }
        let answer = Answer::new(text, &report).with_warnings(warnings);
        Ok(match taken_over {
            0 => answer,
            parts => answer.with_note(format!(
                "{parts} parts were taken over from a run that was stopped"
            )),
        })
    }

    /// The command that makes the report again; of many captures, the first and the last.
    fn command(&self) -> String {
        let captures: Vec<_> = self.captures.iter().map(|path| path.as_os_str()).collect();
        let shown = |argument: &std::ffi::OsStr| {
            captures.len() <= NAMED_CAPTURES || !captures[1..captures.len() - 1].contains(&argument)
        };
        let mut words: Vec<String> = Vec::new();
        for argument in std::env::args_os().skip(1) {
            if shown(&argument) {
                let word = argument.to_string_lossy();
                let plain =
                    |letter: char| letter.is_alphanumeric() || "-_./,:=+@%".contains(letter);
                words.push(match word.chars().all(plain) {
                    true if !word.is_empty() => word.into_owned(),
                    _ => format!("'{}'", word.replace('\'', "'\\''")),
                });
            } else if words.last().is_none_or(|last| last != "…") {
                words.push("…".to_owned());
            }
        }
        format!("capturectl {}", words.join(" "))
    }

    /// Where finished parts are kept and looked for: nowhere without a report.
    fn ledger(
        &self,
        captures: &[Capture],
        roster: &Roster,
        options: &EvalOptions,
        config: &Config,
    ) -> Result<Ledger, CommandError> {
        let Some(report) = &self.report else {
            return Ok(Ledger::none());
        };
        let mut run = blake3::Hasher::new();
        // The very program: another build may measure something else.
        if let Ok(program) = std::env::current_exe() {
            run.update(contents::of(&[&program])?.as_bytes());
        }
        let rows: Vec<String> = roster.rows().iter().map(|row| row.to_string()).collect();
        let backend = self.backend.settings(config);
        let EvalOptions {
            develop,
            development_runs,
            noisy,
            spoiling,
        } = options;
        // Which ways and how many captures are asked for changes no part.
        let spoiling = spoiling
            .as_ref()
            .map(|spoiling| (&spoiling.severities, spoiling.seed, spoiling.lights));
        let options = (develop, development_runs, noisy, spoiling);
        run.update(format!("{options:?} {rows:?} {backend:?}").as_bytes());
        for row in self.answers.iter().chain(&self.noisy_answers) {
            run.update(contents::of(&[&row.folder])?.as_bytes());
        }
        let named = captures.iter().zip(&self.captures).map(|(capture, path)| {
            let beside = [truth_beside(path), mask_beside(path)];
            let parts = [path.as_path(), &beside[0], &beside[1]];
            Ok((capture.name.as_str(), contents::of(&parts)?))
        });
        let named: Vec<(&str, blake3::Hash)> = named.collect::<Result<_, CommandError>>()?;
        Ok(Ledger::beside(report, run.finalize(), &named)?)
    }

    /// The rows answered elsewhere, clean and noisy answers of one row together.
    fn foreign_rows(&self, roster: &Roster) -> Result<Vec<ForeignRow>, CommandError> {
        let mut rows: Vec<ForeignRow> = Vec::new();
        let clean = self.answers.iter().map(|asked| (asked, false));
        let noisy = self.noisy_answers.iter().map(|asked| (asked, true));
        for (asked, noisy) in clean.chain(noisy) {
            let RowFolder { number, folder, .. } = asked;
            if !folder.is_dir() {
                return Err(InputError {
                    path: folder.clone(),
                    problem: "is no folder".to_owned(),
                    remedy: "name the folder that holds one folder of answers per capture",
                }
                .into());
            }
            let name = match (&asked.name, roster.missing_name(*number)) {
                (Some(name), _) => name.clone(),
                (None, Some(name)) => name.to_owned(),
                (None, None) => format!("answered in {}", folder.display()),
            };
            let place = rows
                .iter()
                .position(|row| (row.number, &row.name) == (*number, &name))
                .unwrap_or_else(|| {
                    rows.push(ForeignRow {
                        number: *number,
                        name: name.clone(),
                        clean: None,
                        noisy: None,
                    });
                    rows.len() - 1
                });
            let row = &mut rows[place];
            let folders = if noisy {
                &mut row.noisy
            } else {
                &mut row.clean
            };
            if folders.replace(folder.clone()).is_some() {
                return Err(CommandError::Arguments(format!(
                    "--answers: row {number}, \"{name}\", is answered twice; give one of them another name, as in {number}:NAME=DIR"
                )));
            }
        }
        Ok(rows)
    }
}

/// A capture under every environment map of its truth, by sets of lights of every kind.
fn light_sets(path: &Path, capture: &Capture) -> Result<Vec<LightSetRun>, CommandError> {
    let truth = match path.is_dir() {
        true => path.join("truth"),
        false => truth_beside(path),
    };
    let maps: Vec<PathBuf> = (0..)
        .map(|number| truth.join(format!("environment_{number:03}.hdr")))
        .take_while(|map| map.is_file())
        .collect();
    if maps.is_empty() {
        return Ok(Vec::new());
    }
    let developed = develop(&capture.shot, &EvalOptions::default().develop, &mut |_| ());
    let developed = developed.map_err(|error| SessionError::from(DarkroomError::from(error)))?;
    let mut runs = Vec::new();
    for map in &maps {
        let name = map.file_stem().unwrap_or_default().to_string_lossy();
        let picture = map.with_extension("exr");
        let picture = picture
            .is_file()
            .then(|| linear_picture(&picture))
            .transpose()?;
        let names = [capture.name.as_str(), &name];
        runs.extend(compare(
            names,
            &developed,
            &linear_picture(map)?,
            picture.as_ref(),
        ));
    }
    Ok(runs)
}

/// Rows that networks answer: number, name, and how to get the method.
fn networks(settings: &Settings) -> [(u8, &'static str, Loading); 4] {
    let paper = |variant| -> Loading {
        let loaded = inference::load_paper(variant, settings);
        loaded.map(|paper| -> Box<dyn Method> { Box::new(ThreeNetworks(paper)) })
    };
    let decompose = |variant| inference::load("decompose", variant, settings);
    let env = decompose("env").map(|one| -> Box<dyn Method> { Box::new(WithRoomLight(one)) });
    let sips = decompose("sips").map(|one| -> Box<dyn Method> { Box::new(WithoutDepth(one)) });
    [
        (4, roster::PAPER_CLEAN, paper(Variant::Clean)),
        (4, roster::PAPER_NOISY, paper(Variant::Noisy)),
        (4, roster::PAPER_ENV, env),
        (5, roster::SIPS, sips),
    ]
}

type Loading = Result<Box<dyn Method>, InferenceError>;

/// Fills the rows whose networks are there and says of the others why not; returns what to say about
/// what runs them.
fn fill_networks(roster: &mut Roster, settings: &Settings) -> Option<String> {
    let mut warning = None;
    for (number, name, loaded) in networks(settings) {
        let filled = loaded
            .map_err(|error| match error {
                InferenceError::NotListed { .. } => NOT_SHIPPED.to_owned(),
                other => other.to_string(),
            })
            .and_then(|method| {
                let runtime =
                    inference::Runtime::start(settings).map_err(|error| error.to_string())?;
                warning.clone_from(&runtime.warning);
                roster.fill(method).map_err(|twice| twice.to_string())
            });
        if let Err(reason) = filled {
            roster.miss(number, name, reason);
        }
    }
    warning
}

/// Fills the rows of our own model; returns what to say about its networks and about what steps cost here.
fn fill_ours(
    roster: &mut Roster,
    eval: &Eval,
    config: &Config,
) -> Result<Vec<String>, CommandError> {
    let settings = eval.backend.settings(config);
    let load = || inference::load_compact(&settings);
    let loaded = (!eval.no_networks).then(load).transpose();
    let missing = loaded.as_ref().err();
    let missing = missing.map(|error| format!("closed forms are not corrected: {error}"));
    let networks = loaded.ok().flatten().map(Rc::new);
    let file = costs::usual_file();
    let costs::Known { costs, warning } = costs::known(file.as_deref(), Some(&load))?;
    for choice in Choice::ALL {
        let ours = Ours {
            choice,
            costs,
            networks: networks.clone(),
            develop: EvalOptions::default().develop,
        };
        roster
            .fill(Box::new(ours))
            .map_err(|twice| CommandError::Arguments(twice.to_string()))?;
    }
    Ok(missing.into_iter().chain(warning).collect())
}

fn leave_out_networks(roster: &mut Roster) {
    for name in [roster::PAPER_CLEAN, roster::PAPER_NOISY, roster::PAPER_ENV] {
        roster.miss(4, name, LEFT_OUT.to_owned());
    }
    roster.miss(5, roster::SIPS, LEFT_OUT.to_owned());
}

/// Reads `paper[:SEED]`.
fn noise(text: &str) -> Result<NoisyDepth, String> {
    let (kind, seed) = text.split_once(':').unwrap_or((text, "0"));
    if kind != "paper" {
        return Err(format!(
            "there is no noise \"{kind}\"; give paper or paper:SEED"
        ));
    }
    let seed = seed
        .parse()
        .map_err(|_| format!("the seed \"{seed}\" is no whole number from 0"))?;
    Ok(NoisyDepth {
        noise: DepthNoise::PAPER,
        seed,
    })
}

/// Reads `ROW[:NAME]=DIR`.
fn answers(text: &str) -> Result<RowFolder, String> {
    let (row, folder) = text
        .split_once('=')
        .ok_or("give ROW=DIR or ROW:NAME=DIR, as in 6=answers")?;
    let (number, name) = match row.split_once(':') {
        Some((number, name)) => (number, Some(name.trim())),
        None => (row, None),
    };
    let number = number
        .trim()
        .parse()
        .ok()
        .filter(|number| (OWN_ROWS + 1..=99).contains(number))
        .ok_or_else(|| {
            format!(
                "row \"{number}\" is no number from {} to 99 (1 to {OWN_ROWS} are answered here)",
                OWN_ROWS + 1
            )
        })?;
    if let Some(name) = name
        && (name.is_empty()
            || name.chars().count() > NAME_LETTERS
            || name.chars().any(char::is_control))
    {
        return Err(format!(
            "the name \"{}\" must have 1 to {NAME_LETTERS} printable letters",
            name.escape_debug()
        ));
    }
    if folder.is_empty() {
        return Err("the folder after = is empty".to_owned());
    }
    Ok(RowFolder {
        number,
        name: name.map(str::to_owned),
        folder: folder.into(),
    })
}
