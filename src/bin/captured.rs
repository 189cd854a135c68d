//! The daemon: opens its device, listens, and stops when it is told to.
#![forbid(unsafe_code)]

use captured::{
    commands::{outlive_file_size_limit, read_config},
    daemon::{bind, serve},
};
use clap::Parser;
use miette::{Context, IntoDiagnostic};
use sd_notify::NotifyState;
use std::path::PathBuf;
use tokio::signal::unix::{SignalKind, signal};

/// Owns one capture device and serves shots over a Unix socket.
#[derive(Debug, Parser)]
#[command(name = "captured", version)]
struct Arguments {
    /// Configuration file [default: /etc/captured/captured.toml where there is one].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Address of the device to own, instead of the configured one.
    #[arg(long, value_name = "ADDRESS")]
    device: Option<String>,
    /// Socket to listen on, instead of the configured one.
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Folder to keep shots in, instead of the configured one.
    #[arg(long, value_name = "FOLDER")]
    state: Option<PathBuf>,
}

fn main() -> miette::Result<()> {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .init();
    let arguments = Arguments::parse();
    outlive_file_size_limit()
        .into_diagnostic()
        .wrap_err("signals cannot be handled")?;
    let mut config = read_config(arguments.config.as_deref()).into_diagnostic()?;
    if let Some(device) = arguments.device {
        config.device = device;
    }
    config.socket = arguments.socket.or(config.socket);
    config.state = arguments.state.or(config.state);

    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .into_diagnostic()
        .wrap_err("the runtime cannot start")?;
    runtime.block_on(async {
        let device = drivers::open::open(&config.device).into_diagnostic()?;
        let socket = config.socket_path();
        let listener = bind(&socket).await.into_diagnostic()?;
        let mut terminate = signal(SignalKind::terminate()).into_diagnostic()?;
        let mut interrupt = signal(SignalKind::interrupt()).into_diagnostic()?;
        let stop = async {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
            tracing::info!("stopping");
            tell(NotifyState::Stopping);
        };
        let address = config.device.clone();
        let ready = || {
            tracing::info!("{address} on {}", socket.display());
            tell(NotifyState::Ready);
        };
        let served = serve(config, device, listener, ready, stop)
            .await
            .into_diagnostic();
        // Whoever comes next finds no daemon rather than a dead one.
        if let Err(error) = std::fs::remove_file(&socket) {
            tracing::warn!("{}: {error}", socket.display());
        }
        served
    })
}

/// Tells the service manager, where there is one.
fn tell(state: NotifyState) {
    if let Err(error) = sd_notify::notify(&[state]) {
        tracing::warn!("the service manager was not told: {error}");
    }
}
