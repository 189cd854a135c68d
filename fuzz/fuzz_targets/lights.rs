#![no_main]
#[path = "../parsers.rs"]
#[allow(dead_code, reason = "the parsers of the other targets")]
mod parsers;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    parsers::lights(bytes);
});
