//! Image files that are cut, changed or lie about their size.

use super::{color8, gray16};
use captured::{
    folder::{self, ImageError, Limits, decode_limited},
    output::{Precision, exr},
};
use drivers::Plane;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

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

/// By how much the memory of this process grew at most while something was done, from the kernel.
fn most_bytes(act: impl FnOnce()) -> usize {
    let held = |name: &str| -> usize {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kibibytes = line.unwrap().trim().trim_end_matches(" kB");
        kibibytes.parse::<usize>().unwrap() << 10
    };
    // The high water mark is as high as the water now; where that is refused, it is higher.
    drop(std::fs::write("/proc/self/clear_refs", "5"));
    let before = held("VmRSS:");
    act();
    held("VmHWM:").saturating_sub(before)
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
    let mut most = 0;
    for round in 0..20 {
        let side = 8_000 - round * 10;
        std::fs::write(&path, rows(side, side, round % 2 == 0)).unwrap();
        let grown = most_bytes(|| {
            assert!(decode_limited(&path, Some((8, 6)), Limits::default()).is_err());
        });
        assert!(grown < 64 << 20, "bomb {round} took {grown} bytes");
        most = most.max(grown);
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
    let grown = most_bytes(|| drop(decode(&bomb, Some((8, 6)))));
    assert!(grown < 64 << 20, "the profile took {grown} bytes");
    most = most.max(grown);
    eprintln!(
        "figure | 21 decompression bombs, peak of memory | at most {:.1} MiB each",
        most as f64 / f64::from(1 << 20)
    );
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
