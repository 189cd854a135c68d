//! `calibrate rig`: a rig from shots of a printed board.

use super::super::{Answer, CommandError, input, progress::Progress};
use crate::{
    calibration::{Board, Calibration, FEWEST_VIEWS, LensFit, calibrate},
    config::Config,
    folder::RigFile,
    output::StagedFile,
};
use clap::Args;
use std::path::PathBuf;

/// Arguments of `calibrate rig`.
#[derive(Debug, Args)]
pub struct Rig {
    /// Shots of the board, one pose each: capture folders, recordings or kept shots. Ten or more, near
    /// and far, tilted up to 45° each way, in every part of the picture.
    #[arg(value_name = "SHOT", required = true, num_args = 1..=200)]
    shots: Vec<PathBuf>,
    /// Squares of the board across and down; config/board.png has 9x6.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "9x6", value_parser = squares)]
    squares: (usize, usize),
    /// Side of a square as printed, measured with a ruler.
    #[arg(long, value_name = "METRES")]
    square: f64,
    /// Side of a tag, its black border included [default: three quarters of a square].
    #[arg(long, value_name = "METRES")]
    tag: Option<f64>,
    /// Share of light that the white paper reflects.
    #[arg(long, value_name = "ALBEDO", default_value_t = 0.88)]
    paper: f64,
    /// The file to write; `rig = "FILE"` in captured.toml makes it count.
    #[arg(long, value_name = "FILE", default_value = "rig.toml")]
    out: PathBuf,
}

fn squares(text: &str) -> Result<(usize, usize), String> {
    text.split_once(['x', '×'])
        .and_then(|(columns, rows)| Some((columns.parse().ok()?, rows.parse().ok()?)))
        .ok_or_else(|| "two whole numbers, such as 9x6".to_owned())
}

impl Rig {
    pub(super) fn run(self, config: &Config) -> Result<Answer, CommandError> {
        if !(0.2..=1.0).contains(&self.paper) {
            return Err(CommandError::Arguments(format!(
                "--paper {} is no albedo of white paper; give 0.2 to 1, 0.88 for office paper",
                self.paper
            )));
        }
        if self.shots.len() < FEWEST_VIEWS {
            return Err(CommandError::Arguments(format!(
                "{} shots are too few; give {FEWEST_VIEWS} at least, better ten or more",
                self.shots.len()
            )));
        }
        let tag = self.tag.unwrap_or(0.75 * self.square);
        let board = Board::new(self.squares, self.square, tag)?;
        let progress = Progress::of(self.shots.len() + 1, "reading");
        let mut shots = Vec::with_capacity(self.shots.len());
        for path in &self.shots {
            shots.push(input::read(path, config)?.capture.shot);
            progress.step();
        }
        progress.doing("fitting");
        let found = calibrate(&shots, &board, self.paper)?;
        drop(progress);
        let frame = &shots[0].flash;
        let offset = found
            .depth
            .as_ref()
            .map_or(0.0, |depth| depth.range.offset_metres);
        let file = RigFile {
            rig: found.rig,
            depth_offset_metres: offset,
            transfer: frame.transfer.clone(),
            black_level: frame.black_level,
            white_level: frame.white_level,
        };
        StagedFile::write(&self.out, file.text(&self.out)?.as_bytes())?;
        let mut lines = vec![format!(
            "{}: from {} shots",
            self.out.display(),
            shots.len()
        )];
        lines.extend(in_words(&found));
        let worst = worst(&found.color, &self.shots);
        let json = serde_json::json!({
            "out": self.out, "shots": self.shots, "calibration": found, "worst_shot": worst,
        });
        Ok(Answer::new(lines.join("\n"), &json).with_warnings(found.warnings))
    }
}

/// The shot that fits worst.
fn worst<'a>(fit: &LensFit, shots: &'a [PathBuf]) -> Option<&'a PathBuf> {
    let known = fit.rms_by_view.iter().zip(shots);
    let by_error = known.filter_map(|(rms, shot)| Some(((*rms)?, shot)));
    by_error
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, shot)| shot)
}

fn in_words(found: &Calibration) -> Vec<String> {
    let lens = |name: &str, lens: &drivers::Intrinsics, fit: &LensFit| {
        let [fx, fy, cx, cy] = fit.errors_pixels;
        format!(
            "  {name}: reprojection error {:.3} pixels over {} corners ({} left out); fx {:.2} ±{fx:.2}, \
             fy {:.2} ±{fy:.2}, cx {:.2} ±{cx:.2}, cy {:.2} ±{cy:.2}; {:.0} % of the picture covered",
            fit.rms_pixels,
            fit.corners,
            fit.outliers,
            lens.fx,
            lens.fy,
            lens.cx,
            lens.cy,
            100.0 * fit.coverage
        )
    };
    let mut lines = vec![lens("color", &found.rig.color, &found.color)];
    if let Some((camera, fit)) = found.rig.depth.as_ref().zip(found.depth.as_ref()) {
        lines.push(lens("depth", &camera.lens, &fit.lens));
        let place = 1e3 * camera.to_color.translation_metres;
        lines.push(format!(
            "  depth camera at {:.1}, {:.1}, {:.1} mm (±{:.1}) in the color camera's axes",
            place.x,
            place.y,
            place.z,
            1e3 * fit.translation_error_metres
        ));
        let range = &fit.range;
        lines.push(format!(
            "  distances are {:+.1} mm off (half of {} boards within ±{:.1} mm)",
            1e3 * range.offset_metres,
            range.views,
            1e3 * range.scatter_metres
        ));
    }
    if let Some(fit) = &found.flash {
        let flash = &found.rig.flash;
        let place = 1e3 * flash.position_metres;
        lines.push(format!(
            "  flash at {:.1}, {:.1}, {:.1} mm (±{:.1}), intensity {:.4}, tilt {:+.3} {:+.3}, falloff \
             {:+.3}; light is met to {:.1} % at {} places on paper ({} left out)",
            place.x,
            place.y,
            place.z,
            1e3 * fit.position_error_metres,
            flash.intensity.unwrap_or(f32::NAN),
            flash.beam.tilt[0],
            flash.beam.tilt[1],
            flash.beam.falloff,
            100.0 * fit.rms_fraction,
            fit.samples,
            fit.outliers
        ));
    }
    lines
}
