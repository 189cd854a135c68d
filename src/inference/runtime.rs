//! What runs the networks: chosen once, for the whole process.

use super::{
    InferenceError, Settings,
    library::{self, Found, Refused},
};
use ort::LoadDynamicError;
use serde::Serialize;
use std::{
    error::Error as _,
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
    sync::OnceLock,
};

/// What answers for the networks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "name", rename_all = "snake_case")]
pub enum Backend {
    /// ONNX Runtime, from a shared library.
    OnnxRuntime {
        /// The library.
        library: PathBuf,
        /// Its version.
        version: String,
    },
    /// tract, which is part of this program. One thread, whatever is asked for.
    Tract {
        /// Why it is not ONNX Runtime.
        because: String,
    },
}

impl Backend {
    /// Its name and version.
    pub fn description(&self) -> String {
        match self {
            Self::OnnxRuntime { version, .. } => format!("ONNX Runtime {version}"),
            Self::Tract { .. } => "tract 0.23".to_owned(),
        }
    }

    /// Threads it uses of those it is given.
    pub fn threads(&self, given: usize) -> usize {
        match self {
            Self::OnnxRuntime { .. } => given,
            Self::Tract { .. } => 1,
        }
    }
}

/// The running backend.
#[derive(Debug)]
pub struct Runtime {
    pub(super) environment: ort::environment::Environment,
    /// What it is.
    pub backend: Backend,
    /// What to tell whoever asked for another backend.
    pub warning: Option<String>,
}

/// One per process: neither library can be taken out again.
static RUNNING: OnceLock<Result<Runtime, String>> = OnceLock::new();

impl Runtime {
    /// Starts ONNX Runtime where its library is configured or found, else tract. The first call of a
    /// process decides; later ones get what runs already.
    ///
    /// A library that cannot be used is no error: tract answers, and [`Self::warning`] says why.
    ///
    /// # Errors
    /// [`InferenceError::Start`] when not even tract starts.
    pub fn start(settings: &Settings) -> Result<&'static Self, InferenceError> {
        let running = RUNNING.get_or_init(|| Self::first(settings));
        running.as_ref().map_err(|problem| InferenceError::Start {
            problem: problem.clone(),
        })
    }

    fn first(settings: &Settings) -> Result<Self, String> {
        let (because, asked) = match library::find(settings) {
            Ok(found) => match onnx_runtime(&found) {
                Ok(environment) => {
                    return Ok(Self {
                        environment,
                        backend: Backend::OnnxRuntime {
                            library: found.path,
                            version: found.version,
                        },
                        warning: None,
                    });
                }
                // A library that looked right and does not load deserves a word, found or asked for.
                Err(problem) => (format!("{}: {problem}", found.path.display()), true),
            },
            Err(Refused::Asked(error)) => (error.to_string(), true),
            Err(Refused::Nowhere) => ("its library was not found".to_owned(), false),
        };
        Ok(Self {
            environment: tract()?,
            warning: asked.then(|| format!("{because}; the networks run in tract instead")),
            backend: Backend::Tract { because },
        })
    }
}

/// Loads the library. At most once per process: `ort` takes a failed load for a done one.
fn onnx_runtime(found: &Found) -> Result<ort::environment::Environment, String> {
    quietly(|| {
        let builder = ort::init_from(&found.path).map_err(|error| match &error {
            // The loader's own words stand beneath.
            LoadDynamicError::Dlopen { error, .. } => {
                let words = error
                    .source()
                    .map_or_else(|| error.to_string(), ToString::to_string);
                format!("cannot be loaded: {words}")
            }
            other => other.to_string(),
        })?;
        environment(builder)
    })
}

fn tract() -> Result<ort::environment::Environment, String> {
    quietly(|| {
        if !ort::set_api(ort_tract::api()) {
            return Err(
                "a half-loaded ONNX Runtime is in the way; give another library".to_owned(),
            );
        }
        environment(ort::init())
    })
}

fn environment(
    builder: ort::environment::EnvironmentBuilder,
) -> Result<ort::environment::Environment, String> {
    let builder = builder.with_name("captured").with_telemetry(false);
    builder.build().map_err(|error| error.to_string())
}

/// A panic of `ort` becomes an error.
pub(super) fn quietly<T>(work: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<String>().map(String::as_str);
        let words = words.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(words.unwrap_or("it panicked").to_owned())
    })
}
