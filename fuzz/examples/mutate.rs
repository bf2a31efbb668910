//! Runs fuzz targets on mutated seeds, without libFuzzer: any stable compiler does.
//!
//! In: seconds, the folder of the seeds, names of targets (all unless given). Out: the number of
//! inputs. A panic leaves its input in `FOLDER/TARGET-failed` and ends the program with status 1.
//! The inputs are always the same and in this order; how many are run depends on the machine.
//! An input is a seed that was changed in one to eight places. Memory: the seeds.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};
use std::{env, fs, io, process};

use keygraph::random::Random;
use keygraph_fuzz::targets::ALL;

/// Numbers at which lengths and indices go wrong.
const EDGES: [u32; 8] = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, u32::MAX];

fn main() -> io::Result<()> {
    let mut arguments = env::args().skip(1);
    let seconds = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(20);
    let folder = arguments.next().unwrap_or_else(|| "seeds".into());
    let names: Vec<String> = arguments.collect();
    for (name, run) in ALL.iter().filter(|t| names.is_empty() || names.iter().any(|n| n == t.0)) {
        let mut paths: Vec<_> =
            fs::read_dir(Path::new(&folder).join(name))?.map(|e| Ok(e?.path())).collect::<io::Result<_>>()?;
        paths.sort();
        let seeds: Vec<Vec<u8>> = paths.iter().map(fs::read).collect::<io::Result<_>>()?;
        let (start, mut random, mut inputs) = (Instant::now(), Random::new(1), 0);
        while inputs < seeds.len() || start.elapsed() < Duration::from_secs(seconds) {
            // Every seed is run as it is, too.
            let input = seeds.get(inputs).cloned().unwrap_or_else(|| mutate(&seeds, &mut random));
            if catch_unwind(AssertUnwindSafe(|| run(&input))).is_err() {
                let path = format!("{folder}/{name}-failed");
                fs::write(&path, &input)?;
                eprintln!("{name} failed; its input is {path}");
                process::exit(1);
            }
            inputs += 1;
        }
        println!("{name}: {inputs} inputs, no panic");
    }
    Ok(())
}

/// Changes a seed in a few places.
fn mutate(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut below = |n: usize| (random.bits() % n.max(1) as u64) as usize;
    let mut bytes = seeds[below(seeds.len())].clone();
    for _ in 0..=below(8) {
        // Half of the changes are near the start, where the headers are.
        let reach = if below(2) == 0 { bytes.len().min(128) } else { bytes.len() };
        let at = below(reach).min(bytes.len());
        let order = below(8);
        let length = (1 + below(1 << order)).min(bytes.len() - at);
        match below(7) {
            0 if at < bytes.len() => bytes[at] ^= 1 << below(8),
            1 if at < bytes.len() => bytes[at] = below(256) as u8,
            2 => {
                let edge = EDGES[below(EDGES.len())].to_le_bytes();
                let n = [1, 2, 4][below(3)].min(bytes.len() - at);
                bytes[at..at + n].copy_from_slice(&edge[..n]);
            }
            3 => drop(bytes.drain(at..at + length)),
            4 => {
                let part = bytes[at..at + length].to_vec();
                bytes.splice(at..at, part);
            }
            5 => {
                let other = &seeds[below(seeds.len())];
                let from = below(other.len()).min(other.len());
                let part = other[from..other.len().min(from + length)].to_vec();
                let end = bytes.len().min(at + part.len());
                bytes.splice(at..end, part);
            }
            _ => {
                let value = below(256) as u8;
                bytes[at..at + length].fill(value);
            }
        }
    }
    bytes
}
