//! Who may talk to the viewer's socket.

use super::super::{DaemonError, State as Daemon, routes::refuse};
use crate::{
    api::{Fault, FaultKind},
    config::Viewer,
};
use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::Next,
    response::Response,
};
use std::{fmt::Write as _, net::SocketAddr, sync::Arc};

/// Name of the cookie that holds the token. The port is part of it, since cookies know no ports.
const COOKIE: &str = "captured";

/// What the page may load: its own files, and pictures that it made itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The token of one run of the daemon, and where it counts.
pub(in super::super) struct Guard {
    address: SocketAddr,
    token: String,
}

/// Why a request is refused.
#[derive(Debug, PartialEq, Eq)]
enum Refusal {
    /// It was meant for another host.
    Host,
    /// Another site sent it.
    Site,
    /// It carries no token.
    Token,
}

impl Guard {
    /// A token of 256 random bits.
    ///
    /// # Errors
    /// [`DaemonError::Viewer`] when the system has no randomness.
    pub fn new(address: SocketAddr) -> Result<Self, DaemonError> {
        let mut bits = [0_u8; 32];
        getrandom::fill(&mut bits).map_err(|error| DaemonError::Viewer(error.into()))?;
        let mut token = String::with_capacity(64);
        for byte in bits {
            // Writing into a string cannot fail.
            let _ = write!(token, "{byte:02x}");
        }
        Ok(Self { address, token })
    }

    /// The address of the page, with the token.
    pub fn page(&self) -> String {
        format!("http://{}/#token={}", self.address, self.token)
    }

    /// True for the token, in a time that says nothing of it.
    pub fn is_token(&self, text: &str) -> bool {
        // Hashes compare in constant time, and differ everywhere where texts differ anywhere.
        blake3::hash(text.as_bytes()) == blake3::hash(self.token.as_bytes())
    }

    /// The cookie that carries the token: sent by no other site's requests, read by no script.
    pub fn cookie(&self) -> String {
        format!(
            "{}={}; HttpOnly; SameSite=Strict; Path=/; Max-Age=2592000",
            self.cookie_name(),
            self.token
        )
    }

    fn cookie_name(&self) -> String {
        format!("{COOKIE}_{}", self.address.port())
    }

    /// Judges a request by its head.
    fn judge(
        &self,
        method: &Method,
        path: &str,
        headers: &HeaderMap,
        viewer: &Viewer,
    ) -> Option<Refusal> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let host = match (hosts.next(), hosts.next()) {
            (Some(host), None) => host.to_str().unwrap_or_default(),
            _ => return Some(Refusal::Host),
        };
        if !self.is_host(host, viewer) {
            return Some(Refusal::Host);
        }
        let origin = headers.get_all(header::ORIGIN).iter();
        let own = format!("http://{host}");
        if origin
            .map(HeaderValue::as_bytes)
            .any(|origin| origin != own.as_bytes())
        {
            return Some(Refusal::Site);
        }
        let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
        let allowed = match site {
            None | Some(b"same-origin") => true,
            // Somebody typed the address, or followed a bookmark.
            Some(b"none") => *method == Method::GET,
            Some(_) => false,
        };
        if !allowed {
            return Some(Refusal::Site);
        }
        let open = !path.starts_with("/v1/");
        (!open && !self.holds_token(headers)).then_some(Refusal::Token)
    }

    /// True for the names by which the page is reached.
    fn is_host(&self, host: &str, viewer: &Viewer) -> bool {
        let port = self.address.port();
        let own = [
            format!("127.0.0.1:{port}"),
            format!("localhost:{port}"),
            format!("[::1]:{port}"),
        ];
        own.iter().chain(&viewer.hosts).any(|known| known == host)
    }

    fn holds_token(&self, headers: &HeaderMap) -> bool {
        let bearer = headers
            .get(header::AUTHORIZATION)
            .and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        if bearer.is_some_and(|token| self.is_token(token)) {
            return true;
        }
        let name = format!("{}=", self.cookie_name());
        headers
            .get_all(header::COOKIE)
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'))
            .filter_map(|cookie| cookie.trim().strip_prefix(name.as_str()))
            .any(|token| self.is_token(token))
    }
}

/// Lets through what may pass, and says on every answer what the page may do with it.
pub(super) async fn guarded(
    State(daemon): State<Arc<Daemon>>,
    request: Request,
    next: Next,
) -> Response {
    let viewer = daemon.config.borrow().viewer.clone();
    let path = request.uri().path().to_owned();
    let refusal = match &daemon.viewer {
        Some(guard) => guard.judge(request.method(), &path, request.headers(), &viewer),
        None => Some(Refusal::Token),
    };
    let mut response = match refusal {
        None => next.run(request).await,
        Some(refusal) => {
            let (status, message, remedy) = match refusal {
                Refusal::Host => (
                    StatusCode::MISDIRECTED_REQUEST,
                    "this is no name of the viewer",
                    "use the address that `capturectl viewer` says, or list the name under viewer.hosts",
                ),
                Refusal::Site => (
                    StatusCode::FORBIDDEN,
                    "another site asked for this",
                    "open the page by the address that `capturectl viewer` says",
                ),
                Refusal::Token => (
                    StatusCode::UNAUTHORIZED,
                    "the token is missing or of an earlier daemon",
                    "open the page by the address that `capturectl viewer` says",
                ),
            };
            let fault = Fault {
                kind: FaultKind::Request,
                message: message.to_owned(),
                remedy: Some(remedy.to_owned()),
            };
            refuse(status, fault)
        }
    };
    let headers = response.headers_mut();
    let rules: [(HeaderName, &str); 6] = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (
            HeaderName::from_static("cross-origin-opener-policy"),
            "same-origin",
        ),
        (
            HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
        (header::CACHE_CONTROL, "no-store"),
    ];
    for (name, value) in rules {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thirty requests that a hostile site, a rebound name or a mistake could make, and two that the
    /// page itself makes.
    #[test]
    fn only_the_page_itself_is_let_through() {
        let guard = Guard {
            address: "127.0.0.1:8377".parse().unwrap(),
            token: "ab".repeat(32),
        };
        let other = "cd".repeat(32);
        let good = format!("captured_8377={}", guard.token);
        let wrong = format!("captured_8377={other}");
        let prefix = format!("captured_8377={}", &guard.token[..63]);
        let nearly = format!("xcaptured_8377={}", guard.token);
        let (host, own) = ("127.0.0.1:8377", "http://127.0.0.1:8377");
        let viewer = Viewer {
            hosts: vec!["localhost:9000".to_owned()],
            ..Viewer::default()
        };
        struct Case<'a>(&'a str, &'a str, &'a [(&'a str, &'a str)], Option<Refusal>);
        use Refusal::{Host, Site, Token};
        let cases = [
            // The page.
            Case(
                "GET",
                "/v1/status",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "same-origin"),
                ],
                None,
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", own),
                    ("sec-fetch-site", "same-origin"),
                ],
                None,
            ),
            Case(
                "GET",
                "/",
                &[("host", host), ("sec-fetch-site", "none")],
                None,
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", "localhost:9000"), ("cookie", &good)],
                None,
            ),
            // DNS rebinding, and other names.
            Case(
                "GET",
                "/v1/status",
                &[("host", "evil.example:8377"), ("cookie", &good)],
                Some(Host),
            ),
            Case("GET", "/", &[("host", "evil.example")], Some(Host)),
            Case("GET", "/", &[("host", "127.0.0.1")], Some(Host)),
            Case("GET", "/", &[("host", "127.0.0.1:80")], Some(Host)),
            Case("GET", "/", &[("host", "0.0.0.0:8377")], Some(Host)),
            Case(
                "GET",
                "/",
                &[("host", "localhost.evil.example:8377")],
                Some(Host),
            ),
            Case(
                "GET",
                "/",
                &[("host", "127.0.0.1:8377.evil.example")],
                Some(Host),
            ),
            Case(
                "GET",
                "/",
                &[("host", "evil.example@127.0.0.1:8377")],
                Some(Host),
            ),
            Case("GET", "/", &[], Some(Host)),
            Case(
                "GET",
                "/",
                &[("host", host), ("host", "evil.example")],
                Some(Host),
            ),
            // CSRF.
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", "http://evil.example"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[("host", host), ("cookie", &good), ("origin", "null")],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", "https://127.0.0.1:8377"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", "http://127.0.0.1:8378"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", "http://localhost:8377"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "cross-site"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "same-site"),
                ],
                Some(Site),
            ),
            Case(
                "POST",
                "/v1/shots",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "none"),
                ],
                Some(Site),
            ),
            Case(
                "DELETE",
                "/v1/shots/shot-1",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "cross-site"),
                ],
                Some(Site),
            ),
            Case(
                "GET",
                "/v1/shots/shot-1/files/shot.json",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("sec-fetch-site", "cross-site"),
                ],
                Some(Site),
            ),
            Case(
                "GET",
                "/app.js",
                &[("host", host), ("sec-fetch-site", "cross-site")],
                Some(Site),
            ),
            Case(
                "POST",
                "/login",
                &[("host", host), ("origin", "http://evil.example")],
                Some(Site),
            ),
            // A web socket of another site is a GET with an origin.
            Case(
                "GET",
                "/v1/events",
                &[
                    ("host", host),
                    ("cookie", &good),
                    ("origin", "http://evil.example"),
                    ("upgrade", "websocket"),
                ],
                Some(Site),
            ),
            Case(
                "OPTIONS",
                "/v1/shots",
                &[("host", host), ("origin", "http://evil.example")],
                Some(Site),
            ),
            // No token, or another.
            Case("GET", "/v1/status", &[("host", host)], Some(Token)),
            Case(
                "POST",
                "/v1/shots",
                &[("host", host), ("origin", own)],
                Some(Token),
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", host), ("cookie", &wrong)],
                Some(Token),
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", host), ("cookie", &prefix)],
                Some(Token),
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", host), ("cookie", &nearly)],
                Some(Token),
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", host), ("cookie", "captured_8377=")],
                Some(Token),
            ),
            Case(
                "GET",
                "/v1/status",
                &[("host", host), ("authorization", "Bearer ")],
                Some(Token),
            ),
        ];
        let refused = cases.iter().filter(|case| case.3.is_some()).count();
        assert!(refused >= 30);
        for Case(method, path, sent, expected) in cases {
            let mut headers = HeaderMap::new();
            for (name, value) in sent {
                let name: HeaderName = name.parse().unwrap();
                headers.append(name, value.parse().unwrap());
            }
            let method: Method = method.parse().unwrap();
            let found = guard.judge(&method, path, &headers, &viewer);
            assert_eq!(found, expected, "{method} {path} {sent:?}");
        }
        eprintln!(
            "figure | cases of DNS rebinding, CSRF, cross-site web sockets and wrong tokens | {refused} of {refused} refused"
        );
    }

    #[test]
    fn tokens_are_long_and_never_the_same() {
        let address = "127.0.0.1:1".parse().unwrap();
        let tokens = [0; 9].map(|_| Guard::new(address).unwrap().token);
        assert!(tokens.iter().all(|token| token.len() == 64));
        let distinct: std::collections::BTreeSet<_> = tokens.iter().collect();
        assert_eq!(distinct.len(), tokens.len());
    }
}
