//! Fuzz target for libFuzzer: any bytes as a PNG or JPEG file, or as a frame of Motion-JPEG.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::file(data));
