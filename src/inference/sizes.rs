//! The size of one picture, written into a model that is shipped for any.

use super::{
    onnx::{FLOAT, OnnxError},
    protobuf::{fields, put_bytes, put_number},
};

/// The same model for one size: its signals become those of `inputs` and `outputs` (name and
/// dimensions, 32-bit float), and notes on sizes between are left out. tract works out everything
/// ahead for one size; ONNX Runtime plans its memory better.
///
/// # Errors
/// [`OnnxError::Broken`] for bytes that [`super::inspect`] refuses too.
pub(super) fn with_sizes(
    bytes: &[u8],
    inputs: &[(String, Vec<u64>)],
    outputs: &[(String, Vec<u64>)],
) -> Result<Vec<u8>, OnnxError> {
    let mut model = Vec::with_capacity(bytes.len());
    for field in fields(bytes) {
        let field = field?;
        if field.number != 7 {
            model.extend_from_slice(field.raw);
            continue;
        }
        let mut graph = Vec::with_capacity(bytes.len());
        for (number, signals) in [(11, inputs), (12, outputs)] {
            for (name, dimensions) in signals {
                put_bytes(&mut graph, number, &sized(name, dimensions));
            }
        }
        for field in fields(field.value.bytes()) {
            let field = field?;
            if !matches!(field.number, 11..=13) {
                graph.extend_from_slice(field.raw);
            }
        }
        put_bytes(&mut model, 7, &graph);
    }
    Ok(model)
}

/// A ValueInfoProto of floats.
fn sized(name: &str, dimensions: &[u64]) -> Vec<u8> {
    let (mut shape, mut tensor, mut kind, mut signal) = (vec![], vec![], vec![], vec![]);
    for &size in dimensions {
        let mut dimension = vec![];
        put_number(&mut dimension, 1, size);
        put_bytes(&mut shape, 1, &dimension);
    }
    put_number(&mut tensor, 1, FLOAT);
    put_bytes(&mut tensor, 2, &shape);
    put_bytes(&mut kind, 1, &tensor);
    put_bytes(&mut signal, 1, name.as_bytes());
    put_bytes(&mut signal, 2, &kind);
    signal
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::{inspect, protobuf::message};

    #[test]
    fn sizes_are_written_in_and_read_back() {
        let free = [message(1, b"flash"), message(2, &message(1, b"\x08\x01"))].concat();
        let model = [b"\x08\x08".to_vec(), message(7, &message(11, &free))].concat();
        let inputs = [("flash".to_owned(), vec![1, 3, 64, 300])];
        let fixed = with_sizes(
            &model,
            &inputs,
            &[("albedo".to_owned(), vec![1, 3, 64, 300])],
        )
        .unwrap();
        let found = inspect(&fixed).unwrap();
        let sizes = Some([1, 3, 64, 300].map(Some).to_vec());
        assert_eq!(found.inputs[0].dimensions, sizes);
        assert_eq!(
            (found.outputs[0].name.as_str(), found.inputs.len()),
            ("albedo", 1)
        );
        assert!(fixed.starts_with(b"\x08\x08"));
    }
}
