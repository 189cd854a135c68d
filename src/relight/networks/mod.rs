//! Networks: the paper's three instead of closed forms, and compact ones that correct closed forms.
//!
//! The paper: Qiu, Zeng, Ke, Sun, Yang, "Towards Geometry Guided Neural Relighting with Flash Photography",
//! 3DV 2020. What the networks are fed stands in [`feed`] and is the same as in
//! `models/reference/feeding.py`; what runs them is behind [`Network`] and not known here.

pub mod compact;
pub mod feed;
pub mod frame;
mod grid;
mod paper;
mod render;

pub use feed::{Feed, Photograph};
pub use grid::resampled;
pub use paper::{Decomposed, Paper};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use thiserror::Error;

/// Pictures of one size, channel after channel, each in row order: what networks take and give.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    /// (width, height) in pixels.
    pub size: (usize, usize),
    /// Channels; `samples` holds channels × height × width numbers.
    pub count: usize,
    /// The numbers.
    pub samples: Vec<f32>,
}

impl Channels {
    /// One plane of channel `index`.
    ///
    /// # Panics
    /// When there is no such channel: a bug of the caller.
    pub fn channel(&self, index: usize) -> &[f32] {
        let pixels = self.size.0 * self.size.1;
        &self.samples[index * pixels..(index + 1) * pixels]
    }

    /// Channels from a rule per row, which is given the row of every channel, all 0.
    pub(crate) fn from_rows(
        size: (usize, usize),
        count: usize,
        row: impl Fn(usize, &mut [&mut [f32]]) + Sync,
    ) -> Self {
        let (width, height) = size;
        let mut samples = vec![0.0; count * width * height];
        let planes = samples.chunks_mut((width * height).max(1));
        let mut planes: Vec<_> = planes.map(|plane| plane.chunks_mut(width.max(1))).collect();
        let rows: Vec<Vec<&mut [f32]>> = (0..height)
            .map(|_| planes.iter_mut().filter_map(Iterator::next).collect())
            .collect();
        rows.into_par_iter()
            .enumerate()
            .for_each(|(y, mut planes)| row(y, &mut planes));
        Self {
            size,
            count,
            samples,
        }
    }

    /// Channels from a rule per pixel.
    pub(crate) fn from_pixels<const N: usize>(
        size: (usize, usize),
        pixel: impl Fn(usize) -> [f32; N] + Sync,
    ) -> Self {
        Self::from_rows(size, N, |y, planes| {
            for x in 0..size.0 {
                for (plane, value) in planes.iter_mut().zip(pixel(y * size.0 + x)) {
                    plane[x] = value;
                }
            }
        })
    }
}

/// Where a network comes from and what its answers have cost so far; for `shot.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NetworkRecord {
    /// What it answers: `decompose`, `shadow` or `synthesis`; `surfaces` or `light`.
    pub name: String,
    /// What it was trained on.
    pub variant: String,
    /// BLAKE3 of its file.
    pub blake3: String,
    /// Numbers that training set.
    pub parameters: u64,
    /// What runs it.
    pub backend: String,
    /// Threads it runs on.
    pub threads: usize,
    /// Answers given.
    pub runs: usize,
    /// Time of all answers together, milliseconds.
    pub milliseconds: f64,
}

/// Why a network did not answer.
#[derive(Debug, Clone, PartialEq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum NetworkError {
    #[error("network {network}: input {input:?} {problem}; give what models/manifest.toml states")]
    Input {
        network: String,
        input: String,
        problem: String,
    },
    #[error(
        "network {network}: output {output:?} {problem}; the model does not do what models/manifest.toml states: export it again"
    )]
    Output {
        network: String,
        output: String,
        problem: String,
    },
    #[error(
        "network {network}: {problem}; try the other backend (`capturectl runtime status`), or --tier closed, which needs no network"
    )]
    Failed { network: String, problem: String },
}

/// Named pictures in, named pictures out.
pub trait Network: Send {
    /// Answers with the `wanted` outputs, in their order, each of the inputs' size.
    ///
    /// # Errors
    /// [`NetworkError`] for inputs of another name, size or number of channels than the network
    /// has, and when it fails.
    fn answer(
        &self,
        given: &[(&str, &Channels)],
        wanted: &[&str],
    ) -> Result<Vec<Channels>, NetworkError>;

    /// Its origin and cost.
    fn record(&self) -> NetworkRecord;
}

/// What the networks of a set were trained on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Exact depth. Fed the depth that was smoothed by its own noise.
    #[default]
    Clean,
    /// Depth with the paper's noise. Fed the depth as it was registered.
    Noisy,
}

impl Variant {
    /// What the manifest calls the variant of compact networks, which know clean and noisy depth.
    pub const COMPACT: &'static str = "compact";

    /// Its name in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clean => "clean",
            Self::Noisy => "noisy",
        }
    }
}

impl FromStr for Variant {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "clean" => Ok(Self::Clean),
            "noisy" => Ok(Self::Noisy),
            _ => Err("it must be clean or noisy".to_owned()),
        }
    }
}
