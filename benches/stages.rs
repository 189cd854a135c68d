//! Medians of every stage against a plain memory copy of the same bytes, on two threads.

fn main() {}
