//! `calibrate`: what a camera or a rig is like, from pictures made for it.

mod response;
mod rig;

use super::{Answer, CommandError};
use crate::config::Config;
use clap::Subcommand;

/// Measure something about a camera or a rig.
#[derive(Debug, Subcommand)]
pub enum Calibrate {
    /// The transfer curve, from 8-bit pictures of one still scene at known exposures.
    Response(response::Response),
    /// Lenses, where cameras and flash sit, and the depth camera's offset, from shots of a board.
    Rig(rig::Rig),
}

impl Calibrate {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        match self {
            Self::Response(response) => response.run(),
            Self::Rig(rig) => rig.run(config),
        }
    }
}
