//! The socket: who may connect, how long a connection may last, and the end of them all.

use super::{Listeners, State, access::Caller, routes, viewer};
use crate::store::StoreError;
use axum::Router;
use hyper::{body::Incoming, server::conn::http1, service::Service as _};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{
    os::unix::fs::{FileTypeExt, PermissionsExt},
    path::{Path, PathBuf},
    pin::pin,
    sync::Arc,
    time::Duration,
};
use thiserror::Error;
use tokio::{
    io::{AsyncRead, AsyncWrite},
    net::{TcpListener, TcpStream, UnixListener, UnixStream},
    sync::{Semaphore, watch},
    task::JoinSet,
};

/// Longest time for the head of a request.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Longest time that open requests get once the daemon is told to stop.
const FAREWELL: Duration = Duration::from_secs(10);
/// Most bytes of a request's head.
const HEAD_BYTES: usize = 16 << 10;

/// Why the daemon does not run.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum DaemonError {
    #[error("{path}: a daemon listens here already; stop it, or set another `socket`")]
    Occupied { path: PathBuf },
    #[error("{path}: exists and is not a socket; remove it, or set another `socket`")]
    NotASocket { path: PathBuf },
    #[error(
        "{path}: cannot listen: {source}; set `socket` to a path in a folder that can be written"
    )]
    Listen {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("a thread cannot start: {0}")]
    Thread(std::io::Error),
    #[error("the viewer cannot be served: {0}; set viewer.address, or leave the viewer off")]
    Viewer(std::io::Error),
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Listens at `path`, replacing the socket of a daemon that is no longer there.
///
/// The socket can be used by its owner and its group (mode 0660).
///
/// # Errors
/// [`DaemonError::Occupied`], [`DaemonError::NotASocket`] or [`DaemonError::Listen`].
pub async fn bind(path: &Path) -> Result<UnixListener, DaemonError> {
    let listen = |source| DaemonError::Listen {
        path: path.to_owned(),
        source,
    };
    if let Ok(found) = path.symlink_metadata() {
        if !found.file_type().is_socket() {
            return Err(DaemonError::NotASocket {
                path: path.to_owned(),
            });
        }
        if UnixStream::connect(path).await.is_ok() {
            return Err(DaemonError::Occupied {
                path: path.to_owned(),
            });
        }
        std::fs::remove_file(path).map_err(listen)?;
    }
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(listen)?;
    }
    let listener = UnixListener::bind(path).map_err(listen)?;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660)).map_err(listen)?;
    Ok(listener)
}

/// Serves until `stop` resolves; then connections may finish what they are at, and so may shots.
pub(super) async fn serve(
    daemon: &Arc<State>,
    Listeners { socket, viewer }: Listeners,
    stop: impl Future<Output = ()>,
) {
    let (leave, leaving) = watch::channel(false);
    let api = routes::api(daemon);
    let pages = viewer::pages(daemon, api.clone());
    let programs = accept(daemon, Door::Socket(socket), api, leaving.clone());
    let browsers = async {
        if let Some(listener) = viewer {
            accept(daemon, Door::Viewer(listener), pages, leaving).await;
        }
    };
    let stopping = async {
        stop.await;
        // Receivers that are gone have finished already.
        let _ = leave.send(true);
    };
    tokio::join!(programs, browsers, stopping);
    let mut underway = daemon.underway.subscribe();
    let ended = underway.wait_for(|shots| *shots == 0);
    if tokio::time::timeout(FAREWELL, ended).await.is_err() {
        tracing::warn!(
            "stopped with a shot unfinished; what is whole of it is salvaged at the next start"
        );
    }
}

/// Where connections come in.
enum Door {
    Socket(UnixListener),
    Viewer(TcpListener),
}

/// One connection and who is at its other end.
enum Connected {
    Socket(UnixStream, Caller),
    Viewer(TcpStream),
}

impl Door {
    async fn accept(&self) -> std::io::Result<Connected> {
        match self {
            Self::Socket(listener) => {
                let (stream, _) = listener.accept().await?;
                let caller = Caller::of(&stream)?;
                Ok(Connected::Socket(stream, caller))
            }
            Self::Viewer(listener) => {
                let (stream, _) = listener.accept().await?;
                // Pictures of a dragged light should not wait for the next one.
                stream.set_nodelay(true)?;
                Ok(Connected::Viewer(stream))
            }
        }
    }
}

/// Accepts until told to leave, then waits a while for the connections to end.
async fn accept(
    daemon: &Arc<State>,
    door: Door,
    router: Router,
    mut leaving: watch::Receiver<bool>,
) {
    let most = daemon.config.borrow().limits.connections;
    let places = Arc::new(Semaphore::new(most));
    let mut connections = JoinSet::new();
    loop {
        let accepted = async {
            // Closed only by dropping, which cannot happen while it is borrowed here.
            let place = Arc::clone(&places).acquire_owned().await;
            (door.accept().await, place)
        };
        let told = leaving.clone();
        let (connected, place) = tokio::select! {
            _ = leaving.wait_for(|leaving| *leaving) => break,
            (Ok(connected), Ok(place)) = accepted => (connected, place),
            // Out of file descriptors, most likely: give the open connections time to end.
            else => {
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            }
        };
        let lifetime = daemon.config.borrow().limits.request_time() * 2;
        let open = daemon.metrics.connections.clone();
        let router = router.clone();
        connections.spawn(async move {
            open.inc();
            match connected {
                Connected::Socket(stream, caller) => {
                    connection(stream, caller, router, lifetime, told).await;
                }
                Connected::Viewer(stream) => {
                    connection(stream, Caller::Browser, router, lifetime, told).await;
                }
            }
            open.dec();
            drop(place);
        });
        while connections.try_join_next().is_some() {}
    }
    drop(door);
    let finished = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(FAREWELL, finished).await.is_err() {
        tracing::warn!("stopped with requests still open");
    }
}

/// One connection from its first byte to its last.
async fn connection(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static,
    caller: Caller,
    router: Router,
    lifetime: Duration,
    mut leaving: watch::Receiver<bool>,
) {
    let service = TowerToHyperService::new(router);
    let service = hyper::service::service_fn(move |mut request: hyper::Request<Incoming>| {
        request.extensions_mut().insert(caller.clone());
        service.call(request)
    });
    let mut server = http1::Builder::new();
    server
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .max_buf_size(HEAD_BYTES);
    let mut serving = pin!(server.serve_connection(TokioIo::new(stream), service));
    let whole = async {
        tokio::select! {
            result = serving.as_mut() => return result,
            _ = leaving.wait_for(|leaving| *leaving) => {}
        }
        serving.as_mut().graceful_shutdown();
        serving.await
    };
    match tokio::time::timeout(lifetime, whole).await {
        Ok(Ok(())) => {}
        Ok(Err(error)) => tracing::debug!("connection ended: {error}"),
        Err(_) => tracing::debug!("connection closed after {lifetime:?}"),
    }
}
