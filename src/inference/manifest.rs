//! `models/manifest.toml`: every model this program accepts. The text is part of the program, so
//! its hashes are where the trust in a model file begins.

use super::InferenceError;
use serde::Deserialize;

const EMBEDDED: &str = include_str!("../../models/manifest.toml");
/// Larger than any model here; memory for a file is bounded by what the manifest states.
const LARGEST_FILE: u64 = 256 << 20;

/// All models.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Manifest {
    format: u32,
    #[serde(default, rename = "model")]
    models: Vec<Model>,
}

/// One model. The manifest may say more about it than is needed to run it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Model {
    /// What it answers: `decompose`, `shadow`, `synthesis`.
    pub name: String,
    /// What it was trained on: `clean`, `noisy`, `env`, `sips`, `oss`.
    pub variant: String,
    /// Path below the folder of models.
    pub file: String,
    /// BLAKE3 of the file, in hexadecimal.
    pub blake3: String,
    /// Length of the file.
    pub bytes: u64,
    /// Numbers that training set.
    pub parameters: u64,
    /// Billions of operations for one answer at 256 × 256; a multiplication and its addition are two.
    pub gflop_256: f64,
    /// What it takes.
    #[serde(rename = "input")]
    pub inputs: Vec<Signal>,
    /// What it gives.
    #[serde(rename = "output")]
    pub outputs: Vec<Signal>,
}

/// An input or output: 32-bit floats of (1, channels, height, width).
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Signal {
    /// Its name in the graph.
    pub name: String,
    /// Its sides.
    pub shape: [Side; 4],
}

/// Length of one side of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum Side {
    /// The same for every picture.
    Fixed(u64),
    /// The picture's height.
    Height,
    /// The picture's width.
    Width,
}

impl TryFrom<String> for Side {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        match text.as_str() {
            "height" => Ok(Self::Height),
            "width" => Ok(Self::Width),
            number => number.parse().map(Self::Fixed).map_err(|_| {
                format!("shape {text:?}: a side is a number, \"height\" or \"width\"")
            }),
        }
    }
}

impl Signal {
    /// Channels of each pixel.
    pub fn channels(&self) -> u64 {
        match self.shape[1] {
            Side::Fixed(channels) => channels,
            Side::Height | Side::Width => 0,
        }
    }

    /// Sides for pictures of (width, height) pixels.
    pub(super) fn sides(&self, (width, height): (usize, usize)) -> Vec<u64> {
        let side = |side: &Side| match side {
            Side::Fixed(length) => *length,
            Side::Height => height as u64,
            Side::Width => width as u64,
        };
        self.shape.iter().map(side).collect()
    }
}

impl Manifest {
    /// The one that this program was built with.
    ///
    /// # Errors
    /// [`InferenceError::Manifest`], which a test rules out.
    pub fn embedded() -> Result<Self, InferenceError> {
        Self::parse(EMBEDDED)
    }

    /// Reads and checks a manifest's text.
    ///
    /// # Errors
    /// [`InferenceError::Manifest`], naming the model and the key.
    pub fn parse(text: &str) -> Result<Self, InferenceError> {
        let wrong = |problem: String| InferenceError::Manifest { problem };
        let manifest: Self =
            toml::from_str(text).map_err(|error| wrong(error.to_string().trim_end().to_owned()))?;
        if manifest.format != 1 {
            return Err(wrong(format!("format is {}, not 1", manifest.format)));
        }
        for model in &manifest.models {
            if let Some(problem) = model.problem() {
                let Model { name, variant, .. } = model;
                return Err(wrong(format!("{name} ({variant}): {problem}")));
            }
        }
        Ok(manifest)
    }

    /// Every model, in the file's order.
    pub fn models(&self) -> &[Model] {
        &self.models
    }

    /// The model of this name and variant.
    ///
    /// # Errors
    /// [`InferenceError::NotListed`] where there is none.
    pub fn model(&self, name: &str, variant: &str) -> Result<&Model, InferenceError> {
        let found = self
            .models
            .iter()
            .find(|model| model.name == name && model.variant == variant);
        found.ok_or_else(|| {
            let listed = self.models.iter();
            let listed: Vec<String> = listed
                .map(|model| format!("{} {}", model.name, model.variant))
                .collect();
            InferenceError::NotListed {
                name: name.to_owned(),
                variant: variant.to_owned(),
                listed: if listed.is_empty() {
                    "none".to_owned()
                } else {
                    listed.join(", ")
                },
            }
        })
    }
}

impl Model {
    fn problem(&self) -> Option<&'static str> {
        let hexadecimal = self.blake3.bytes().all(|byte| byte.is_ascii_hexdigit());
        let inside = std::path::Path::new(&self.file)
            .components()
            .all(|part| matches!(part, std::path::Component::Normal(_)));
        let pictures = |signal: &Signal| {
            let [batch, channels, height, width] = signal.shape;
            let few = matches!(channels, Side::Fixed(1..=64));
            (batch, height, width) == (Side::Fixed(1), Side::Height, Side::Width) && few
        };
        let rules = [
            (
                self.blake3.len() == 64 && hexadecimal,
                "blake3 must be 64 hexadecimal digits",
            ),
            (
                (1..=LARGEST_FILE).contains(&self.bytes),
                "bytes must be from 1 to 268435456",
            ),
            (inside, "file must stay below the folder of models"),
            (
                self.inputs.iter().chain(&self.outputs).all(pictures),
                "a shape must be [\"1\", channels, \"height\", \"width\"], of at most 64 channels",
            ),
            (
                !self.inputs.is_empty() && !self.outputs.is_empty(),
                "input and output must not be empty",
            ),
        ];
        let broken = rules.into_iter().find(|(kept, _)| !kept)?;
        Some(broken.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: &str = r#"
        format = 1
        [[model]]
        name = "shadow"
        variant = "clean"
        file = "weights/shadow.onnx"
        blake3 = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"
        bytes = 10
        parameters = 3
        gflop_256 = 0.5
        card = "cards/shadow.md"
        [[model.input]]
        name = "cloud"
        shape = ["1", "3", "height", "width"]
        unit = "half extents"
        range = [-1, 2]
        [[model.output]]
        name = "shadow"
        shape = ["1", "1", "height", "width"]
    "#;

    #[test]
    fn the_manifest_of_this_program_can_be_read() {
        Manifest::embedded().unwrap();
    }

    #[test]
    fn a_model_is_found_by_name_and_variant_and_its_sides_follow_the_picture() {
        let manifest = Manifest::parse(ONE).unwrap();
        let model = manifest.model("shadow", "clean").unwrap();
        assert_eq!(model.inputs[0].sides((320, 192)), [1, 3, 192, 320]);
        assert_eq!(model.outputs[0].channels(), 1);
        let missing = manifest.model("shadow", "noisy").unwrap_err().to_string();
        for word in ["noisy", "shadow clean", "--tier closed"] {
            assert!(missing.contains(word), "{missing}");
        }
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_its_key() {
        for (from, to, named) in [
            ("format = 1", "format = 2", "format"),
            ("weights/shadow.onnx", "../shadow.onnx", "file"),
            ("weights/shadow.onnx", "/shadow.onnx", "file"),
            ("00112233", "0011223x", "blake3"),
            ("bytes = 10", "bytes = 0", "bytes"),
            ("bytes = 10", "bytes = 9999999999", "bytes"),
            ("\"3\", \"height\"", "\"3\", \"depth\"", "depth"),
            ("\"3\", \"height\"", "\"3\", \"7\"", "shape"),
            ("\"1\", \"3\"", "\"1\", \"3000\"", "64 channels"),
            ("gflop_256 = 0.5", "", "gflop_256"),
        ] {
            let error = Manifest::parse(&ONE.replace(from, to)).unwrap_err();
            assert!(error.to_string().contains(named), "{from} → {to}: {error}");
        }
    }
}
