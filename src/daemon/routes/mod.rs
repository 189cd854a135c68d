//! What is answered at which address; the OpenAPI document is made of the same list.

mod devices;
mod events;
mod shots;

use super::State as Daemon;
use crate::api::{self, Fault, FaultKind};
use axum::{
    Json, Router,
    body::{Bytes, HttpBody as _},
    extract::{DefaultBodyLimit, Request, State},
    http::{StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use std::{sync::Arc, time::Duration};
use utoipa::OpenApi;
use utoipa_axum::{router::OpenApiRouter, routes};

/// Longest time for a request's body: places for connections are few.
const BODY_TIME: Duration = Duration::from_secs(10);

/// The document's head.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "captured",
        description = "Shots with flash, without flash and with depth, and the same photograph under any light. Directions point toward the light: x right, y up, z toward the camera.",
    ),
    components(schemas(api::Event))
)]
struct Head;

/// Every address of the daemon.
pub(super) fn api(daemon: &Arc<Daemon>) -> Router {
    let (router, document) = OpenApiRouter::with_openapi(Head::openapi())
        .routes(routes!(devices::status))
        .routes(routes!(devices::devices))
        .routes(routes!(devices::preview))
        .routes(routes!(devices::config))
        .routes(routes!(devices::viewer_address))
        .routes(routes!(shots::list, shots::shoot))
        .routes(routes!(shots::describe, shots::delete))
        .routes(routes!(shots::file))
        .routes(routes!(shots::relight))
        .routes(routes!(shots::view))
        .routes(routes!(events::events))
        .routes(routes!(events::metrics))
        .split_for_parts();
    // One for all: each client that asks for it and never reads would hold a copy of its own.
    let text = Bytes::from(document.to_json().unwrap_or_default());
    let known: Arc<str> = addresses(&document).into();
    let lost = move |request: Request| unknown(request, known.clone());
    router
        .route(
            "/v1/openapi.json",
            get(
                move || async move { ([(header::CONTENT_TYPE, "application/json")], text.clone()) },
            ),
        )
        .fallback(lost.clone())
        .method_not_allowed_fallback(lost)
        .layer(middleware::from_fn_with_state(Arc::clone(daemon), limited))
        // The limit that can be changed while the daemon runs stands in `limited`.
        .layer(DefaultBodyLimit::disable())
        .with_state(Arc::clone(daemon))
}

/// Every method and path of the document, for people.
fn addresses(document: &utoipa::openapi::OpenApi) -> String {
    let paths = document.paths.paths.iter();
    let lines = paths.flat_map(|(path, item)| {
        let methods = [
            ("GET", &item.get),
            ("POST", &item.post),
            ("DELETE", &item.delete),
        ];
        let known = methods
            .into_iter()
            .filter(|(_, operation)| operation.is_some());
        known
            .map(move |(method, _)| format!("{method} {path}"))
            .collect::<Vec<_>>()
    });
    lines.collect::<Vec<_>>().join(", ")
}

/// Holds a request to the limits of size and time.
async fn limited(State(daemon): State<Arc<Daemon>>, request: Request, next: Next) -> Response {
    let limits = daemon.config.borrow().limits.clone();
    let most = limits.request_bytes;
    let too_large = || {
        let message = format!(
            "the body has more than {most} bytes; send fewer lights, or raise limits.request_bytes"
        );
        refuse(StatusCode::PAYLOAD_TOO_LARGE, fault(message))
    };
    // Said at once, not after the body has been waited for.
    if request.body().size_hint().lower() > most as u64 {
        return too_large();
    }
    let (parts, body) = request.into_parts();
    let whole = async {
        let Ok(read) = tokio::time::timeout(BODY_TIME, axum::body::to_bytes(body, most)).await
        else {
            let message = format!("the body did not arrive within {BODY_TIME:?}");
            return refuse(StatusCode::REQUEST_TIMEOUT, fault(message));
        };
        let Ok(bytes) = read else {
            return too_large();
        };
        next.run(Request::from_parts(parts, bytes.into())).await
    };
    let patience = limits.request_time();
    tokio::time::timeout(patience, whole)
        .await
        .unwrap_or_else(|_| {
            let late = Fault {
                kind: FaultKind::Daemon,
                message: format!("no answer within {patience:?}"),
                remedy: Some("raise limits.request_seconds or ask for fewer lights".to_owned()),
            };
            refuse(StatusCode::GATEWAY_TIMEOUT, late)
        })
}

async fn unknown(request: Request, known: Arc<str>) -> Response {
    let message = format!("nothing at {} {}", request.method(), request.uri().path());
    let fault = Fault {
        remedy: Some(known.to_string()),
        ..fault(message)
    };
    refuse(StatusCode::NOT_FOUND, fault)
}

fn fault(message: String) -> Fault {
    Fault {
        kind: FaultKind::Request,
        message,
        remedy: None,
    }
}

/// An answer with a fault in it.
pub(super) fn refuse(status: StatusCode, fault: Fault) -> Response {
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
