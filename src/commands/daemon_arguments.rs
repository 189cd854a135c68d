//! The command line of `captured` itself.

use super::read_config;
use crate::config::{Config, ConfigError};
use clap::Parser;
use std::path::PathBuf;

/// Owns capture devices and serves shots over a Unix socket.
#[derive(Debug, Clone, Parser)]
#[command(name = "captured", version)]
pub struct DaemonArguments {
    /// Configuration file [default: /etc/captured/captured.toml where there is one].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Address of a device to own, instead of the configured ones; may be given several times.
    #[arg(long, value_name = "ADDRESS")]
    device: Vec<String>,
    /// Socket to listen on, instead of the configured one.
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Folder to keep shots in, instead of the configured one.
    #[arg(long, value_name = "FOLDER")]
    state: Option<PathBuf>,
    /// Serve the page on which to look at shots, at viewer.address of the configuration.
    #[arg(long)]
    viewer: bool,
}

impl DaemonArguments {
    /// The configuration with what the command line says instead.
    ///
    /// # Errors
    /// [`ConfigError`] for a file that cannot be read or used.
    pub fn configured(&self) -> Result<Config, ConfigError> {
        let mut config = read_config(self.config.as_deref())?;
        if !self.device.is_empty() {
            config.devices.clone_from(&self.device);
        }
        config.socket = self.socket.clone().or(config.socket);
        config.state = self.state.clone().or(config.state);
        config.viewer.enabled |= self.viewer;
        Ok(config)
    }
}
