//! The viewer's socket as browsers and attackers meet it.

use crate::Daemon;
use std::{
    io::{Read, Write},
    net::TcpStream,
};

struct Web {
    daemon: Daemon,
    host: String,
    token: String,
}

impl Web {
    fn start() -> Self {
        let config = "[viewer]\nenabled = true\naddress = \"127.0.0.1:0\"\n";
        let daemon = Daemon::start_with(config, &["synthetic:desk"]);
        let (status, page) = daemon.send("GET", "/v1/viewer", "");
        assert_eq!(status, 200, "{page}");
        let page = page.as_str().unwrap().strip_prefix("http://").unwrap();
        let (host, token) = page.split_once("/#token=").unwrap();
        let (host, token) = (host.to_owned(), token.to_owned());
        Self {
            daemon,
            host,
            token,
        }
    }

    /// Sends a request; returns the status and the whole answer.
    fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &str,
    ) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut request = format!(
            "{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n",
            body.len()
        );
        for (name, value) in headers {
            request.push_str(&format!("{name}: {value}\r\n"));
        }
        request.push_str("\r\n");
        request.push_str(body);
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        drop(stream.read_to_end(&mut answer));
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|code| code.parse().ok());
        (status.unwrap_or(0), answer)
    }
}

#[test]
fn the_token_becomes_a_strict_cookie_and_only_that_opens_the_api() {
    let web = Web::start();
    let host = ("host", web.host.as_str());
    assert_eq!(web.token.len(), 64);
    let (status, page) = web.send("GET", "/", &[host], "");
    assert_eq!(status, 200);
    for rule in [
        "content-security-policy: default-src 'none'",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
    ] {
        assert!(page.to_lowercase().contains(rule), "{rule}");
    }
    assert!(
        !page.contains("unsafe-inline") && !page.contains(" onclick="),
        "inline code"
    );
    assert_eq!(web.send("GET", "/page/app.js", &[host], "").0, 200);
    assert_eq!(
        web.send("GET", "/page/..%2f..%2fmod.rs", &[host], "").0,
        404
    );
    assert_eq!(web.send("GET", "/v1/status", &[host], "").0, 401);
    assert_eq!(web.send("POST", "/login", &[host], "0123").0, 401);
    let (status, answer) = web.send("POST", "/login", &[host], &web.token);
    assert_eq!(status, 204);
    let cookie = answer
        .lines()
        .find_map(|line| line.strip_prefix("set-cookie: "))
        .unwrap();
    assert!(
        cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"),
        "{cookie}"
    );
    let pair = cookie.split(';').next().unwrap();
    let own = format!("http://{}", web.host);
    assert_eq!(
        web.send("GET", "/v1/status", &[host, ("cookie", pair)], "")
            .0,
        200
    );
    let shoot = |headers: &[(&str, &str)]| web.send("POST", "/v1/shots", headers, "{}").0;
    assert_eq!(
        shoot(&[host, ("cookie", pair), ("origin", "http://evil.example")]),
        403
    );
    assert_eq!(
        shoot(&[host, ("cookie", pair), ("sec-fetch-site", "cross-site")]),
        403
    );
    assert_eq!(shoot(&[("host", "evil.example"), ("cookie", pair)]), 421);
    assert_eq!(web.daemon.send("GET", "/v1/shots", "").1["count"], 0);
    assert_eq!(
        shoot(&[host, ("cookie", pair), ("origin", own.as_str())]),
        200
    );
    // Nothing that a link could do changes anything.
    for path in ["/v1/shots/delete", "/login", "/v1/shots?delete=1"] {
        let (status, _) = web.send("GET", path, &[host, ("cookie", pair)], "");
        assert!(status >= 400, "{path}: {status}");
    }
    assert_eq!(web.daemon.send("GET", "/v1/shots", "").1["count"], 1);
}

#[test]
fn without_being_asked_for_there_is_no_page_and_no_socket() {
    let daemon = Daemon::start("synthetic:desk");
    let (status, answer) = daemon.send("GET", "/v1/viewer", "");
    assert_eq!(status, 400);
    assert!(
        answer["message"].as_str().unwrap().contains("--viewer"),
        "{answer}"
    );
    assert_eq!(daemon.send("GET", "/", "").0, 404);
    assert_eq!(daemon.send("POST", "/login", "x").0, 404);
}
