//! Fuzz target for libFuzzer: any headers, tokens and outlines of a request.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::request(data));
