//! A film of one size and pace: animated WebP, or animated PNG without loss.

use super::{
    commit::CommitError,
    file_system::{Disk, FileSystem},
    staged_file::StagedFile,
};
use drivers::Plane;
use std::{
    fs::File,
    io::{self, BufWriter},
    path::{Path, PathBuf},
    str::FromStr,
};
use thiserror::Error;
use webp_animation::{Encoder, EncoderOptions, EncodingConfig};

/// Most frames of a film.
pub const MOST_FRAMES: usize = 3600;
/// The longest edge that WebP can have, pixels.
const LONGEST_EDGE: usize = 16_383;
/// Of 100; at 90 and more losses are hard to see.
const WEBP_QUALITY: f32 = 92.0;

/// What a film is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilmFormat {
    /// Animated WebP (RFC 9649), lossy.
    WebP,
    /// Animated PNG (PNG, third edition), without loss, some ten times as large.
    Apng,
}

impl FromStr for FilmFormat {
    type Err = String;

    /// By a file name's extension.
    fn from_str(extension: &str) -> Result<Self, String> {
        match extension.to_ascii_lowercase().as_str() {
            "webp" => Ok(Self::WebP),
            "png" | "apng" => Ok(Self::Apng),
            _ => Err("it must end in .webp, .apng or .png".to_owned()),
        }
    }
}

/// Why there is no film; nothing is left behind.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum FilmError {
    #[error(transparent)]
    Commit(#[from] CommitError),
    #[error("{path}: {frames} frames; a film has 1 to {MOST_FRAMES}, so make it shorter or slower")]
    Frames { path: PathBuf, frames: usize },
    #[error(
        "{path}: frames of {width}×{height} pixels; a film has 1 to {LONGEST_EDGE} either way, so make it narrower"
    )]
    Size {
        path: PathBuf,
        width: usize,
        height: usize,
    },
    #[error("{path}: frame {frame} cannot be encoded: {problem}")]
    Frame {
        path: PathBuf,
        frame: usize,
        problem: String,
    },
}

/// A film of so many frames, on its way to a file that appears when it is whole.
pub struct Film {
    staged: StagedFile,
    target: PathBuf,
    size: (usize, usize),
    frames: usize,
    pushed: usize,
    frames_per_second: u16,
    encoder: FilmEncoder,
}

enum FilmEncoder {
    /// Holds what is encoded until the end; boxed, for it is large.
    WebP(Box<Encoder>),
    Apng(Box<png::Writer<BufWriter<File>>>),
}

impl Film {
    /// Begins a film that repeats for ever. Every frame is encoded when it is made: in memory is one frame,
    /// and of WebP also what is encoded.
    ///
    /// # Errors
    /// [`FilmError`] for a name that is taken or cannot be written, and for sizes and lengths no film has.
    pub fn begin(
        target: &Path,
        format: FilmFormat,
        (width, height): (usize, usize),
        frames: usize,
        frames_per_second: u16,
    ) -> Result<Self, FilmError> {
        if !(1..=MOST_FRAMES).contains(&frames) {
            return Err(FilmError::Frames {
                path: target.to_owned(),
                frames,
            });
        }
        let edges = 1..=LONGEST_EDGE;
        if !(edges.contains(&width) && edges.contains(&height)) {
            return Err(FilmError::Size {
                path: target.to_owned(),
                width,
                height,
            });
        }
        let staged = StagedFile::begin(target)?;
        let size = (width as u32, height as u32);
        let failed = |problem: String| FilmError::Frame {
            path: target.to_owned(),
            frame: 0,
            problem,
        };
        let encoder = match format {
            FilmFormat::WebP => {
                // Known before hours are spent on what cannot be written.
                let empty = Disk.write_new(staged.partial(), &[]);
                empty.map_err(|source| CommitError::unwritten(target, source))?;
                let options = EncoderOptions {
                    encoding_config: Some(EncodingConfig::new_lossy(WEBP_QUALITY)),
                    color_mode: webp_animation::ColorMode::Rgb,
                    ..EncoderOptions::default()
                };
                let encoder = Encoder::new_with_options(size, options);
                FilmEncoder::WebP(Box::new(
                    encoder.map_err(|error| failed(error.to_string()))?,
                ))
            }
            FilmFormat::Apng => {
                let file = File::create_new(staged.partial())
                    .map_err(|source| CommitError::unwritten(target, source))?;
                let mut encoder = png::Encoder::new(BufWriter::new(file), size.0, size.1);
                encoder.set_color(png::ColorType::Rgb);
                encoder.set_depth(png::BitDepth::Eight);
                encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
                encoder.set_compression(png::Compression::Fast);
                let count = u32::try_from(frames).unwrap_or(u32::MAX);
                let begun = encoder
                    .set_animated(count, 0)
                    .and_then(|()| encoder.set_frame_delay(1, frames_per_second))
                    .and_then(|()| encoder.write_header());
                FilmEncoder::Apng(Box::new(
                    begun.map_err(|error| unwritten(target, 0, error))?,
                ))
            }
        };
        Ok(Self {
            staged,
            target: target.to_owned(),
            size: (width, height),
            frames,
            pushed: 0,
            frames_per_second,
            encoder,
        })
    }

    /// The next frame, sRGB.
    ///
    /// # Errors
    /// [`FilmError`] when it cannot be encoded or written.
    ///
    /// # Panics
    /// For a frame of another size, or one too many: bugs of the caller.
    pub fn push(&mut self, frame: &Plane<[u8; 3]>) -> Result<(), FilmError> {
        assert_eq!(frame.size(), self.size);
        assert!(self.pushed < self.frames);
        let bytes = frame.samples().as_flattened();
        let at = self.begins_ms(self.pushed);
        match &mut self.encoder {
            FilmEncoder::WebP(encoder) => {
                let added = encoder.add_frame(bytes, at);
                added.map_err(|error| FilmError::Frame {
                    path: self.target.clone(),
                    frame: self.pushed,
                    problem: error.to_string(),
                })?;
            }
            FilmEncoder::Apng(writer) => {
                let written = writer.write_image_data(bytes);
                written.map_err(|error| unwritten(&self.target, self.pushed, error))?;
            }
        }
        self.pushed += 1;
        Ok(())
    }

    /// When a frame begins, milliseconds.
    fn begins_ms(&self, frame: usize) -> i32 {
        (frame as f64 * 1e3 / f64::from(self.frames_per_second)).round() as i32
    }

    /// Gives the film its name.
    ///
    /// # Errors
    /// [`FilmError`] when it cannot be written.
    ///
    /// # Panics
    /// When frames are missing: a bug of the caller.
    pub fn finish(self) -> Result<u64, FilmError> {
        assert_eq!(self.pushed, self.frames);
        let end = self.begins_ms(self.frames);
        let io = |source: io::Error| CommitError::unwritten(&self.target, source);
        match self.encoder {
            FilmEncoder::WebP(encoder) => {
                let bytes = encoder.finalize(end).map_err(|error| FilmError::Frame {
                    path: self.target.clone(),
                    frame: self.frames,
                    problem: error.to_string(),
                })?;
                std::fs::remove_file(self.staged.partial()).map_err(io)?;
                Disk.write_new(self.staged.partial(), &bytes).map_err(io)?;
            }
            FilmEncoder::Apng(writer) => {
                let ended = writer.finish();
                ended.map_err(|error| unwritten(&self.target, self.frames, error))?;
                let file = File::open(self.staged.partial()).map_err(io)?;
                file.sync_all().map_err(io)?;
            }
        }
        let bytes = std::fs::metadata(self.staged.partial()).map_err(io)?.len();
        self.staged.commit()?;
        Ok(bytes)
    }
}

fn unwritten(target: &Path, frame: usize, error: png::EncodingError) -> FilmError {
    match error {
        png::EncodingError::IoError(source) => CommitError::unwritten(target, source).into(),
        other => FilmError::Frame {
            path: target.to_owned(),
            frame,
            problem: other.to_string(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames() -> Vec<Plane<[u8; 3]>> {
        let frame = |n: usize| {
            Plane::from_fn(33, 17, |x, y| {
                let bright = ((x + 4 * n) % 33) as u8 * 7;
                [bright, (y * 15) as u8, 120]
            })
        };
        (0..5).map(frame).collect()
    }

    fn written(name: &str) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join(name);
        let format = name.rsplit('.').next().unwrap().parse().unwrap();
        let mut film = Film::begin(&target, format, (33, 17), 5, 24).unwrap();
        for frame in frames() {
            film.push(&frame).unwrap();
            assert!(!target.exists(), "it appears whole");
        }
        film.finish().unwrap();
        let names = Disk.list(folder.path()).unwrap().unwrap();
        assert_eq!(names, [name]);
        std::fs::read(target).unwrap()
    }

    #[test]
    fn a_webp_film_shows_its_frames_at_their_time() {
        let bytes = written("a.webp");
        let decoder = webp_animation::Decoder::new(&bytes).unwrap();
        let found: Vec<_> = decoder.into_iter().collect();
        assert_eq!(found.len(), 5);
        for (n, (shown, made)) in found.iter().zip(frames()).enumerate() {
            // WebP says when a frame ends.
            assert_eq!(
                shown.timestamp(),
                ((n + 1) as f64 * 1e3 / 24.0).round() as i32
            );
            let pixels = shown.data().chunks(4).zip(made.samples());
            let difference: f64 = pixels
                .map(|(a, b)| (0..3).map(|c| f64::from(a[c].abs_diff(b[c]))).sum::<f64>() / 3.0)
                .sum::<f64>()
                / made.len() as f64;
            // Lossy, with color at half resolution: steep ramps of 33 pixels are its worst case.
            assert!(difference < 6.0, "frame {n}: {difference}");
        }
    }

    #[test]
    fn an_animated_png_holds_exactly_its_frames() {
        let bytes = written("a.apng");
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
        for made in frames() {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(pixels, made.samples().as_flattened());
            let delay = reader.info().frame_control().unwrap();
            assert_eq!((delay.delay_num, delay.delay_den), (1, 24));
        }
    }

    #[test]
    fn films_that_cannot_be_are_refused_and_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("a.webp");
        let begin = |size, frames| Film::begin(&target, FilmFormat::WebP, size, frames, 24);
        assert!(matches!(begin((8, 8), 0), Err(FilmError::Frames { .. })));
        assert!(matches!(
            begin((8, 8), MOST_FRAMES + 1),
            Err(FilmError::Frames { .. })
        ));
        assert!(matches!(begin((8, 0), 1), Err(FilmError::Size { .. })));
        assert!(matches!(begin((20_000, 8), 1), Err(FilmError::Size { .. })));
        drop(begin((8, 8), 2).unwrap());
        assert!(Disk.list(folder.path()).unwrap().unwrap().is_empty());
        std::fs::write(&target, "taken").unwrap();
        assert!(matches!(
            begin((8, 8), 2),
            Err(FilmError::Commit(CommitError::Taken { .. }))
        ));
        assert!("gif".parse::<FilmFormat>().is_err());
    }
}
