//! Every parser of bytes from outside under thousands of small lies, the same ones each time.
//!
//! `fuzz/` holds the parsers, what they are fed, and the same for a fuzzer that goes on for hours.

#[path = "../fuzz/parsers.rs"]
mod parsers;

use drivers::chance::Chance;
use parsers::PARSERS;
use std::{
    panic::catch_unwind,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// Longest time for one input. All of them are small; a hang would take for ever.
const PATIENCE: Duration = Duration::from_secs(20);

fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/corpus")
        .join(name);
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    let read = |path: PathBuf| {
        let bytes = std::fs::read(&path).unwrap();
        (path, bytes)
    };
    files.into_iter().map(read).collect()
}

/// Numbers that parsers stumble over.
const EDGES: [u64; 10] = [
    0,
    1,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    u64::MAX,
];
/// Words that parsers of text stumble over.
const WORDS: [&[u8]; 12] = [
    b"nan",
    b"-1",
    b"1e999",
    b"18446744073709551616",
    b"\"",
    b"[[[[[[[[",
    b"{",
    b"null",
    b"\0",
    b"\xff\xfe",
    b"=",
    b"\n",
];

struct Mutator(Chance, u64);

impl Mutator {
    fn below(&mut self, end: usize) -> usize {
        self.1 += 1;
        (self.0.unit(self.1) * end as f64) as usize
    }

    /// A few lies in what was true, or in a cut of it, or with a piece of something else of its kind.
    fn mutated(&mut self, seed: &[u8], other: &[u8]) -> Vec<u8> {
        let mut bytes = seed.to_vec();
        for _ in 0..=self.below(3) {
            let at = self.below(bytes.len() + 1);
            match self.below(7) {
                0 => bytes.truncate(at),
                1 => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte ^= 1 << self.below(8);
                    }
                }
                2 => {
                    let edge = EDGES[self.below(EDGES.len())].to_le_bytes();
                    let width = 1 << self.below(4);
                    let end = (at + width).min(bytes.len());
                    bytes[at..end].copy_from_slice(&edge[..end - at]);
                }
                3 => {
                    let end = at + self.below(bytes.len() - at + 1);
                    bytes.drain(at..end.min(at + 64));
                }
                4 => {
                    let end = at + self.below(bytes.len() - at + 1).min(64);
                    let piece = bytes[at..end].to_vec();
                    bytes.splice(at..at, piece);
                }
                5 => {
                    let word = WORDS[self.below(WORDS.len())];
                    bytes.splice(at..at, word.iter().copied());
                }
                _ => {
                    let from = self.below(other.len() + 1);
                    let end = from + self.below(other.len() - from + 1).min(64);
                    let reach = (at + end - from).min(bytes.len());
                    bytes.splice(at..reach, other[from..end].iter().copied());
                }
            }
        }
        bytes
    }
}

/// Feeds each parser its corpus and so many mutations of each file in it; how many it took all the same.
fn feed(each: usize) -> (usize, usize) {
    let (mut inputs, mut taken) = (0, 0);
    for (name, parser) in PARSERS {
        let seeds = corpus(name);
        for (path, seed) in &seeds {
            // What points outside itself is the one thing among them that is refused.
            let refused = path.ends_with("shadow-external.onnx");
            assert_eq!(parser(seed), !refused, "{}", path.display());
            let of_this = blake3::hash(seed).as_bytes()[0];
            let mut mutator = Mutator(Chance::new(u64::from(of_this)), 0);
            for number in 0..each {
                let other = &seeds[mutator.below(seeds.len())].1;
                let bytes = mutator.mutated(seed, other);
                let began = Instant::now();
                let found = catch_unwind(|| parser(&bytes));
                let told = || {
                    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{name}"));
                    std::fs::write(&kept, &bytes).unwrap();
                    format!(
                        "{}, mutation {number}: {} holds it",
                        path.display(),
                        kept.display()
                    )
                };
                assert!(found.is_ok(), "panic: {}", told());
                assert!(began.elapsed() < PATIENCE, "too slow: {}", told());
                inputs += 1;
                taken += usize::from(found.unwrap());
            }
        }
    }
    (inputs, taken)
}

#[test]
fn no_lie_in_a_file_or_a_request_brings_a_parser_down() {
    let (inputs, taken) = feed(150);
    eprintln!(
        "figure | mutated files and requests | {inputs} to {} parsers, {taken} of them still valid, 0 panics",
        PARSERS.len()
    );
    // Mutations that are all refused at the first byte, or all taken, would prove little.
    assert!(
        taken > inputs / 100 && taken < inputs / 2,
        "{taken} of {inputs}"
    );
}

#[test]
#[ignore = "the long form"]
fn no_lie_of_a_hundred_thousand_brings_a_parser_down() {
    let (inputs, taken) = feed(5000);
    eprintln!(
        "figure | mutated files and requests (long) | {inputs} to {} parsers, {taken} of them still valid, 0 panics",
        PARSERS.len()
    );
    assert!(inputs >= 100_000, "{inputs}");
}
