//! Shots: taken, listed, looked at, relit and deleted.

use super::{super::access::Shooter, Daemon};
use crate::{
    api::{
        CheckedLights, Event, Fault, RelightRequest, ShotEntry, ShotReply, ShotRequest, ShotsReply,
        ViewRequest,
    },
    daemon::{
        light_table::Look,
        shooting::{self, Underway, broken, refused},
    },
    store::StoreError,
};
use axum::{
    Json,
    body::{Body, Bytes},
    extract::{Path, Query, State},
    http::{HeaderMap, StatusCode, header},
    response::{
        IntoResponse, Response,
        sse::{self, KeepAlive, Sse},
    },
};
use futures_util::stream;
use serde::{Deserialize, de::DeserializeOwned};
use std::{
    convert::Infallible,
    sync::{Arc, mpsc::TrySendError},
};
use tokio::sync::oneshot;
use tokio_util::io::ReaderStream;
use utoipa::IntoParams;

/// Most shots of one list.
const LONGEST_LIST: usize = 200;

/// Which part of the list.
#[derive(Debug, Clone, Default, Deserialize, IntoParams)]
#[serde(default, deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// How many at most, up to 200.
    limit: Option<usize>,
    /// Leave out so many of the newest.
    skip: usize,
}

/// What is kept, newest first.
#[utoipa::path(get, path = "/v1/shots", params(ListQuery), responses((status = 200, body = ShotsReply)))]
pub(super) async fn list(
    State(daemon): State<Arc<Daemon>>,
    Query(query): Query<ListQuery>,
) -> Result<Json<ShotsReply>, Fault> {
    let listed = tokio::task::spawn_blocking(move || {
        let ids = daemon.store.ids()?;
        let limit = query.limit.unwrap_or(50).min(LONGEST_LIST);
        let asked = ids.iter().skip(query.skip).take(limit);
        // One that is damaged, or went meanwhile, does not hide the others; `fsck` names it.
        let shots = asked.filter_map(|id| entry(&daemon, id).ok()).collect();
        Ok(ShotsReply {
            count: ids.len(),
            shots,
        })
    });
    let reply = listed.await.map_err(broken)?;
    reply.map(Json).map_err(|error: StoreError| error.fault())
}

fn entry(daemon: &Daemon, id: &str) -> Result<ShotEntry, StoreError> {
    let manifest = daemon.store.manifest(id)?;
    let digits = id.trim_start_matches("shot-");
    Ok(ShotEntry {
        id: id.to_owned(),
        at_ms: digits.parse().unwrap_or(0),
        source: manifest.source,
        width: manifest.width,
        height: manifest.height,
        lights: manifest
            .lights
            .into_iter()
            .map(|light| light.label)
            .collect(),
        warnings: manifest.warnings,
        files: manifest.files.into_iter().map(|file| file.name).collect(),
    })
}

/// Takes a shot now. With `accept: text/event-stream` its steps come as `step` events, and at last one
/// `done` with a `ShotReply` or one `failed` with a `Fault`.
#[utoipa::path(
    post,
    path = "/v1/shots",
    request_body = ShotRequest,
    responses(
        (status = 200, body = ShotReply, description = "Safe on the disk"),
        (status = 400, body = Fault, description = "The request makes no sense"),
        (status = 403, body = Fault, description = "The caller may only look"),
        (status = 422, body = Fault, description = "The shot cannot be developed"),
        (status = 502, body = Fault, description = "The device gave no shot"),
        (status = 503, body = Fault, description = "Too many wait already"),
        (status = 507, body = Fault, description = "There is no room for a shot; the flash did not fire"),
    ),
)]
pub(super) async fn shoot(
    State(daemon): State<Arc<Daemon>>,
    Shooter(caller): Shooter,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let begun = match parsed(&body) {
        Ok(request) => shooting::begin(&daemon, caller, request).await,
        Err(fault) => Err(fault),
    };
    answer(&daemon, &headers, begun).await
}

/// Develops a kept shot once more, under other lights; what comes of it is kept as a new shot. Steps
/// come as for a new shot.
#[utoipa::path(
    post,
    path = "/v1/shots/{id}/relight",
    params(("id" = String, Path)),
    request_body = RelightRequest,
    responses(
        (status = 200, body = ShotReply, description = "Safe on the disk"),
        (status = 400, body = Fault, description = "The request makes no sense"),
        (status = 403, body = Fault, description = "The caller may only look"),
        (status = 422, body = Fault, description = "The shot cannot be developed"),
    ),
)]
pub(super) async fn relight(
    State(daemon): State<Arc<Daemon>>,
    _: Shooter,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let begun = match parsed(&body) {
        Ok(request) => shooting::begin_again(&daemon, &id, request).await,
        Err(fault) => Err(fault),
    };
    answer(&daemon, &headers, begun).await
}

/// One answer when all is done, or one event per step.
async fn answer(daemon: &Daemon, headers: &HeaderMap, begun: Result<Underway, Fault>) -> Response {
    let underway = match begun {
        Ok(underway) => underway,
        Err(fault) => {
            daemon.metrics.failures.inc();
            return fault.into_response();
        }
    };
    let accepts = headers.get(header::ACCEPT);
    let streams = accepts.is_some_and(|kinds| kinds.as_bytes().starts_with(b"text/event-stream"));
    if streams {
        return Sse::new(stream::unfold(Some(underway), step))
            .keep_alive(KeepAlive::default())
            .into_response();
    }
    // `step` lives until then: that it is listened to says that somebody waits.
    let Underway { step, done } = underway;
    let became = done.await;
    drop(step);
    match became {
        Ok(Ok(reply)) => Json::<ShotReply>(reply).into_response(),
        Ok(Err(fault)) => fault.into_response(),
        Err(_) => ended().into_response(),
    }
}

/// The next event of a shot that is underway.
async fn step(
    underway: Option<Underway>,
) -> Option<(Result<sse::Event, Infallible>, Option<Underway>)> {
    let Underway { mut step, mut done } = underway?;
    let became = tokio::select! {
        biased;
        became = &mut done => became,
        Ok(()) = step.changed() => {
            let words = step.borrow_and_update().clone();
            let event = sse::Event::default().event("step").data(words);
            return Some((Ok(event), Some(Underway { step, done })));
        }
        else => return None,
    };
    let event = match became.unwrap_or_else(|_| Err(ended())) {
        Ok(reply) => sse::Event::default().event("done").json_data(reply),
        Err(fault) => sse::Event::default().event("failed").json_data(fault),
    };
    Some((Ok(event.unwrap_or_default()), None))
}

fn ended() -> Fault {
    Fault {
        kind: crate::api::FaultKind::Daemon,
        message: "the daemon is stopping".to_owned(),
        remedy: Some("ask again when it runs".to_owned()),
    }
}

/// `shot.json` of a shot.
#[utoipa::path(
    get,
    path = "/v1/shots/{id}",
    params(("id" = String, Path)),
    responses((status = 200, body = Object), (status = 404, body = Fault)),
)]
pub(super) async fn describe(
    State(daemon): State<Arc<Daemon>>,
    Path(id): Path<String>,
) -> Result<Response, Fault> {
    let read = tokio::task::spawn_blocking(move || daemon.store.manifest(&id));
    Ok(match read.await.map_err(broken)? {
        Ok(manifest) => Json(manifest).into_response(),
        Err(error @ StoreError::NoShot { .. }) => {
            super::refuse(StatusCode::NOT_FOUND, error.fault())
        }
        Err(error) => error.fault().into_response(),
    })
}

/// Deletes a shot.
#[utoipa::path(
    delete,
    path = "/v1/shots/{id}",
    params(("id" = String, Path)),
    responses(
        (status = 204, description = "Gone"),
        (status = 403, body = Fault, description = "The caller may only look"),
        (status = 404, body = Fault),
    ),
)]
pub(super) async fn delete(
    State(daemon): State<Arc<Daemon>>,
    Shooter(caller): Shooter,
    Path(id): Path<String>,
) -> Result<Response, Fault> {
    let deleting = tokio::task::spawn_blocking(move || {
        daemon.store.delete(&id)?;
        tracing::info!(id, by = %caller, "deleted");
        let newest = daemon.store.ids()?.into_iter().next();
        daemon.latest.send_replace(newest);
        // Nobody may be listening.
        let _ = daemon.events.send(Event::Deleted { id });
        Ok(())
    });
    Ok(match deleting.await.map_err(broken)? {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(error @ StoreError::NoShot { .. }) => {
            super::refuse(StatusCode::NOT_FOUND, error.fault())
        }
        Err(error) => error.fault().into_response(),
    })
}

/// One file of a shot.
#[utoipa::path(
    get,
    path = "/v1/shots/{id}/files/{name}",
    params(("id" = String, Path), ("name" = String, Path)),
    responses(
        (status = 200, description = "Its bytes", content_type = "application/octet-stream"),
        (status = 400, body = Fault, description = "There is none"),
    ),
)]
pub(super) async fn file(
    State(daemon): State<Arc<Daemon>>,
    Path((id, name)): Path<(String, String)>,
) -> Result<Response, Fault> {
    let path = daemon
        .store
        .file(&id, &name)
        .map_err(|error| error.fault())?;
    let unread = |source| StoreError::Read {
        path: path.clone(),
        source,
    };
    let opened = async {
        let file = tokio::fs::File::open(&path).await?;
        let bytes = file.metadata().await?.len();
        Ok((file, bytes))
    };
    let (file, bytes) = opened.await.map_err(|error| unread(error).fault())?;
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, bytes.to_string()),
        (
            header::CONTENT_DISPOSITION,
            format!("attachment; filename=\"{name}\""),
        ),
    ];
    // In pieces: a shot's files together would not fit beside the shots in memory.
    Ok((headers, Body::from_stream(ReaderStream::new(file))).into_response())
}

/// Shows a kept shot under any light, and keeps nothing of it.
#[utoipa::path(
    post,
    path = "/v1/shots/{id}/view",
    params(("id" = String, Path)),
    request_body = ViewRequest,
    responses(
        (status = 200, description = "The picture; `x-width` and `x-height` say its size", content_type = "image/jpeg"),
        (status = 400, body = Fault, description = "The request makes no sense"),
        (status = 422, body = Fault, description = "The shot cannot be developed"),
        (status = 503, body = Fault, description = "Too many look at once"),
    ),
)]
pub(super) async fn view(
    State(daemon): State<Arc<Daemon>>,
    Path(id): Path<String>,
    body: Bytes,
) -> Result<Response, Fault> {
    let request: ViewRequest = parsed(&body)?;
    let environment = request.environment.as_ref();
    let lights = CheckedLights::new(&request.lights, ViewRequest::MOST_LIGHTS, environment)
        .map_err(|error| refused(error.to_string()))?;
    let frames = daemon.store.file(&id, crate::output::FRAMES);
    let frames = frames.map_err(|error| error.fault())?;
    let (reply, answer) = oneshot::channel();
    let look = Look {
        id,
        folder: frames.parent().map(Into::into).unwrap_or_default(),
        layer: request.layer,
        detail: request.detail,
        lights,
        reply,
    };
    let unavailable = |message: &str| Fault {
        kind: crate::api::FaultKind::Daemon,
        message: message.to_owned(),
        remedy: Some("ask again in a moment".to_owned()),
    };
    daemon
        .looks
        .try_send(look)
        .map_err(|refused| match refused {
            TrySendError::Full(_) => unavailable("too many look at once"),
            TrySendError::Disconnected(_) => unavailable("the light table's thread has ended"),
        })?;
    let picture = answer
        .await
        .map_err(|_| unavailable("the light table's thread has ended"))??;
    let encoded = tokio::task::spawn_blocking(move || picture.encoded(request.format));
    let encoded = encoded.await.map_err(broken)?.map_err(|problem| Fault {
        kind: crate::api::FaultKind::Daemon,
        message: format!("the picture cannot be packed: {problem}"),
        remedy: Some("ask for another format".to_owned()),
    })?;
    daemon.metrics.views.inc();
    Ok(encoded.response(&[]))
}

/// A body that is JSON of a type.
fn parsed<T: DeserializeOwned>(body: &[u8]) -> Result<T, Fault> {
    serde_json::from_slice(body).map_err(|error| refused(format!("the request's JSON: {error}")))
}
