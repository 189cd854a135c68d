//! Every way in which a model can be wrong is refused in words, before or by the runtime.

use super::{folder, manifest, network, pictures, read};
use captured::{
    inference::{InferenceError, ModelFile, Settings},
    relight::networks::Network,
};

#[test]
fn evil_models_are_refused_before_a_runtime_sees_them() {
    struct Case(&'static str, &'static [&'static str]);
    for Case(variant, words) in [
        Case("external", &["external data", "k_16"]),
        Case("foreign", &["EPContext", "com.microsoft"]),
        Case("named_otherwise", &["inputs are points, not cloud"]),
        Case(
            "shaped_otherwise",
            &["\"cloud\"", "(1, 3, 64, 64)", "(1, 3, height, width)"],
        ),
        Case("typed_otherwise", &["element type 10", "not 1"]),
    ] {
        let message = read("shadow", variant).unwrap_err().to_string();
        for word in words
            .iter()
            .chain(&["--tier closed", &format!("shadow-{variant}.onnx")[..]])
        {
            assert!(
                message.contains(word),
                "{variant}: {word:?} is missing in {message}"
            );
        }
    }
}

#[test]
fn any_altered_byte_and_any_cut_is_refused() {
    let manifest = manifest();
    let model = manifest.model("shadow", "clean").unwrap();
    let path = folder().join(&model.file);
    let whole = std::fs::read(&path).unwrap();
    let accept = |bytes: &[u8]| ModelFile::accept(model, path.clone(), bytes);
    accept(&whole).unwrap();
    for at in 0..whole.len() {
        let mut altered = whole.clone();
        altered[at] ^= 1;
        let error = accept(&altered).unwrap_err();
        assert!(
            matches!(error, InferenceError::Hash { .. }),
            "byte {at}: {error}"
        );
        let error = accept(&whole[..at]).unwrap_err();
        assert!(
            matches!(error, InferenceError::Length { .. }),
            "cut at {at}: {error}"
        );
    }
    let longer = [whole, vec![0]].concat();
    let message = accept(&longer).unwrap_err().to_string();
    assert!(message.contains("more than 217"), "{message}");
}

#[test]
fn an_endless_file_is_read_no_further_than_the_manifest_states() {
    let manifest = manifest();
    let model = manifest.model("shadow", "clean").unwrap();
    let error = ModelFile::accept(model, "endless".into(), std::io::repeat(7)).unwrap_err();
    assert!(matches!(error, InferenceError::Length { .. }), "{error}");
}

#[test]
fn a_model_that_is_not_there_names_every_place_and_the_way_out() {
    let nowhere = Settings {
        models: Some("/nonexistent/models".into()),
        ..Settings::default()
    };
    let manifest = manifest();
    let model = manifest.model("shadow", "clean").unwrap();
    let message = ModelFile::read(model, &nowhere).unwrap_err().to_string();
    for word in [
        "shadow-clean.onnx",
        "/nonexistent/models",
        "--models DIR",
        "--tier closed",
    ] {
        assert!(message.contains(word), "{word:?} is missing in {message}");
    }
    let unsaid = ModelFile::read(model, &Settings::default())
        .unwrap_err()
        .to_string();
    assert!(unsaid.contains("share/captured/models"), "{unsaid}");
}

#[test]
fn a_graph_that_lies_about_its_outputs_fails_in_words() {
    // Accepted by hash and signals; only running it shows that it gives three channels, not one.
    let liar = network("shadow", "lying");
    let cloud = pictures(3, (32, 32), 1);
    match liar.answer(&[("cloud", &cloud)], &["shadow"]) {
        Err(error) => assert!(error.to_string().contains("shadow (lying)"), "{error}"),
        Ok(answers) => assert_eq!(answers[0].count, 3),
    }
}
