//! Fuzz target for libFuzzer: any points to triangulate.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::points(data));
