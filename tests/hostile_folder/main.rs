//! Captures that contradict themselves and images that lie: each is refused in words that name the
//! file, the field and the remedy, and nothing panics or asks for more memory than it may.

mod images;
mod toml;

use captured::{
    folder,
    output::{Precision, exr, png},
};
use drivers::Plane;
use std::path::Path;

const TOML: &str = r#"format = 1
[color]
width = 8
height = 6
fx = 10.0
fy = 10
cx = 3.5
cy = 2.5
distortion = { model = "none" }
transfer = "linear"
[depth]
width = 4
height = 3
fx = 5.0
fy = 5.0
cx = 1.5
cy = 1.0
distortion = { model = "rational", k1 = 0.1, k2 = 0.0, k3 = 0.0, k4 = 0.0, k5 = 0.0, k6 = 0.0, p1 = 0.0, p2 = 0.0 }
depth_unit_metres = 0.001
rotation = [[1,0,0],[0,1,0],[0,0,1]]
translation_metres = [0.01, 0.0, 0.0]
[flash]
position_metres = [0.02, 0.0, 0.0]
intensity = 9.5
"#;
const LIGHTS: &str = r#"scale = "unknown"
[[light]]
direction = [0.0, 0.6, 0.8]
image = "relit_000.png"
shadow = "shadow_000.png"
intensity = [2.0, 1.0, 0.5]
"#;

fn gray16(width: usize, height: usize, value: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(::png::ColorType::Grayscale);
    encoder.set_depth(::png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().unwrap();
    writer
        .write_image_data(&value.to_be_bytes().repeat(width * height))
        .unwrap();
    writer.finish().unwrap();
    bytes
}

fn color8(width: usize, height: usize) -> Vec<u8> {
    png::rgb8(&Plane::from_fn(width, height, |x, y| [x as u8, y as u8, 7])).unwrap()
}

fn gray8(width: usize, height: usize) -> Vec<u8> {
    png::fraction(&Plane::filled(width, height, 0.5)).unwrap()
}

/// A whole, valid capture.
fn good() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    std::fs::create_dir(dir.path().join("truth")).unwrap();
    put("capture.toml", TOML.as_bytes());
    put("flash.png", &color8(8, 6));
    put("ambient.png", &color8(8, 6));
    put("depth.png", &gray16(4, 3, 1500));
    put("amplitude.png", &gray16(4, 3, 77));
    put("mask.png", &gray8(8, 6));
    put("truth/lights.toml", LIGHTS.as_bytes());
    put("truth/relit_000.png", &color8(8, 6));
    put("truth/shadow_000.png", &gray8(8, 6));
    dir
}

#[test]
fn the_good_capture_the_others_are_made_from_is_read() {
    let dir = good();
    let capture = folder::read(dir.path()).unwrap();
    let shot = &capture.shot;
    assert_eq!(shot.depth.metres[(0, 0)], 1.5);
    assert_eq!(shot.depth.amplitude.as_ref().unwrap()[(0, 0)], 77.0);
    assert_eq!(shot.rig.flash.intensity, Some(9.5));
    let truth = capture.truth.unwrap();
    assert!(!truth.scale_known);
    let (relit, shadow) = truth.lights[0].load().unwrap();
    // 7/255 by sRGB is 0.002125 (IEC 61966-2-1, linear part), divided by the intensity 0.5.
    assert!((relit.0[(0, 0)][2] - 7.0 / 255.0 / 12.92 / 0.5).abs() < 1e-7);
    assert!((shadow.unwrap()[(0, 0)] - 0.5).abs() < 0.01);
    let toward = truth.lights[0].toward_light().to_array();
    for (found, expected) in toward.iter().zip([0.0, -0.6, -0.8]) {
        assert!((found - expected).abs() < 1e-6, "{toward:?}");
    }
}

#[test]
fn files_that_are_missing_doubled_or_of_the_wrong_kind_are_named() {
    type Change = fn(&Path);
    let cases: [(Change, &[&str]); 11] = [
        (
            |dir| std::fs::remove_file(dir.join("capture.toml")).unwrap(),
            &["capture.toml", "missing"],
        ),
        (
            |dir| std::fs::remove_file(dir.join("flash.png")).unwrap(),
            &["flash.png", "missing", "add"],
        ),
        (
            |dir| std::fs::remove_file(dir.join("depth.png")).unwrap(),
            &["depth.png", "missing", "add"],
        ),
        (
            |dir| std::fs::write(dir.join("flash.exr"), "").unwrap(),
            &["flash.png", "flash.exr", "keep one"],
        ),
        (
            |dir| std::fs::write(dir.join("depth.png"), gray8(4, 3)).unwrap(),
            &["depth.png", "16-bit"],
        ),
        (
            |dir| std::fs::write(dir.join("mask.png"), gray8(8, 5)).unwrap(),
            &["mask.png", "8×5", "8×6"],
        ),
        (
            |dir| std::fs::write(dir.join("ambient.png"), color8(7, 6)).unwrap(),
            &["ambient.png", "7×6"],
        ),
        (
            |dir| std::fs::write(dir.join("amplitude.png"), color8(4, 3)).unwrap(),
            &["amplitude.png", "gray"],
        ),
        (
            |dir| std::fs::write(dir.join("flash.png"), "GIF89a").unwrap(),
            &["flash.png", "convert"],
        ),
        (
            |dir| std::fs::write(dir.join("flash.png"), "").unwrap(),
            &["flash.png", "convert"],
        ),
        (
            |dir| {
                std::fs::remove_file(dir.join("flash.png")).unwrap();
                std::fs::create_dir(dir.join("flash.png")).unwrap();
            },
            &["flash.png", "not a regular file"],
        ),
    ];
    for (change, names) in cases {
        let dir = good();
        change(dir.path());
        let message = folder::read(dir.path()).expect_err(names[0]).to_string();
        for name in names {
            assert!(message.contains(name), "{message:?} does not name {name:?}");
        }
    }
}

#[test]
fn a_named_pipe_is_refused_instead_of_waited_for() {
    let dir = good();
    let flash = dir.path().join("flash.png");
    std::fs::remove_file(&flash).unwrap();
    rustix::fs::mknodat(
        rustix::fs::CWD,
        &flash,
        rustix::fs::FileType::Fifo,
        rustix::fs::Mode::RUSR,
        0,
    )
    .unwrap();
    let message = folder::read(dir.path()).unwrap_err().to_string();
    assert!(message.contains("not a regular file"), "{message}");
}

#[test]
fn zero_negative_and_infinite_depths_are_no_answer() {
    let dir = good();
    std::fs::remove_file(dir.path().join("depth.png")).unwrap();
    let mut metres = Plane::filled(4, 3, 1.25);
    for (x, value) in [0.0, -1.0, f32::INFINITY, f32::NAN].into_iter().enumerate() {
        metres[(x, 0)] = value;
    }
    let bytes = exr::gray(&metres, Precision::Float).unwrap();
    std::fs::write(dir.path().join("depth.exr"), bytes).unwrap();
    let shot = folder::read(dir.path()).unwrap().shot;
    assert!(shot.depth.metres.row(0).iter().all(|m| m.is_nan()));
    assert!(shot.depth.metres.row(1).iter().all(|m| *m == 1.25));
    drivers::admission::admit_depth(&shot.depth, &shot.rig).unwrap();
}
