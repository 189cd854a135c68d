//! What a command says when it is done.

use serde::Serialize;

/// The answer of one command, in both forms.
#[derive(Debug, Clone)]
pub struct Answer {
    /// For people; lines without a last line break.
    pub text: String,
    /// For scripts: one object.
    pub json: serde_json::Value,
    /// What lowers the trust in the answer; also under `warnings` in `json`.
    pub warnings: Vec<String>,
    /// How it was done, for standard error.
    pub note: Option<String>,
    /// Exit code of the process.
    pub exit_code: u8,
}

impl Answer {
    /// An answer without warnings.
    pub(super) fn new(text: impl Into<String>, json: &impl Serialize) -> Self {
        // Our own types have string keys and no failing serialisers; NaN becomes null.
        let json = serde_json::to_value(json).unwrap_or_default();
        Self {
            text: text.into(),
            json,
            warnings: Vec::new(),
            note: None,
            exit_code: 0,
        }
    }

    /// The same answer with its warnings.
    pub(super) fn with_warnings(mut self, warnings: Vec<String>) -> Self {
        if let Some(object) = self.json.as_object_mut() {
            object.insert("warnings".to_owned(), warnings.clone().into());
        }
        self.warnings = warnings;
        self
    }

    /// The same answer with how it was done.
    pub(super) fn with_note(mut self, note: String) -> Self {
        self.note = Some(note);
        self
    }
}
