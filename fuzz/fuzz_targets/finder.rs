//! Fuzz target for libFuzzer: any keypoints and triples.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::finder(data));
