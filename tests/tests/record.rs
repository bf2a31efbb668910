//! Checks that the records of what was measured are of the search as it is.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use keygraph::bench::{Plan, bench};
use keygraph::input::{Source, read_picture};
use keygraph::learn::{Preset, train};
use keygraph::search::{Profile, Request};
use keygraph_core::{DEFAULT_THRESHOLD, Model};
use keygraph_tests::file;
use serde_json::Value;

/// Numbers of figures, which lie beside their figures.
const FIGURES: [&str; 4] = ["curves", "economy", "growth", "look-alikes"];

/// Records that pages cannot do without.
const NEEDED: [&str; 5] = ["accuracy", "calibration", "costs", "precision", "rivals"];

/// Returns the files of all records.
fn records() -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = FIGURES.iter().map(|f| file(&format!("docs/{f}.json"))).collect();
    paths.extend(
        fs::read_dir(file("benches/record"))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|p| p.extension().is_some_and(|e| e == "json")),
    );
    paths
}

/// Returns the digest of all stages over the shipped sequence, with a model of one picture, by preset.
fn digests() -> BTreeMap<String, String> {
    let picture = read_picture(&file("assets/pictures/astronaut.jpg")).unwrap();
    let frames: Vec<_> = Source::open(&[file("assets/sequence")]).unwrap().map(|f| f.picture.unwrap()).collect();
    let request = Request::new(Profile::Vga, DEFAULT_THRESHOLD);
    [("large", Preset::Large), ("standard", Preset::Standard), ("compact", Preset::Compact)]
        .into_iter()
        .map(|(name, preset)| {
            let (bytes, _) = train(&picture, "astronaut", preset, false).unwrap();
            let plan = Plan { request, passes: 1, track: false };
            let digest = bench(&frames, &Model::parse(&bytes).unwrap(), &plan).unwrap().digest;
            (name.to_string(), format!("{digest:08x}"))
        })
        .collect()
}

/// Checks that each record is of a search that does to the bit what the present one does.
#[test]
fn records_are_of_this_search() {
    let now = digests();
    let paths = records();
    for name in NEEDED {
        assert!(paths.iter().any(|p| p.file_stem().unwrap() == name), "{name} is measured by scripts/measure");
    }
    for path in paths {
        let record: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        // A record that does not say of which search it is has no digests.
        let told: BTreeMap<String, String> =
            serde_json::from_value(record["build"]["digests"].clone()).unwrap_or_default();
        assert_eq!(told, now, "{} is of another search: run scripts/measure", path.display());
    }
}
