//! Captures that contradict themselves and images that lie: each is refused in words that name the
//! file, the field and the remedy, and nothing panics or asks for more memory than it may.

use captured::{
    folder::{self, ImageError, Limits, decode_limited},
    output::{Precision, exr, png},
};
use drivers::Plane;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

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

struct Case {
    /// Text of `capture.toml` replaced …
    from: &'static str,
    to: &'static str,
    /// … and what the message must name.
    names: &'static [&'static str],
}

#[test]
fn every_mistake_in_capture_toml_names_file_field_and_remedy() {
    let cases = [
        Case {
            from: "format = 1",
            to: "format = 2",
            names: &["format is 2", "format = 1"],
        },
        Case {
            from: "format = 1",
            to: "",
            names: &["format"],
        },
        Case {
            from: "format = 1",
            to: "format = 1\nauthor = 3",
            names: &["author"],
        },
        Case {
            from: "cx = 3.5",
            to: "cx = 3.5\nskew = 0.0",
            names: &["skew"],
        },
        Case {
            from: "fx = 10.0",
            to: "",
            names: &["fx"],
        },
        Case {
            from: "fx = 10.0",
            to: "fx = -1.0",
            names: &["color.fx", "-1", "above zero"],
        },
        Case {
            from: "fy = 10",
            to: "fy = nan",
            names: &["color.fy", "NaN"],
        },
        Case {
            from: "cx = 3.5",
            to: "cx = inf",
            names: &["color.cx", "finite"],
        },
        Case {
            from: "width = 8",
            to: "width = 0",
            names: &["color.width", "16384"],
        },
        Case {
            from: "width = 8",
            to: "width = 20000",
            names: &["color.width", "20000"],
        },
        Case {
            from: "width = 8",
            to: "width = -8",
            names: &["width"],
        },
        Case {
            from: "width = 8",
            to: "width = 9",
            names: &["flash.png", "8×6", "9×6"],
        },
        Case {
            from: "height = 3",
            to: "height = 4",
            names: &["depth.png", "4×3", "4×4"],
        },
        Case {
            from: "\"linear\"",
            to: "\"gamut\"",
            names: &["transfer", "gamut"],
        },
        Case {
            from: "transfer = \"linear\"",
            to: "",
            names: &["transfer"],
        },
        Case {
            from: "\"linear\"",
            to: "{ gamma = 0.0 }",
            names: &["color.transfer.gamma"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nblack_level = 1.0",
            names: &["color.black_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nwhite_level = 1.5",
            names: &["color.white_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nblack_level = 0.5\nwhite_level = 0.4",
            names: &["color.white_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nflash_exposure = { seconds = 0.0, gain = 1.0 }",
            names: &["color.flash_exposure.seconds"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nambient_exposure = { seconds = 0.1, gain = 1.0 }",
            names: &["color.ambient_exposure", "both"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nflash_exposure = { seconds = 0.1, iso = 100 }",
            names: &["iso"],
        },
        Case {
            from: "\"none\"",
            to: "\"fisheye\"",
            names: &["fisheye"],
        },
        Case {
            from: "\"none\"",
            to: "\"none\", k1 = 0.1",
            names: &["k1"],
        },
        Case {
            from: "k6 = 0.0, ",
            to: "",
            names: &["k6"],
        },
        Case {
            from: "k1 = 0.1",
            to: "k1 = nan",
            names: &["depth.distortion", "finite"],
        },
        Case {
            from: "0.001",
            to: "0.0",
            names: &["depth.depth_unit_metres"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[1.01,0,0]",
            names: &["depth.rotation", "orthonormal"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[-1,0,0]",
            names: &["depth.rotation", "determinant"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[nan,0,0]",
            names: &["depth.rotation", "finite"],
        },
        Case {
            from: "[[1,0,0],",
            to: "[",
            names: &["rotation"],
        },
        Case {
            from: "[0.01, 0.0, 0.0]",
            to: "[0.01, inf, 0.0]",
            names: &["depth.translation_metres"],
        },
        Case {
            from: "[0.02, 0.0, 0.0]",
            to: "[0.02, nan, 0.0]",
            names: &["flash.position_metres"],
        },
        Case {
            from: "9.5",
            to: "0.0",
            names: &["flash.intensity"],
        },
        Case {
            from: "9.5",
            to: "\"bright\"",
            names: &["intensity"],
        },
        Case {
            from: "format = 1",
            to: "format = = 1",
            names: &["line 1"],
        },
    ];
    for case in cases {
        let dir = good();
        assert!(
            TOML.contains(case.from),
            "the case {:?} changes nothing",
            case.from
        );
        let text = TOML.replacen(case.from, case.to, 1);
        std::fs::write(dir.path().join("capture.toml"), text).unwrap();
        let message = folder::read(dir.path()).expect_err(case.to).to_string();
        for name in case.names {
            assert!(
                message.contains(name),
                "{:?}: {message:?} does not name {name:?}",
                case.to
            );
        }
        let names_a_file = message.contains("capture.toml") || message.contains(".png");
        assert!(
            names_a_file && message.contains(';'),
            "{message:?} names no file or remedy"
        );
    }
}

#[test]
fn every_mistake_in_lights_toml_names_file_field_and_remedy() {
    let cases = [
        Case {
            from: "\"unknown\"",
            to: "\"maybe\"",
            names: &["scale", "maybe"],
        },
        Case {
            from: "scale",
            to: "scales",
            names: &["scales"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[0.0, 0.0, 0.0]",
            names: &["light[0].direction"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[nan, 0.0, 1.0]",
            names: &["light[0].direction"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[0.0, 1.0]",
            names: &["direction"],
        },
        Case {
            from: "[2.0, 1.0, 0.5]",
            to: "[2.0, 0.0, 0.5]",
            names: &["light[0].intensity"],
        },
        Case {
            from: "relit_000.png",
            to: "relit_001.png",
            names: &["relit_001.png", "light[0].image"],
        },
        Case {
            from: "relit_000.png",
            to: "../flash.png",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "relit_000.png",
            to: "/etc/passwd",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "relit_000.png",
            to: "..",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "shadow_000.png",
            to: "",
            names: &["light[0].shadow"],
        },
        Case {
            from: "shadow =",
            to: "shade =",
            names: &["shade"],
        },
    ];
    for case in cases {
        let dir = good();
        assert!(
            LIGHTS.contains(case.from),
            "the case {:?} changes nothing",
            case.from
        );
        let text = LIGHTS.replacen(case.from, case.to, 1);
        std::fs::write(dir.path().join("truth/lights.toml"), text).unwrap();
        let message = folder::read(dir.path()).expect_err(case.to).to_string();
        for name in case.names.iter().chain(&["lights.toml", ";"]) {
            assert!(
                message.contains(name),
                "{:?}: {message:?} does not name {name:?}",
                case.to
            );
        }
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

/// One small valid file of every kind and layout.
fn valid_images() -> Vec<(&'static str, Vec<u8>)> {
    let color = Plane::from_fn(20, 17, |x, y| [x as f32 / 7.0, y as f32, 0.5]);
    let small: Vec<u8> = (0..20 * 17 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut jpeg)
        .encode(&small, 20, 17, image::ExtendedColorType::Rgb8)
        .unwrap();
    let pixels: Vec<image::Rgb<f32>> = color.samples().iter().map(|rgb| image::Rgb(*rgb)).collect();
    let mut hdr = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut hdr)
        .encode(&pixels, 20, 17)
        .unwrap();
    vec![
        ("color8.png", color8(20, 17)),
        ("gray16.png", gray16(20, 17, 999)),
        ("picture.jpg", jpeg),
        ("half.exr", exr::rgb(&color, Precision::Half).unwrap()),
        ("float.exr", exr::rgb(&color, Precision::Float).unwrap()),
        ("sky.hdr", hdr),
    ]
}

fn decode(bytes: &[u8], expected: Option<(usize, usize)>) -> Result<folder::Decoded, ImageError> {
    folder::decode::decode_bytes_limited(Path::new("image"), bytes, expected, Limits::default())
}

#[test]
fn every_truncation_of_every_kind_of_image_is_refused() {
    for (name, bytes) in valid_images() {
        decode(&bytes, Some((20, 17))).unwrap_or_else(|error| panic!("{name}: {error}"));
        // The last bytes of a PNG (IEND) and a JPEG (end marker) carry no pixels.
        let whole = bytes.len() - 16;
        for length in (0..whole).step_by(1 + whole / 150) {
            let error = decode(&bytes[..length], Some((20, 17)))
                .expect_err(&format!("{name} cut to {length} of {}", bytes.len()));
            assert!(error.to_string().starts_with("image: "), "{error}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn mutated_images_never_panic_and_never_come_out_in_another_size(
        which in 0_usize..6,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        thread_local! {
            static IMAGES: Vec<(&'static str, Vec<u8>)> = valid_images();
        }
        let mut bytes = IMAGES.with(|images| images[which].1.clone());
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok(decoded) = decode(&bytes, Some((20, 17))) {
            prop_assert_eq!(decoded.samples.size(), (20, 17));
        }
    }

    #[test]
    fn arbitrary_bytes_after_a_known_beginning_never_panic(
        kind in 0_usize..6, rest in prop::collection::vec(any::<u8>(), 0..400),
    ) {
        let starts: [&[u8]; 6] = [
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"\xff\xd8\xff\xe0", b"\x76\x2f\x31\x01\x02\0\0\0",
            b"#?RADIANCE\n\n-Y 4 +X 9\n", b"#?RGBE\n", b"",
        ];
        let bytes = [starts[kind], &rest].concat();
        let _ = decode(&bytes, None);
    }
}

/// Changes the size a valid file claims.
fn claim(name: &str, bytes: &mut Vec<u8>, width: u32, height: u32) {
    match name.rsplit('.').next() {
        Some("png") => {
            bytes[16..20].copy_from_slice(&width.to_be_bytes());
            bytes[20..24].copy_from_slice(&height.to_be_bytes());
            let mut crc = 0xffff_ffff_u32;
            for byte in &bytes[12..29] {
                crc ^= u32::from(*byte);
                for _ in 0..8 {
                    crc = if crc & 1 == 1 {
                        crc >> 1 ^ 0xedb8_8320
                    } else {
                        crc >> 1
                    };
                }
            }
            bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
        }
        Some("jpg") => {
            let at = bytes
                .windows(2)
                .position(|pair| pair == [0xff, 0xc0])
                .unwrap()
                + 5;
            bytes[at..at + 2].copy_from_slice(&(height as u16).to_be_bytes());
            bytes[at + 2..at + 4].copy_from_slice(&(width as u16).to_be_bytes());
        }
        Some("exr") => {
            for window in ["dataWindow", "displayWindow"] {
                let end = [window.as_bytes(), b"\0box2i\0\x10\0\0\0"].concat();
                let at = bytes
                    .windows(end.len())
                    .position(|part| part == end)
                    .unwrap();
                let at = at + end.len() + 8;
                bytes[at..at + 4].copy_from_slice(&(width - 1).to_le_bytes());
                bytes[at + 4..at + 8].copy_from_slice(&(height - 1).to_le_bytes());
            }
        }
        _ => {
            let at = bytes.windows(3).position(|part| part == b"-Y ").unwrap();
            let line_end = at + bytes[at..].iter().position(|byte| *byte == b'\n').unwrap();
            let text = format!("-Y {height} +X {width}");
            bytes.splice(at..line_end, text.into_bytes());
        }
    }
}

#[test]
fn a_small_file_that_claims_a_huge_picture_is_refused_by_its_header() {
    for (name, bytes) in valid_images() {
        let mut declared = bytes.clone();
        claim(name, &mut declared, 16_000, 4_000);
        let error = decode(&declared, Some((20, 17))).expect_err(name);
        // An EXR also counts its blocks in the header, and contradicts itself there already.
        let by_count = name.ends_with(".exr") && error.to_string().contains("chunk count");
        let by_size = matches!(
            error,
            ImageError::Size {
                found: (16_000, 4_000),
                ..
            }
        );
        assert!(by_size || by_count, "{name}: {error}");

        for (width, height) in [(60_000, 60_000), (16_384, 16_384), (65_000, 2)] {
            let mut huge = bytes.clone();
            claim(name, &mut huge, width, height);
            let error = decode(&huge, None).expect_err(name);
            let by_header = matches!(error, ImageError::TooLarge { .. })
                // Some decoders refuse such sides themselves, also by the header.
                || matches!(error, ImageError::Malformed { .. });
            assert!(by_header, "{name}: {error}");
        }
    }
}

/// Bytes this process holds, from the kernel.
fn resident_bytes() -> usize {
    let statm = std::fs::read_to_string("/proc/self/statm").unwrap();
    statm
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<usize>()
        .unwrap()
        * 4096
}

#[test]
fn twenty_decompression_bombs_take_under_64_mib_each() {
    // Each claims half a gigabyte of pixels where 8×6 were declared.
    let dir = tempfile::tempdir().unwrap();
    let path: PathBuf = dir.path().join("bomb.png");
    let rows = |width: u32, height: u32, interlaced: bool| {
        let mut bytes = Vec::new();
        let mut info = ::png::Info::with_size(width, height);
        info.color_type = ::png::ColorType::Rgba;
        info.bit_depth = ::png::BitDepth::Sixteen;
        info.interlaced = interlaced;
        let encoder = ::png::Encoder::with_info(&mut bytes, info).unwrap();
        drop(encoder.write_header().unwrap());
        bytes
    };
    let before = resident_bytes();
    for round in 0..20 {
        let side = 8_000 - round * 10;
        std::fs::write(&path, rows(side, side, round % 2 == 0)).unwrap();
        assert!(decode_limited(&path, Some((8, 6)), Limits::default()).is_err());
        let grown = resident_bytes().saturating_sub(before);
        assert!(grown < 64 << 20, "bomb {round} took {grown} bytes");
    }
    // Metadata can be a bomb as well: a compressed colour profile of 200 MB of zeros.
    let mut bomb = color8(8, 6);
    let profile = [b"p\0\0".as_slice(), &deflated_zeros(200 << 20)].concat();
    let mut chunk = b"iCCP".to_vec();
    chunk.extend(&profile);
    let mut crc = 0xffff_ffff_u32;
    for byte in &chunk {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 {
                crc >> 1 ^ 0xedb8_8320
            } else {
                crc >> 1
            };
        }
    }
    let mut whole = (profile.len() as u32).to_be_bytes().to_vec();
    whole.extend(chunk);
    whole.extend((!crc).to_be_bytes());
    bomb.splice(33..33, whole);
    let before = resident_bytes();
    let _ = decode(&bomb, Some((8, 6)));
    let grown = resident_bytes().saturating_sub(before);
    assert!(grown < 64 << 20, "the profile took {grown} bytes");
}

/// A zlib stream of `count` zeros, made of fixed-Huffman runs (RFC 1951): 258 zeros in 13 bits.
fn deflated_zeros(count: usize) -> Vec<u8> {
    let mut bits: Vec<bool> = vec![true, true, false]; // last block, fixed codes
    let code = |bits: &mut Vec<bool>, value: u32, length: u32| {
        bits.extend((0..length).rev().map(|at| value >> at & 1 == 1));
    };
    code(&mut bits, 0x30, 8); // literal 0
    for _ in 0..count / 258 {
        code(&mut bits, 0b1100_0101, 8); // length 258
        code(&mut bits, 0, 5); // distance 1
    }
    code(&mut bits, 0, 7); // end of block
    let mut bytes = vec![0x78, 0x01];
    bytes.extend(bits.chunks(8).map(|byte| {
        byte.iter()
            .enumerate()
            .fold(0_u8, |all, (at, set)| all | u8::from(*set) << at)
    }));
    bytes.extend([0; 4]);
    bytes
}
