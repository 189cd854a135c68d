//! The commands of `capturectl`, without its terminal: what each takes, does and answers.
//!
//! An answer goes to standard output, as text or as one JSON document; progress, notes and
//! warnings go to standard error only.

mod answer;
mod calibrate;
mod check_device;
mod client;
mod contents;
mod corrupt;
mod corruption_sheet;
mod daemon;
mod daemon_arguments;
mod error;
mod eval;
mod export;
mod film;
mod fsck;
mod import;
mod inference;
mod info;
mod install;
mod lamps_off;
mod lessons;
mod manual;
mod input;
mod lights;
mod progress;
mod record;
mod relight;
mod runtime;
mod shoot;
mod small_file;
mod spoiling;
mod sync_report;

pub use answer::Answer;
pub use client::{Client, ClientError};
pub use daemon_arguments::DaemonArguments;
pub use error::CommandError;

use crate::config::{Config, ConfigError};
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use tokio::signal::unix::{SignalKind, signal};

/// The configuration read when `--config` is not given and the file exists.
const SYSTEM_CONFIG: &str = "/etc/captured/captured.toml";

const EXIT_CODES: &str = "\
Exit codes:
  0  done (warnings stand on standard error and in the JSON answer)
  1  check-device: the device broke a clause of the contract
  2  the command line or a light makes no sense
  3  a file, recording or capture folder is not what it claims to be
  4  the device is not there, does not answer or was unplugged
  5  a result could not be written
  6  the shot cannot be developed (no flash in it, no depth in it)
  7  the daemon is overloaded, stopping or broken

Light directions: x right, y up, z toward the camera, pointing toward the light; any length.
0,0,1 is the flash's own direction. Positions of near lights: the same axes, metres from the color
camera's lens, so that what the camera sees has negative z.";

/// Takes shots with flash, no-flash and depth, and shows them under new light.
#[derive(Debug, Parser)]
#[command(name = "capturectl", version, after_help = EXIT_CODES, max_term_width = 100)]
pub struct CommandLine {
    /// Answer with one JSON document on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Configuration file [default: /etc/captured/captured.toml where there is one].
    #[arg(long, global = true, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Say how the daemon and its devices are.
    Status,
    /// List the shots that the daemon keeps, or delete some.
    Shots(daemon::Shots),
    /// Say the address of the daemon's page on which to look at shots.
    Viewer,
    /// Check that the shots that the daemon keeps are still what was written.
    Fsck(fsck::Fsck),
    /// Put the programs, their units, rules, manual and completions in place.
    Install(install::Install),
    /// Switch off every lamp with a flash driver; the service does so when the daemon has ended.
    LampsOff,
    /// Take a shot now, with the daemon where one runs, else in this process.
    Shoot(shoot::Shoot),
    /// Show a capture folder or a recording under new light.
    Relight(relight::Relight),
    /// Show a capture folder or a recording under a light that moves: animated WebP or PNG.
    Film(film::Film),
    /// Turn a capture folder into a recording.
    Import(import::Import),
    /// Record what a device delivers.
    Record(record::Record),
    /// Say what a capture folder, a recording or a result holds.
    Info(info::Info),
    /// List the devices that can be opened.
    Devices,
    /// Check that a device upholds the contract every driver must.
    CheckDevice(check_device::CheckDevice),
    /// Say how well the cameras of a device keep time: offsets, jitter, drift.
    SyncReport(sync_report::SyncReport),
    /// Relight captures that have truth, and measure the error.
    Eval(eval::Eval),
    /// Make a capture worse on purpose, in one or more of eighteen ways.
    Corrupt(corrupt::Corrupt),
    /// Write a capture's surfaces for other tools: .glb, .ply, .exr with layers, or .ptm.
    Export(export::Export),
    /// Turn rendered captures into what the compact networks learn from.
    Lessons(lessons::Lessons),
    /// Say what runs the networks of --tier paper, or how to get a faster one.
    #[command(subcommand)]
    Runtime(runtime::Runtime),
    /// Measure something about a camera or a rig.
    #[command(subcommand)]
    Calibrate(calibrate::Calibrate),
}

impl CommandLine {
    /// Does it.
    ///
    /// # Errors
    /// [`CommandError`], from which the exit code follows.
    pub fn run(self) -> Result<Answer, CommandError> {
        let config = read_config(self.config.as_deref())?;
        match self.command {
            Command::Status => daemon::status(&config),
            Command::Shots(shots) => shots.run(&config),
            Command::Viewer => daemon::viewer(&config),
            Command::Install(install) => install.run(),
            Command::LampsOff => lamps_off::run(),
            Command::Fsck(fsck) => fsck.run(&config),
            Command::Shoot(shoot) => shoot.run(&config),
            Command::Relight(relight) => relight.run(&config),
            Command::Film(film) => film.run(&config),
            Command::Import(import) => import.run(),
            Command::Record(record) => record.run(&config),
            Command::Info(info) => info.run(),
            Command::Devices => check_device::list(),
            Command::CheckDevice(check) => check.run(),
            Command::SyncReport(report) => report.run(&config),
            Command::Eval(eval) => eval.run(&config),
            Command::Corrupt(corrupt) => corrupt.run(&config),
            Command::Export(export) => export.run(&config),
            Command::Lessons(lessons) => lessons.run(&config),
            Command::Runtime(runtime) => runtime.run(&config),
            Command::Calibrate(calibrate) => calibrate.run(&config),
        }
    }
}

/// The configuration asked for, else the system's, else the defaults.
///
/// # Errors
/// [`ConfigError`] for a file that cannot be read or used.
pub fn read_config(asked: Option<&Path>) -> Result<Config, ConfigError> {
    match asked {
        Some(path) => Config::read(path),
        None if Path::new(SYSTEM_CONFIG).exists() => Config::read(Path::new(SYSTEM_CONFIG)),
        None => Ok(Config::default()),
    }
}

/// Turns a write beyond the limit on file sizes (`ulimit -f`) into an error like that of a full
/// disk; by default its signal ends the process in the middle of a result.
///
/// # Errors
/// When the system allows no handler; the default then stays.
pub fn outlive_file_size_limit() -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .build()?;
    let _entered = runtime.enter();
    // The handler outlives both the listener and the runtime.
    signal(SignalKind::from_raw(libc::SIGXFSZ)).map(drop)
}
