//! The other end of the daemon's socket.

use crate::api::{Fault, FaultKind, ShotReply, ShotRequest, ShotsReply, StatusReply};
use http_body_util::{BodyExt, Full, Limited};
use hyper::{Method, Request, body::Bytes, client::conn::http1};
use hyper_util::rt::TokioIo;
use serde::{Serialize, de::DeserializeOwned};
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
    time::Duration,
};
use thiserror::Error;
use tokio::net::UnixStream;

/// Most bytes of a JSON reply.
const LARGEST_REPLY: usize = 16 << 20;
/// Most bytes of a file that is fetched.
const LARGEST_FILE: usize = 1 << 30;
/// Longest time to reach a daemon that listens.
const REACH_TIME: Duration = Duration::from_secs(5);

/// Why the daemon gave no answer.
#[derive(Debug, Error)]
pub enum ClientError {
    /// The socket is there but cannot be used.
    #[error(
        "{socket}: {problem}; check that the daemon is well (`systemctl status captured`) and that you may use its socket"
    )]
    Unreachable {
        /// The socket.
        socket: PathBuf,
        /// What happened.
        problem: String,
    },
    /// An answer that is not what the API promises.
    #[error("{socket}: {problem}; is the daemon of the same version as capturectl?")]
    Answer {
        /// The socket.
        socket: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// The daemon said no.
    #[error("the daemon: {}", .0.message)]
    Refused(Fault),
}

impl ClientError {
    /// The part that failed.
    pub fn fault(&self) -> Fault {
        match self {
            Self::Refused(fault) => Fault {
                message: format!("the daemon: {}", fault.message),
                ..fault.clone()
            },
            other => Fault {
                kind: FaultKind::Daemon,
                message: other.to_string(),
                remedy: None,
            },
        }
    }
}

/// A daemon that was found listening.
pub struct Client {
    socket: PathBuf,
    runtime: tokio::runtime::Runtime,
}

impl Client {
    /// The first daemon that listens at one of `sockets`; `None` where none does.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`] for a socket that is there and refuses for another reason than
    /// that nobody listens: a person without the right should not be given another camera silently.
    pub fn find(sockets: &[PathBuf]) -> Result<Option<Self>, ClientError> {
        let unreachable = |socket: &Path, problem: String| ClientError::Unreachable {
            socket: socket.to_owned(),
            problem,
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|error| unreachable(Path::new("client"), error.to_string()))?;
        for socket in sockets {
            let reached = runtime.block_on(async {
                tokio::time::timeout(REACH_TIME, UnixStream::connect(socket)).await
            });
            match reached {
                Ok(Ok(_)) => {
                    return Ok(Some(Self {
                        socket: socket.clone(),
                        runtime,
                    }));
                }
                Ok(Err(error)) if nobody_listens(&error) => {}
                Ok(Err(error)) => return Err(unreachable(socket, error.to_string())),
                Err(_) => return Err(unreachable(socket, "does not accept connections".into())),
            }
        }
        Ok(None)
    }

    /// Where the daemon listens.
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// How the daemon is.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn status(&self) -> Result<StatusReply, ClientError> {
        self.json(
            Method::GET,
            "/v1/status",
            None::<&()>,
            Duration::from_secs(10),
        )
    }

    /// The newest shots that it keeps.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn shots(&self, limit: usize) -> Result<ShotsReply, ClientError> {
        let address = format!("/v1/shots?limit={limit}");
        self.json(Method::GET, &address, None::<&()>, Duration::from_secs(30))
    }

    /// Deletes a shot.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn delete(&self, id: &str) -> Result<(), ClientError> {
        let address = format!("/v1/shots/{id}");
        let patience = Duration::from_secs(30);
        self.bytes(
            Method::DELETE,
            &address,
            Bytes::new(),
            LARGEST_REPLY,
            patience,
        )
        .map(drop)
    }

    /// Where the viewer's page is.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn viewer(&self) -> Result<String, ClientError> {
        self.json(
            Method::GET,
            "/v1/viewer",
            None::<&()>,
            Duration::from_secs(10),
        )
    }

    /// Asks for a shot and waits for it.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Refused`] carries the daemon's own words.
    pub fn shoot(
        &self,
        request: &ShotRequest,
        patience: Duration,
    ) -> Result<ShotReply, ClientError> {
        self.json(Method::POST, "/v1/shots", Some(request), patience)
    }

    /// Fetches one file of a shot.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn file(&self, id: &str, name: &str) -> Result<Vec<u8>, ClientError> {
        let address = format!("/v1/shots/{id}/files/{name}");
        self.bytes(
            Method::GET,
            &address,
            Bytes::new(),
            LARGEST_FILE,
            Duration::from_secs(60),
        )
        .map(Into::into)
    }

    fn json<T: DeserializeOwned>(
        &self,
        method: Method,
        address: &str,
        body: Option<&impl Serialize>,
        patience: Duration,
    ) -> Result<T, ClientError> {
        let strange = |error: serde_json::Error| self.strange(error.to_string());
        let body = match body {
            Some(body) => serde_json::to_vec(body).map_err(strange)?,
            None => Vec::new(),
        };
        let reply = self.bytes(method, address, body.into(), LARGEST_REPLY, patience)?;
        serde_json::from_slice(&reply).map_err(strange)
    }

    fn strange(&self, problem: String) -> ClientError {
        ClientError::Answer {
            socket: self.socket.clone(),
            problem,
        }
    }

    /// One request on a connection of its own.
    fn bytes(
        &self,
        method: Method,
        address: &str,
        body: Bytes,
        most: usize,
        patience: Duration,
    ) -> Result<Bytes, ClientError> {
        let request = Request::builder()
            .method(method)
            .uri(address)
            .header("host", "captured")
            .header("content-type", "application/json")
            .body(Full::new(body))
            .map_err(|error| self.strange(error.to_string()))?;
        let exchange = async {
            let lost = |error: &dyn std::fmt::Display| ClientError::Unreachable {
                socket: self.socket.clone(),
                problem: error.to_string(),
            };
            let stream = UnixStream::connect(&self.socket)
                .await
                .map_err(|e| lost(&e))?;
            let (mut sender, connection) = http1::handshake(TokioIo::new(stream))
                .await
                .map_err(|e| lost(&e))?;
            // Ends with the sender; what goes wrong on it is seen by the request below.
            let driving = tokio::spawn(connection);
            let reply = sender.send_request(request).await.map_err(|e| lost(&e))?;
            let status = reply.status();
            let body = Limited::new(reply.into_body(), most)
                .collect()
                .await
                .map_err(|e| self.strange(e.to_string()))?
                .to_bytes();
            driving.abort();
            Ok((status, body))
        };
        let (status, body) = self
            .runtime
            .block_on(async { tokio::time::timeout(patience, exchange).await })
            .map_err(|_| self.strange(format!("no answer within {patience:?}")))??;
        if status.is_success() {
            return Ok(body);
        }
        let fault = serde_json::from_slice(&body)
            .map_err(|_| self.strange(format!("answered {status} to {address}")))?;
        Err(ClientError::Refused(fault))
    }
}

/// True when no daemon is behind the socket's path.
fn nobody_listens(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::NotFound | ErrorKind::ConnectionRefused | ErrorKind::NotADirectory
    )
}
