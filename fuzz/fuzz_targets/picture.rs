//! Fuzz target for libFuzzer: any picture and parameters to train from.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::picture(data));
