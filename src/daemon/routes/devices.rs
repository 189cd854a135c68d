//! Devices: how they are, what there is, and what they see now.

use super::{
    super::access::{Caller, Shooter},
    Daemon,
};
use crate::{
    api::{DevicesReply, Fault, FaultKind, PreviewQuery, StatusReply},
    daemon::{
        preview::{self, Preview},
        shooting::{broken, refused},
    },
};
use axum::{
    Extension, Json,
    extract::{Path, Query, State},
    response::Response,
};
use std::{sync::Arc, time::Duration};

/// Longest wait for a preview.
const PREVIEW_PATIENCE: Duration = Duration::from_secs(10);

/// How the daemon and its devices are.
#[utoipa::path(get, path = "/v1/status", responses((status = 200, body = StatusReply)))]
pub(super) async fn status(
    State(daemon): State<Arc<Daemon>>,
    Extension(caller): Extension<Caller>,
) -> Json<StatusReply> {
    let devices: Vec<_> = daemon
        .devices
        .statuses()
        .map(|(status, _)| status)
        .collect();
    Json(StatusReply {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        in_use: devices.iter().any(|device| device.in_use),
        devices,
        shots: daemon.metrics.shots.get(),
        failures: daemon.metrics.failures.get(),
        latest: daemon.latest.borrow().clone(),
        used_bytes: daemon.store.used_bytes(),
        role: caller.role(&daemon.config.borrow()),
    })
}

/// Everything a driver can open now.
#[utoipa::path(get, path = "/v1/devices", responses((status = 200, body = DevicesReply)))]
pub(super) async fn devices() -> Result<Json<DevicesReply>, Fault> {
    let listed = tokio::task::spawn_blocking(drivers::open::list).await;
    Ok(Json(DevicesReply {
        devices: listed.map_err(broken)?,
    }))
}

/// What a device of the daemon sees now, without flash: waits for a frame newer than `after`. Its
/// camera streams until nobody has asked for two seconds.
#[utoipa::path(
    get,
    path = "/v1/devices/{number}/preview",
    params(("number" = usize, Path, description = "Place in the configuration, from 0"), PreviewQuery),
    responses(
        (status = 200, description = "The picture; `x-frame` counts", content_type = "image/jpeg"),
        (status = 502, body = Fault, description = "The device gives no preview"),
    ),
)]
pub(super) async fn preview(
    State(daemon): State<Arc<Daemon>>,
    Extension(caller): Extension<Caller>,
    Path(number): Path<usize>,
    Query(query): Query<PreviewQuery>,
) -> Result<Response, Fault> {
    let handle = daemon.devices.number(number).ok_or_else(|| {
        refused(format!(
            "there is no device {number}; GET /v1/status lists them"
        ))
    })?;
    if !handle.previews.wanted() {
        tracing::info!(device = %handle.address, by = %caller, "preview");
    }
    let (looking, mut newest) = handle.previews.look();
    // What is left from an earlier look is not what is seen now.
    newest.mark_unchanged();
    let patience = tokio::time::timeout(PREVIEW_PATIENCE, async {
        loop {
            match &*newest.borrow_and_update() {
                Preview::Frame { number, frame } if *number > query.after && query.after > 0 => {
                    return Ok((*number, Arc::clone(frame)));
                }
                _ => {}
            }
            if newest.changed().await.is_err() {
                return Err("its thread has ended".to_owned());
            }
            match &*newest.borrow() {
                Preview::Frame { number, frame } => return Ok((*number, Arc::clone(frame))),
                Preview::Refused(problem) => return Err(problem.clone()),
                Preview::Nothing => {}
            }
        }
    });
    let fault = |problem: String| Fault {
        kind: FaultKind::Device,
        message: problem,
        remedy: None,
    };
    let late = |_| {
        fault(format!(
            "{}: no preview within {PREVIEW_PATIENCE:?}",
            handle.address
        ))
    };
    let (count, frame) = patience.await.map_err(late)?.map_err(fault)?;
    // The camera need not stop between one preview and the next.
    tokio::spawn(async move {
        tokio::time::sleep(Duration::from_secs(2)).await;
        drop(looking);
    });
    let encoded = tokio::task::spawn_blocking(move || {
        preview::picture(&frame).and_then(|picture| picture.encoded(query.format))
    });
    let encoded = encoded.await.map_err(broken)?.map_err(fault)?;
    Ok(encoded.response(&[("x-frame", count)]))
}

/// The configuration that counts now.
#[utoipa::path(get, path = "/v1/config", responses((status = 200, body = Object)))]
pub(super) async fn config(State(daemon): State<Arc<Daemon>>) -> Json<serde_json::Value> {
    // Our own types have string keys and no failing serialisers.
    Json(serde_json::to_value(&**daemon.config.borrow()).unwrap_or_default())
}

/// Where the viewer's page is, with the token that opens it: whoever has it may do what the page may.
#[utoipa::path(
    get,
    path = "/v1/viewer",
    responses((status = 200, body = String), (status = 400, body = Fault, description = "It is switched off")),
)]
pub(super) async fn viewer_address(
    State(daemon): State<Arc<Daemon>>,
    _: Shooter,
) -> Result<Json<String>, Fault> {
    let page = daemon
        .viewer
        .as_ref()
        .map(super::super::viewer::Guard::page);
    page.map(Json).ok_or_else(|| {
        refused("the viewer is off; set viewer.enabled, or start captured with --viewer")
    })
}
