//! The one gate for every image file: kind by content, size by header, and only then the pixels.
//!
//! A file is hostile until it is checked. Its size is compared with what was declared *before* a
//! pixel is decoded, so that a few hundred bytes cannot ask for gigabytes.

mod exif;
mod exr;
mod hdr;
mod jpeg;
mod png;

use drivers::Plane;
use std::{
    fs::File,
    io::{BufReader, Read, Seek},
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Why an image file was not read.
#[derive(Debug, Error)]
pub enum ImageError {
    /// The operating system refused.
    #[error("{path}: cannot be read: {source}; check that the file exists and may be read")]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The bytes are of no kind we know.
    #[error(
        "{path}: is not a PNG, JPEG, OpenEXR or Radiance HDR file by its first bytes; convert it to one of these"
    )]
    Kind {
        /// The file.
        path: PathBuf,
    },
    /// The size in the header contradicts what was declared.
    #[error(
        "{path}: width × height is {}×{} but {}×{} was declared; correct the declaration or supply the right image",
        found.0, found.1, declared.0, declared.1
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// `(width, height)` declared elsewhere.
        declared: (usize, usize),
        /// `(width, height)` in the file's header.
        found: (usize, usize),
    },
    /// Larger than the limits allow.
    #[error("{path}: {field} is {found}, more than the {limit} allowed; scale the image down")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is too large.
        field: &'static str,
        /// How large.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// A kind of picture this project does not read.
    #[error("{path}: {problem}; {remedy}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found, with the field.
        problem: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Truncated or lying.
    #[error("{path}: {problem}; the file is damaged or incomplete, write it again")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the field.
        problem: String,
    },
}

/// How large an image may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Pixels in all.
    pub max_pixels: usize,
    /// Pixels per row, and rows.
    pub max_side: usize,
}

impl Default for Limits {
    /// 64 megapixels, 16384 on a side.
    fn default() -> Self {
        Self {
            max_pixels: 64_000_000,
            max_side: 16_384,
        }
    }
}

/// What a file is, by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum ImageKind {
    Png,
    Jpeg,
    Exr,
    Radiance,
}

/// Decoded samples; alpha is dropped, palettes are resolved, half floats are widened.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// One channel, full scale 255.
    Gray8(Plane<u8>),
    /// One channel, full scale 65535.
    Gray16(Plane<u16>),
    /// One channel, as written.
    GrayF32(Plane<f32>),
    /// Red, green, blue, full scale 255.
    Rgb8(Plane<[u8; 3]>),
    /// Red, green, blue, full scale 65535.
    Rgb16(Plane<[u16; 3]>),
    /// Red, green, blue, as written.
    RgbF32(Plane<[f32; 3]>),
}

impl Samples {
    /// `(width, height)` in pixels.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Gray8(plane) => plane.size(),
            Self::Gray16(plane) => plane.size(),
            Self::GrayF32(plane) => plane.size(),
            Self::Rgb8(plane) => plane.size(),
            Self::Rgb16(plane) => plane.size(),
            Self::RgbF32(plane) => plane.size(),
        }
    }

    /// What the samples are, in words for people.
    pub fn describe(&self) -> &'static str {
        match self {
            Self::Gray8(_) => "8-bit gray",
            Self::Gray16(_) => "16-bit gray",
            Self::GrayF32(_) => "one float channel",
            Self::Rgb8(_) => "8-bit color",
            Self::Rgb16(_) => "16-bit color",
            Self::RgbF32(_) => "float color",
        }
    }
}

/// A decoded image file.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoded {
    /// What the file was.
    pub kind: ImageKind,
    /// Its pixels, in the order they are stored in.
    pub samples: Samples,
    /// EXIF's orientation: 1 = upright as stored, also where nothing is said; 2 to 8 = viewers
    /// mirror or turn the picture.
    pub orientation: u16,
}

/// The file being decoded and what it must keep to.
struct Gate<'a> {
    path: &'a Path,
    expected: Option<(usize, usize)>,
    limits: Limits,
    file_bytes: u64,
}

impl Gate<'_> {
    /// Passes a header's size, or says why not; every decoder asks before it decodes.
    fn admit(&self, width: usize, height: usize) -> Result<(), ImageError> {
        if width == 0 || height == 0 {
            return Err(self.malformed(format!("width × height is {width}×{height}")));
        }
        if let Some(declared) = self.expected
            && declared != (width, height)
        {
            return Err(ImageError::Size {
                path: self.path.into(),
                declared,
                found: (width, height),
            });
        }
        let side = width.max(height);
        if side > self.limits.max_side {
            return Err(self.too_large("the longer side", side, self.limits.max_side));
        }
        let pixels = width.saturating_mul(height);
        if pixels > self.limits.max_pixels {
            return Err(self.too_large("width × height", pixels, self.limits.max_pixels));
        }
        Ok(())
    }

    fn too_large(&self, field: &'static str, found: usize, limit: usize) -> ImageError {
        let [found, limit] = [found as u64, limit as u64];
        ImageError::TooLarge {
            path: self.path.into(),
            field,
            found,
            limit,
        }
    }

    fn malformed(&self, problem: impl Into<String>) -> ImageError {
        ImageError::Malformed {
            path: self.path.into(),
            problem: problem.into(),
        }
    }

    fn unsupported(&self, problem: impl Into<String>, remedy: &'static str) -> ImageError {
        ImageError::Unsupported {
            path: self.path.into(),
            problem: problem.into(),
            remedy,
        }
    }

    fn plane<T>(&self, (w, h): (usize, usize), samples: Vec<T>) -> Result<Plane<T>, ImageError> {
        Plane::new(w, h, samples).map_err(|mismatch| self.malformed(mismatch.to_string()))
    }
}

/// Decodes an image file of at most `limits`, of exactly `expected` size `(width, height)` where one
/// was declared.
///
/// Memory: the decoded picture, plus at most 64 MiB (a progressive JPEG also holds its
/// coefficients, six bytes a pixel).
///
/// # Errors
/// [`ImageError::Io`] when the file cannot be read or is not a regular file, [`ImageError::Kind`]
/// for unknown bytes, [`ImageError::Size`] and [`ImageError::TooLarge`] from the header alone,
/// [`ImageError::Unsupported`] for pictures not read here (deep or multi-part EXR, CMYK), and
/// [`ImageError::Malformed`] for bytes that are truncated or contradict the header.
pub fn decode_limited(
    path: &Path,
    expected: Option<(usize, usize)>,
    limits: Limits,
) -> Result<Decoded, ImageError> {
    let (file, file_bytes) = open_regular(path)?;
    let gate = Gate {
        path,
        expected,
        limits,
        file_bytes,
    };
    decode_reader(&gate, BufReader::new(file))
}

/// [`decode_limited`] for bytes already in memory; `name` stands in for the path in errors.
///
/// # Errors
/// As [`decode_limited`].
pub fn decode_bytes_limited(
    name: &Path,
    bytes: &[u8],
    expected: Option<(usize, usize)>,
    limits: Limits,
) -> Result<Decoded, ImageError> {
    let gate = Gate {
        path: name,
        expected,
        limits,
        file_bytes: bytes.len() as u64,
    };
    decode_reader(&gate, std::io::Cursor::new(bytes))
}

/// Opens without waiting (a named pipe would block for ever) and insists on a regular file.
pub(super) fn open_regular(path: &Path) -> Result<(File, u64), ImageError> {
    let io = |source| ImageError::Io {
        path: path.into(),
        source,
    };
    let flags = rustix::fs::OFlags::RDONLY
        | rustix::fs::OFlags::CLOEXEC
        | rustix::fs::OFlags::NONBLOCK
        | rustix::fs::OFlags::NOCTTY;
    let file = File::from(
        rustix::fs::open(path, flags, rustix::fs::Mode::empty())
            .map_err(|errno| io(errno.into()))?,
    );
    let metadata = file.metadata().map_err(io)?;
    if !metadata.is_file() {
        return Err(io(std::io::Error::other("not a regular file")));
    }
    Ok((file, metadata.len()))
}

fn decode_reader<R: std::io::BufRead + Seek>(
    gate: &Gate<'_>,
    mut reader: R,
) -> Result<Decoded, ImageError> {
    let io = |source| ImageError::Io {
        path: gate.path.into(),
        source,
    };
    let mut magic = Vec::with_capacity(10);
    reader
        .by_ref()
        .take(10)
        .read_to_end(&mut magic)
        .map_err(io)?;
    reader.rewind().map_err(io)?;
    let kind = kind_of(&magic).ok_or_else(|| ImageError::Kind {
        path: gate.path.into(),
    })?;
    // The decoders are other people's: a panic in one is a damaged file, not our end.
    let (samples, orientation) = catch_unwind(AssertUnwindSafe(|| match kind {
        ImageKind::Png => png::decode(gate, reader),
        ImageKind::Jpeg => jpeg::decode(gate, reader),
        ImageKind::Exr => exr::decode(gate, reader).map(|samples| (samples, exif::UPRIGHT)),
        ImageKind::Radiance => hdr::decode(gate, reader).map(|samples| (samples, exif::UPRIGHT)),
    }))
    .unwrap_or_else(|_| Err(gate.malformed("the decoder gave up on its contents")))?;
    Ok(Decoded {
        kind,
        samples,
        orientation,
    })
}

fn kind_of(magic: &[u8]) -> Option<ImageKind> {
    if magic.starts_with(b"\x89PNG\r\n\x1a\n") {
        Some(ImageKind::Png)
    } else if magic.starts_with(b"\xff\xd8\xff") {
        Some(ImageKind::Jpeg)
    } else if magic.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        Some(ImageKind::Exr)
    } else if magic.starts_with(b"#?RADIANCE") || magic.starts_with(b"#?RGBE") {
        Some(ImageKind::Radiance)
    } else {
        None
    }
}
