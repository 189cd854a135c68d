//! The road a shot takes, every stage by name.
