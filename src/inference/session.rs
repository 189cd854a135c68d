//! One network as the running backend holds it.

use super::{Backend, ModelFile, Runtime, runtime::quietly};
use crate::relight::networks::{Channels, Network, NetworkError, NetworkRecord};
use ort::{
    ep,
    session::{
        Session, SessionInputValue,
        builder::{GraphOptimizationLevel, SessionBuilder},
    },
    value::TensorRef,
};
use std::{borrow::Cow, cell::RefCell, time::Instant};

/// A model, ready for pictures of one size at a time.
pub struct NetworkSession {
    file: ModelFile,
    runtime: &'static Runtime,
    threads: usize,
    state: RefCell<State>,
}

/// What changes with every answer.
#[derive(Default)]
struct State {
    /// The session for the size of the last pictures. A second one would hold the weights twice.
    session: Option<((usize, usize), Session)>,
    runs: usize,
    milliseconds: f64,
}

impl NetworkSession {
    /// Nothing is handed to the runtime before the first picture.
    pub fn new(file: ModelFile, runtime: &'static Runtime, threads: usize) -> Self {
        Self {
            file,
            runtime,
            threads,
            state: RefCell::default(),
        }
    }

    /// Prepares for pictures of (width, height) pixels, unless that was done last.
    ///
    /// # Errors
    /// [`NetworkError::Failed`] when the runtime refuses the model.
    pub fn prepare(&self, size: (usize, usize)) -> Result<(), NetworkError> {
        let session = &mut self.state.borrow_mut().session;
        if session.as_ref().is_some_and(|(ready, _)| *ready == size) {
            return Ok(());
        }
        // The old one goes first, so that memory never holds two.
        *session = None;
        let built = quietly(|| {
            let bytes = self.file.sized(size).map_err(|error| error.to_string())?;
            build(self.runtime, self.threads, &bytes)
        });
        *session = Some((size, built.map_err(|problem| self.failed(problem))?));
        Ok(())
    }

    fn failed(&self, problem: String) -> NetworkError {
        NetworkError::Failed {
            network: self.name(),
            problem: format!("{}: {problem}", self.runtime.backend.description()),
        }
    }

    fn name(&self) -> String {
        let model = &self.file.model;
        format!("{} ({})", model.name, model.variant)
    }

    /// The size all inputs share, each being what the manifest states.
    fn checked(&self, given: &[(&str, &Channels)]) -> Result<(usize, usize), NetworkError> {
        let wrong = |input: &str, problem: String| NetworkError::Input {
            network: self.name(),
            input: input.to_owned(),
            problem,
        };
        let size = given.first().map_or((0, 0), |(_, channels)| channels.size);
        for signal in &self.file.model.inputs {
            let name = signal.name.as_str();
            let Some((_, found)) = given.iter().find(|(given, _)| *given == name) else {
                return Err(wrong(name, "is not given".to_owned()));
            };
            let whole = found.count * found.size.0 * found.size.1;
            if found.size != size || found.samples.len() != whole || whole == 0 {
                let (width, height) = found.size;
                let others = format!("{}×{}", size.0, size.1);
                return Err(wrong(
                    name,
                    format!("is {width}×{height}, the others {others}"),
                ));
            }
            if found.count as u64 != signal.channels() {
                let (found, stated) = (found.count, signal.channels());
                return Err(wrong(name, format!("has {found} channels, not {stated}")));
            }
        }
        let stated = |name: &str| {
            self.file
                .model
                .inputs
                .iter()
                .any(|input| input.name == name)
        };
        match given.iter().find(|(name, _)| !stated(name)) {
            Some((name, _)) => Err(wrong(name, "is none of its inputs".to_owned())),
            None => Ok(size),
        }
    }
}

impl Network for NetworkSession {
    fn answer(
        &self,
        given: &[(&str, &Channels)],
        wanted: &[&str],
    ) -> Result<Vec<Channels>, NetworkError> {
        let size = self.checked(given)?;
        self.prepare(size)?;
        let mut state = self.state.borrow_mut();
        let Some((_, session)) = &mut state.session else {
            return Err(self.failed("no session".to_owned()));
        };
        let began = Instant::now();
        let answers = quietly(|| {
            // In the model's own order, which tract goes by.
            let ordered = self.file.model.inputs.iter().flat_map(|signal| {
                let named = given.iter().find(|(name, _)| *name == signal.name);
                named.map(|(name, channels)| (*name, *channels, signal.sides(size)))
            });
            let mut inputs: Vec<(Cow<'_, str>, SessionInputValue<'_>)> = Vec::new();
            for (name, channels, sides) in ordered {
                let sides: Vec<i64> = sides.into_iter().map(|side| side as i64).collect();
                let tensor = TensorRef::from_array_view((sides, &*channels.samples));
                let tensor = tensor.map_err(|error| error.to_string())?;
                inputs.push((name.into(), tensor.into()));
            }
            let outputs = session.run(inputs).map_err(|error| error.to_string())?;
            let mut answers = Vec::with_capacity(wanted.len());
            for name in wanted {
                let missing = || format!("no output {name:?}");
                let value = outputs.get(*name).ok_or_else(missing)?;
                let (shape, samples) = value
                    .try_extract_tensor::<f32>()
                    .map_err(|error| error.to_string())?;
                answers.push((shape.to_vec(), samples.to_vec()));
            }
            Ok(answers)
        });
        let answers = answers.map_err(|problem| self.failed(problem))?;
        state.runs += 1;
        state.milliseconds += began.elapsed().as_secs_f64() * 1e3;
        let outputs = wanted.iter().zip(answers);
        outputs
            .map(|(name, (shape, samples))| {
                let [_, count, height, width] = *shape.as_slice() else {
                    return Err(NetworkError::Output {
                        network: self.name(),
                        output: (*name).to_owned(),
                        problem: format!("has the shape {shape:?}"),
                    });
                };
                Ok(Channels {
                    size: (width as usize, height as usize),
                    count: count as usize,
                    samples,
                })
            })
            .collect()
    }

    fn record(&self) -> NetworkRecord {
        let (state, model) = (self.state.borrow(), &self.file.model);
        NetworkRecord {
            name: model.name.clone(),
            variant: model.variant.clone(),
            blake3: model.blake3.clone(),
            parameters: model.parameters,
            backend: self.runtime.backend.description(),
            threads: self.runtime.backend.threads(self.threads),
            runs: state.runs,
            milliseconds: state.milliseconds,
        }
    }
}

/// A session of bounded threads and memory. Sizes are fixed, so ONNX Runtime plans its memory once and
/// takes no more; without its arena each answer costs a fifth to a third more processor time and
/// saves 30 MiB at most.
fn build(runtime: &Runtime, threads: usize, bytes: &[u8]) -> Result<Session, String> {
    let words = |error: ort::Error<SessionBuilder>| error.to_string();
    let builder = Session::builder(&runtime.environment).map_err(|error| error.to_string())?;
    let mut builder = builder
        .with_optimization_level(GraphOptimizationLevel::All)
        .map_err(words)?;
    // tract knows none of these.
    if let Backend::OnnxRuntime { .. } = runtime.backend {
        builder = builder.with_intra_threads(threads).map_err(words)?;
        builder = builder.with_inter_threads(1).map_err(words)?;
        builder = builder.with_intra_op_spinning(false).map_err(words)?;
        builder = builder.with_memory_pattern(true).map_err(words)?;
        let cpu = ep::CPU::default().with_arena_allocator(true).build();
        builder = builder.with_execution_providers([cpu]).map_err(words)?;
    }
    let session = builder.commit_from_memory(bytes);
    session.map_err(|error| error.to_string())
}
