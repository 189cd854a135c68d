//! Requests, good and bad: each has an answer, and after each the daemon goes on.

use crate::Daemon;

#[test]
fn the_daemon_says_what_it_is_and_what_it_owns() {
    let daemon = Daemon::start("synthetic:desk");
    let (status, body) = daemon.send("GET", "/v1/status", "");
    assert_eq!(status, 200);
    assert_eq!(body["version"], env!("CARGO_PKG_VERSION"));
    assert!(
        body["devices"][0]["device"]["address"]
            .as_str()
            .unwrap()
            .starts_with("synthetic:desk"),
        "{body}"
    );
    assert_eq!(body["in_use"], false);
    assert_eq!(body["shots"], 0);
    let (status, body) = daemon.send("GET", "/v1/devices", "");
    assert_eq!(status, 200);
    assert!(!body["devices"].as_array().unwrap().is_empty());
}

#[test]
fn bad_requests_are_refused_by_field_and_the_daemon_goes_on() {
    struct Case(&'static str, &'static str, &'static str, u16, &'static str);
    let shots = "/v1/shots";
    let cases = [
        Case("POST", shots, "", 400, "JSON"),
        Case("POST", shots, "{\"relight\": tru", 400, "JSON"),
        Case("POST", shots, "{\"relihgt\": true}", 400, "relihgt"),
        Case("POST", shots, "{\"relight\": true}", 400, "no light"),
        Case(
            "POST",
            shots,
            "{\"lights\": [{\"direction\": [0, 0, 1]}]}",
            400,
            "relight",
        ),
        Case(
            "POST",
            shots,
            "{\"relight\": true, \"lights\": [{\"direction\": [0, 0, 0]}]}",
            400,
            "light 0",
        ),
        Case(
            "POST",
            shots,
            "{\"relight\": true, \"lights\": [{\"direction\": [0, 0]}]}",
            400,
            "JSON",
        ),
        Case(
            "POST",
            shots,
            "{\"relight\": true, \"environment\": {\"name\": \"sky\", \"lights\": []}}",
            400,
            "\"sky\"",
        ),
        Case("POST", shots, "{\"tier\": \"fast\"}", 400, "JSON"),
        Case("POST", shots, "{\"burst\": 1}", 400, "limits.burst"),
        Case("POST", shots, "{\"burst\": 33}", 400, "limits.burst"),
        Case("POST", shots, "{\"burst\": -2}", 400, "JSON"),
        Case("POST", shots, "{\"tier\": \"paper\"}", 400, "tier"),
        Case("PUT", shots, "", 404, "PUT /v1/shots"),
        Case("DELETE", "/v1/status", "", 404, "DELETE"),
        Case("GET", "/", "", 404, "GET /"),
        Case("GET", "/v1/shots/none/files/shot.json", "", 400, "none"),
        Case(
            "GET",
            "/v1/shots/..%2f..%2fnotify/files/x",
            "",
            400,
            "no shot",
        ),
        Case(
            "GET",
            "/v1/shots/none/files/..%2f..%2f..%2fetc%2fpasswd",
            "",
            400,
            "no shot",
        ),
    ];
    let daemon = Daemon::start("synthetic:desk");
    for Case(method, path, body, status, word) in cases {
        let (found, answer) = daemon.send(method, path, body);
        assert_eq!(found, status, "{method} {path} {body}: {answer}");
        assert!(
            answer["message"].as_str().unwrap_or("").contains(word),
            "{path} {body}: {answer}"
        );
        assert_eq!(answer["kind"], "request", "{answer}");
    }
    let (status, body) = daemon.send("GET", "/v1/status", "");
    assert_eq!((status, &body["shots"]), (200, &serde_json::json!(0)));
}

#[test]
fn what_is_too_large_or_no_http_is_refused_without_being_read_whole() {
    let daemon = Daemon::start("synthetic:desk");
    let (status, _) = daemon.send("POST", "/v1/shots", &" ".repeat(100_000));
    assert_eq!(status, 413);
    let (status, _) = daemon
        .ask(b"POST /v1/shots HTTP/1.1\r\nhost: captured\r\ncontent-length: 1073741824\r\n\r\n{");
    assert_eq!(status, 413);
    let head = format!(
        "GET /v1/status HTTP/1.1\r\nx: {}\r\n\r\n",
        "x".repeat(100_000)
    );
    let (status, _) = daemon.ask(head.as_bytes());
    assert!((400..500).contains(&status), "{status}");
    let (status, _) = daemon.ask(b"\x16\x03\x01 not http at all\r\n\r\n");
    assert!(status == 0 || status == 400, "{status}");
    assert_eq!(daemon.send("GET", "/v1/status", "").0, 200);
}
