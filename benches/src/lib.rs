//! Holds the package together: the timings are in `benches/benches`, run by `cargo bench -p keygraph-benches`.
