//! What happens, as it happens and in sum.

use super::Daemon;
use crate::api::Event;
use axum::{
    extract::State,
    http::header,
    response::{
        IntoResponse,
        sse::{self, KeepAlive, Sse},
    },
};
use futures_util::stream::{self, Stream};
use std::{convert::Infallible, sync::Arc, time::Duration};
use tokio::sync::broadcast::{Receiver, error::RecvError};

/// Everything that happens from now on, as server-sent events whose data is an `Event`. A listener
/// that is slow misses the oldest, and hears of that as a comment.
#[utoipa::path(
    get,
    path = "/v1/events",
    responses((status = 200, body = Event, content_type = "text/event-stream")),
)]
pub(super) async fn events(
    State(daemon): State<Arc<Daemon>>,
) -> Sse<impl Stream<Item = Result<sse::Event, Infallible>>> {
    let heard = daemon.events.subscribe();
    drop(daemon);
    Sse::new(stream::unfold(heard, next))
        .keep_alive(KeepAlive::new().interval(Duration::from_secs(15)))
}

async fn next(
    mut heard: Receiver<Event>,
) -> Option<(Result<sse::Event, Infallible>, Receiver<Event>)> {
    let said = match heard.recv().await {
        Ok(event) => {
            let data = serde_json::to_string(&event).unwrap_or_default();
            sse::Event::default().data(data)
        }
        Err(RecvError::Lagged(count)) => sse::Event::default().comment(format!("{count} missed")),
        Err(RecvError::Closed) => return None,
    };
    Some((Ok(said), heard))
}

/// Counters and gauges, for Prometheus.
#[utoipa::path(
    get,
    path = "/v1/metrics",
    responses((status = 200, body = String, content_type = "application/openmetrics-text")),
)]
pub(super) async fn metrics(State(daemon): State<Arc<Daemon>>) -> impl IntoResponse {
    const KIND: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    let text = daemon.metrics.text(&daemon);
    ([(header::CONTENT_TYPE, KIND)], text)
}
