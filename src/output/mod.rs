//! Encoded results: PNG, EXR, the contact sheet and `shot.json`.
