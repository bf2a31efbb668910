//! Fuzz target for libFuzzer: any bytes as a model.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::model(data));
