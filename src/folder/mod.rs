//! The capture folder: the plain form a capture is read from.
