//! Empty library that holds the package together. The timings are in `benches/benches`: run them
//! with `cargo bench -p keygraph-benches`.
