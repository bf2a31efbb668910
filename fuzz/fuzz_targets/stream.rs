//! Fuzz target for libFuzzer: any bytes as a YUV4MPEG2 stream.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| keygraph_fuzz::targets::stream(data));
