//! The viewer's page in a real browser: what it shows, how it is used, and how fast it follows.

mod browser;

use browser::Page;
use std::{
    os::unix::net::UnixDatagram,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// A daemon with its viewer, on a port of its own.
struct Daemon {
    folder: tempfile::TempDir,
    process: Child,
}

impl Daemon {
    fn start(device: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("captured.toml");
        std::fs::write(
            &config,
            "[viewer]\nenabled = true\naddress = \"127.0.0.1:0\"\n",
        )
        .unwrap();
        let notify = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        notify
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let process = Command::new(env!("CARGO_BIN_EXE_captured"))
            .args(["--config", "captured.toml", "--device", device])
            .args(["--socket", "captured/captured.sock", "--state", "state"])
            .current_dir(folder.path())
            .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
            .env("NOTIFY_SOCKET", folder.path().join("notify"))
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let daemon = Self { folder, process };
        notify.recv(&mut [0; 100]).expect("the daemon gets ready");
        daemon
    }

    fn capturectl(&self, arguments: &[&str]) -> String {
        let output = Command::new(env!("CARGO_BIN_EXE_capturectl"))
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.folder.path())
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        drop(self.process.kill());
        drop(self.process.wait());
    }
}

/// A number that differs where pictures differ.
const FINGERPRINT: &str = "(() => { const c = document.getElementById('picture'); \
    const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
    let h = 0; for (let i = 0; i < d.length; i += 4) h = (h * 31 + d[i] + 7 * d[i + 1]) >>> 0; return h; })()";

/// Mean brightness of the picture, of 255.
const BRIGHTNESS: &str = "(() => { const c = document.getElementById('picture'); \
    const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
    let s = 0; for (let i = 0; i < d.length; i += 4) s += d[i + 1]; return s / (d.length / 4); })()";

const IDLE: &str =
    "document.getElementById('busy').hidden && !document.getElementById('shoot').disabled";

fn chip(group: &str, value: &str) -> String {
    format!("#{group} label:has(input[value=\"{value}\"])")
}

/// Chooses one of a group, again where the page moved under the pointer, as somebody at it would.
fn choose(page: &mut Page, group: &str, value: &str) {
    let chosen = format!("document.querySelector('#{group} input[value=\"{value}\"]').checked");
    for _ in 0..20 {
        page.click(&chip(group, value));
        if page.value(&chosen) == true {
            return;
        }
    }
    panic!("{value} of {group} cannot be chosen");
}

/// Waits until the picture is another than before and the last that was asked for, and returns its
/// fingerprint: a drag asks for several.
fn changed(page: &mut Page, before: &serde_json::Value) -> serde_json::Value {
    page.wait(&format!(
        "document.body.dataset.asking === '0' && {FINGERPRINT} !== {before}"
    ));
    page.value(FINGERPRINT)
}

#[test]
fn a_newcomer_shoots_drags_the_light_and_sees_every_layer() {
    let Some(mut page) = Page::open(1280, 900, false) else {
        return;
    };
    let daemon = Daemon::start("synthetic:desk");
    page.go(&daemon.capturectl(&["viewer"]));
    assert_eq!(
        page.value("location.hash"),
        "",
        "the token stays in the address"
    );
    assert_eq!(
        page.value("document.cookie"),
        "",
        "a script can read the token"
    );
    page.screenshot("viewer-empty.png");

    page.key("s");
    page.wait("document.querySelectorAll('#shots button').length === 1");
    page.wait(IDLE);
    page.wait("document.querySelector('#shots img').complete && document.querySelector('#shots img').naturalWidth > 0");
    page.screenshot("viewer-desktop.png");

    // Beyond the limit of the configuration nothing is shot; the arrows and Enter are enough for a burst.
    page.value("document.getElementById('burst').focus()");
    for digit in ["3", "3"] {
        page.key(digit);
    }
    page.key("Enter");
    let told = page.value("document.getElementById('burst').validationMessage");
    assert!(told.as_str().unwrap().contains("32"), "{told}");
    page.value("document.getElementById('burst').value = ''");
    for _ in 0..3 {
        page.key("ArrowUp");
    }
    assert_eq!(page.value("document.getElementById('burst').value"), "4");
    page.screenshot("viewer-burst.png");
    page.key("Enter");
    page.wait("document.querySelectorAll('#shots button').length === 2");
    page.wait(IDLE);
    page.value("document.getElementById('about-shot').open = true");
    page.wait("document.getElementById('made-of').textContent.includes('without')");
    let made_of = page.value("document.getElementById('made-of').textContent");
    let numbers: Vec<u32> = made_of
        .as_str()
        .unwrap()
        .split(' ')
        .filter_map(|word| word.parse().ok())
        .collect();
    // Both lights come in runs; the last of each is taken whole.
    assert!(numbers[0] + numbers[1] >= 4, "{made_of}");
    page.screenshot("viewer-burst-about.png");
    page.value("document.getElementById('about-shot').open = false");
    page.value("document.getElementById('burst').value = ''");
    page.value("document.getElementById('burst').blur()");
    let mut print = page.value(FINGERPRINT);

    page.drag("#hemisphere", (-50.0, 20.0), false);
    print = changed(&mut page, &print);
    page.drag("#picture", (120.0, -60.0), false);
    print = changed(&mut page, &print);
    page.value("document.getElementById('hemisphere').focus()");
    page.key("ArrowLeft");
    print = changed(&mut page, &print);

    for layer in [
        "flash",
        "ambient",
        "albedo",
        "normals",
        "roughness",
        "shadow",
        "depth",
        "confidence",
    ] {
        choose(&mut page, "layers", layer);
        print = changed(&mut page, &print);
        if layer == "normals" {
            page.screenshot("viewer-normals.png");
        }
    }
    choose(&mut page, "environments", "Studio");
    print = changed(&mut page, &print);
    page.screenshot("viewer-environment.png");
    page.value("(() => { const t = document.getElementById('turn'); t.value = 90; t.dispatchEvent(new Event('input')); })()");
    changed(&mut page, &print);
    choose(&mut page, "environments", "");

    page.click("#compare");
    page.wait("!document.getElementById('divider').hidden");
    page.drag("#divider", (150.0, 0.0), false);
    assert!(
        page.value("Number(document.getElementById('divider').getAttribute('aria-valuenow'))")
            .as_f64()
            .unwrap()
            > 55.0
    );
    page.screenshot("viewer-compare.png");
    page.click("#compare");

    // What is kept is a second shot; what is deleted is gone from the disk.
    page.click("#keep");
    page.wait("document.querySelectorAll('#shots button').length === 3");
    page.wait(IDLE);
    page.value("document.getElementById('about-shot').open = true");
    page.click("#delete");
    page.click("#confirm button[value=yes]");
    page.wait("document.querySelectorAll('#shots button').length === 2");
    assert_eq!(daemon.capturectl(&["shots"]).lines().count(), 3);
    assert_eq!(page.complaints, Vec::<String>::new());
}

#[test]
fn the_live_picture_shows_what_is_clipped_and_stops_with_the_page() {
    let Some(mut page) = Page::open(1280, 900, false) else {
        return;
    };
    let daemon = Daemon::start("synthetic:desk?pace=real");
    page.go(&daemon.capturectl(&["viewer"]));
    page.click("#to-live");
    page.wait("document.getElementById('clipped').textContent !== ''");
    page.wait("Number(document.body.dataset.drawn) > 3");
    page.screenshot("viewer-live.png");
    assert!(daemon.capturectl(&["status"]).contains("armed"));
    page.click("#to-live");
    // Two seconds after the last who looked.
    let began = std::time::Instant::now();
    while daemon.capturectl(&["status"]).contains("armed") {
        assert!(
            began.elapsed() < Duration::from_secs(20),
            "the camera still streams"
        );
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(page.complaints, Vec::<String>::new());
}

#[test]
fn a_phone_held_upright_shows_everything_and_a_finger_moves_the_light() {
    let Some(mut page) = Page::open(390, 844, true) else {
        return;
    };
    let daemon = Daemon::start("synthetic:desk");
    daemon.capturectl(&["shoot", "--relight"]);
    page.go(&daemon.capturectl(&["viewer"]));
    page.wait(IDLE);
    let print = page.value(FINGERPRINT);
    page.screenshot("viewer-phone.png");
    assert!(
        page.value("document.documentElement.scrollWidth")
            .as_f64()
            .unwrap()
            <= 390.0,
        "the page is wider than the screen"
    );
    page.drag("#hemisphere", (-40.0, 10.0), true);
    changed(&mut page, &print);
    page.screenshot("viewer-phone-light.png");
    // A finger reaches the frames of a burst, and the numbers of the screen's keyboard arrive there.
    page.tap("#burst");
    page.type_text("3");
    page.screenshot("viewer-phone-burst.png");
    page.tap("#shoot");
    page.wait("document.querySelectorAll('#shots button').length === 2");
    page.wait(IDLE);
    page.wait("document.getElementById('made-of').textContent.includes('without')");
    page.value("window.scrollTo(0, document.body.scrollHeight)");
    page.wait("document.querySelector('#shots img').naturalWidth > 0");
    page.screenshot("viewer-phone-end.png");
    // Fingers need at least 40 pixels.
    let small = page.value(
        "[...document.querySelectorAll('button, .chips label, #burst')].filter(e => e.offsetParent && e.offsetHeight < 35).map(e => e.textContent)",
    );
    assert_eq!(small, serde_json::json!([]));
    assert_eq!(page.complaints, Vec::<String>::new());
}

#[test]
fn a_page_with_a_wrong_token_says_what_to_do() {
    let Some(mut page) = Page::open(800, 600, false) else {
        return;
    };
    let daemon = Daemon::start("synthetic:desk");
    let address = daemon.capturectl(&["viewer"]);
    let wrong = address.split('#').next().unwrap().to_owned() + "#token=0123";
    page.go(&wrong);
    page.wait("document.getElementById('notice').textContent.includes('capturectl viewer')");
}

/// Pictures per second while a light is dragged, as the page draws them.
fn rate(page: &mut Page) -> f64 {
    let drawn = page.value(
        "(async () => { const h = document.getElementById('hemisphere'); const b = h.getBoundingClientRect(); \
         const at = (t) => ({ pointerId: 1, bubbles: true, clientX: b.x + b.width * (0.5 + 0.35 * Math.cos(t)), clientY: b.y + b.height * (0.5 + 0.35 * Math.sin(t)) }); \
         h.setPointerCapture = () => {}; h.hasPointerCapture = () => true; \
         const from = Number(document.body.dataset.drawn); const began = performance.now(); \
         while (performance.now() - began < 4000) { h.dispatchEvent(new PointerEvent('pointermove', at((performance.now() - began) / 500))); await new Promise(requestAnimationFrame); } \
         return (Number(document.body.dataset.drawn) - from) / ((performance.now() - began) / 1000); })()",
    );
    drawn.as_f64().unwrap()
}

#[test]
#[ignore = "a measurement; cargo test --release --test viewer -- --ignored --nocapture"]
fn pictures_per_second_while_the_light_is_dragged() {
    let Some(mut page) = Page::open(1280, 900, false) else {
        return;
    };
    for (size, full) in [
        ("width=512&height=512", false),
        ("width=1920&height=1080", false),
        ("width=1920&height=1080", true),
    ] {
        let daemon = Daemon::start(&format!("synthetic:desk?{size}"));
        daemon.capturectl(&["shoot"]);
        page.go(&daemon.capturectl(&["viewer"]));
        page.wait(IDLE);
        if full {
            page.click("#full");
            page.wait("document.getElementById('picture').width === 1920");
            page.wait(IDLE);
        }
        let shown = page.value(
            "`${document.getElementById('picture').width} × ${document.getElementById('picture').height}`",
        );
        eprintln!(
            "figure | dragging the light, photograph of {}, shown at {} | {:.1} pictures a second",
            size.replace("width=", "").replace("&height=", " × "),
            shown.as_str().unwrap(),
            rate(&mut page)
        );
        assert!(page.value(BRIGHTNESS).as_f64().unwrap() > 5.0);
    }
}
