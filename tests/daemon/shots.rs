//! Shots through the daemon, and what becomes of them when it goes away.

use crate::Daemon;

const SHOOT: [&str; 6] = [
    "--json",
    "shoot",
    "--relight",
    "--light",
    "0.5,0.4,0.8",
    "--out",
];

fn shoot(daemon: &Daemon, out: &str) -> (Option<i32>, serde_json::Value, String) {
    let (code, text, err) = daemon.capturectl(&[&SHOOT[..], &[out]].concat());
    let answer = serde_json::from_str(&text).unwrap_or_else(|_| panic!("no JSON: {text} {err}"));
    (code, answer, err)
}

#[test]
fn a_shot_through_the_socket_is_the_shot_taken_in_process() {
    let mut daemon = Daemon::start("synthetic:desk");
    let (code, answer, err) = shoot(&daemon, "through");
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(answer["by"], "daemon", "{answer}");
    assert!(err.contains("captured.sock"), "does not say which: {err}");
    let (_, status) = daemon.send("GET", "/v1/status", "");
    assert_eq!(status["shots"], 1);
    assert_eq!(status["in_use"], false);

    // SIGKILL leaves the socket behind: a client must not take it for a daemon.
    assert_eq!(daemon.end_by("KILL"), None);
    assert!(daemon.socket().exists());
    let (code, answer, err) = shoot(&daemon, "within");
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(answer["by"], "process", "{answer}");
    assert!(err.contains("in this process"), "does not say which: {err}");

    let folder = daemon.folder.path();
    for name in [
        "relit_000.exr",
        "relit_000.png",
        "shadow_000.png",
        "albedo.exr",
        "normal.exr",
    ] {
        let read = |out: &str| std::fs::read(folder.join(out).join(name)).expect(name);
        assert!(read("through") == read("within"), "{name} differs");
    }
}

#[test]
fn a_burst_through_the_socket_is_the_burst_taken_in_process() {
    let mut daemon = Daemon::start("synthetic:desk?width=64&depth_width=32&noise=4");
    let device = "synthetic:desk?width=64&depth_width=32&noise=4";
    let shoot = |daemon: &Daemon, out: &str| {
        let arguments = [
            "--json", "shoot", "--device", device, "--burst", "12", "--out", out,
        ];
        let (code, text, err) = daemon.capturectl(&arguments);
        assert_eq!(code, Some(0), "{err}");
        assert!(err.contains("frames with flash"), "not told: {err}");
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let through = shoot(&daemon, "through");
    assert_eq!(through["by"], "daemon");
    let burst = &through["shot"]["report"]["burst"];
    let used = [0, 1].map(|light| burst["used"][light].as_u64().unwrap());
    assert!((12..=15).contains(&(used[0] + used[1])), "{burst}");
    // Kept by the daemon, and good to be looked at like any other.
    let (_, list) = daemon.send("GET", "/v1/shots", "");
    let id = list["shots"][0]["id"].as_str().unwrap();
    let view = "{\"lights\": [{\"direction\": [0, 0, 1]}], \"layer\": \"relit\"}";
    let asked = Daemon::request("POST", &format!("/v1/shots/{id}/view"), view);
    assert_eq!(daemon.ask(asked.as_bytes()).0, 200);
    // More than the owner of the machine allows is refused before anything is lit, by either.
    let (code, _, err) = daemon.capturectl(&["shoot", "--burst", "33", "--out", "more"]);
    assert_eq!(code, Some(2));
    assert!(err.contains("limits.burst"), "{err}");

    daemon.end_by("TERM");
    let within = shoot(&daemon, "within");
    assert_eq!(within["by"], "process");
    assert_eq!(&within["shot"]["report"]["burst"], burst);
    let read = |out: &str| std::fs::read(daemon.folder.path().join(out).join("shot.mcap"));
    assert!(read("through").unwrap() == read("within").unwrap());
}

#[test]
fn a_camera_lost_in_the_middle_of_a_burst_fails_it_and_the_next_shot_is_whole() {
    // Its first bracket takes six frames of color and depth.
    let device = "flaky:unplug=20:synthetic:desk?width=64&depth_width=32";
    let daemon = Daemon::start(device);
    let (status, answer) = daemon.send("POST", "/v1/shots", "{\"burst\": 24}");
    assert_eq!(
        (status, &answer["kind"]),
        (502, &"device".into()),
        "{answer}"
    );
    assert!(
        answer["message"].as_str().unwrap().contains("unplugged"),
        "{answer}"
    );
    let (_, list) = daemon.send("GET", "/v1/shots", "");
    assert_eq!(list["count"], 0, "half a burst was kept");
    // It is opened again at once, but not in no time.
    let began = std::time::Instant::now();
    while daemon.send("GET", "/v1/status", "").1["devices"][0]["phase"] != "idle" {
        assert!(began.elapsed() < crate::PATIENCE, "it does not come back");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let (status, answer) = daemon.send("POST", "/v1/shots", "{}");
    assert_eq!(status, 200, "{answer}");
}

#[test]
fn an_environment_lights_the_same_through_the_socket_as_in_process() {
    let mut daemon = Daemon::start("synthetic:desk");
    let map = image::Rgb32FImage::from_fn(128, 64, |x, y| {
        let sun = (90..94).contains(&x) && (12..16).contains(&y);
        image::Rgb([if sun { 300.0 } else { 0.4 }, 0.4, 0.1 + y as f32 / 64.0])
    });
    map.save(daemon.folder.path().join("sky.hdr")).unwrap();
    let shoot = |daemon: &Daemon, out: &str| {
        let arguments = [
            "--json",
            "shoot",
            "--relight",
            "--environment",
            "sky.hdr",
            "--out",
            out,
        ];
        let (code, text, err) = daemon.capturectl(&arguments);
        assert_eq!(code, Some(0), "{err}");
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    };
    let through = shoot(&daemon, "through");
    assert_eq!(through["by"], "daemon");
    assert_eq!(through["shot"]["lights"][0]["label"], "sky");
    daemon.end_by("TERM");
    let within = shoot(&daemon, "within");
    assert_eq!(within["by"], "process");
    assert_eq!(within["shot"]["lights"], through["shot"]["lights"]);
    let read = |out: &str, name: &str| std::fs::read(daemon.folder.path().join(out).join(name));
    for name in ["relit_000.exr", "relit_000.png", "shadow_000.png"] {
        assert!(
            read("through", name).unwrap() == read("within", name).unwrap(),
            "{name} differs"
        );
    }
}

#[test]
fn every_file_of_a_shot_arrives_with_the_hash_its_manifest_states() {
    let daemon = Daemon::start("synthetic:desk");
    let (code, _, err) = shoot(&daemon, "shot");
    assert_eq!(code, Some(0), "{err}");
    let shot = daemon.folder.path().join("shot");
    let manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(shot.join("shot.json")).unwrap()).unwrap();
    let files = manifest["files"].as_array().unwrap();
    assert!(files.len() >= 8, "{manifest}");
    for file in files {
        let bytes = std::fs::read(shot.join(file["name"].as_str().unwrap())).unwrap();
        assert_eq!(
            blake3::hash(&bytes).to_hex().as_str(),
            file["blake3"],
            "{file}"
        );
    }
}

#[test]
fn a_device_that_is_unplugged_fails_the_shot_and_not_the_daemon() {
    let daemon = Daemon::start("flaky:unplug=1:synthetic:desk");
    let (code, answer, err) = shoot(&daemon, "shot");
    assert_eq!(code, Some(4), "{err}");
    assert_eq!(answer["error"]["kind"], "device", "{answer}");
    assert!(
        answer["error"]["message"]
            .as_str()
            .unwrap()
            .contains("unplugged"),
        "{answer}"
    );
    assert!(!daemon.folder.path().join("shot").exists());
    let (status, body) = daemon.send("GET", "/v1/status", "");
    assert_eq!((status, &body["failures"]), (200, &serde_json::json!(1)));
}

#[test]
fn told_to_stop_it_stops_and_leaves_no_socket() {
    for signal in ["TERM", "INT"] {
        let mut daemon = Daemon::start("synthetic:desk");
        assert_eq!(daemon.end_by(signal), Some(0), "{signal}");
        assert_eq!(daemon.notification(), "STOPPING=1");
        assert!(!daemon.socket().exists());
    }
}

#[test]
fn a_second_daemon_does_not_take_the_socket_of_the_first() {
    let daemon = Daemon::start("synthetic:desk");
    let (code, message) = daemon.start_another();
    assert_ne!(code, Some(0));
    assert!(
        message.contains("captured.sock") && message.contains("listens"),
        "{message}"
    );
    assert_eq!(daemon.send("GET", "/v1/status", "").0, 200);
}
