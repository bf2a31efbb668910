//! Fuzz target for libFuzzer: any pixels as a frame.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::frame(data));
