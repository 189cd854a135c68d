//! An ONNX file looked through before any runtime sees it.
//!
//! Field numbers: `onnx.proto3` of ONNX 1.18. Every place where a tensor can stand is visited, also
//! repeated and nested ones, since a decoder may merge or follow any of them.

use super::protobuf::{Broken, Field, Value, fields};
use thiserror::Error;

/// Graphs within graphs, deeper than any exporter nests them.
const DEEPEST: usize = 16;
/// `TensorProto.FLOAT`.
pub(super) const FLOAT: u64 = 1;

/// Why a file is not handed to a runtime.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum OnnxError {
    #[error("not a whole ONNX model: {0}")]
    Broken(#[from] Broken),
    #[error("not a whole ONNX model: {0}")]
    Shape(&'static str),
    #[error("tensor {tensor:?} has external data, in a file of its own, which is never followed")]
    External { tensor: String },
    #[error("operator {operator:?} is of the domain {domain:?}; only ONNX's own are run")]
    Domain { operator: String, domain: String },
}

/// An input or output of a graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GraphSignal {
    /// Its name.
    pub name: String,
    /// Element type, as ONNX numbers them; 1 = 32-bit float.
    pub element: u64,
    /// One entry per dimension, `None` where it is free; `None` for a signal without a shape.
    pub dimensions: Option<Vec<Option<u64>>>,
}

/// What a file says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inspected {
    /// What it takes, without what it holds itself.
    pub inputs: Vec<GraphSignal>,
    /// What it gives.
    pub outputs: Vec<GraphSignal>,
}

/// Looks through a whole file.
///
/// # Errors
/// [`OnnxError::External`] for any tensor with a part in another file, wherever it stands;
/// [`OnnxError::Domain`] for operators that are not ONNX's own; otherwise for bytes that are no
/// model of one graph.
pub fn inspect(bytes: &[u8]) -> Result<Inspected, OnnxError> {
    let mut found = None;
    for field in fields(bytes) {
        let Field { number, value, .. } = field?;
        match number {
            7 if found.is_some() => return Err(OnnxError::Shape("it has two graphs")),
            7 => {
                graph(value.bytes(), 0)?;
                found = Some(signals(value.bytes())?);
            }
            // TrainingInfoProto: initialization and algorithm are graphs.
            20 => each(value.bytes(), &[1, 2], |inner| graph(inner, 1))?,
            25 => function(value.bytes())?,
            _ => {}
        }
    }
    found.ok_or(OnnxError::Shape("it has no graph"))
}

/// Runs `visit` on every message in one of the fields `numbers`.
fn each(
    message: &[u8],
    numbers: &[u32],
    mut visit: impl FnMut(&[u8]) -> Result<(), OnnxError>,
) -> Result<(), OnnxError> {
    for field in fields(message) {
        let Field { number, value, .. } = field?;
        if numbers.contains(&number) {
            visit(value.bytes())?;
        }
    }
    Ok(())
}

fn graph(message: &[u8], depth: usize) -> Result<(), OnnxError> {
    if depth > DEEPEST {
        return Err(OnnxError::Shape("its graphs are nested too deep"));
    }
    each(message, &[1], |inner| node(inner, depth))?;
    each(message, &[5], tensor)?;
    each(message, &[15], sparse)
}

fn function(message: &[u8]) -> Result<(), OnnxError> {
    each(message, &[7], |inner| node(inner, 1))?;
    each(message, &[11], |inner| attribute(inner, 1))
}

fn node(message: &[u8], depth: usize) -> Result<(), OnnxError> {
    each(message, &[5], |inner| attribute(inner, depth))?;
    let mut words = [String::new(), String::new()];
    for field in fields(message) {
        let Field { number, value, .. } = field?;
        // Of a field given twice the last counts.
        match number {
            4 => words[0] = text(value),
            7 => words[1] = text(value),
            _ => {}
        }
    }
    let [operator, domain] = words;
    if domain.is_empty() || domain == "ai.onnx" {
        Ok(())
    } else {
        Err(OnnxError::Domain { operator, domain })
    }
}

fn attribute(message: &[u8], depth: usize) -> Result<(), OnnxError> {
    each(message, &[5, 10], tensor)?;
    each(message, &[22, 23], sparse)?;
    each(message, &[6, 11], |inner| graph(inner, depth + 1))
}

fn sparse(message: &[u8]) -> Result<(), OnnxError> {
    each(message, &[1, 2], tensor)
}

fn tensor(message: &[u8]) -> Result<(), OnnxError> {
    let (mut external, mut name) = (false, String::new());
    for field in fields(message) {
        let Field { number, value, .. } = field?;
        match number {
            8 => name = text(value),
            13 => external = true,
            14 => external |= value != Value::Number(0),
            _ => {}
        }
    }
    if external {
        return Err(OnnxError::External { tensor: name });
    }
    Ok(())
}

fn text(value: Value<'_>) -> String {
    String::from_utf8_lossy(value.bytes()).into_owned()
}

fn signals(graph: &[u8]) -> Result<Inspected, OnnxError> {
    let (mut inputs, mut outputs, mut held) = (Vec::new(), Vec::new(), Vec::new());
    for field in fields(graph) {
        let Field { number, value, .. } = field?;
        match number {
            5 => each(value.bytes(), &[8], |name| {
                held.push(String::from_utf8_lossy(name).into_owned());
                Ok(())
            })?,
            11 => inputs.push(signal(value.bytes())?),
            12 => outputs.push(signal(value.bytes())?),
            _ => {}
        }
    }
    inputs.retain(|input| !held.contains(&input.name));
    Ok(Inspected { inputs, outputs })
}

/// A ValueInfoProto.
fn signal(message: &[u8]) -> Result<GraphSignal, OnnxError> {
    let mut found = GraphSignal {
        name: String::new(),
        element: 0,
        dimensions: None,
    };
    for field in fields(message) {
        let Field { number, value, .. } = field?;
        match number {
            1 => found.name = text(value),
            // TypeProto.tensor_type
            2 => each(value.bytes(), &[1], |tensor| {
                for field in fields(tensor) {
                    let Field { number, value, .. } = field?;
                    match (number, value) {
                        (1, Value::Number(element)) => found.element = element,
                        (2, Value::Bytes(shape)) => {
                            let all = found.dimensions.get_or_insert_default();
                            each(shape, &[1], |one| {
                                all.push(dimension(one)?);
                                Ok(())
                            })?;
                        }
                        _ => {}
                    }
                }
                Ok(())
            })?,
            _ => {}
        }
    }
    Ok(found)
}

/// The fixed size, where there is one.
fn dimension(message: &[u8]) -> Result<Option<u64>, OnnxError> {
    let mut fixed = None;
    for field in fields(message) {
        match field? {
            Field {
                number: 1,
                value: Value::Number(size),
                ..
            } => fixed = Some(size),
            Field { number: 2, .. } => fixed = None,
            _ => {}
        }
    }
    Ok(fixed)
}

#[cfg(test)]
mod tests {
    use super::super::protobuf::{message, put_number};
    use super::*;
    use proptest::prelude::*;

    /// A tensor whose data_location says EXTERNAL.
    fn outside() -> Vec<u8> {
        let mut tensor = message(8, b"weights");
        put_number(&mut tensor, 14, 1);
        tensor
    }

    #[test]
    fn external_data_is_found_wherever_a_tensor_can_stand() {
        let listed = [message(8, b"weights"), message(13, b"")].concat();
        let node = |attribute: &[u8]| message(1, &message(5, attribute));
        let places = [
            ("initializer", message(7, &message(5, &outside()))),
            ("external_data alone", message(7, &message(5, &listed))),
            (
                "sparse values",
                message(7, &message(15, &message(1, &outside()))),
            ),
            (
                "sparse indices",
                message(7, &message(15, &message(2, &outside()))),
            ),
            ("attribute", message(7, &node(&message(5, &outside())))),
            (
                "attribute's list",
                message(7, &node(&message(10, &outside()))),
            ),
            (
                "sparse attribute",
                message(7, &node(&message(22, &message(1, &outside())))),
            ),
            (
                "sparse attributes",
                message(7, &node(&message(23, &message(2, &outside())))),
            ),
            (
                "subgraph",
                message(7, &node(&message(6, &message(5, &outside())))),
            ),
            (
                "subgraphs",
                message(7, &node(&message(11, &message(5, &outside())))),
            ),
            (
                "function",
                message(25, &message(7, &message(5, &message(5, &outside())))),
            ),
            (
                "function's default",
                message(25, &message(11, &message(5, &outside()))),
            ),
            (
                "training",
                message(20, &message(2, &message(5, &outside()))),
            ),
        ];
        for (place, bytes) in places {
            // Behind a sound graph, as a second thought.
            let bytes = if place == "function" || place == "training" {
                [message(7, b""), bytes].concat()
            } else {
                bytes
            };
            assert_eq!(
                inspect(&bytes),
                Err(OnnxError::External {
                    tensor: "weights".into()
                }),
                "{place}"
            );
        }
    }

    #[test]
    fn foreign_operators_endless_nesting_and_no_graph_are_refused() {
        let foreign = [message(4, b"EPContext"), message(7, b"com.microsoft")].concat();
        assert!(matches!(
            inspect(&message(7, &message(1, &foreign))),
            Err(OnnxError::Domain { .. })
        ));
        let mut graph = vec![];
        for _ in 0..100 {
            graph = message(1, &message(5, &message(6, &graph)));
        }
        for bytes in [message(7, &graph), vec![], message(7, b"").repeat(2)] {
            assert!(matches!(inspect(&bytes), Err(OnnxError::Shape(_))));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_inspected_or_refused_but_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            drop(inspect(&message(7, &bytes)));
            drop(inspect(&bytes));
        }
    }
}
