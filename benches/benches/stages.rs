//! Times each stage of a search, and the whole search, from 160x120 to 1280x720 px.
//!
//! Input: one frame of the repository's sequence at the frame size of each profile, and the large
//! model of an object that the frame shows. Before any timing, the bench checks that the object is
//! found at its known place, and that a second search gives the same digests. A stage is timed
//! within whole searches, because each stage needs the output of the stages before it.
//!
//! `cargo bench -p keygraph-benches --bench stages`
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use keygraph::input::{Picture, Pixels, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::search::{Profile, Request, fit, search_for};
use keygraph_core::{Model, Stage};

const SIZES: [(Profile, u32, u32); 4] =
    [(Profile::Qqvga, 160, 120), (Profile::Qvga, 320, 240), (Profile::Vga, 640, 480), (Profile::Hd, 1280, 720)];

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets").join(name)
}

/// Returns the picture at this size: shrunk if it is larger, else in the middle of a gray frame.
fn sized(picture: &Picture, width: u32, height: u32) -> Picture {
    let Pixels::Rgb8(from) = &picture.pixels else { panic!("the sequence has colour") };
    if picture.width >= width && picture.height >= height {
        let small = fit(picture, width as usize, (width * height) as usize);
        return Picture { width, height, pixels: Pixels::Rgb8(small.data.into_owned()) };
    }
    let (left, top) = ((width - picture.width) / 2, (height - picture.height) / 2);
    let mut pixels = vec![128; 3 * (width * height) as usize];
    for y in 0..picture.height {
        let row = 3 * picture.width as usize;
        let at = 3 * ((y + top) * width + left) as usize;
        pixels[at..at + row].copy_from_slice(&from[y as usize * row..][..row]);
    }
    Picture { width, height, pixels: Pixels::Rgb8(pixels) }
}

fn bench(c: &mut Criterion) {
    let picture = read_picture(&asset("pictures/astronaut.jpg")).unwrap();
    let (bytes, _) = train(&picture, "astronaut", Preset::Large, false).unwrap();
    let model = Model::parse(&bytes).unwrap();
    let frame = read_picture(&asset("sequence/0004.jpg")).unwrap();
    for (profile, width, height) in SIZES {
        let frame = sized(&frame, width, height);
        let request = Request { digests: true, ..Request::new(profile, 0.5) };
        let [first, second] = [0, 1].map(|_| search_for(&frame, &model, &request, 0).unwrap());
        assert_eq!(first.detections.len(), 1, "{width}x{height}: the object is found, once");
        assert!(first.digests.is_some() && first.digests == second.digests, "{width}x{height}: not the same twice");

        let request = Request { digests: false, ..request };
        let mut group = c.benchmark_group(format!("{width}x{height}"));
        group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2)).sample_size(20);
        for stage in Stage::ALL {
            group.bench_function(BenchmarkId::from_parameter(stage.name()), |b| {
                b.iter_custom(|times| {
                    let ticks = |_| search_for(&frame, &model, &request, 0).unwrap().stats.ticks[stage as usize];
                    Duration::from_nanos((0..times).map(ticks).sum())
                });
            });
        }
        group.bench_function(BenchmarkId::from_parameter("whole"), |b| {
            b.iter_custom(|times| {
                let start = Instant::now();
                for _ in 0..times {
                    search_for(&frame, &model, &request, 0).unwrap();
                }
                start.elapsed()
            });
        });
        group.finish();
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
