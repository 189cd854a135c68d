//! Pictures as clients see them: rows of red, green, blue and alpha, or JPEG.

use crate::{
    api::PictureFormat,
    output::{Tone, sheet},
    radiometry::transfer::srgb_encode,
};
use axum::{
    body::Body,
    http::{HeaderValue, Response, header},
};
use drivers::Plane;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rayon::prelude::*;

/// Quality of JPEG pictures.
const QUALITY: u8 = 88;
/// Alpha of a previewed pixel that is clipped.
const CLIPPED: u8 = 254;

/// An sRGB picture; alpha 0 = unknown.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub width: usize,
    pub height: usize,
    /// Four bytes a pixel.
    pub rgba: Vec<u8>,
}

impl Picture {
    fn from_pixels<T: Sync>(
        plane: &Plane<T>,
        pixel: impl Fn(&T) -> Option<[u8; 3]> + Sync,
    ) -> Self {
        let (width, height) = plane.size();
        let mut rgba = vec![0; plane.len() * 4];
        rgba.par_chunks_mut(4 * width.max(1))
            .zip(plane.samples().par_chunks(width.max(1)))
            .with_min_len(32)
            .for_each(|(row, pixels)| {
                for (out, found) in row.chunks_exact_mut(4).zip(pixels) {
                    if let Some([r, g, b]) = pixel(found) {
                        out.copy_from_slice(&[r, g, b, 255]);
                    }
                }
            });
        Self {
            width,
            height,
            rgba,
        }
    }

    /// Scene-linear light.
    pub fn light(plane: &Plane<[f32; 3]>, tone: &Tone) -> Self {
        Self::from_pixels(plane, |rgb| tone.srgb8(*rgb))
    }

    /// Fractions as gray.
    pub fn fraction(plane: &Plane<f32>) -> Self {
        // A cast from float saturates.
        Self::from_pixels(plane, |value| {
            (!value.is_nan()).then(|| [(value * 255.0).round() as u8; 3])
        })
    }

    /// Unit vectors in the camera's axes (x right, y down, z forward), shown in people's.
    pub fn normals(plane: &Plane<glam::Vec3>) -> Self {
        Self::from_pixels(plane, |normal| {
            let byte = |value: f32| (127.5 * (value + 1.0)).round() as u8;
            (!normal.x.is_nan()).then(|| [byte(normal.x), byte(-normal.y), byte(-normal.z)])
        })
    }

    /// Distances from the 2nd to the 98th percentile, near = yellow.
    pub fn distance(metres: &Plane<f32>) -> Self {
        let (near, far) = sheet::range(metres).unwrap_or((0.0, 1.0));
        let span = (far - near).max(1e-6);
        Self::from_pixels(metres, |metres| {
            metres
                .is_finite()
                .then(|| sheet::viridis(1.0 - (metres - near) / span))
        })
    }

    /// What a camera sees, as numbers of its sensor in [0, 1], and whether they are clipped.
    pub fn previewed(plane: &Plane<([f32; 3], bool)>) -> Self {
        let mut picture = Self::from_pixels(plane, |(rgb, _)| {
            Some(rgb.map(|value| (255.0 * srgb_encode(value.clamp(0.0, 1.0))).round() as u8))
        });
        let pixels = picture.rgba.chunks_exact_mut(4).zip(plane.samples());
        for (pixel, (_, clipped)) in pixels {
            if *clipped {
                pixel[3] = CLIPPED;
            }
        }
        picture
    }

    /// As bytes of a format.
    pub fn encoded(self, format: PictureFormat) -> Result<Encoded, String> {
        let (width, height) = (self.width, self.height);
        let bytes = match format {
            PictureFormat::Raw => self.rgba,
            PictureFormat::Jpeg => {
                let side = |pixels| u16::try_from(pixels).map_err(|error| format!("{error}"));
                let mut bytes = Vec::with_capacity(self.rgba.len() / 8);
                let mut encoder = Encoder::new(&mut bytes, QUALITY);
                // Color at half the size, as cameras do: half the work here and in the browser.
                encoder.set_sampling_factor(SamplingFactor::R_4_2_0);
                encoder
                    .encode(&self.rgba, side(width)?, side(height)?, ColorType::Rgba)
                    .map_err(|error| error.to_string())?;
                bytes
            }
        };
        Ok(Encoded {
            format,
            width,
            height,
            bytes,
        })
    }
}

/// A picture ready to be sent.
#[derive(Debug, Clone)]
pub(super) struct Encoded {
    format: PictureFormat,
    width: usize,
    height: usize,
    bytes: Vec<u8>,
}

impl Encoded {
    /// The answer; `headers` are further ones.
    pub fn response(self, headers: &[(&'static str, u64)]) -> Response<Body> {
        let kind = match self.format {
            PictureFormat::Jpeg => "image/jpeg",
            PictureFormat::Raw => "application/octet-stream",
        };
        let mut response = Response::new(Body::from(self.bytes));
        let found = response.headers_mut();
        found.insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
        found.insert("x-width", HeaderValue::from(self.width as u64));
        found.insert("x-height", HeaderValue::from(self.height as u64));
        for (name, value) in headers {
            found.insert(*name, HeaderValue::from(*value));
        }
        response
    }
}
