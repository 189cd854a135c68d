//! The API: its document, its events, and everything that can be done with a kept shot.

use crate::Daemon;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};

/// Server-sent events of one request, until they end: name and data.
pub fn events(
    daemon: &Daemon,
    method: &str,
    path: &str,
    body: &str,
) -> impl Iterator<Item = (String, String)> {
    let mut stream = daemon.connect();
    let request = Daemon::request(method, path, body);
    let request = request.replacen("\r\n", "\r\naccept: text/event-stream\r\n", 1);
    stream.write_all(request.as_bytes()).unwrap();
    let mut name = String::from("message");
    let lines = BufReader::new(stream).lines().map_while(Result::ok);
    lines.filter_map(move |line| {
        if let Some(said) = line.strip_prefix("event: ") {
            name = said.to_owned();
        }
        let data = line.strip_prefix("data: ")?;
        Some((
            std::mem::replace(&mut name, "message".into()),
            data.to_owned(),
        ))
    })
}

#[test]
fn every_address_of_the_document_is_answered_and_every_schema_it_names_is_there() {
    let daemon = Daemon::start("synthetic:desk");
    let (status, document) = daemon.send("GET", "/v1/openapi.json", "");
    assert_eq!(status, 200);
    let paths = document["paths"].as_object().unwrap();
    let mut count = 0;
    for (path, methods) in paths {
        for method in methods.as_object().unwrap().keys() {
            // A stream that does not end by itself.
            if path == "/v1/events" {
                continue;
            }
            let filled = path
                .replace("{id}", "shot-1")
                .replace("{name}", "x")
                .replace("{number}", "7");
            let (status, answer) = daemon.send(&method.to_uppercase(), &filled, "");
            let unknown = answer["message"]
                .as_str()
                .is_some_and(|said| said.starts_with("nothing at"));
            assert!(status != 404 || !unknown, "{method} {path}: {answer}");
            count += 1;
        }
    }
    assert!(count >= 13, "{count} operations");
    let text = document.to_string();
    for name in text.split("#/components/schemas/").skip(1) {
        let name = name.split('"').next().unwrap();
        assert!(
            document["components"]["schemas"][name].is_object(),
            "{name} is not described"
        );
    }
    for name in [
        "ShotRequest",
        "ShotReply",
        "ViewRequest",
        "Fault",
        "StatusReply",
        "Event",
    ] {
        assert!(
            document["components"]["schemas"][name].is_object(),
            "{name} is not described"
        );
    }
}

#[test]
fn a_shot_says_its_steps_and_everybody_hears_of_it() {
    let daemon = Daemon::start("synthetic:desk");
    let mut heard = events(&daemon, "GET", "/v1/events", "");
    let body = r#"{"relight": true, "tier": "closed", "lights": [{"direction": [0, 0, 1]}]}"#;
    let said: Vec<_> = events(&daemon, "POST", "/v1/shots", body).collect();
    let (last, reply) = said.last().unwrap();
    assert_eq!(last, "done", "{said:?}");
    assert!(said.len() > 2 && said[0].0 == "step", "{said:?}");
    let reply: Value = serde_json::from_str(reply).unwrap();
    let id = reply["id"].as_str().unwrap();
    let mut phases = Vec::new();
    let committed = heard.by_ref().find_map(|(_, data)| {
        let event: Value = serde_json::from_str(&data).unwrap();
        if event["event"] == "device" {
            phases.push(event["phase"].as_str().unwrap().to_owned());
        }
        (event["event"] == "committed").then_some(event)
    });
    assert_eq!(committed.unwrap()["id"], id);
    assert!(phases.contains(&"bracketing".to_owned()), "{phases:?}");
    assert!(phases.contains(&"committing".to_owned()), "{phases:?}");

    // What was wrong before it began is an answer, not an event.
    let refused: Vec<_> = events(&daemon, "POST", "/v1/shots/shot-5/relight", "{}").collect();
    assert!(refused.is_empty(), "{refused:?}");
}

#[test]
fn a_kept_shot_is_listed_described_viewed_relit_and_deleted() {
    let daemon = Daemon::start("synthetic:desk");
    let (status, reply) = daemon.send("POST", "/v1/shots", "{}");
    assert_eq!(status, 200, "{reply}");
    let id = reply["id"].as_str().unwrap().to_owned();

    let view = |body: Value| {
        let request = Daemon::request("POST", &format!("/v1/shots/{id}/view"), &body.to_string());
        daemon.ask_bytes(request.as_bytes())
    };
    let (status, head, raw) =
        view(json!({ "lights": [{ "direction": [0.5, 0.4, 0.8] }], "format": "raw" }));
    assert_eq!(status, 200);
    assert!(
        head.contains("x-width: 320") && head.contains("x-height: 240"),
        "{head}"
    );
    assert_eq!(raw.len(), 320 * 240 * 4);
    assert!(raw.chunks(4).any(|pixel| pixel[3] == 255 && pixel[0] > 100));
    let (status, _, jpeg) = view(json!({ "layer": "albedo" }));
    assert_eq!((status, &jpeg[..3]), (200, &[0xff, 0xd8, 0xff][..]));
    for layer in [
        "relit",
        "flash",
        "ambient",
        "albedo",
        "normals",
        "roughness",
        "shadow",
        "depth",
        "confidence",
    ] {
        assert_eq!(
            view(json!({ "layer": layer, "format": "raw" })).0,
            200,
            "{layer}"
        );
    }
    assert_eq!(view(json!({ "layer": "soul" })).0, 400);
    assert_eq!(
        view(json!({ "lights": vec![json!({ "direction": [0, 0, 1] }); 9] })).0,
        400
    );

    let relight = format!("/v1/shots/{id}/relight");
    let body = r#"{"lights": [{"direction": [-0.5, 0.4, 0.8]}], "tier": "closed"}"#;
    let (status, again) = daemon.send("POST", &relight, body);
    assert_eq!(status, 200, "{again}");
    assert_eq!(again["shot"]["source"], id.as_str());
    let (_, list) = daemon.send("GET", "/v1/shots", "");
    assert_eq!(list["count"], 2);
    assert_eq!(list["shots"][0]["id"], again["id"]);
    assert_eq!(list["shots"][1]["id"], id.as_str());

    let one = format!("/v1/shots/{id}");
    assert_eq!(
        daemon.send("GET", &one, "").1["files"][0]["name"],
        "shot.mcap"
    );
    assert_eq!(daemon.send("DELETE", &one, "").0, 204);
    assert_eq!(daemon.send("DELETE", &one, "").0, 404);
    assert_eq!(daemon.send("GET", &one, "").0, 404);
    assert_eq!(daemon.send("GET", "/v1/shots", "").1["count"], 1);
}

#[test]
fn a_preview_comes_without_flash_as_jpeg_and_raw_and_in_use_says_so() {
    let daemon = Daemon::start("synthetic:desk?pace=real");
    let get = |path: &str| daemon.ask_bytes(Daemon::request("GET", path, "").as_bytes());
    let (status, head, jpeg) = get("/v1/devices/0/preview");
    assert_eq!(
        (status, &jpeg[..3]),
        (200, &[0xff, 0xd8, 0xff][..]),
        "{head}"
    );
    assert_eq!(daemon.send("GET", "/v1/status", "").1["in_use"], true);
    let number = |head: &str| -> u64 {
        let line = head.lines().find_map(|line| line.strip_prefix("x-frame: "));
        line.unwrap().trim().parse().unwrap()
    };
    let first = number(&head);
    let (_, head, raw) = get(&format!("/v1/devices/0/preview?format=raw&after={first}"));
    assert!(number(&head) > first);
    assert_eq!(raw.len(), 320 * 240 * 4);
    // A shot takes the camera from those who look, and gives it back.
    let (status, reply) = daemon.send("POST", "/v1/shots", "{}");
    assert_eq!(status, 200, "{reply}");
    assert_eq!(get("/v1/devices/0/preview").0, 200);
    assert_eq!(get("/v1/devices/9/preview").0, 400);
}

#[test]
fn metrics_count_what_happened() {
    let daemon = Daemon::start("synthetic:desk");
    daemon.send("POST", "/v1/shots", "{}");
    daemon.send("POST", "/v1/shots", "{\"relight\": true}");
    let (status, text) = daemon.ask(Daemon::request("GET", "/v1/metrics", "").as_bytes());
    assert_eq!(status, 200);
    for line in [
        "captured_shots_total 1",
        "captured_shot_failures_total 1",
        "captured_shot_duration_seconds_count 1",
        "phase=\"idle\"} 1",
        "captured_resident_memory_bytes ",
        "captured_store_bytes ",
    ] {
        assert!(text.contains(line), "{line} is missing from {text}");
    }
}
