//! Registration against what two vendors' own engines made of the same frames.
//!
//! Needs the development captures (`CAPTURED_DATA`, else `../shared/data`); skips without them.
//! With `CAPTURED_PICTURES` naming a folder, the results are written there as 16-bit PNG in
//! millimetres, to be looked at.

#![expect(
    clippy::print_stdout,
    reason = "a skipped capture and the figures are told to whoever runs it"
)]

use captured::{
    folder,
    radiometry::linearise,
    registration::{RegisteredDepth, RigMaps, register},
};
use glam::DVec2;
use std::path::{Path, PathBuf};

fn capture(name: &str) -> Option<PathBuf> {
    let data = std::env::var_os("CAPTURED_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let folder = data.join(name);
    if folder.join("capture.toml").is_file() {
        return Some(folder);
    }
    println!("skipped: no {name} among the development captures; set CAPTURED_DATA");
    None
}

fn registered(folder: &Path) -> RegisteredDepth {
    let shot = folder::read(folder).unwrap().shot;
    let maps = RigMaps::new(&shot.rig).unwrap();
    let guide = linearise(&shot.flash).unwrap();
    let registered = register(&shot.depth, &maps, Some(&guide)).unwrap();
    if let Some(pictures) = std::env::var_os("CAPTURED_PICTURES") {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let write = |what: &str, metre: &dyn Fn(usize) -> f32| {
            let (width, height) = registered.metres.size();
            let millimetres: Vec<u16> = (0..width * height)
                .map(|i| (metre(i) * 1e3).round() as u16)
                .collect();
            let picture: image::ImageBuffer<image::Luma<u16>, _> =
                image::ImageBuffer::from_raw(width as u32, height as u32, millimetres).unwrap();
            picture
                .save(Path::new(&pictures).join(format!("{name}_{what}.png")))
                .unwrap();
        };
        let measured = registered.measured.samples();
        let metres = registered.metres.samples();
        write("all", &|i| metres[i]);
        write("measured", &|i| if measured[i] { metres[i] } else { 0.0 });
        write("sigma", &|i| 100.0 * registered.sigma_metres.samples()[i]);
    }
    registered
}

/// The vendor's answer in metres, row by row; NaN = none.
fn vendor(folder: &Path) -> (Vec<f32>, usize, usize) {
    let picture = image::open(folder.join("truth/registered_depth.png"))
        .unwrap()
        .into_luma16();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let metres = picture.into_raw().into_iter().map(|mm| match mm {
        0 => f32::NAN,
        mm => f32::from(mm) * 1e-3,
    });
    (metres.collect(), width, height)
}

/// The same points with their distance along the depth camera's axis: `rs.align` moves samples to
/// the color grid but leaves their values as they were (librealsense `align.cpp`).
fn in_depth_axes(ours: &RegisteredDepth, folder: &Path) -> RegisteredDepth {
    let rig = folder::read(folder).unwrap().shot.rig;
    let to_color = rig.depth.unwrap().to_color;
    let mut turned = ours.clone();
    for y in 0..rig.color.height {
        for x in 0..rig.color.width {
            let ray = rig.color.ray(DVec2::new(x as f64, y as f64)).unwrap();
            let point = ray * f64::from(ours.metres[(x, y)]) - to_color.translation_metres;
            turned.metres[(x, y)] = (to_color.rotation.transpose() * point).z as f32;
        }
    }
    turned
}

struct Agreement {
    median_mm: f32,
    p90_mm: f32,
    p95_mm: f32,
    /// Of the pixels the vendor answers, those we measured.
    coverage: f32,
    /// Of the pixels we measured within 3 pixels of a depth edge of the vendor's, those that
    /// differ by more than 3 cm from all the vendor's answers within 2 pixels: a second image of
    /// a rim, or a ramp between surfaces, would stand there.
    ghosts: f32,
    /// Of the pixels we filled and the vendor answers, the median difference.
    filled_median_mm: f32,
}

fn compare(
    ours: &RegisteredDepth,
    (vendor, width, height): &(Vec<f32>, usize, usize),
) -> Agreement {
    assert_eq!(ours.metres.size(), (*width, *height));
    let (metres, measured) = (ours.metres.samples(), ours.measured.samples());
    let answers = |x: usize, y: usize, reach: usize| {
        (y.saturating_sub(reach)..(y + reach + 1).min(*height)).flat_map(move |y| {
            (x.saturating_sub(reach)..(x + reach + 1).min(*width)).map(move |x| y * width + x)
        })
    };
    let (mut differences, mut filled, mut answered) = (Vec::new(), Vec::new(), 0);
    let (mut near_edge, mut ghosts) = (0, 0);
    for y in 0..*height {
        for x in 0..*width {
            let i = y * width + x;
            answered += usize::from(vendor[i].is_finite());
            let difference = (metres[i] - vendor[i]).abs() * 1e3;
            if difference.is_finite() {
                if measured[i] {
                    &mut differences
                } else {
                    &mut filled
                }
                .push(difference);
            }
            if measured[i] {
                let (low, high) = answers(x, y, 3).fold((f32::INFINITY, 0.0f32), |(l, h), i| {
                    (l.min(vendor[i]), h.max(vendor[i]))
                });
                if high - low > 0.05 {
                    near_edge += 1;
                    ghosts += usize::from(
                        answers(x, y, 2)
                            .filter(|&j| vendor[j].is_finite())
                            .all(|j| (vendor[j] - metres[i]).abs() > 0.03),
                    );
                }
            }
        }
    }
    let coverage = differences.len() as f32 / answered as f32;
    let quantile = |values: &mut Vec<f32>, q: f32| {
        let at = (q * (values.len().max(1) - 1) as f32) as usize;
        if values.is_empty() {
            f32::NAN
        } else {
            *values.select_nth_unstable_by(at, f32::total_cmp).1
        }
    };
    Agreement {
        median_mm: quantile(&mut differences, 0.5),
        p90_mm: quantile(&mut differences, 0.9),
        p95_mm: quantile(&mut differences, 0.95),
        coverage,
        ghosts: ghosts as f32 / near_edge.max(1) as f32,
        filled_median_mm: quantile(&mut filled, 0.5),
    }
}

fn print(name: &str, a: &Agreement, ours: &RegisteredDepth) {
    let share = |count: usize| count as f32 / ours.metres.len() as f32;
    println!(
        "{name:15} median {:.2} mm  p90 {:.2}  p95 {:.2}  coverage {:.4}  ghosts {:.4}  \
         filled where the vendor answers {:.2} mm  known {:.3}  measured {:.3}",
        a.median_mm,
        a.p90_mm,
        a.p95_mm,
        a.coverage,
        a.ghosts,
        a.filled_median_mm,
        share(
            ours.metres
                .samples()
                .iter()
                .filter(|z| z.is_finite())
                .count()
        ),
        share(ours.measured.samples().iter().filter(|m| **m).count()),
    );
}

#[test]
fn azure_kinect_frame_lands_where_the_vendors_engine_puts_it() {
    let Some(folder) = capture("azure_kinect") else {
        return;
    };
    let ours = registered(&folder);
    let agreement = compare(&ours, &vendor(&folder));
    print("azure_kinect", &agreement, &ours);
    // An independent script reached 0.43 mm and 2.7 mm; the vendor rounds to whole millimetres.
    assert!(agreement.median_mm <= 1.0);
    assert!(agreement.p95_mm <= 4.0);
    assert!(agreement.coverage >= 0.97);
    assert!(agreement.ghosts <= 0.01);
    assert!(ours.amplitude.is_some());
}

#[test]
fn realsense_frame_lands_where_the_vendors_engine_puts_it() {
    let Some(folder) = capture("realsense_d435") else {
        return;
    };
    let ours = registered(&folder);
    let truth = vendor(&folder);
    let turned = compare(&in_depth_axes(&ours, &folder), &truth);
    print("realsense_d435", &compare(&ours, &truth), &ours);
    print("  in depth axes", &turned, &ours);
    let agreement = turned;
    // An independent script reached 3 mm and 12 mm; the vendor paints blocks, not a surface.
    assert!(agreement.median_mm <= 3.0);
    assert!(agreement.p90_mm <= 12.0);
    assert!(agreement.coverage >= 0.95);
    assert!(agreement.ghosts <= 0.02);
}

#[test]
fn phone_frame_covers_the_photograph_sixteen_times_as_fine() {
    let Some(folder) = capture("honor_tof") else {
        return;
    };
    let ours = registered(&folder);
    let share = |count: usize| count as f32 / ours.metres.len() as f32;
    let measured = share(ours.measured.samples().iter().filter(|m| **m).count());
    let known = share(
        ours.metres
            .samples()
            .iter()
            .filter(|z| z.is_finite())
            .count(),
    );
    println!("honor_tof       measured {measured:.3}  known {known:.3}");
    // 86 % of its samples have an answer; a rim of one sample is lost along holes and edges.
    assert!(measured >= 0.75);
    assert!(known >= measured);
}
