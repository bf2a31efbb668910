//! `keygraph pack`: models in one file, and several models given to `detect`.

use std::path::Path;

use crate::lines::{count, list, text, without_times};
use crate::program::{Folder, frame};
use crate::{astronaut, compact};

#[test]
fn packed_models_find_what_each_finds() {
    let folder = Folder::new("pack");
    let (astronaut, coffee) = (astronaut(&folder), folder.file("coffee.kgm", &compact("coffee", &[])));
    let all = folder.join("all.kgm");
    let packed = keygraph!("pack", astronaut, coffee, "-o", all).ended_with(0);
    assert!(packed.out.contains("2 objects"), "{}", packed.out);

    let one = |model: &Path| keygraph!("inspect", model, "--json").ended_with(0).object();
    let (report, parts) = (one(&all), [one(&astronaut), one(&coffee)]);
    let sum = |key| parts.iter().map(|p| count(p, key)).sum::<u64>();
    for key in ["keypoints", "triples"] {
        assert_eq!(count(&report, key), sum(key), "{key} add up");
    }
    let own = sum("keygraphs");
    assert!((own + 1..=2 * own).contains(&count(&report, "keygraphs")), "some are on the lists, too");
    let names: Vec<_> = list(&report, "objects").iter().map(|o| text(o, "name").to_string()).collect();
    assert_eq!(names, ["astronaut", "coffee"]);

    // `detect` gives the same results for the packed file and for the models one by one.
    let by_file = keygraph!("detect", "-m", all, frame(17), "--json").ended_with(0);
    let by_two = keygraph!("detect", "-m", astronaut, "-m", coffee, frame(17), "--json").ended_with(0);
    let mut found: Vec<_> =
        list(&by_two.lines()[0], "detections").iter().map(|d| text(d, "object").to_string()).collect();
    found.sort();
    assert_eq!(found, ["astronaut", "coffee"], "both objects of the frame");
    assert_eq!(without_times(by_file.lines()), without_times(by_two.lines()));
}

#[test]
fn models_that_do_not_go_together_are_refused_with_advice() {
    let folder = Folder::new("mixed");
    let (both, luma) = (astronaut(&folder), folder.file("luma.kgm", &compact("coffee", &["--luma"])));
    let all = folder.join("all.kgm");
    keygraph!("pack", both, luma, "-o", all).refused_with(&["model 2", "--luma", "train all alike"]);
    assert!(!all.exists());
    keygraph!("detect", "-m", luma, "-m", both, frame(0), "--json").refused_with(&["train all alike"]);
}
