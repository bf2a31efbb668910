//! `keygraph pack`: models in one file, its objects added, replaced and removed, and several models given to `detect`.

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;
use image::imageops::{FilterType, resize};

use crate::lines::{count, list, text, without_times};
use crate::program::{Folder, frame, picture, pixels};
use crate::{astronaut, compact, program};

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
fn a_slim_file_finds_the_same_and_cannot_be_changed() {
    let folder = Folder::new("slim");
    let (astronaut, coffee) = (astronaut(&folder), folder.file("coffee.kgm", &compact("coffee", &[])));
    let [all, slim, at_once, other] =
        ["all", "slim", "at-once", "other"].map(|name| folder.join(&format!("{name}.kgm")));
    keygraph!("pack", astronaut, coffee, "-o", all).ended_with(0);
    keygraph!("pack", astronaut, coffee, "--slim", "-o", at_once).ended_with(0);
    let told = keygraph!("pack", "-m", all, "--slim", "-o", slim).ended_with(0);
    assert!(told.out.contains("slim: those of the lists alone"), "{}", told.out);
    let [whole, made, once] = [&all, &slim, &at_once].map(|path| fs::read(path).unwrap());
    assert!(made == once && 10 * made.len() < 6 * whole.len(), "{} of {} bytes", made.len(), whole.len());
    assert!(keygraph!("inspect", slim, "--json").ended_with(0).object()["slim"] == true);
    let [a, b] = [&all, &slim].map(|m| keygraph!("detect", "-m", m, frame(17), "--json").ended_with(0).lines());
    assert_eq!(without_times(a), without_times(b));

    // Fewer keygraphs of each object, from the models and from the whole file.
    let [few, again] = ["few", "again"].map(|name| folder.join(&format!("{name}.kgm")));
    keygraph!("pack", astronaut, coffee, "--slim", "--listed", "1000", "-o", few).ended_with(0);
    keygraph!("pack", "-m", all, "--slim", "--listed", "1000", "-o", again).ended_with(0);
    assert_eq!(count(&keygraph!("inspect", few, "--json").ended_with(0).object(), "keygraphs"), 2000);
    assert!(fs::read(&few).unwrap() == fs::read(&again).unwrap());

    let alone = keygraph!("pack", astronaut, "--listed", "1000", "-o", folder.join("alone.kgm")).ended_with(0);
    assert!(alone.err.contains("--listed changes nothing"), "{}", alone.err);

    keygraph!("pack", slim, astronaut, "-o", other).refused_with(&["slim.kgm", "pack the models that it was made of"]);
    keygraph!("pack", "-m", slim, "--remove", "coffee")
        .refused_with(&["slim.kgm", "pack the models that it was made of"]);
    keygraph!("pack", "-m", all, "--add", slim).refused_with(&["slim.kgm", "is slim"]);
    keygraph!("detect", "-m", slim, "-m", astronaut, frame(0)).refused_with(&["slim.kgm", "is slim"]);
    let url = "http://localhost/models/";
    keygraph!("order", "--url", url, slim).ended_with(0);
    keygraph!("order", "--url", url, astronaut, slim).refused_with(&["slim.kgm is slim: it must be the only model"]);
    keygraph!("pack", "-m", all, "--slim").refused_with(&["-o", "keep "]);
    keygraph!("pack", "-m", all, "--slim", "-o", all).refused_with(&["overwrite an input"]);
    keygraph!("pack", astronaut, "--slim", "-o", other).refused_with(&["at least two objects"]);
    assert!(!other.exists() && fs::read(&slim).unwrap() == made && fs::read(&all).unwrap() == whole);
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

    // What is added is compared with all that is kept, which is not compared with each other.
    let alike = |run: program::Run| -> Vec<String> {
        let said: Vec<_> = run.err.lines().filter(|l| l.contains("looks like")).map(String::from).collect();
        assert!(said.iter().all(|line| line.contains(" three")), "{said:?}");
        let names =
            ["one", "two", "other"].into_iter().filter(|name| said.iter().any(|l| l.contains(&format!(" {name}"))));
        names.map(String::from).collect()
    };
    let three = model("three", ["astronaut", "rocket"]);
    assert_eq!(alike(keygraph!("pack", "-m", all, "--add", three).ended_with(0)), ["one", "two", "other"]);
    assert!(alike(keygraph!("pack", "-m", all, "--remove", "three").ended_with(0)).is_empty());
    assert_eq!(alike(keygraph!("pack", "-m", all, "--remove", "one", "--add", three).ended_with(0)), ["two", "other"]);

    let picture = joined(&folder, "p.png", ["astronaut", "chelsea"]);
    let again = folder.join("again.kgm");
    let report = keygraph!("train", picture, "-o", again, "--preset", "compact", "--json", "--beside", one, other);
    let alike = list(&report.ended_with(0).said(&["looks like one"]).object(), "alike").to_vec();
    assert_eq!(alike.iter().map(|a| text(a, "object")).collect::<Vec<_>>(), ["one"]);
    assert!((0.45..0.75).contains(&alike[0]["share"].as_f64().unwrap()), "{alike:?}");
    keygraph!("train", picture, "-o", again, "--beside", folder.join("none.kgm")).refused_with(&["none.kgm"]);
}

/// Models of four pictures: their paths, and a function that gives the bytes of a pack of them.
fn four(folder: &Folder) -> ([PathBuf; 4], impl Fn(&[&Path]) -> Vec<u8>) {
    let models = ["coffee", "rocket", "brick"].map(|name| folder.file(&format!("{name}.kgm"), &compact(name, &[])));
    let [coffee, rocket, brick] = models;
    let (astronaut, all) = (astronaut(folder), folder.join("expected.kgm"));
    let packed = move |models: &[&Path]| {
        let mut arguments = args!["pack", "-o", all].to_vec();
        arguments.extend(models.iter().map(|m| m.as_os_str().to_owned()));
        program::keygraph(&arguments).ended_with(0);
        let bytes = fs::read(&all).unwrap();
        fs::remove_file(&all).unwrap();
        bytes
    };
    ([astronaut, coffee, rocket, brick], packed)
}

#[test]
fn objects_are_added_replaced_and_removed_as_if_all_were_packed_anew() {
    let folder = Folder::new("change");
    let ([astronaut, coffee, rocket, brick], packed) = four(&folder);
    let two = packed(&[&astronaut, &coffee]);
    let all = folder.file("all.kgm", &two);
    let assert_is = |what: &str, expected: Vec<u8>| assert!(fs::read(&all).unwrap() == expected, "{what}");

    let run = keygraph!("pack", "-m", all, "--add", rocket, brick).ended_with(0);
    assert!(run.out.starts_with("4 objects, 2 added\n"), "{}", run.out);
    assert_is("two are added", packed(&[&astronaut, &coffee, &rocket, &brick]));
    let run = keygraph!("pack", "-m", all, "--remove", "coffee").ended_with(0);
    assert!(run.out.starts_with("3 objects, 1 removed\n"), "{}", run.out);
    assert_is("one in the middle is removed", packed(&[&astronaut, &rocket, &brick]));
    keygraph!("pack", "-m", all, "--add", coffee, "--remove", "rocket", "brick").ended_with(0);
    assert_is("two are removed and one is added", two.clone());
    keygraph!("pack", "-m", all, "--add", rocket).ended_with(0);
    keygraph!("pack", "-m", all, "--remove", "rocket").ended_with(0);
    assert_is("the last added is removed", two.clone());

    // A replaced object keeps its place. One that is removed and added comes last.
    let other = folder.file("other.kgm", &compact("chelsea", &["--name", "astronaut"]));
    let run = keygraph!("pack", "-m", all, "--replace", other, "--add", rocket).ended_with(0);
    assert!(run.out.starts_with("3 objects, 1 added, 1 replaced\n"), "{}", run.out);
    assert_is("one is replaced", packed(&[&other, &coffee, &rocket]));
    keygraph!("pack", "-m", all, "--remove", "astronaut", "--add", astronaut).ended_with(0);
    assert_is("one is removed and added", packed(&[&coffee, &rocket, &astronaut]));

    // The models come out as they went in, also those of gray pictures. Another file can be written.
    keygraph!("pack", "-m", all, "--add", brick).ended_with(0);
    let (before, out) = (fs::read(&all).unwrap(), folder.join("out.kgm"));
    keygraph!("pack", "-m", all, "--remove", "coffee", "rocket", "astronaut", "-o", out).ended_with(0);
    assert!(fs::read(out).unwrap() == fs::read(brick).unwrap(), "the last object is its model");
    assert_is("-o leaves the file as it is", before);
}

#[test]
fn changes_that_cannot_be_made_are_refused_and_the_file_stays() {
    let folder = Folder::new("no-change");
    let ([astronaut, coffee, rocket, _], packed) = four(&folder);
    let before = packed(&[&astronaut, &coffee]);
    let all = folder.file("all.kgm", &before);
    let twice = folder.file("twice.kgm", &packed(&[&astronaut, &coffee, &astronaut]));
    let paper = folder.join("paper.kgm");
    keygraph!("train", picture("rocket"), "-o", paper, "--preset", "paper").ended_with(0);
    let names = folder.names();

    keygraph!("pack", "-m", all, "--add", coffee).refused_with(&["all.kgm", "an object coffee already", "replace"]);
    keygraph!("pack", "-m", all, "--add", rocket, rocket).refused_with(&["an object rocket already"]);
    keygraph!("pack", "-m", all, "--remove", "cofee")
        .refused_with(&["all.kgm: there is no object cofee: there are astronaut, coffee"]);
    keygraph!("pack", "-m", all, "--replace", rocket)
        .refused_with(&["no object rocket", "there are astronaut, coffee"]);
    keygraph!("pack", "-m", all, "--replace", coffee, coffee).refused_with(&["coffee is to be replaced twice"]);
    keygraph!("pack", "-m", twice, "--replace", astronaut).refused_with(&["2 objects astronaut", "remove them"]);
    keygraph!("pack", "-m", all, "--remove", "astronaut", "coffee").refused_with(&["no object would be left"]);
    keygraph!("pack", "-m", all, "--add", paper).refused_with(&["rocket", "another method", "--preset paper"]);
    keygraph!("pack", "-m", all, "--add", all).refused_with(&["would overwrite an input"]);
    keygraph!("pack", "-m", all, "--add", rocket, "-o", rocket).refused_with(&["would overwrite an input"]);
    keygraph!("pack", "-m", folder.join("none.kgm"), "--add", rocket).refused_with(&["none.kgm", "keygraph train"]);
    keygraph!("pack", "-m", "/dev/null", "--add", rocket).refused_with(&["/dev/null is no file", "-o"]);
    assert_eq!((fs::read(&all).unwrap() == before, folder.names()), (true, names), "nothing was written");

    keygraph!("pack", "-m", twice, "--remove", "astronaut").ended_with(0);
    assert!(fs::read(twice).unwrap() == fs::read(coffee).unwrap(), "all objects of a name are removed");
}
