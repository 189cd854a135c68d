//! The page's files, which are part of the program, and its way in.

use super::{
    super::{State as Daemon, routes::refuse},
    guard::guarded,
};
use crate::api::{Fault, FaultKind};
use axum::{
    Router,
    body::Bytes,
    extract::{Path, State},
    http::{StatusCode, header},
    middleware,
    response::{IntoResponse, Response},
    routing::{get, post},
};
use rust_embed::RustEmbed;
use std::sync::Arc;

/// A build for development reads them from the source tree, so that a change of them needs no build.
#[derive(RustEmbed)]
#[folder = "src/daemon/viewer/page/"]
struct Files;

/// The page, its way in, and the API behind it; all of it guarded.
pub(in super::super) fn pages(daemon: &Arc<Daemon>, api: Router) -> Router {
    let page = Router::new()
        .route("/", get(|| async { file("index.html") }))
        .route("/login", post(login))
        .route(
            "/page/{name}",
            get(|Path(name): Path<String>| async move { file(&name) }),
        )
        .with_state(Arc::clone(daemon));
    api.merge(page)
        .layer(middleware::from_fn_with_state(Arc::clone(daemon), guarded))
}

fn file(name: &str) -> Response {
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    };
    match Files::get(name) {
        Some(file) => ([(header::CONTENT_TYPE, kind)], file.data).into_response(),
        None => {
            let fault = Fault {
                kind: FaultKind::Request,
                message: "no such file of the page".to_owned(),
                remedy: None,
            };
            refuse(StatusCode::NOT_FOUND, fault)
        }
    }
}

/// Trades the token for a cookie.
async fn login(State(daemon): State<Arc<Daemon>>, body: Bytes) -> Response {
    let token = std::str::from_utf8(&body).unwrap_or_default();
    match &daemon.viewer {
        Some(guard) if guard.is_token(token) => (
            StatusCode::NO_CONTENT,
            [(header::SET_COOKIE, guard.cookie())],
        )
            .into_response(),
        _ => {
            let fault = Fault {
                kind: FaultKind::Request,
                message: "the token is not that of this daemon".to_owned(),
                remedy: Some(
                    "open the page by the address that `capturectl viewer` says".to_owned(),
                ),
            };
            refuse(StatusCode::UNAUTHORIZED, fault)
        }
    }
}
