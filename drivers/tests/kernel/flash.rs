//! Flash lamps of every kind the kernel has: a flash subdevice, LEDs, a GPIO line.

use crate::machine::{PATIENCE, control, number, write};
use drivers::{
    DriverError, Frame, Illumination, Settings,
    flash::{self, Kind, Mode, Plan},
    lamp::Lamp,
    open,
};
use std::{
    path::Path,
    process::Command,
    time::{Duration, Instant},
};

const FAKE: &str = "/sys/module/fakeflash/parameters";
const LINES: &str = "/sys/module/fakegpio/parameters/levels";

fn lit() -> bool {
    number(&format!("{FAKE}/strobing")) == 1
}

fn strobes() -> i64 {
    number(&format!("{FAKE}/strobes"))
}

fn lamp(plan: Plan) -> Result<Box<dyn Lamp>, DriverError> {
    plan.check().unwrap();
    Ok(flash::open(&plan, Path::new("/dev/video0"))?.expect("a lamp"))
}

fn subdevice() -> Plan {
    Plan {
        kind: Kind::Subdevice,
        ..Plan::default()
    }
}

/// How long it stays lit, at most a second more than `bound`.
fn on_time(is_lit: impl Fn() -> bool, bound: Duration) -> Duration {
    let since = Instant::now();
    while is_lit() {
        assert!(
            since.elapsed() < bound + Duration::from_secs(1),
            "an LED left on"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
    since.elapsed()
}

const FLASH: Duration = Duration::from_millis(80);
/// Its timer's step and error, and the ticks of the kernel.
const BOUND: Duration = Duration::from_millis(80 + 10 + 10 + 12);

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_subdevice_is_found_in_the_media_controller_and_its_timeout_ends_each_flash() {
    let mut lamp = lamp(subdevice()).unwrap();
    assert!(lamp.reach().bounded_by_kernel);
    let before = strobes();
    let fired = lamp.fire(FLASH).unwrap();
    assert!(lit() && strobes() == before + 1);
    let took = on_time(lit, BOUND);
    eprintln!("a flash of {FLASH:?} ended by itself after {took:?}; {fired:?}");
    assert!(
        took >= FLASH - Duration::from_millis(5) && took <= BOUND,
        "{took:?}"
    );
    // Put out before its time, and by dropping.
    lamp.fire(FLASH).unwrap();
    lamp.put_out().unwrap();
    assert!(!lit());
    lamp.fire(FLASH).unwrap();
    assert!(lit());
    drop(lamp);
    assert!(!lit(), "dark when dropped");
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_flash_that_fails_is_a_typed_error_and_dark() {
    let mut lamp = lamp(subdevice()).unwrap();
    write(&format!("{FAKE}/fail_strobe"), "-5");
    let error = lamp.fire(FLASH).unwrap_err();
    write(&format!("{FAKE}/fail_strobe"), "0");
    assert!(
        matches!(error, DriverError::Hardware { .. }) && !lit(),
        "{error}"
    );
    eprintln!("{error}");
    for (bits, says) in [
        ("1", "over voltage"),
        ("4", "over temperature"),
        ("8", "short circuit"),
    ] {
        write(&format!("{FAKE}/fault"), bits);
        let error = lamp.fire(FLASH).unwrap_err();
        write(&format!("{FAKE}/fault"), "0");
        assert!(error.to_string().contains(says) && !lit(), "{error}");
        eprintln!("{error}");
    }
    lamp.fire(FLASH).expect("it works again");
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn no_flash_is_longer_or_hotter_than_its_plan_allows() {
    let mut lamp = lamp(Plan {
        longest_seconds: 0.1,
        duty: 0.2,
        window_seconds: 1.0,
        ..subdevice()
    })
    .unwrap();
    assert!(
        lamp.fire(Duration::from_millis(101))
            .unwrap_err()
            .to_string()
            .contains("longer")
    );
    lamp.fire(Duration::from_millis(60)).unwrap();
    on_time(lit, BOUND);
    let mut refused = None;
    for _ in 0..3 {
        match lamp.fire(Duration::from_millis(60)) {
            Ok(_) => drop(on_time(lit, BOUND)),
            Err(error) => refused = Some(error.to_string()),
        }
    }
    let refused = refused.expect("three flashes are too many for a fifth of a second");
    assert!(refused.contains("too hot") && !lit(), "{refused}");
    eprintln!("{refused}");
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn leds_are_strobed_or_timed_by_the_kernel() {
    let led = |mode| Plan {
        kind: Kind::Led,
        node: Some("white:flash".into()),
        mode,
        ..Plan::default()
    };
    let mut strobe = lamp(led(Mode::Strobe)).unwrap();
    assert!(strobe.reach().bounded_by_kernel);
    strobe.fire(FLASH).unwrap();
    assert!(lit());
    let took = on_time(lit, BOUND);
    eprintln!("flash_strobe of {FLASH:?} ended by itself after {took:?}");
    assert!(took <= BOUND);
    strobe.fire(FLASH).unwrap();
    drop(strobe);
    assert!(!lit());
    // The same LED as a torch, by the trigger `transient`.
    let torch_lit = || number(&format!("{FAKE}/torch")) > 0;
    let mut torch = lamp(led(Mode::Torch)).unwrap();
    assert!(torch.reach().bounded_by_kernel);
    torch.fire(FLASH).unwrap();
    assert!(torch_lit());
    let took = on_time(torch_lit, BOUND);
    eprintln!("transient of {FLASH:?} ended by itself after {took:?}");
    assert!(took <= BOUND);
    torch.fire(FLASH).unwrap();
    drop(torch);
    assert!(!torch_lit());
    let error = lamp(Plan {
        node: Some("nowhere".into()),
        ..led(Mode::Strobe)
    })
    .err()
    .expect("no such LED");
    assert!(matches!(error, DriverError::NoDevice { .. }), "{error}");
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_line_and_a_torch_go_dark_though_nobody_asks_for_a_frame() {
    let line_lit = || number(LINES) & 1 == 1;
    let plan = Plan {
        kind: Kind::Gpio,
        node: Some("/dev/gpiochip0".into()),
        line: 0,
        ..Plan::default()
    };
    let mut line = lamp(plan.clone()).unwrap();
    line.fire(FLASH).unwrap();
    assert!(line_lit());
    let took = on_time(line_lit, BOUND);
    eprintln!("a line lit for {FLASH:?} was let go after {took:?}");
    assert!(took <= BOUND);
    line.fire(FLASH).unwrap();
    drop(line);
    assert!(!line_lit());
    let torch_lit = || number(&format!("{FAKE}/torch")) > 0;
    let mut torch = lamp(Plan {
        mode: Mode::Torch,
        ..subdevice()
    })
    .unwrap();
    assert!(!torch.reach().bounded_by_kernel);
    torch.fire(FLASH).unwrap();
    assert!(torch_lit());
    let took = on_time(torch_lit, BOUND);
    eprintln!("a torch lit for {FLASH:?} was put out after {took:?}");
    assert!(took <= BOUND);
    drop(torch);
    write("/sys/module/fakegpio/parameters/fail_set", "-5");
    let error = lamp(plan).err().expect("a line that cannot be driven");
    write("/sys/module/fakegpio/parameters/fail_set", "0");
    eprintln!("{error}");
}

/// Set in the process that is to be killed, to the number of its lamp.
const VICTIM: &str = "FLASH_VICTIM";
/// What plays a control of the camera that switches a lamp.
const NODE: &str = "/dev/video0";
const BRIGHTNESS: u32 = 0x0098_0900;

/// A kind of lamp, how it is opened, and whether it is lit.
type Kindled = (&'static str, Plan, fn() -> bool);

fn lamps() -> [Kindled; 5] {
    let torch = || number(&format!("{FAKE}/torch")) > 0;
    let led = |intensity| Plan {
        kind: Kind::Led,
        node: Some("white:flash".into()),
        mode: Mode::Torch,
        intensity,
        ..Plan::default()
    };
    [
        ("strobe", subdevice(), lit),
        (
            "torch of a subdevice",
            Plan {
                mode: Mode::Torch,
                ..subdevice()
            },
            torch,
        ),
        // Not at its full brightness, which no kernel timer can switch.
        ("torch of an LED", led(Some(5)), torch),
        (
            "line",
            Plan {
                kind: Kind::Gpio,
                node: Some("/dev/gpiochip0".into()),
                ..Plan::default()
            },
            || number(LINES) & 1 == 1,
        ),
        (
            "control",
            Plan {
                kind: Kind::Control,
                control: Some("brightness".into()),
                on: 200,
                off: 100,
                ..Plan::default()
            },
            || control(NODE, BRIGHTNESS) == 200,
        ),
    ]
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn a_killed_process_leaves_no_lamp_on_and_a_stopped_one_none_beyond_its_bound() {
    const LONG: Duration = Duration::from_millis(400);
    if let Ok(number) = std::env::var(VICTIM) {
        let (_, plan, _) = lamps()[number.parse::<usize>().unwrap()].clone();
        let mut lamp = lamp(plan).unwrap();
        lamp.fire(LONG).unwrap();
        std::thread::sleep(Duration::from_secs(60));
    }
    let mut latest = [Duration::ZERO; 2];
    for (number, (name, plan, lit)) in lamps().into_iter().enumerate() {
        // The guard's word for its lamp; the thread's ends with its process too.
        let longest = Duration::from_secs_f64(plan.longest_seconds) + Duration::from_millis(100);
        for (signal, latest) in ["KILL", "STOP"].into_iter().zip(&mut latest) {
            let mut child = Command::new(std::env::current_exe().unwrap())
                .args([
                    "--ignored",
                    "--exact",
                    "flash::a_killed_process_leaves_no_lamp_on_and_a_stopped_one_none_beyond_its_bound",
                ])
                .env(VICTIM, number.to_string())
                .spawn()
                .unwrap();
            let since = Instant::now();
            while !lit() {
                assert!(
                    since.elapsed() < Duration::from_secs(10),
                    "the flash was never fired"
                );
                std::thread::sleep(Duration::from_millis(1));
            }
            let burning = Instant::now();
            let told = Command::new("kill")
                .args([&format!("-{signal}"), &child.id().to_string()])
                .status();
            assert!(told.unwrap().success());
            on_time(lit, longest);
            let took = burning.elapsed();
            eprintln!("{name}: dark {took:?} after SIG{signal} in a flash of {LONG:?}");
            assert!(took <= longest, "{name}: {took:?}");
            *latest = took.max(*latest);
            child.kill().unwrap();
            child.wait().unwrap();
            assert!(!lit(), "{name}");
        }
    }
    let [killed, stopped] = latest.map(|time| 1e3 * time.as_secs_f64());
    eprintln!(
        "figure | process with a burning lamp killed or stopped, {} kinds of lamps of a real kernel, flash of {} ms | \
         dark within {killed:.0} ms of SIGKILL and {stopped:.0} ms of SIGSTOP",
        lamps().len(),
        LONG.as_millis()
    );
}

#[test]
#[ignore = "needs the kernel of tests/guest/run"]
fn each_flash_frame_lies_within_a_strobe_and_no_ambient_frame_touches_one() {
    let mut device = open(
        "v4l:/dev/video0?color.format=YUYV&color.width=320&color.height=180&\
         color.frames_per_second=25&depth.frames_per_second=25&\
         depth.node=/dev/video1&depth.format=Y16&depth.width=320&depth.height=180&\
         flash.kind=subdevice&flash.duty=1",
    )
    .unwrap();
    let before = strobes();
    let mut stream = device.start(&Settings::default()).unwrap();
    let (mut flash, mut ambient) = (0, 0);
    let mut worst = i64::MAX;
    while flash + ambient < 60 {
        let Frame::Color(frame) = stream.next_frame(PATIENCE).unwrap() else {
            continue;
        };
        match frame.light {
            Illumination::Flash => flash += 1,
            Illumination::Ambient => ambient += 1,
        }
        if frame.light == Illumination::Flash {
            // The latest strobe is this frame's: the next one comes two frames later.
            let strobe = number(&format!("{FAKE}/last_strobe_ns"));
            worst = worst.min(frame.at.as_nanos() as i64 - strobe);
        }
    }
    let fired = strobes() - before;
    eprintln!(
        "{flash} flash and {ambient} ambient frames of {fired} strobes; \
         the latest strobe was {:.2} ms before its exposure; {:?}",
        worst as f64 / 1e6,
        stream.losses()
    );
    assert!(flash >= 15 && ambient >= 2 * flash - 2);
    assert!(worst >= 0, "an exposure began before its strobe");
    assert!(fired <= flash * 5 / 4 + 1, "strobes in vain");
    // A lamp that fails ends the session with its error, and dark.
    write(&format!("{FAKE}/fault"), "8");
    let error = loop {
        match stream.next_frame(PATIENCE) {
            Ok(_) => {}
            Err(error) => break error,
        }
    };
    write(&format!("{FAKE}/fault"), "0");
    assert!(
        error.to_string().contains("short circuit") && !lit(),
        "{error}"
    );
}
