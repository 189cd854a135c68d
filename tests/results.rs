//! Results: what is written reads back, and a folder appears whole or not at all.

use captured::{
    folder::{ImageKind, Limits, Samples, decode_limited},
    output::{
        self, CommitError, Disk, Existing, FileSystem, Manifest, NewFile, OutputError, Precision,
        RelitView, Results, Staging, Tone, sheet::Panel,
    },
    radiometry::LinearImage,
    scene::{Material, Scene},
};
use drivers::{Distortion, Intrinsics, Plane};
use glam::Vec3;
use proptest::prelude::*;
use std::{
    io::{self, Read},
    path::{Path, PathBuf},
    sync::atomic::{AtomicUsize, Ordering},
};

fn decode(bytes: &[u8], size: (usize, usize)) -> captured::folder::Decoded {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("image");
    std::fs::write(&path, bytes).unwrap();
    decode_limited(&path, Some(size), Limits::default()).unwrap()
}

fn same(a: f32, b: f32) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

fn scene(width: usize, height: usize, scale_known: bool) -> Scene {
    let plane = |value: f32| Plane::filled(width, height, value);
    let mut depth_metres = plane(1.5);
    depth_metres[(0, 0)] = f32::NAN;
    Scene {
        camera: Intrinsics {
            width,
            height,
            fx: 100.0,
            fy: 100.0,
            cx: 0.0,
            cy: 0.0,
            distortion: Distortion::None {},
        },
        depth_metres,
        depth_sigma_metres: plane(0.01),
        thickness_metres: plane(0.2),
        normal: Plane::filled(width, height, Vec3::new(0.0, -0.6, -0.8)),
        albedo: Plane::filled(width, height, [0.5, 0.25, 0.125]),
        roughness: plane(0.5),
        confidence: plane(1.0),
        scale_known,
        flash_lit: true,
        material: Material::Varying,
        shine: None,
    }
}

struct Made {
    scene: Scene,
    light: LinearImage,
    shadow: Plane<f32>,
}

impl Made {
    fn new(scale_known: bool) -> Self {
        let (width, height) = (37, 21);
        let light = Plane::from_fn(width, height, |x, y| {
            if (x, y) == (3, 4) {
                [f32::NAN; 3]
            } else {
                [x as f32 / 36.0, 0.25, 2.0]
            }
        });
        let shadow = Plane::from_fn(width, height, |x, _| if x < 10 { 0.0 } else { 1.0 });
        Self {
            scene: scene(width, height, scale_known),
            light: LinearImage(light),
            shadow,
        }
    }

    fn write(
        &self,
        dir: &Path,
        existing: Existing,
        disk: &dyn FileSystem,
    ) -> Result<Manifest, OutputError> {
        let relit = [
            RelitView {
                toward_person: [0.0, 0.0, 1.0],
                label: "0,0,1",
                relit: &self.light,
                shadow: &self.shadow,
            },
            RelitView {
                toward_person: [1.0, 0.0, 0.0],
                label: "1,0,0",
                relit: &self.light,
                shadow: &self.shadow,
            },
        ];
        let results = Results {
            source: "made up",
            photographs: &[Panel::light(
                "flash photograph",
                &self.light.0,
                &Tone::absolute(),
            )],
            flash_only: &self.light,
            scene: &self.scene,
            relit: &relit,
            timings_ms: &[("scene".into(), 12.3)],
            report: serde_json::json!({ "clipped_fraction": 0.1 }),
            warnings: &["The wall is a mirror.".into()],
            attachments: &[],
        };
        output::write(&results, dir, existing, disk)
    }
}

const NAMES: [&str; 12] = [
    "albedo.exr",
    "depth.exr",
    "normal.exr",
    "overview.png",
    "relit_000.exr",
    "relit_000.png",
    "relit_001.exr",
    "relit_001.png",
    "roughness.exr",
    "shadow_000.png",
    "shadow_001.png",
    "shot.json",
];

fn listed(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn full_float_exr_gives_every_number_back(
        width in 1_usize..70, height in 1_usize..70, seed in any::<u32>(),
    ) {
        let mut state = seed | 1;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f32::from_bits(state)
        };
        let samples = (0..width * height).map(|_| std::array::from_fn::<f32, 3, _>(|_| next()));
        let plane = Plane::new(width, height, samples.collect()).unwrap();
        let bytes = output::exr::rgb(&plane, Precision::Float).unwrap();
        let Samples::RgbF32(back) = decode(&bytes, (width, height)).samples else { panic!("not RGB") };
        let pairs = plane.samples().as_flattened().iter().zip(back.samples().as_flattened());
        for (wrote, read) in pairs {
            prop_assert!(same(*wrote, *read), "{wrote} became {read}");
        }
    }

    #[test]
    fn half_float_exr_is_exact_to_one_part_in_2048(values in prop::collection::vec(1e-4_f32..60_000.0, 1..60)) {
        let plane = Plane::new(values.len(), 1, values.clone()).unwrap();
        let bytes = output::exr::gray(&plane, Precision::Half).unwrap();
        let Samples::GrayF32(back) = decode(&bytes, plane.size()).samples else { panic!("not gray") };
        for (wrote, read) in values.iter().zip(back.samples()) {
            prop_assert!((wrote - read).abs() <= wrote / 2048.0, "{wrote} became {read}");
        }
    }
}

#[test]
fn pictures_are_srgb_with_unknown_light_transparent() {
    // Codes by IEC 61966-2-1 from an independent table: light 0.5 → 188, 0.18 → 118, 0.002 → 7.
    let light = LinearImage(
        Plane::new(
            3,
            1,
            vec![[0.5, 0.18, 0.002], [f32::NAN; 3], [7.0, -1.0, 1.0]],
        )
        .unwrap(),
    );
    let bytes = output::png::picture(&light, &Tone::absolute()).unwrap();
    let image = image::load_from_memory(&bytes).unwrap().to_rgba8();
    assert_eq!(image.get_pixel(0, 0).0, [188, 118, 7, 255]);
    assert_eq!(image.get_pixel(1, 0).0, [0, 0, 0, 0]);
    assert_eq!(image.get_pixel(2, 0).0, [255, 0, 255, 255]);
}

#[test]
fn robust_white_ignores_the_brightest_hundredth_and_what_is_unknown() {
    let mut plane = Plane::filled(100, 100, [0.2_f32, 0.1, 0.1]);
    for x in 0..50 {
        plane[(x, 0)] = [900.0; 3];
        plane[(x, 1)] = [f32::NAN; 3];
    }
    assert_eq!(Tone::robust([&plane]).white(), 0.2);
    assert_eq!(
        Tone::robust([&Plane::filled(4, 4, [f32::NAN; 3])]).white(),
        1.0
    );
    assert_eq!(
        Tone::robust([&Plane::filled(4, 4, [-1.0_f32; 3])]).white(),
        1.0
    );
}

#[test]
fn results_hold_exactly_the_promised_files_and_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("results");
    let made = Made::new(true);
    let wrote = made.write(&out, Existing::Refuse, &Disk).unwrap();
    assert_eq!(listed(&out), NAMES);
    assert_eq!(listed(dir.path()), ["results"], "no partial folder is left");
    let read = Manifest::verify(&out).unwrap();
    assert_eq!(read.blake3, wrote.blake3);
    assert_eq!(read.lights[1].relit_exr, "relit_001.exr");
    assert_eq!(read.warnings, ["The wall is a mirror."]);

    let decode =
        |name: &str| decode_limited(&out.join(name), Some((37, 21)), Limits::default()).unwrap();
    let Samples::RgbF32(relit) = decode("relit_000.exr").samples else {
        panic!("relit is not RGB")
    };
    assert!(relit[(3, 4)][0].is_nan());
    assert_eq!(relit[(36, 0)], [1.0, 0.25, 2.0]);
    let Samples::RgbF32(normal) = decode("normal.exr").samples else {
        panic!("normal is not RGB")
    };
    for (found, expected) in normal[(5, 5)].iter().zip([0.0, 0.6, 0.8]) {
        assert!(
            (found - expected).abs() < 1e-3,
            "x right, y up, z toward the camera"
        );
    }
    let Samples::GrayF32(depth) = decode("depth.exr").samples else {
        panic!("depth is not gray")
    };
    assert!(depth[(0, 0)].is_nan() && depth[(1, 0)] == 1.5);
    let shadow = decode("shadow_000.png");
    assert_eq!(shadow.kind, ImageKind::Png);
    let Samples::Gray8(shadow) = shadow.samples else {
        panic!("shadow is not gray")
    };
    assert_eq!((shadow[(0, 0)], shadow[(20, 0)]), (0, 255));
}

#[test]
fn a_smaller_working_grid_is_stretched_to_the_photographs() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("results");
    let mut made = Made::new(true);
    made.scene = scene(18, 10, true);
    made.write(&out, Existing::Refuse, &Disk).unwrap();
    for name in ["albedo.exr", "normal.exr", "roughness.exr", "depth.exr"] {
        decode_limited(&out.join(name), Some((37, 21)), Limits::default()).unwrap();
    }
    let depth = decode_limited(&out.join("depth.exr"), None, Limits::default()).unwrap();
    let Samples::GrayF32(depth) = depth.samples else {
        panic!("depth is not gray")
    };
    assert!(
        depth
            .samples()
            .iter()
            .all(|metres| metres.is_nan() || *metres == 1.5)
    );
    assert!(depth[(0, 0)].is_nan());
}

#[test]
fn an_unknown_scale_is_said_in_plain_words() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = Made::new(false)
        .write(&dir.path().join("out"), Existing::Refuse, &Disk)
        .unwrap();
    assert!(!manifest.scale_known);
    assert!(
        manifest
            .warnings
            .iter()
            .any(|warning| warning.contains("one global scale"))
    );
}

#[test]
fn a_changed_byte_or_a_missing_file_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("results");
    Made::new(true)
        .write(&out, Existing::Refuse, &Disk)
        .unwrap();
    for name in NAMES {
        let path = out.join(name);
        let bytes = std::fs::read(&path).unwrap();
        let mut changed = bytes.clone();
        let middle = changed.len() / 2;
        changed[middle] ^= 1;
        std::fs::write(&path, &changed).unwrap();
        assert!(Manifest::verify(&out).is_err(), "{name} changed");
        std::fs::remove_file(&path).unwrap();
        assert!(Manifest::verify(&out).is_err(), "{name} missing");
        std::fs::write(&path, &bytes).unwrap();
    }
    Manifest::verify(&out).unwrap();
}

#[test]
fn a_folder_in_the_way_is_kept_unless_it_is_empty_or_forced_and_ours() {
    let dir = tempfile::tempdir().unwrap();
    let made = Made::new(true);
    let out = dir.path().join("empty");
    std::fs::create_dir(&out).unwrap();
    made.write(&out, Existing::Refuse, &Disk).unwrap();
    Manifest::verify(&out).unwrap();

    let refused = made.write(&out, Existing::Refuse, &Disk).unwrap_err();
    assert!(
        matches!(refused, OutputError::Commit(CommitError::Exists { .. })),
        "{refused}"
    );
    assert!(refused.to_string().contains("empty") && refused.to_string().contains("--force"));

    std::fs::write(out.join("relit_999.png"), "stale").unwrap();
    made.write(&out, Existing::Replace, &Disk).unwrap();
    assert_eq!(listed(&out), NAMES, "replaced whole, nothing stale is left");

    std::fs::write(out.join("thesis.tex"), "years of work").unwrap();
    let refused = made.write(&out, Existing::Replace, &Disk).unwrap_err();
    assert!(refused.to_string().contains("thesis.tex"), "{refused}");
    assert!(out.join("thesis.tex").exists());
    assert_eq!(listed(dir.path()), ["empty"]);
}

#[test]
fn a_place_that_cannot_be_written_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    std::fs::write(&file, "").unwrap();
    let made = Made::new(true);
    for out in [
        file.join("inside"),
        file.clone(),
        dir.path().join("no/such/parent"),
        PathBuf::from("/"),
    ] {
        let error = made
            .write(&out, Existing::Replace, &Disk)
            .unwrap_err()
            .to_string();
        assert!(error.contains(&*out.to_string_lossy()), "{error}");
    }
    assert_eq!(listed(dir.path()), ["file"]);
}

/// The real disk until `calls` is used up; then every write fails as a full disk does.
struct FullAfter {
    calls: AtomicUsize,
}

impl FullAfter {
    fn step(&self) -> io::Result<()> {
        match self.calls.load(Ordering::Relaxed).checked_sub(1) {
            Some(left) => {
                self.calls.store(left, Ordering::Relaxed);
                Ok(())
            }
            None => Err(io::Error::from_raw_os_error(28)),
        }
    }
}

impl FileSystem for FullAfter {
    fn create_dir(&self, dir: &Path) -> io::Result<()> {
        self.step()?;
        Disk.create_dir(dir)
    }
    fn create_file<'a>(&'a self, file: &Path) -> io::Result<Box<dyn NewFile + 'a>> {
        Disk.create_file(file)
    }
    fn open<'a>(&'a self, file: &Path) -> io::Result<(u64, Box<dyn Read + 'a>)> {
        Disk.open(file)
    }
    fn sync_file(&self, file: &Path) -> io::Result<()> {
        Disk.sync_file(file)
    }
    fn remove_file(&self, file: &Path) -> io::Result<()> {
        Disk.remove_file(file)
    }
    fn free_bytes(&self, dir: &Path) -> io::Result<u64> {
        Disk.free_bytes(dir)
    }
    fn write_new(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        if let Err(full) = self.step() {
            // A full disk takes part of the file before it says so.
            Disk.write_new(file, &bytes[..bytes.len() / 2])?;
            return Err(full);
        }
        Disk.write_new(file, bytes)
    }
    fn sync_dir(&self, dir: &Path) -> io::Result<()> {
        self.step()?;
        Disk.sync_dir(dir)
    }
    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step()?;
        Disk.rename_new(from, to)
    }
    fn rename_over_empty(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step()?;
        Disk.rename_over_empty(from, to)
    }
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        self.step()?;
        Disk.exchange(one, other)
    }
    fn remove(&self, dir: &Path) -> io::Result<()> {
        Disk.remove(dir)
    }
    fn list(&self, dir: &Path) -> io::Result<Option<Vec<String>>> {
        Disk.list(dir)
    }
}

#[test]
fn a_disk_that_fills_up_at_any_step_leaves_nothing_half_written() {
    let made = Made::new(true);
    let mut failures = 0;
    for calls in 0.. {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("results");
        let disk = FullAfter {
            calls: AtomicUsize::new(calls),
        };
        match made.write(&out, Existing::Refuse, &disk) {
            Ok(_) => break,
            Err(error) => {
                failures += 1;
                assert!(error.to_string().contains("results"), "{error}");
                assert!(error.to_string().contains("os error 28"), "{error}");
            }
        }
        // Only the last step, syncing the parent, comes after the folder has its name.
        if out.exists() {
            Manifest::verify(&out).unwrap();
        }
        assert!(
            listed(dir.path()).iter().all(|name| name == "results"),
            "partial left at {calls}"
        );
    }
    assert_eq!(
        failures,
        1 + NAMES.len() + 3,
        "every step was made to fail once"
    );
}

#[test]
fn a_replaced_folder_is_old_or_new_at_every_failing_step() {
    let made = Made::new(true);
    for calls in 0.. {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("results");
        made.write(&out, Existing::Refuse, &Disk).unwrap();
        let disk = FullAfter {
            calls: AtomicUsize::new(calls),
        };
        let done = made.write(&out, Existing::Replace, &disk).is_ok();
        Manifest::verify(&out).unwrap();
        assert_eq!(listed(dir.path()), ["results"]);
        if done {
            break;
        }
    }
}

#[test]
fn a_name_taken_while_writing_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("results");
    let mut staging = Staging::begin(&Disk, &out, Existing::Refuse, |_| true).unwrap();
    staging.put("shot.json", b"{}").unwrap();
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("theirs"), "").unwrap();
    assert!(matches!(staging.commit(), Err(CommitError::Exists { .. })));
    assert_eq!(listed(&out), ["theirs"]);
    assert_eq!(listed(dir.path()), ["results"]);
}
