//! What a warm daemon takes, in time and in memory. Measurements: `.ci/reliability` runs them.

use crate::{Daemon, api::events};
use serde_json::{Value, json};
use std::{
    path::Path,
    time::{Duration, Instant},
};

/// Shots that are measured; one before them warms the daemon.
const SHOTS: usize = 20;

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Of sorted times, the one that so many of a hundred do not exceed.
fn percentile(times: &mut [f64], percent: usize) -> f64 {
    times.sort_by(f64::total_cmp);
    times[(times.len() * percent).div_ceil(100) - 1]
}

/// Of which profile the programs are: cargo names folders so.
fn build() -> String {
    let programs = crate::program("captured");
    match programs.parent().and_then(|folder| folder.file_name()) {
        Some(debug) if debug == "debug" => "development build".to_owned(),
        Some(profile) => format!("{} build", profile.to_string_lossy()),
        None => panic!("{} lies in no folder", programs.display()),
    }
}

#[test]
#[ignore = "a measurement"]
fn measured_from_shoot_to_the_committed_result_of_the_720p_recording() {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings/wall-720p.mcap");
    let daemon = Daemon::start(recording.to_str().unwrap());
    let mut steps: Vec<(String, Vec<f64>)> = Vec::new();
    let mut totals = Vec::new();
    for shot in 0..=SHOTS {
        let out = format!("out-{shot}");
        let began = Instant::now();
        let asked = [
            "--json",
            "shoot",
            "--relight",
            "--light",
            "0.5,0.4,0.8",
            "--out",
            &out,
        ];
        let (code, text, err) = daemon.capturectl(&asked);
        let took = ms(began.elapsed());
        assert_eq!(code, Some(0), "{err}");
        let answer: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(answer["by"], "daemon");
        std::fs::remove_dir_all(daemon.folder.path().join(&out)).unwrap();
        // The same once more, listened to step by step.
        let body = json!({ "relight": true, "lights": [{ "direction": [0.5, 0.4, 0.8] }] });
        let mut begun = (Instant::now(), "waiting for the camera".to_owned());
        let mut heard = Vec::new();
        for (event, data) in events(&daemon, "POST", "/v1/shots", &body.to_string()) {
            heard.push((begun.1.clone(), ms(begun.0.elapsed())));
            begun = (Instant::now(), data);
            assert_ne!(event, "failed", "{begun:?}");
        }
        if shot == 0 {
            continue;
        }
        totals.push(took);
        for (step, took) in heard {
            match steps.iter_mut().find(|(known, _)| *known == step) {
                Some((_, times)) => times.push(took),
                None => steps.push((step, vec![took])),
            }
        }
    }
    let told: Vec<String> = steps
        .iter_mut()
        .map(|(step, times)| (step, percentile(times, 50)))
        .filter(|(_, took)| *took >= 1.0)
        .map(|(step, took)| format!("{step} {took:.0}"))
        .collect();
    eprintln!(
        "figure | `capturectl shoot --relight`, 720p recording, daemon warm, {} | p50 {:.0} ms, p95 {:.0} ms of {SHOTS}; steps of the daemon, p50 ms: {}",
        build(),
        percentile(&mut totals, 50),
        percentile(&mut totals, 95),
        told.join(", ")
    );
}

#[test]
#[ignore = "a measurement"]
fn measured_memory_while_shots_of_12_megapixels_are_relit_and_looked_at() {
    let config = "[capture]\npatience_seconds = 60\ndeadline_seconds = 300\n[limits]\nrequest_seconds = 900\n";
    let daemon = Daemon::start_with(config, &["synthetic:desk?width=4000&height=3000"]);
    let idle = daemon.peak_bytes();
    let body =
        json!({ "relight": true, "tier": "closed", "lights": [{ "direction": [0.5, 0.4, 0.8] }] });
    // One is developed while the next is taken, and somebody looks.
    std::thread::scope(|scope| {
        let shots: Vec<_> = (0..3)
            .map(|_| scope.spawn(|| daemon.send_for(900, "POST", "/v1/shots", &body.to_string())))
            .collect();
        // A camera that is busy with shots gives no preview within ten seconds; who looks asks again.
        let looking = scope.spawn(|| {
            let ask = || daemon.send_for(900, "GET", "/v1/devices/0/preview?format=raw", "");
            (0..60).map(|_| ask().0).find(|status| *status == 200)
        });
        for shot in shots {
            let (status, answer) = shot.join().unwrap();
            assert_eq!(status, 200, "{answer}");
        }
        assert_eq!(looking.join().unwrap(), Some(200));
    });
    let id = daemon.send("GET", "/v1/shots", "").1["shots"][0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let view =
        json!({ "lights": [{ "direction": [0.1, 0.4, 0.8] }], "detail": "full", "format": "raw" });
    let looked = daemon.send_for(
        900,
        "POST",
        &format!("/v1/shots/{id}/view"),
        &view.to_string(),
    );
    assert_eq!(looked.0, 200);
    let mebi = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    eprintln!(
        "figure | most memory while 3 shots of 12 MP are relit, one is viewed in full and somebody looks, {} | {:.0} MiB (idle {:.1})",
        build(),
        mebi(daemon.peak_bytes()),
        mebi(idle)
    );
    // 36 MiB a picture as the camera gives it; light is four times as large, and there are some of these.
    assert!(mebi(daemon.peak_bytes()) < 3072.0);
}
