//! Times the coarse and the exact functions of core's `math`.
//!
//! Each pass takes 20,000 arguments, more than a processor can learn. The bench times angles of
//! random vectors by `coarse_atan2` (micromath) and by libm, and square roots by micromath, by libm
//! and by `coarse_sqrt`. It checks the accuracy of each function first. The decision behind the
//! split is `docs/decisions/0002-float-math.md`.
//!
//! `cargo bench -p keygraph-benches --bench float_math`
#![allow(clippy::cast_possible_truncation, missing_docs)]

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use keygraph_core::stages::math;
use micromath::F32Ext;

const COUNT: usize = 20_000;

/// Returns pseudo-random numbers. Every run gives the same numbers.
fn numbers() -> impl Iterator<Item = u64> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        state >> 16
    })
}

/// Returns the sum of `f` over `arguments`. The sum keeps the compiler from removing calls.
fn sum<T: Copy>(arguments: &[T], f: impl Fn(T) -> f32) -> f32 {
    black_box(arguments).iter().map(|&a| f(a)).sum()
}

fn bench(c: &mut Criterion) {
    // Vectors as they occur in keygraph angles: coordinates of up to 1,000,000.
    let mut coordinate = numbers().map(|n| (n % 2_000_001) as f32 - 1_000_000.0);
    let vectors: Vec<(f32, f32)> = coordinate
        .by_ref()
        .zip(numbers().skip(1))
        .map(|(x, n)| (x, (n % 1_000_000) as f32 + 1.0))
        .take(COUNT)
        .collect();
    let roots: Vec<f32> = numbers().map(|n| (n % 1_000_000) as f32).take(COUNT).collect();

    let turn = |a: f32, y: f32, x: f32| (f64::from(a) - f64::from(y).atan2(f64::from(x))).abs();
    for &(y, x) in &vectors {
        assert!(turn(math::coarse_atan2(y, x), y, x) < 3e-3, "coarse_atan2({y}, {x})");
        assert!(turn(libm::atan2f(y, x), y, x) < 1e-6, "atan2f({y}, {x})");
    }
    for &x in &roots {
        assert_eq!(math::sqrt(x), x.sqrt(), "sqrt({x})");
        assert!((F32Ext::sqrt(x) - x.sqrt()).abs() <= 0.07 * x.sqrt(), "micromath sqrt({x})");
        assert!((math::coarse_sqrt(x) - x.sqrt()).abs() <= 3e-7 * x.sqrt(), "coarse_sqrt({x})");
    }

    let mut group = c.benchmark_group("float_math");
    group
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .throughput(Throughput::Elements(COUNT as u64));
    group.bench_function("atan2: coarse_atan2", |b| b.iter(|| sum(&vectors, |(y, x)| math::coarse_atan2(y, x))));
    group.bench_function("atan2: libm", |b| b.iter(|| sum(&vectors, |(y, x)| libm::atan2f(y, x))));
    group.bench_function("sqrt: micromath", |b| b.iter(|| sum(&roots, F32Ext::sqrt)));
    group.bench_function("sqrt: libm", |b| b.iter(|| sum(&roots, math::sqrt)));
    group.bench_function("sqrt: coarse_sqrt", |b| b.iter(|| sum(&roots, math::coarse_sqrt)));
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
