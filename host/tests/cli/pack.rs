//! `keygraph pack`: models in one file, and several models given to `detect`.

use std::path::{Path, PathBuf};

use image::RgbImage;
use image::imageops::{FilterType, resize};

use crate::lines::{count, list, text, without_times};
use crate::program::{Folder, frame, picture, pixels};
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
    let (both, paper, all) = (astronaut(&folder), folder.join("paper.kgm"), folder.join("all.kgm"));
    keygraph!("train", picture("coffee"), "-o", paper, "--preset", "paper").ended_with(0);
    keygraph!("pack", both, paper, "-o", all).refused_with(&["model 2", "train all with `--preset paper`, or none"]);
    assert!(!all.exists());
    keygraph!("detect", "-m", paper, "-m", both, frame(0), "--json").refused_with(&["--preset paper"]);
}

#[test]
fn gray_and_coloured_pictures_are_searched_together() {
    let folder = Folder::new("gray");
    let (both, luma) = (astronaut(&folder), folder.file("luma.kgm", &compact("coffee", &["--luma"])));
    let all = folder.join("all.kgm");
    keygraph!("pack", luma, both, "-o", all).ended_with(0);
    let run = keygraph!("detect", "-m", all, frame(17), "--json").ended_with(0);
    let mut found: Vec<_> = list(&run.lines()[0], "detections").iter().map(|d| text(d, "object").to_string()).collect();
    found.sort();
    assert_eq!(found, ["astronaut", "coffee"]);
}

#[test]
fn of_two_models_of_one_picture_the_place_has_one_name_and_a_rival() {
    let folder = Folder::new("rivals");
    let first = astronaut(&folder);
    let second = folder.file("second.kgm", &compact("astronaut", &["--name", "second"]));
    let detections = |option: &str| {
        let run = keygraph!("detect", "-m", first, "-m", second, "--json", option, frame(1)).ended_with(0);
        list(&run.lines()[0], "detections").to_vec()
    };
    let best = detections("--min-visible=0");
    assert_eq!(best.len(), 1, "one name a place");
    let rivals = list(&best[0], "rivals");
    assert_eq!(rivals.len(), 1);
    assert_ne!(text(&rivals[0], "object"), text(&best[0], "object"));
    assert!(best[0]["visible"].as_f64().unwrap() > 0.8, "{}", best[0]["visible"]);
    assert_eq!(detections("--all-names").len(), 2);
}

#[test]
fn what_shows_less_of_itself_than_asked_for_is_left_out() {
    let folder = Folder::new("visible");
    let model = astronaut(&folder);
    let visible = |least: &str| -> Vec<f64> {
        let run = keygraph!("detect", "-m", model, "--json", least, frame(8)).ended_with(0);
        list(&run.lines()[0], "detections").iter().map(|d| d["visible"].as_f64().unwrap()).collect()
    };
    let all = visible("--min-visible=0");
    assert!(all.len() == 1 && (0.8..0.95).contains(&all[0]), "{all:?}");
    assert_eq!(visible("--min-visible=0.8"), all);
    assert!(visible("--min-visible=0.95").is_empty());
}

/// A picture of two pictures of the repository: the left part of `left`, and the rest of `right`.
fn joined(folder: &Folder, name: &str, [left, right]: [&str; 2]) -> PathBuf {
    let path = folder.join(name);
    let parts = [left, right].map(|n| resize(&pixels(&picture(n)), 400, 300, FilterType::Triangle));
    RgbImage::from_fn(400, 300, |x, y| *parts[usize::from(x >= 240)].get_pixel(x, y)).save(&path).unwrap();
    path
}

#[test]
fn objects_that_look_alike_are_told_with_a_picture_of_what_they_share() {
    let folder = Folder::new("alike");
    let model = |name: &str, parts: [&str; 2]| {
        let path = folder.join(name);
        keygraph!("train", joined(&folder, "p.png", parts), "-o", path, "--preset", "compact", "--name", name)
            .ended_with(0);
        path
    };
    let (one, two) = (model("one", ["astronaut", "coffee"]), model("two", ["astronaut", "chelsea"]));
    let (other, all, shared) = (model("other", ["hubble", "rocket"]), folder.join("all.kgm"), folder.join("shared"));

    let run = keygraph!("pack", one, two, other, "-o", all, "--shared", shared).ended_with(0);
    let said: Vec<&str> = run.err.lines().filter(|l| l.contains("looks like")).collect();
    assert_eq!(said.len(), 1, "{said:?}");
    let share: f64 = said[0].split(": ").nth(2).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((45.0..75.0).contains(&share), "60 % are shared: {share}");
    let drawn = pixels(&shared.join("one-two.png"));
    let bright = |x: u32| {
        (0..drawn.height()).map(|y| u64::from(drawn.get_pixel(x, y).0.iter().max().copied().unwrap())).sum::<u64>()
    };
    assert!(bright(60) > 2 * bright(250), "bright where they agree, dark where they differ");

    let picture = joined(&folder, "p.png", ["astronaut", "chelsea"]);
    let again = folder.join("again.kgm");
    let report = keygraph!("train", picture, "-o", again, "--preset", "compact", "--json", "--beside", one, other);
    let alike = list(&report.ended_with(0).said(&["looks like one"]).object(), "alike").to_vec();
    assert_eq!(alike.iter().map(|a| text(a, "object")).collect::<Vec<_>>(), ["one"]);
    assert!((0.45..0.75).contains(&alike[0]["share"].as_f64().unwrap()), "{alike:?}");
    keygraph!("train", picture, "-o", again, "--beside", folder.join("none.kgm")).refused_with(&["none.kgm"]);
}
