//! The socket: who may connect, how long a connection may last, and the end of them all.

use super::store::StoreError;
use crate::config::Limits;
use axum::Router;
use hyper::server::conn::http1;
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
    net::{UnixListener, UnixStream},
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
    #[error("the camera's thread cannot start: {0}")]
    Thread(std::io::Error),
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

/// Serves until `stop` resolves; then connections may finish what they are at.
pub(super) async fn serve(
    listener: UnixListener,
    router: Router,
    limits: &Limits,
    stop: impl Future<Output = ()>,
) {
    let places = Arc::new(Semaphore::new(limits.connections));
    let (leave, leaving) = watch::channel(false);
    let mut connections = JoinSet::new();
    let mut stop = pin!(stop);
    loop {
        let accepted = async {
            // Closed only by dropping, which cannot happen while it is borrowed here.
            let place = Arc::clone(&places).acquire_owned().await;
            (listener.accept().await, place)
        };
        let (stream, place) = tokio::select! {
            () = &mut stop => break,
            (Ok((stream, _)), Ok(place)) = accepted => (stream, place),
            // Out of file descriptors, most likely: give the open connections time to end.
            else => {
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            }
        };
        let connection = connection(stream, router.clone(), limits, leaving.clone());
        connections.spawn(async move {
            connection.await;
            drop(place);
        });
        while connections.try_join_next().is_some() {}
    }
    drop(listener);
    // Receivers that are gone have finished already.
    let _ = leave.send(true);
    let finished = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(FAREWELL, finished).await.is_err() {
        tracing::warn!("stopped with requests still open");
    }
}

/// One connection from its first byte to its last.
fn connection(
    stream: UnixStream,
    router: Router,
    limits: &Limits,
    mut leaving: watch::Receiver<bool>,
) -> impl Future<Output = ()> + use<> {
    let lifetime = limits.request_time() * 2;
    let service = TowerToHyperService::new(router);
    async move {
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
}
