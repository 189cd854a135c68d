//! What `eval` makes worse on purpose: `--corrupt` and the options that go with it.

use crate::{
    corruption::{CORRUPTIONS, Corruption, MOST_SEVERE},
    eval::Spoiling,
};
use clap::Args;

/// What `--corrupt` takes for all of them.
const ALL: &str = "all";

/// How captures are made worse for the stability run.
#[derive(Debug, Args)]
pub struct SpoilingArguments {
    /// Measure captures once more after each of these corruptions (`corrupt --help` lists them),
    /// with every row that answers here: error against severity, and where a row becomes worse
    /// than doing nothing.
    #[arg(long, value_name = "all|NAME,…", value_parser = ways)]
    corrupt: Option<Ways>,
    /// Severities to measure, 1 to 5 [default: 1,2,3,4,5].
    #[arg(long, value_name = "N,…", value_parser = severities, requires = "corrupt")]
    severities: Option<Severities>,
    /// Make at most so many captures worse, evenly over all that have true pictures [default: all].
    #[arg(long, value_name = "N", value_parser = count, requires = "corrupt")]
    corrupt_captures: Option<usize>,
    /// Compare under at most so many lights of each, evenly over their angles.
    #[arg(long, value_name = "N", value_parser = count, default_value = "4")]
    corrupt_lights: usize,
    /// Other dice.
    #[arg(long, value_name = "N", default_value_t = 0)]
    corrupt_seed: u64,
}

/// Corruptions, each once, in the order of their table.
#[derive(Debug, Clone)]
struct Ways(Vec<&'static Corruption>);

/// Severities, ascending, each once.
#[derive(Debug, Clone)]
struct Severities(Vec<u8>);

impl SpoilingArguments {
    /// What is asked for; `None` without `--corrupt`.
    pub fn asked(&self) -> Option<Spoiling> {
        let ways = self.corrupt.as_ref()?;
        let severities = self.severities.as_ref();
        Some(Spoiling {
            ways: ways.0.clone(),
            severities: severities.map_or_else(|| (1..=MOST_SEVERE).collect(), |all| all.0.clone()),
            seed: self.corrupt_seed,
            captures: self.corrupt_captures.unwrap_or(usize::MAX),
            lights: self.corrupt_lights,
        })
    }
}

/// Reads `all` or `NAME,…`.
fn ways(text: &str) -> Result<Ways, String> {
    if text == ALL {
        return Ok(Ways(CORRUPTIONS.iter().collect()));
    }
    let asked = text
        .split(',')
        .map(|name| Corruption::named(name.trim()).map_err(|error| error.to_string()))
        .collect::<Result<Vec<_>, _>>()?;
    let asked_for = |way: &&Corruption| asked.iter().any(|asked| asked.name == way.name);
    Ok(Ways(CORRUPTIONS.iter().filter(asked_for).collect()))
}

/// Reads `N,…`.
fn severities(text: &str) -> Result<Severities, String> {
    let read = |word: &str| {
        let severity = word.trim().parse().ok();
        severity
            .filter(|severity| (1..=MOST_SEVERE).contains(severity))
            .ok_or_else(|| {
                format!("severity \"{word}\" is no whole number from 1 to {MOST_SEVERE} (worst)")
            })
    };
    let mut severities: Vec<u8> = text.split(',').map(read).collect::<Result<_, _>>()?;
    severities.sort_unstable();
    severities.dedup();
    Ok(Severities(severities))
}

/// Reads a number from 1.
fn count(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| format!("\"{text}\" is no whole number from 1"))
}
