//! Checks that the example in `docs/model-format.md` is a model with the contents that the page gives.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use keygraph_core::stages::feature::signature;
use keygraph_core::stages::geometry::Point;
use keygraph_core::stages::keygraph::{CELLS, Keygraph};
use keygraph_core::stages::model::Tier;
use keygraph_core::{FeatureKind, Homography, MAGIC, Method, Model, ModelError, VERSION};
use keygraph_tests::{Sections, file, seal};

fn page() -> String {
    std::fs::read_to_string(file("docs/model-format.md")).unwrap()
}

fn hex(digits: &str) -> u8 {
    u8::from_str_radix(digits, 16).unwrap_or_else(|_| panic!("{digits:?} is no byte"))
}

/// Expands text like `aa bb [cc dd] x 3` to bytes.
fn expand(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(group) = rest.strip_prefix('[') {
            let (group, after) = group.split_once(']').unwrap_or_else(|| panic!("open bracket in {text:?}"));
            let after = after.trim_start();
            let after = after.strip_prefix('x').unwrap_or_else(|| panic!("no count in {text:?}")).trim_start();
            let (count, after) = after.split_once(' ').unwrap_or((after, ""));
            let group: Vec<u8> = group.split_whitespace().map(hex).collect();
            bytes.extend(group.repeat(count.parse().unwrap()));
            rest = after.trim_start();
        } else {
            let (byte, after) = rest.split_once(' ').unwrap_or((rest, ""));
            bytes.push(hex(byte));
            rest = after.trim_start();
        }
    }
    bytes
}

/// Returns the model in the hex block of the page, and checks the offset of each line.
fn example() -> Vec<u8> {
    let page = page();
    let block = page.split("```hex\n").nth(1).unwrap().split("```").next().unwrap();
    let mut model = Vec::new();
    for line in block.lines() {
        let [offset, bytes, _] = *line.splitn(3, '|').collect::<Vec<_>>() else {
            panic!("{line:?} has no three columns")
        };
        let offset = offset.trim();
        if !offset.is_empty() {
            assert_eq!(usize::from_str_radix(offset, 16).unwrap(), model.len(), "offset of {line:?}");
        }
        model.extend(expand(bytes));
    }
    model
}

#[test]
fn repeats_are_expanded() {
    assert_eq!(expand("4b 47 [00 01] x 3 ff"), [0x4b, 0x47, 0, 1, 0, 1, 0, 1, 0xff]);
    assert_eq!(expand(" [80] x 4 "), [0x80; 4]);
    assert!(expand("").is_empty());
}

#[test]
fn the_example_parses() {
    let bytes = example();
    let mut sealed = bytes.clone();
    seal(&mut sealed);
    assert_eq!(bytes[8..16], sealed[8..16], "length and checksum: on the page, and as computed");
    assert!(Model::parse(&bytes).is_ok(), "{:?}", Model::parse(&bytes).err());
    assert_eq!(
        Model::parse(&bytes[..bytes.len() - 1]).unwrap_err(),
        ModelError::Truncated { expected: 3777, given: 3776 }
    );
}

#[test]
fn the_header_and_counts_are_the_page_s() {
    let bytes = example();
    assert_eq!((&bytes[..4], VERSION), (&MAGIC[..], 6));
    let model = Model::parse(&bytes).unwrap();
    assert_eq!((model.method(), model.feature()), (Method::Keygraph, FeatureKind::Luma));
    assert_eq!((model.objects(), model.views(), model.keypoints(), model.keygraphs()), (1, 1, 3, 1));
    assert_eq!(model.bytes().len(), 3777);
}

#[test]
fn the_object_and_its_template_are_the_page_s() {
    let bytes = example();
    let o = Model::parse(&bytes).unwrap().object(0);
    assert_eq!((o.name, o.width, o.height, o.triples, o.keypoints), ("box", 32, 32, 1, 3));
    assert_eq!((o.template.width, o.template.height), (8, 8));
    let row = |level: usize, y: usize| o.template.luma(level).row(y).to_vec();
    assert_eq!([row(0, 0), row(0, 3), row(0, 4), row(0, 7)], [[0x10; 8], [0x10; 8], [0xf0; 8], [0xf0; 8]]);
    assert_eq!([row(1, 1), row(1, 2)], [[0x10; 4], [0xf0; 4]]);
    assert_eq!([row(2, 0), row(2, 1), row(3, 0)], [vec![0x10; 2], vec![0xf0; 2], vec![0x80]]);
    assert!(o.template.chroma(0).iter().all(|c| (0..4).all(|y| c.row(y) == [0x80; 4])));
}

#[test]
fn the_view_and_its_keypoints_are_the_page_s() {
    let bytes = example();
    let model = Model::parse(&bytes).unwrap();
    let v = model.view(0);
    assert_eq!((v.object, v.keypoints, v.first), (0, 3, 0));
    assert_eq!((v.to_picture, v.centre, v.scale), (Homography::IDENTITY, [15.5, 15.5], 1.0));
    let points = [(4, 4), (25, 5), (4, 18)].map(|(x, y)| Point::new(16 * x, 16 * y));
    assert_eq!([0, 1, 2].map(|i| model.keypoint(i)), points);
}

#[test]
fn the_keygraph_is_the_page_s_and_what_core_makes_of_its_points() {
    let bytes = example();
    let model = Model::parse(&bytes).unwrap();
    let points = [0, 1, 2].map(|i| model.keypoint(i));
    assert_eq!(model.keygraph(0), (0, [points[1], points[2], points[0]]));
    let keys = model.keys();
    assert_eq!((keys.sizes, keys.angles), (&[74][..], &[0x46][..]), "54 and 116 half-degrees");
    assert_eq!(keys.signatures, [&[0x3f], &[0xf0], &[0x03]]);
    let rising = [0x58, 0x60, 0x68, 0x70, 0x78, 0x80, 0x88, 0x90, 0x98, 0xa0, 0xa8, 0xb0];
    assert_eq!(model.features(), [&rising[..], &[0x80; 6], &[0x90; 6]].concat());
    assert_eq!(signature(model.features()), 0x03_f03f);

    let made = Keygraph::new(points, [0, 1, 2], &Method::Keygraph.parameters().scalene).unwrap();
    assert_eq!(made.vertices, [1, 2, 0]);
    assert_eq!((made.key.largest, made.key.second, made.size), (54, 116, 74));
    assert!(!made.key.mirrored);
    assert_eq!(made.key.cell(), 269);
    let occupied: Vec<usize> = (0..CELLS).filter(|&c| !model.cell(Tier::First(0), c).is_empty()).collect();
    assert!(!model.has_lists() && !model.has_second_tiers());
    assert_eq!((occupied, model.cell(Tier::First(0), 269)), (vec![269], 0..1));
}

/// Checks that the sizes in the text of the page are those of the format.
#[test]
fn the_tables_are_right() {
    let page = page();
    let row = |start: &str| page.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("no row {start:?}"));
    for (section, bytes) in [
        ("header", Sections::HEADER),
        ("objects", Sections::OBJECT),
        ("views", Sections::VIEW),
        ("keypoints", Sections::KEYPOINT),
        ("keys", Sections::KEY),
        ("vertices", Sections::VERTICES),
        ("sketches", Sections::SKETCH),
    ] {
        let row = row(&format!("| [{section}]"));
        let told = row.split('|').nth(2).unwrap().split_whitespace().next().unwrap();
        assert_eq!(told, bytes.to_string(), "{row}");
    }
    assert_eq!(Sections::CELLS, CELLS);
    assert!(row("| [index]").contains(&format!("{} x tiers + 4", 4 * CELLS)));
    assert_eq!(Sections::of(&example()).end, 3777);
    // The fields of a record follow each other and fill the record.
    for (heading, length) in [
        ("## Header", Sections::HEADER),
        ("## Objects", Sections::OBJECT),
        ("## Views", Sections::VIEW),
        ("## Keypoints", Sections::KEYPOINT),
        ("## Keys", Sections::KEY),
        ("## Vertices", Sections::VERTICES),
    ] {
        let section = page.split(&format!("\n{heading}\n")).nth(1).unwrap().split("\n## ").next().unwrap();
        let mut at = 0;
        for line in section.lines() {
            let mut cells = line.split('|').skip(1).map(|c| c.trim().parse::<usize>());
            if let (Some(Ok(offset)), Some(Ok(size))) = (cells.next(), cells.next()) {
                assert_eq!(offset, at, "{heading}: {line}");
                at += size;
            }
        }
        assert_eq!(at, length, "{heading}: the fields' sizes add up to");
    }
}
