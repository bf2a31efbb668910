//! Fuzz target for libFuzzer: frames in order for the tracker.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::sequence(data));
