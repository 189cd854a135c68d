//! What runs the networks: chosen by what is there, never by crashing, and alike in its answers.

use super::{folder, manifest, pictures, settings};
use captured::{
    inference::{Manifest, ModelFile, NetworkSession, Runtime, Settings, find},
    relight::networks::{Channels, Network},
};
use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Names the file that [`answers_of_this_process`] writes; a backend is chosen once per process, so
/// each has one of its own.
const ANSWERS: &str = "CAPTURED_TEST_ANSWERS";

/// ONNX Runtime on this machine, also where Python's package holds it.
fn library() -> Option<PathBuf> {
    if let Ok(found) = find(&Settings::default()) {
        return Some(found.path);
    }
    let script = "import glob, os, onnxruntime as o; print(glob.glob(os.path.join(os.path.dirname(o.__file__), 'capi', 'libonnxruntime.so*'))[0])";
    let output = Command::new("python3").args(["-c", script]).output().ok()?;
    let path = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim());
    path.exists().then_some(path)
}

/// Runs [`answers_of_this_process`] with a library, and reads what it wrote.
fn answers(library: &Path) -> (String, Vec<f32>) {
    let file = tempfile::NamedTempFile::new().unwrap();
    let done = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "backends::answers_of_this_process"])
        .env("ORT_DYLIB_PATH", library)
        .env(ANSWERS, file.path())
        .output()
        .unwrap();
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stdout)
    );
    let text = std::fs::read_to_string(file.path()).unwrap();
    let (backend, numbers) = text.split_once('\n').unwrap();
    let bits = numbers.split_whitespace();
    let numbers = bits
        .map(|bits| f32::from_bits(bits.parse().unwrap()))
        .collect();
    (backend.to_owned(), numbers)
}

/// The tiny networks, and the shipped ones where their files are there.
fn every_model() -> Vec<ModelFile> {
    let (shipped, tiny) = (Manifest::embedded().unwrap(), manifest());
    let tiny = tiny
        .models()
        .iter()
        .filter(|model| model.variant == "clean");
    let tiny = tiny.map(|model| ModelFile::read(model, &settings()).unwrap());
    let own = Settings::default();
    let shipped = shipped.models().iter();
    let shipped = shipped.filter_map(|model| ModelFile::read(model, &own).ok());
    tiny.chain(shipped).collect()
}

#[test]
fn answers_of_this_process() {
    let runtime = Runtime::start(&Settings::default()).unwrap();
    let mut text = format!("{}\n", runtime.backend.description());
    for (seed, file) in every_model().into_iter().enumerate() {
        let (inputs, outputs) = (file.model.inputs.clone(), file.model.outputs.clone());
        let given: Vec<(String, Channels)> = inputs
            .iter()
            .map(|input| {
                (
                    input.name.clone(),
                    pictures(input.channels() as usize, (64, 96), seed),
                )
            })
            .collect();
        let given: Vec<(&str, &Channels)> = given.iter().map(|(n, c)| (n.as_str(), c)).collect();
        let wanted: Vec<&str> = outputs.iter().map(|output| output.name.as_str()).collect();
        let session = NetworkSession::new(file, runtime, 2);
        for answer in session.answer(&given, &wanted).unwrap() {
            assert!(answer.samples.iter().all(|value| value.is_finite()));
            let bits = answer
                .samples
                .iter()
                .map(|value| value.to_bits().to_string());
            text.push_str(&bits.collect::<Vec<_>>().join(" "));
            text.push('\n');
        }
    }
    if let Some(path) = std::env::var_os(ANSWERS) {
        std::fs::write(path, text).unwrap();
    }
}

#[test]
fn both_backends_give_the_same_answers() {
    let Some(library) = library() else {
        eprintln!(
            "SKIPPED: no ONNX Runtime here to compare tract with; `capturectl runtime fetch` says how to get it"
        );
        return;
    };
    let (ort, by_ort) = answers(&library);
    let (tract, by_tract) = answers(Path::new("/nonexistent/libonnxruntime.so"));
    assert!(
        ort.starts_with("ONNX Runtime 1.") && tract.starts_with("tract"),
        "{ort}, {tract}"
    );
    assert_eq!(by_ort.len(), by_tract.len());
    let differences = by_ort.iter().zip(&by_tract).map(|(a, b)| (a - b).abs());
    let largest = differences.fold(0.0, f32::max);
    eprintln!(
        "largest difference of {} answers: {largest:e}",
        by_ort.len()
    );
    // The promise of the manual; sums in another order differ by some 1e-6.
    assert!(largest < 1e-3, "{largest}");
}

fn status(arguments: &[&str]) -> serde_json::Value {
    let output = Command::new(env!("CARGO_BIN_EXE_capturectl"))
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .args(["runtime", "status", "--json"])
        .args(arguments)
        .env_remove("ORT_DYLIB_PATH")
        .output()
        .unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && !err.contains("panicked"),
        "{err}"
    );
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_library_that_cannot_be_used_leaves_tract_and_a_warning() {
    let scratch = tempfile::tempdir().unwrap();
    let text = scratch.path().join("text.so");
    std::fs::write(&text, "no library").unwrap();
    // Looks right and does not load: a header, the marks, and nothing else.
    let hollow = scratch.path().join("hollow.so");
    let program = std::fs::read(std::env::current_exe().unwrap()).unwrap();
    let mut bytes = program[..64].to_vec();
    bytes[16] = 3;
    bytes.extend_from_slice(b"OrtGetApiBase\0VERS_1.32.0\0");
    std::fs::write(&hollow, bytes).unwrap();
    struct Case<'a>(&'a Path, &'a str);
    for Case(path, words) in [
        Case(
            Path::new("/nonexistent/libonnxruntime.so"),
            "cannot be read",
        ),
        Case(&text, "no shared library"),
        Case(&hollow, "cannot be loaded"),
    ] {
        let status = status(&["--runtime", path.to_str().unwrap()]);
        assert_eq!(status["backend"]["name"], "tract", "{status}");
        let warning = status["warnings"][0].as_str().unwrap();
        assert!(
            warning.contains(words) && warning.contains("tract"),
            "{warning}"
        );
    }
}

#[test]
fn the_status_names_the_library_its_version_and_the_threads() {
    let Some(library) = library() else {
        eprintln!("SKIPPED: no ONNX Runtime here to say the status of");
        return;
    };
    let status = status(&["--runtime", library.to_str().unwrap(), "--threads", "2"]);
    assert_eq!(status["backend"]["name"], "onnx_runtime");
    assert_eq!(status["threads"], 2);
    assert!(
        status["backend"]["version"]
            .as_str()
            .unwrap()
            .starts_with("1.")
    );
    assert!(folder().exists() && status["warnings"].as_array().is_none_or(Vec::is_empty));
}
