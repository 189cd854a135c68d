//! What is answered at which address.

use super::State as Daemon;
use crate::{
    api::{
        CheckedLights, DevicesReply, Fault, FaultKind, LightError, ShotReply, ShotRequest,
        StatusReply, Tier,
    },
    darkroom::{self, Answering, Asked},
    inference::{self, InferenceError},
    output::Existing,
    session::{self, SessionError},
};
use axum::{
    Json, Router,
    body::Bytes,
    body::HttpBody as _,
    extract::{DefaultBodyLimit, Path, Request, State},
    http::{StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use std::{
    sync::{Arc, atomic::Ordering},
    time::Duration,
};

/// Every address of the daemon.
pub(super) fn router(daemon: Arc<Daemon>) -> Router {
    let limits = daemon.config.limits.clone();
    Router::new()
        .route("/v1/status", get(status))
        .route("/v1/devices", get(devices))
        .route("/v1/shots", post(shoot))
        .route("/v1/shots/{id}/files/{name}", get(file))
        .fallback(unknown)
        .method_not_allowed_fallback(unknown)
        .layer(DefaultBodyLimit::max(limits.request_bytes))
        .layer(middleware::from_fn(move |request: Request, next: Next| {
            let patience = limits.request_time();
            let most = limits.request_bytes as u64;
            async move {
                // Said at once, not after the body has been waited for.
                if request.body().size_hint().lower() > most {
                    let message = format!(
                        "the body has more than {most} bytes; send fewer lights, or raise limits.request_bytes"
                    );
                    let fault = Fault {
                        kind: FaultKind::Request,
                        message,
                        remedy: None,
                    };
                    return refuse(StatusCode::PAYLOAD_TOO_LARGE, fault);
                }
                tokio::time::timeout(patience, next.run(request))
                    .await
                    .unwrap_or_else(|_| {
                        refuse(
                            StatusCode::GATEWAY_TIMEOUT,
                            Fault {
                                kind: FaultKind::Daemon,
                                message: format!("no answer within {patience:?}"),
                                remedy: Some(
                                    "raise limits.request_seconds or ask for fewer lights"
                                        .to_owned(),
                                ),
                            },
                        )
                    })
            }
        }))
        .with_state(daemon)
}

fn refuse(status: StatusCode, fault: Fault) -> Response {
    (status, Json(fault)).into_response()
}

impl IntoResponse for Fault {
    fn into_response(self) -> Response {
        let status = match self.kind {
            FaultKind::Request => StatusCode::BAD_REQUEST,
            FaultKind::Input | FaultKind::Shot | FaultKind::Contract => {
                StatusCode::UNPROCESSABLE_ENTITY
            }
            FaultKind::Device => StatusCode::BAD_GATEWAY,
            FaultKind::Output => StatusCode::INSUFFICIENT_STORAGE,
            FaultKind::Daemon => StatusCode::SERVICE_UNAVAILABLE,
        };
        refuse(status, self)
    }
}

async fn unknown(request: Request) -> Response {
    let message = format!("nothing at {} {}", request.method(), request.uri().path());
    refuse(
        StatusCode::NOT_FOUND,
        Fault {
            kind: FaultKind::Request,
            message,
            remedy: Some(
                "GET /v1/status, GET /v1/devices, POST /v1/shots, GET /v1/shots/{id}/files/{name}"
                    .to_owned(),
            ),
        },
    )
}

async fn status(State(daemon): State<Arc<Daemon>>) -> Json<StatusReply> {
    Json(StatusReply {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        device: daemon.camera.info().clone(),
        in_use: daemon.camera.in_use(),
        shots: daemon.shots.load(Ordering::Relaxed),
        failures: daemon.failures.load(Ordering::Relaxed),
        latest: daemon.latest(),
    })
}

async fn devices() -> Result<Json<DevicesReply>, Fault> {
    let listed = tokio::task::spawn_blocking(drivers::open::list).await;
    Ok(Json(DevicesReply {
        devices: listed.map_err(broken)?,
    }))
}

async fn file(
    State(daemon): State<Arc<Daemon>>,
    Path((id, name)): Path<(String, String)>,
) -> Response {
    let read = tokio::task::spawn_blocking(move || daemon.store.read(&id, &name)).await;
    match read.map_err(broken) {
        Ok(Ok(bytes)) => {
            ([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response()
        }
        Ok(Err(error)) => error.fault().into_response(),
        Err(fault) => fault.into_response(),
    }
}

async fn shoot(State(daemon): State<Arc<Daemon>>, body: Bytes) -> Result<Json<ShotReply>, Fault> {
    let answer = take_and_keep(&daemon, &body).await;
    if answer.is_err() {
        daemon.failures.fetch_add(1, Ordering::Relaxed);
    }
    answer.map(Json)
}

/// Checks everything that can be checked before the flash fires, then takes, develops and commits.
async fn take_and_keep(daemon: &Arc<Daemon>, body: &[u8]) -> Result<ShotReply, Fault> {
    let request_fault = |message: String| Fault {
        kind: FaultKind::Request,
        message,
        remedy: None,
    };
    let request: ShotRequest = serde_json::from_slice(body)
        .map_err(|error| request_fault(format!("the request's JSON: {error}")))?;
    let environment = request.environment.as_ref();
    let mut lights = CheckedLights::new(&request.lights, daemon.config.limits.lights, environment)
        .map_err(|error| request_fault(error.to_string()))?;
    if !request.relight && !lights.is_empty() {
        return Err(request_fault(
            "lights: given, but relight is false; set relight to true".to_owned(),
        ));
    }
    if request.relight && lights.is_empty() {
        return Err(request_fault(LightError::None.to_string()));
    }
    let unusual = request.tier != Tier::default() || request.budget_ms.is_some();
    if unusual && !request.relight {
        return Err(request_fault(
            "tier: given, but relight is false; set relight to true".to_owned(),
        ));
    }
    let asked = asked(&request).map_err(request_fault)?;
    let settings = daemon.config.inference.clone();
    if asked.tier == Tier::Paper {
        let checked = settings.clone();
        let check = move || inference::check_paper(asked.variant, &checked);
        let checked = tokio::task::spawn_blocking(check).await.map_err(broken)?;
        checked.map_err(unusable)?;
    }
    let taken = daemon.camera.shoot().await?;
    // Never closed. It goes with the work, which goes on when the client leaves.
    let turn = Arc::clone(&daemon.darkroom).acquire_owned().await;
    let (id, folder) = daemon.store.next();
    let kept = tokio::task::spawn_blocking(move || {
        let answering = if request.relight {
            // Loaded for this shot alone: an idle daemon holds no network.
            let ready = darkroom::ready(asked, &settings);
            let (answering, said) = ready.map_err(|error| SessionError::from(error).fault())?;
            lights.warnings.extend(said);
            answering
        } else {
            Answering::Closed
        };
        let lights = request.relight.then_some(&lights);
        let (answering, silent) = (&answering, &mut |_: &str| {});
        let kept = session::keep(&taken, lights, answering, &folder, Existing::Refuse, silent);
        drop(turn);
        kept.map_err(|error| error.fault())
    });
    let kept = kept.await.map_err(broken)??;
    daemon.count_shot(&id);
    Ok(ShotReply {
        id,
        device: daemon.camera.info().address.clone(),
        files: kept.files,
        warnings: kept.warnings,
        shot: kept.manifest,
    })
}

/// What the request asks to answer.
fn asked(request: &ShotRequest) -> Result<Asked, String> {
    let budget = match request.budget_ms {
        None => None,
        Some(_) if request.tier != Tier::Auto => {
            return Err("budget_ms: given with another tier than auto; leave one out".to_owned());
        }
        Some(ms) if ms > 0.0 && ms <= 3.6e6 => Some(Duration::from_secs_f64(ms / 1e3)),
        Some(ms) => {
            return Err(format!(
                "budget_ms is {ms}; it must be above 0 and at most 3600000"
            ));
        }
    };
    Ok(Asked {
        tier: request.tier,
        variant: request.variant,
        budget,
    })
}

/// A network that cannot be had.
fn unusable(error: InferenceError) -> Fault {
    Fault {
        kind: FaultKind::Input,
        message: error.to_string(),
        remedy: None,
    }
}

/// A task that panicked: our bug, and the request's end, but not the daemon's.
fn broken(error: tokio::task::JoinError) -> Fault {
    tracing::error!("a request failed: {error}");
    Fault {
        kind: FaultKind::Daemon,
        message: "the request failed in the daemon".to_owned(),
        remedy: Some("report this as a bug, with the daemon's log".to_owned()),
    }
}
