//! The daemon: listens, watches its configuration, and stops when it is told to.
#![forbid(unsafe_code)]

use captured::{
    commands::{DaemonArguments, outlive_file_size_limit},
    config::Config,
    daemon::{Listeners, Signs, bind, serve},
};
use clap::Parser;
use listenfd::ListenFd;
use miette::{Context, IntoDiagnostic};
use sd_notify::NotifyState;
use std::{
    path::PathBuf,
    sync::{
        Arc,
        mpsc::{Receiver, SyncSender, sync_channel},
    },
    time::Duration,
};
use tokio::{
    net::{TcpListener, UnixListener},
    signal::unix::{SignalKind, signal},
    sync::watch,
};
use tracing_subscriber::{EnvFilter, layer::SubscriberExt, util::SubscriberInitExt};

/// Longest wait for a service manager to hear of the end.
const FAREWELL: Duration = Duration::from_secs(1);
/// Between two signs of life where the service manager asks for none.
const USUAL_PERIOD: Duration = Duration::from_secs(5);

fn main() -> miette::Result<()> {
    speak();
    let arguments = DaemonArguments::parse();
    outlive_file_size_limit()
        .into_diagnostic()
        .wrap_err("signals cannot be handled")?;
    let config = arguments.configured().into_diagnostic()?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .into_diagnostic()
        .wrap_err("the runtime cannot start")?;
    runtime.block_on(run(arguments, config))
}

async fn run(arguments: DaemonArguments, config: Config) -> miette::Result<()> {
    let (manager, all_told) = Manager::new()?;
    let (listeners, own_socket) = listeners(&config).await?;
    let mut terminate = signal(SignalKind::terminate()).into_diagnostic()?;
    let mut interrupt = signal(SignalKind::interrupt()).into_diagnostic()?;
    let stop = async {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        tracing::info!("stopping");
        manager.tell(&[NotifyState::Stopping]);
    };
    let devices = config.devices.join(", ");
    let (changed, current) = watch::channel(Arc::new(config));
    let reloading = tokio::spawn(reload(arguments, changed, manager.clone()));
    // Half of what the manager waits, so that one sign may come late.
    let period = sd_notify::watchdog_enabled().map_or(USUAL_PERIOD, |most| most / 2);
    let mut ready = |page: Option<&str>| {
        tracing::info!("{devices} ready");
        if page.is_some() {
            tracing::info!("viewer: `capturectl viewer` says its address");
        }
        manager.tell(&[NotifyState::Ready]);
    };
    let signs = Signs {
        ready: &mut ready,
        alive: &mut || manager.tell(&[NotifyState::Watchdog]),
        period,
    };
    let served = serve(current, listeners, signs, stop)
        .await
        .into_diagnostic();
    reloading.abort();
    // It ended as it was told, if at all.
    drop(reloading.await);
    // Whoever comes next finds no daemon rather than a dead one.
    if let Some(socket) = own_socket
        && let Err(error) = std::fs::remove_file(&socket)
    {
        tracing::warn!("{}: {error}", socket.display());
    }
    drop(manager);
    // Until the last is told; its end is an error of the receiver.
    let _ = all_told.recv_timeout(FAREWELL);
    served
}

/// The sockets that the service manager opened, else our own; and the path of our own.
async fn listeners(config: &Config) -> miette::Result<(Listeners, Option<PathBuf>)> {
    let mut given = ListenFd::from_env();
    let mut socket = None;
    let mut viewer = None;
    for index in 0..given.len() {
        if let Ok(Some(found)) = given.take_unix_listener(index) {
            found.set_nonblocking(true).into_diagnostic()?;
            socket = Some(UnixListener::from_std(found).into_diagnostic()?);
        } else if let Ok(Some(found)) = given.take_tcp_listener(index) {
            found.set_nonblocking(true).into_diagnostic()?;
            viewer = Some(TcpListener::from_std(found).into_diagnostic()?);
        }
    }
    let (socket, own) = match socket {
        Some(socket) => (socket, None),
        None => {
            let path = config.socket_path();
            (bind(&path).await.into_diagnostic()?, Some(path))
        }
    };
    if viewer.is_none() && config.viewer.enabled {
        let address = config.viewer.address;
        let listener = TcpListener::bind(address).await.into_diagnostic();
        viewer = Some(listener.wrap_err_with(|| {
            format!("viewer.address {address} cannot be listened on; set another, or leave the viewer off")
        })?);
    }
    Ok((Listeners { socket, viewer }, own))
}

/// Reads the configuration again at every SIGHUP; one that cannot be used changes nothing.
async fn reload(arguments: DaemonArguments, changed: watch::Sender<Arc<Config>>, manager: Manager) {
    let Ok(mut hangup) = signal(SignalKind::hangup()) else {
        tracing::error!("SIGHUP cannot be handled; a changed configuration takes a restart");
        return;
    };
    while hangup.recv().await.is_some() {
        manager.tell(&[
            NotifyState::Reloading,
            NotifyState::monotonic_usec_now().unwrap_or(NotifyState::MonotonicUsec(0)),
        ]);
        match arguments.configured() {
            Ok(config) => {
                for key in takes_restart(&changed.borrow(), &config) {
                    tracing::warn!("{key} has changed; that counts from the next start on");
                }
                changed.send_replace(Arc::new(config));
                tracing::info!("configuration read again");
            }
            Err(error) => {
                tracing::error!("the last good configuration stays: {error}");
            }
        }
        manager.tell(&[NotifyState::Ready]);
    }
}

/// Keys that a running daemon does not change.
fn takes_restart(old: &Config, new: &Config) -> Vec<&'static str> {
    [
        ("devices", old.devices != new.devices),
        ("rig", old.rig != new.rig),
        ("socket", old.socket != new.socket),
        ("state", old.state != new.state),
        ("viewer.address", old.viewer.address != new.viewer.address),
        ("viewer.enabled", old.viewer.enabled != new.viewer.enabled),
        ("limits.queue", old.limits.queue != new.limits.queue),
        (
            "limits.connections",
            old.limits.connections != new.limits.connections,
        ),
    ]
    .into_iter()
    .filter_map(|(key, changed)| changed.then_some(key))
    .collect()
}

/// To the journal with its fields where systemd runs us, else to standard error.
fn speak() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let all = tracing_subscriber::registry().with(filter);
    let journal = std::env::var_os("JOURNAL_STREAM").and_then(|_| tracing_journald::layer().ok());
    match journal {
        Some(journal) => all.with(journal).init(),
        None => all
            .with(tracing_subscriber::fmt::layer().with_writer(std::io::stderr))
            .init(),
    }
}

/// Tells the service manager, where there is one. It does so on a thread of its own: a manager that does
/// not listen fills its socket, and whoever writes to that waits for ever.
#[derive(Clone)]
struct Manager(SyncSender<Vec<NotifyState<'static>>>);

impl Manager {
    /// Starts its thread, whose end is told through the receiver once nobody has anything to tell.
    fn new() -> miette::Result<(Self, Receiver<()>)> {
        let (sender, told) = sync_channel::<Vec<NotifyState<'static>>>(8);
        let (ended, end) = sync_channel(0);
        let telling = move || {
            let _ended: SyncSender<()> = ended;
            for states in told {
                if let Err(error) = sd_notify::notify(&states) {
                    tracing::warn!("the service manager was not told: {error}");
                }
            }
        };
        std::thread::Builder::new()
            .name("manager".to_owned())
            .spawn(telling)
            .into_diagnostic()
            .wrap_err("a thread cannot start")?;
        Ok((Self(sender), end))
    }

    fn tell(&self, states: &[NotifyState<'static>]) {
        // One that has not heard the last eight will not miss this one.
        drop(self.0.try_send(states.to_vec()));
    }
}
