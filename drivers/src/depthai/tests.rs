//! The driver against bridges of these tests: honest ones with a slow strobe, and liars.

use super::*;
use std::process::Command;

/// What all bridges here begin with; `say`, `hear`, `ready` and `frame` speak for them.
const PRELUDE: &str = r#"
import json, os, select, socket, struct, sys, time
line = socket.socket(fileno=0)
W, H = 16, 16
SIZE = 6 * W * H
os.ftruncate(1, 4 * SIZE)
def raw(body):
    line.sendall(struct.pack("<I", len(body)) + body)
def say(**message):
    raw(json.dumps(message).encode())
def exactly(count):
    parts = b""
    while len(parts) < count:
        part = line.recv(count - len(parts))
        if not part:
            os._exit(0)
        parts += part
    return parts
def hear():
    return json.loads(exactly(struct.unpack("<I", exactly(4))[0]))
def heard():
    while select.select([line], [], [], 0)[0]:
        yield hear()
LENS = dict(width=W, height=H, fx=20.0, fy=20.0, cx=7.5, cy=7.5,
            distortion=dict(k1=0, k2=0, p1=0, p2=0, k3=0, k4=0, k5=0, k6=0))
READY = dict(model="test", id="ABC123", color=LENS, depth=LENS,
             rotation=[[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_metres=[0.02, 0, 0],
             slots=4, slot_bytes=SIZE)
def store(slot, data):
    os.pwrite(1, data, slot * SIZE)
DEVICE = 5_000_000_000_000
def times(at):
    return dict(device_ns=DEVICE + at, stamp_ns=at)
def color(k, value, slot=0, at=None, **other):
    store(slot, bytes([value]) * (3 * W * H))
    facts = dict(camera="color", slot=slot, bytes=3 * W * H, sequence=k,
                 exposure=dict(seconds=0.001, gain=1.0), **times(at or time.monotonic_ns()))
    say(frame={**facts, **other})
def depth(k, slot=1, at=None, **other):
    store(slot, struct.pack("<H", 1500) * (W * H) + struct.pack("<H", 7) * (W * H))
    facts = dict(camera="depth", slot=slot, bytes=4 * W * H, sequence=k, planes=["amplitude"],
                 **times(at or time.monotonic_ns()))
    say(frame={**facts, **other})
opened = hear()
"#;

/// The device that a bridge of this script makes; `None`, with a reason said, without Python.
fn device(options: &str, script: &str) -> Option<Result<DepthAi, DriverError>> {
    let options = Options::parse(options).unwrap();
    let mut command = Command::new("python3");
    command.arg("-c").arg(format!("{PRELUDE}{script}"));
    match Bridge::run(&options.address(), &mut command) {
        Ok(bridge) => Some(DepthAi::through(bridge, options)),
        Err(error) => {
            eprintln!("SKIPPED: no python3 to play the bridge ({error})");
            None
        }
    }
}

const PATIENCE: Duration = Duration::from_secs(10);

#[test]
fn frames_of_a_strobe_that_obeys_late_carry_the_light_they_were_taken_in() {
    let script = r#"
say(ready=READY)
hear()
state, changes, k = False, [], 0
while True:
    now = time.monotonic()
    for message in heard():
        if "strobe" in message:
            # Up to 25 of the 30 milliseconds the driver reckons with.
            changes.append((now + 0.005 * (k % 6), message["strobe"]))
    while changes and changes[0][0] <= now:
        state = changes.pop(0)[1]
    # Both at one moment, as cameras in step; a busy machine would put the one after the flash's switching.
    at = time.monotonic_ns()
    color(k, 200 if state else 50, at=at)
    depth(k, at=at)
    k += 1
    time.sleep(0.005)
"#;
    let Some(device) = device("?rate=100&strobe=sensor&latency=6&readout=1", script) else {
        return;
    };
    let mut device = device.unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    let (mut flash, mut ambient, mut depths) = (0, 0, 0);
    while flash < 5 {
        match stream.next_frame(PATIENCE).unwrap() {
            Frame::Color(color) => {
                let Pixels::Rgb8(pixels) = &color.pixels else {
                    panic!("not what was sent: {color:?}");
                };
                let (count, value) = match color.light {
                    Illumination::Flash => (&mut flash, 200),
                    Illumination::Ambient => (&mut ambient, 50),
                };
                *count += 1;
                assert_eq!(
                    pixels[(3, 3)],
                    [value; 3],
                    "{:?} frame {}",
                    color.light,
                    color.sequence
                );
            }
            Frame::Depth(depth) => {
                assert_eq!(depth.metres[(2, 2)], 1.5);
                assert_eq!(depth.amplitude.unwrap()[(2, 2)], 7.0);
                depths += 1;
            }
        }
    }
    // Two ambient frames before each flash; the depth of the last color frame was not waited for.
    assert!(
        ambient >= 10 && depths + 1 >= flash + ambient,
        "{flash} flash, {ambient} ambient, {depths} depth"
    );
}

#[test]
fn a_silent_bridge_is_a_timeout_and_frames_come_afterwards() {
    let script = r#"
say(ready=READY)
hear()
time.sleep(0.3)
color(1, 50)
hear()
"#;
    let Some(device) = device("", script) else {
        return;
    };
    let mut device = device.unwrap();
    let mut stream = device.start(&Settings::default()).unwrap();
    let asked = Instant::now();
    let silent = stream.next_frame(Duration::from_millis(20)).unwrap_err();
    assert!(matches!(silent, DriverError::Timeout { .. }), "{silent}");
    assert!(
        asked.elapsed() < Duration::from_millis(250),
        "{:?}",
        asked.elapsed()
    );
    let frame = stream.next_frame(PATIENCE).unwrap();
    assert_eq!(frame.sequence(), 1);
    // It ends after that.
    let gone = stream.next_frame(PATIENCE).unwrap_err();
    assert!(matches!(gone, DriverError::Unplugged { .. }), "{gone}");
}

#[test]
fn a_bridge_that_lies_is_a_typed_error() {
    struct Case {
        script: &'static str,
        /// A word of the message.
        word: &'static str,
    }
    const STARTED: &str = "say(ready=READY)\nhear()\n";
    for case in [
        Case {
            script: "raw(b'{]')",
            word: "column",
        },
        Case {
            script: "line.sendall(b'\\xff\\xff\\xff\\xff')",
            word: "4294967295 bytes",
        },
        Case {
            script: "sys.exit(3)",
            word: "ended",
        },
        Case {
            script: "say(error=dict(kind='missing', message='no package'))",
            word: "no package",
        },
        Case {
            script: "say(ready=dict(READY, slot_bytes=10))",
            word: "slots of 10 bytes",
        },
        Case {
            script: "say(ready=dict(READY, slots=1 << 40))",
            word: "slots",
        },
        Case {
            script: "say(ready=dict(READY, color=dict(LENS, fx=-1.0)))",
            word: "rig.color",
        },
        Case {
            script: "say(ready=dict(READY, color=dict(LENS, width=0)))",
            word: "rig.color",
        },
        Case {
            script: "say(ready=dict(READY, rotation=[[1,0,0],[0,2,0],[0,0,1]]))",
            word: "rotation",
        },
        Case {
            script: "color(0, 1)",
            word: "before it was ready",
        },
        Case {
            script: "S color(0, 1, slot=0, **{})\nsay(frame=dict(camera='color', slot=9, bytes=768, sequence=2, exposure=dict(seconds=0.001, gain=1.0), **times(time.monotonic_ns())))",
            word: "slot 9",
        },
        Case {
            script: "S color(0, 1, bytes=10)",
            word: "10 bytes",
        },
        Case {
            script: "S color(0, 1, exposure=None)",
            word: "without exposure",
        },
        Case {
            script: "S color(0, 1, exposure=dict(seconds=-1.0, gain=1.0))",
            word: "exposure",
        },
        Case {
            script: "S color(0, 1, sequence=-1)",
            word: "invalid value",
        },
        Case {
            script: "S os.ftruncate(1, 0)\nsay(frame=dict(camera='color', slot=0, bytes=768, sequence=2, exposure=dict(seconds=0.001, gain=1.0), **times(time.monotonic_ns())))",
            word: "768 bytes at 0",
        },
        Case {
            script: "S say(ready=READY)",
            word: "ready twice",
        },
        Case {
            script: "S say(error=dict(kind='lost', message='link is down'))",
            word: "link is down",
        },
    ] {
        let script = match case.script.strip_prefix("S ") {
            Some(rest) => format!("{STARTED}{rest}\nhear()"),
            None => format!("{}\nhear()", case.script),
        };
        let Some(device) = device("", &script) else {
            return;
        };
        let seen = device.and_then(|mut device| {
            let mut stream = device.start(&Settings::default())?;
            // One good frame may come first.
            stream.next_frame(PATIENCE)?;
            stream.next_frame(PATIENCE).map(drop)
        });
        let message = seen.expect_err(case.script).to_string();
        assert!(message.contains(case.word), "{}: {message}", case.script);
    }
}

#[test]
fn the_process_is_gone_when_the_device_is() {
    // It does not hear the end of its line, as if the vendor's library hung.
    let script = "say(ready=READY)\nimport signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\ntime.sleep(600)\n";
    let Some(device) = device("", script) else {
        return;
    };
    let device = device.unwrap();
    let process = device.bridge.as_ref().unwrap().id().unwrap();
    let folder = format!("/proc/{process}");
    assert!(Path::new(&folder).exists());
    drop(device);
    assert!(!Path::new(&folder).exists(), "process {process} lives on");
}

#[test]
fn addresses_say_what_is_valid_and_open_the_same_again() {
    let text = "14442C10?width=640&height=400&strobe=41&latency=4&sync=input&rate=20&python=/opt/py/bin/python";
    let options = Options::parse(text).unwrap();
    let again = Options::parse(options.address().strip_prefix("depthai:").unwrap()).unwrap();
    assert_eq!(options, again);
    for (wrong, word) in [
        ("../x", "serial number"),
        ("?width=641", "even"),
        ("?strobe=lots", "GPIO"),
        ("?sync=maybe", "output"),
        ("?speed=3", "valid options"),
        ("?latency=0", "from 1"),
    ] {
        let refused = Options::parse(wrong).unwrap_err();
        assert!(refused.contains(word), "{wrong}: {refused}");
    }
    let ask = |exposure, gain| {
        let settings = Settings {
            exposure_seconds: exposure,
            gain,
            ..Settings::default()
        };
        options.exposure(&settings, "depthai:")
    };
    assert_eq!(ask(None, None).unwrap(), (None, None));
    assert_eq!(
        ask(Some(0.01), Some(4.0)).unwrap(),
        (Some(10_000), Some(400))
    );
    assert!(ask(Some(f32::NAN), None).is_err() && ask(Some(1.0), None).is_err());
    assert!(ask(None, Some(100.0)).is_err());
}
