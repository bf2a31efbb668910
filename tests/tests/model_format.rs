//! Tests with damaged and contradictory models. Each must be refused with a message that says what
//! to do, or be harmless. None may make the parser or the detector panic.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{LazyLock, Mutex, PoisonError};

use keygraph_core::stages::frame::NO_CHROMA;
use keygraph_core::{Detection, FeatureKind, Method, Model, ModelError, QqvgaDetector, Stage, Stats, VERSION};
use keygraph_tests::{Crop, Sections, put, read_u32, seal, small_model, small_picture};

static MODEL: LazyLock<Vec<u8>> = LazyLock::new(|| small_model(Method::Keygraph, FeatureKind::Both, 14));
static PICTURE: LazyLock<Crop> = LazyLock::new(small_picture);

/// Searches the picture that the model was trained on.
fn detect(model: &Model<'_>) -> (Vec<Detection>, Stats) {
    static DETECTOR: Mutex<QqvgaDetector> = Mutex::new(QqvgaDetector::new());
    let mut detector = DETECTOR.lock().unwrap_or_else(PoisonError::into_inner);
    let found = detector.detect(&PICTURE.frame(), model, 0.0, &mut || 0).unwrap().to_vec();
    (found, *detector.stats())
}

/// Reads everything that a parsed model offers, as text.
fn read_all(model: &Model<'_>) -> String {
    let objects: Vec<_> = (0..model.objects()).map(|i| model.object(i)).collect();
    let views: Vec<_> = (0..model.views()).map(|i| model.view(i)).collect();
    let keypoints: Vec<_> = (0..model.keypoints()).map(|i| model.keypoint(i)).collect();
    let keygraphs: Vec<_> = (0..model.keygraphs()).map(|i| model.keygraph(i)).collect();
    let rest = (model.method(), model.feature(), model.occupancy(), model.keys(), model.features());
    format!("{objects:?} {views:?} {keypoints:?} {keygraphs:?} {rest:?}")
}

/// The outcome of a change.
#[derive(Debug)]
enum Outcome {
    Refused(ModelError),
    Harmless,
    /// The parser or the detector panicked with this message.
    Panicked(String),
}

/// Parses the bytes. If they are accepted, reads the whole model and searches for it.
fn try_out(bytes: &[u8]) -> Outcome {
    let run = AssertUnwindSafe(|| match Model::parse(bytes) {
        Err(e) => Outcome::Refused(e),
        Ok(model) => {
            read_all(&model);
            detect(&model);
            Outcome::Harmless
        }
    });
    catch_unwind(run).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<&str>().map(ToString::to_string);
        Outcome::Panicked(text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default())
    })
}

/// Fails if any change caused a panic, and shows the first of them.
fn assert_none(panics: &[String]) {
    let shown = panics.iter().take(12).cloned().collect::<Vec<_>>().join("\n  ");
    assert!(panics.is_empty(), "{} changes panicked:\n  {shown}", panics.len());
}

#[test]
fn the_small_model_is_whole_and_is_used() {
    let model = Model::parse(&MODEL).unwrap();
    let sections = Sections::of(&MODEL);
    assert_eq!(sections.end, MODEL.len());
    assert!(MODEL.len() < 16_000, "{} bytes: too many to damage one by one", MODEL.len());
    assert_eq!((model.objects(), model.views()), (1, 2));
    assert!(model.keygraphs() >= 20, "{} keygraphs", model.keygraphs());
    let (_, stats) = detect(&model);
    for stage in [Stage::Classify, Stage::Vote, Stage::Pose, Stage::Accept] {
        assert!(stats.stages[stage as usize].seen > 0, "{} has nothing to do", stage.name());
    }
}

#[test]
fn cut_off_at_every_length() {
    for length in 0..MODEL.len() {
        let error = Model::parse(&MODEL[..length]).unwrap_err();
        let expected = match length {
            0..4 => ModelError::NotAModel,
            4..Sections::HEADER => ModelError::Truncated { expected: Sections::HEADER, given: length },
            _ => ModelError::Truncated { expected: MODEL.len(), given: length },
        };
        assert_eq!(error, expected, "{length} bytes of {}", MODEL.len());
    }
}

#[test]
fn every_byte_damaged() {
    let mut bytes = MODEL.clone();
    for at in 0..bytes.len() {
        for flip in [1, 16, 128, 255] {
            bytes[at] ^= flip;
            let error = Model::parse(&bytes).err();
            bytes[at] ^= flip;
            let error = error.unwrap_or_else(|| panic!("byte {at} ^ {flip} went unnoticed"));
            let right = match at {
                0..4 => error == ModelError::NotAModel,
                4..6 => matches!(error, ModelError::NewerVersion { .. } | ModelError::OlderVersion { .. }),
                6..8 => error == ModelError::Inconsistent { section: "header" },
                8..12 => matches!(error, ModelError::Truncated { .. } | ModelError::TrailingBytes { .. }),
                _ => matches!(error, ModelError::Checksum { .. }),
            };
            assert!(right, "byte {at} ^ {flip}: {error:?}");
        }
    }
}

#[test]
fn appended_bytes() {
    for extra in [1, 2, 7, 4096] {
        let mut bytes = MODEL.clone();
        bytes.resize(bytes.len() + extra, 0);
        let error = Model::parse(&bytes).unwrap_err();
        assert_eq!(error, ModelError::TrailingBytes { expected: MODEL.len(), given: bytes.len() });
    }
    let twice = [&MODEL[..], &MODEL[..]].concat();
    assert!(matches!(Model::parse(&twice), Err(ModelError::TrailingBytes { .. })));
    // A partition holds one model after the other, and then what erased flash has.
    let partition = [&twice[..], &[0xff; 999]].concat();
    let mut rest = &partition[..];
    for _ in 0..2 {
        let (model, after) = rest.split_at(Model::length(rest).expect("a model begins here"));
        assert!(Model::parse(model).is_ok());
        rest = after;
    }
    assert_eq!((rest.len(), Model::length(rest)), (999, Err(ModelError::NotAModel)));
    let cut = MODEL.len() - 1;
    assert_eq!(Model::length(&MODEL[..cut]), Err(ModelError::Truncated { expected: MODEL.len(), given: cut }));
}

#[test]
fn other_versions() {
    for found in [0, VERSION - 1, VERSION + 1, u16::MAX] {
        let error =
            if found > VERSION { ModelError::NewerVersion { found } } else { ModelError::OlderVersion { found } };
        let mut bytes = MODEL.clone();
        put(&mut bytes, 4, &found.to_le_bytes());
        assert_eq!(Model::parse(&bytes).unwrap_err(), error);
        // Whatever else another version has changed, the parser must report its number first.
        put(&mut bytes, 6, &[0xff; 34]);
        assert_eq!(Model::parse(&bytes[..100]).unwrap_err(), error);
    }
}

#[test]
fn other_files() {
    let png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x02\0\0\0\x90wS\xde";
    for bytes in [&png[..], b"KGM", b"KGM\n", b"kgm\x1a", &[0; 5000], &[0xff; 5000]] {
        assert_eq!(Model::parse(bytes).unwrap_err(), ModelError::NotAModel);
    }
}

#[test]
fn every_message_says_what_to_do() {
    let table = [
        (ModelError::NotAModel, &["not a keygraph model", "keygraph train"][..]),
        (ModelError::NewerVersion { found: 7 }, &["version 7", "newer", "update", "train again"]),
        (ModelError::OlderVersion { found: 5 }, &["version 5", "older", "train again"]),
        (ModelError::Truncated { expected: 900, given: 31 }, &["900", "31", "copy it again"]),
        (ModelError::TrailingBytes { expected: 900, given: 931 }, &["900", "931", "copy it again"]),
        (
            ModelError::Checksum { expected: 0xdead_beef, computed: 0x0bad_cafe },
            &["deadbeef", "0badcafe", "copy it again"],
        ),
        (ModelError::Inconsistent { section: "views" }, &["views", "train again"]),
    ];
    for (error, words) in table {
        let message = error.to_string();
        for word in words {
            assert!(message.contains(word), "{message:?} does not say {word:?}");
        }
    }
}

#[test]
fn every_alignment_reads_the_same() {
    let outlines = |m: &Model<'_>| detect(m).0.iter().map(|d| (d.corners, d.score)).collect::<Vec<_>>();
    let model = Model::parse(&MODEL).unwrap();
    let (all, found) = (read_all(&model), outlines(&model));
    let mut buffer = vec![0xa5; MODEL.len() + 16];
    for offset in 0..8 {
        // The model starts `offset` bytes behind an address that is a multiple of 8.
        let start = buffer.as_ptr().align_offset(8) + offset;
        put(&mut buffer, start, &MODEL);
        let moved = Model::parse(&buffer[start..start + MODEL.len()]).unwrap();
        assert_eq!(read_all(&moved), all, "offset {offset}");
        assert_eq!(outlines(&moved), found, "offset {offset}");
    }
}

/// The section that a change makes wrong, the name of the change, and the change itself.
type Change = (&'static str, &'static str, fn(&mut Vec<u8>, &Sections));

/// Changes that keep the length of the file and the other sections.
const CONTRADICTIONS: [Change; 47] = [
    ("method", "an unknown method", |b, _| b[16] = 2),
    ("feature kind", "feature kind 0", |b, _| b[17] = 0),
    ("feature kind", "feature kind 4", |b, _| b[17] = 4),
    ("header", "features of another kind", |b, _| b[17] = 1),
    ("tiers", "tiers of no kind", |b, _| b[18] = 8),
    ("tiers", "a shortlist of the version before", |b, _| b[18] |= 1),
    ("header", "a longer header", |b, _| b[6] = 48),
    ("header", "one object more", |b, _| b[20] += 1),
    ("header", "no object", |b, _| put(b, 20, &[0; 4])),
    ("header", "one view more", |b, _| b[24] += 1),
    ("header", "one keypoint less", |b, _| b[28] -= 1),
    ("header", "one keygraph more", |b, _| b[32] += 1),
    ("header", "no templates", |b, _| put(b, 36, &[0; 4])),
    ("counts", "the most keygraphs", |b, _| put(b, 32, &[0xff; 4])),
    ("header", "a keygraph on a list", |b, _| b[40] = 1),
    ("counts", "a keygraph on a list, its sketch where the templates start", |b, _| {
        b[40] = 1;
        let templates = read_u32(b, 36) - 8;
        put(b, 36, &templates.to_le_bytes());
    }),
    ("counts", "no object, its bytes in the templates", |b, s| {
        put(b, 20, &[0; 4]);
        let index = (s.keys - s.cells - 4) as u32;
        let templates = read_u32(b, 36) + 56 + index;
        put(b, 36, &templates.to_le_bytes());
    }),
    ("objects", "a name that is not UTF-8", |b, s| b[s.objects] = 0xff),
    ("objects", "a name cut within a character", |b, s| put(b, s.objects, "é\0".as_bytes().split_at(1).0)),
    ("objects", "a picture without width", |b, s| put(b, s.objects + 32, &[0; 4])),
    ("objects", "a picture without height", |b, s| put(b, s.objects + 36, &[0; 4])),
    ("objects", "a picture too wide", |b, s| put(b, s.objects + 32, &((1u32 << 20) + 1).to_le_bytes())),
    ("objects", "a picture of the most height", |b, s| put(b, s.objects + 36, &[0xff; 4])),
    ("objects", "a template too narrow", |b, s| put(b, s.objects + 44, &[7, 0])),
    ("objects", "a template too high", |b, s| put(b, s.objects + 46, &[97, 0])),
    ("templates", "a template that starts too late", |b, s| put(b, s.objects + 40, &[1, 0, 0, 0])),
    ("templates", "a template at the end of memory", |b, s| put(b, s.objects + 40, &[0xff; 4])),
    ("templates", "a template that is too large", |b, s| put(b, s.objects + 46, &[96, 0])),
    ("views", "a view of no object", |b, s| put(b, s.views, &[1, 0])),
    ("views", "a view with too many keypoints", |b, s| put(b, s.views + 2, &[0xff; 2])),
    ("views", "a view whose keypoints start too late", |b, s| put(b, s.views + 4, &[0xff; 4])),
    ("views", "a view one keypoint beyond the end", |b, s| {
        let last = s.keypoints - Sections::VIEW;
        let first = read_u32(b, last + 4) + 1;
        put(b, last + 4, &first.to_le_bytes());
    }),
    ("views", "a map that is not a number", |b, s| put(b, s.views + 8, &f32::NAN.to_le_bytes())),
    ("views", "an infinite map", |b, s| put(b, s.views + 28, &f32::INFINITY.to_le_bytes())),
    ("views", "a middle that is not a number", |b, s| put(b, s.views + 36, &f32::NAN.to_le_bytes())),
    ("views", "an infinite scale", |b, s| put(b, s.views + 40, &f32::INFINITY.to_le_bytes())),
    ("views", "no scale", |b, s| put(b, s.views + 40, &0f32.to_le_bytes())),
    ("views", "a negative scale", |b, s| put(b, s.views + 40, &(-1f32).to_le_bytes())),
    ("keypoints", "a negative column", |b, s| b[s.keypoints + 1] = 0x80),
    ("keypoints", "a negative row in the last keypoint", |b, s| b[s.cells - 1] = 0xff),
    ("index", "a first subset that starts late", |b, s| b[s.cells] = 1),
    ("index", "a subset that starts beyond the end", |b, s| put(b, s.cells + 4 * 400, &[0xff; 4])),
    ("index", "subsets that descend", |b, s| put(b, s.keys - 8, &[0; 4])),
    ("index", "a keygraph in no subset", |b, s| {
        let last = read_u32(b, s.keys - 4) - 1;
        for at in (s.cells..s.keys).step_by(4).filter(|&at| read_u32(b, at) > last).collect::<Vec<_>>() {
            put(b, at, &last.to_le_bytes());
        }
    }),
    ("keygraphs", "a keygraph of no view", |b, s| put(b, s.vertices, &[2, 0])),
    ("keygraphs", "a vertex that its view does not have", |b, s| b[s.vertices + 2] = 14),
    ("keygraphs", "the last vertex of the last keygraph", |b, s| b[s.features - 1] = 0xff),
];

#[test]
fn contradictions_name_their_section() {
    for (section, what, change) in CONTRADICTIONS {
        let mut bytes = MODEL.clone();
        change(&mut bytes, &Sections::of(&MODEL));
        assert!(bytes != *MODEL, "{what}: nothing was changed");
        seal(&mut bytes);
        match Model::parse(&bytes) {
            Err(e) => {
                assert_eq!(e, ModelError::Inconsistent { section }, "{what}");
                assert!(e.to_string().contains(section), "{e}");
            }
            Ok(_) => panic!("{what}: accepted, but section {section} is wrong"),
        }
    }
}

#[test]
fn counts_traded_between_sections() {
    // The sum of the counts stays the same, so that only the content shows the contradiction.
    let sizes = [56i64, 44, 4, 5 + 5 + 36, 1, 8];
    let mut panics = Vec::new();
    for (i, from) in sizes.into_iter().enumerate() {
        for (j, to) in sizes.into_iter().enumerate().filter(|&(j, _)| j != i) {
            for steps in 1..=3 {
                let mut bytes = MODEL.clone();
                let mut add = |i: usize, n: i64| {
                    let count = i64::from(read_u32(&bytes, 20 + 4 * i)) + n;
                    put(&mut bytes, 20 + 4 * i, &(count as u32).to_le_bytes());
                };
                add(i, -to * steps);
                add(j, from * steps);
                seal(&mut bytes);
                match try_out(&bytes) {
                    Outcome::Panicked(p) => panics.push(format!("count {i} for count {j}, {steps} times: {p}")),
                    Outcome::Refused(e) => assert!(matches!(e, ModelError::Inconsistent { .. }), "{e:?}"),
                    Outcome::Harmless => {}
                }
            }
        }
    }
    assert_none(&panics);
}

#[test]
fn no_changed_byte_panics_even_with_a_right_checksum() {
    let sections = Sections::of(&MODEL);
    // Behind the keypoints all records are alike, so that a sample of the bytes is enough.
    let some = (sections.cells..MODEL.len()).step_by(97);
    let vertices = (sections.vertices..sections.features).step_by(7);
    let mut panics = Vec::new();
    for at in (0..sections.cells).chain(some).chain(vertices) {
        let values: &[u8] = if at < sections.cells { &[0, 1, 0x3f, 0x7f, 0x80, 0xff] } else { &[0, 0x7f, 0xff] };
        for &value in values {
            let mut bytes = MODEL.clone();
            bytes[at] = value;
            seal(&mut bytes);
            if let Outcome::Panicked(p) = try_out(&bytes) {
                panics.push(format!("byte {at} = {value:#04x}: {p}"));
            }
        }
    }
    assert_none(&panics);
}

#[test]
fn views_with_extreme_numbers_are_refused_or_harmless() {
    let sections = Sections::of(&MODEL);
    let values = [0.0, -0.0, 1e-45, f32::MIN_POSITIVE, 1e-20, 1e9, -1e9, 2.2e9, 1e20, -1e20, f32::MAX, f32::MIN];
    let mut panics = Vec::new();
    for field in (8..Sections::VIEW).step_by(4) {
        for value in values {
            let mut bytes = MODEL.clone();
            for view in 0..2 {
                put(&mut bytes, sections.views + Sections::VIEW * view + field, &f32::to_le_bytes(value));
            }
            seal(&mut bytes);
            if let Outcome::Panicked(p) = try_out(&bytes) {
                panics.push(format!("view field at byte {field} = {value:e}: {p}"));
            }
        }
    }
    assert_none(&panics);
}

#[test]
fn whole_sections_of_noise_are_refused_or_harmless() {
    let s = Sections::of(&MODEL);
    let mut state = 7u32;
    let mut noise = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let ranges = [
        ("objects", s.objects..s.views),
        ("views", s.views..s.keypoints),
        ("keypoints", s.keypoints..s.cells),
        ("subset table", s.cells..s.keys),
        ("keys", s.keys..s.vertices),
        ("vertices", s.vertices..s.features),
        ("features", s.features..s.sketches),
        ("templates", s.templates..s.end),
        ("everything", Sections::HEADER..s.end),
    ];
    let mut panics = Vec::new();
    for (name, range) in ranges {
        for round in 0..20 {
            let mut bytes = MODEL.clone();
            // Small numbers are more likely to be accepted than large ones.
            let mask = [0xff, 0x7f, 0x0f, 0x01][round % 4];
            bytes[range.clone()].fill_with(|| noise() & mask);
            seal(&mut bytes);
            if let Outcome::Panicked(p) = try_out(&bytes) {
                panics.push(format!("{name}, round {round}: {p}"));
            }
        }
    }
    assert_none(&panics);
}

#[test]
fn names_of_every_length_come_back() {
    let at = Sections::of(&MODEL).objects;
    for n in 0..=32 {
        let mut bytes = MODEL.clone();
        bytes[at..at + 32].fill(0);
        bytes[at..at + n].fill(b'n');
        seal(&mut bytes);
        assert_eq!(Model::parse(&bytes).unwrap().object(0).name, "n".repeat(n));
    }
}

#[test]
fn all_methods_and_features_are_read_back() {
    for (method, sizes) in [(Method::Keygraph, [12, 24, 36]), (Method::Paper, [24, 12, 36])] {
        for (feature, n) in [FeatureKind::Chroma, FeatureKind::Luma, FeatureKind::Both].into_iter().zip(sizes) {
            let bytes = small_model(method, feature, 20);
            let model = Model::parse(&bytes).unwrap();
            assert_eq!((model.method(), model.feature()), (method, feature));
            assert_eq!(model.features().len(), n * model.keygraphs());
            assert_eq!(Sections::of(&bytes).end, bytes.len());
            detect(&model);
        }
    }
}

#[test]
fn a_template_without_chroma_is_harmless() {
    let mut bytes = MODEL.clone();
    let template = Model::parse(&MODEL).unwrap().object(0).template;
    let luma: usize = (0..4).map(|l| (template.width >> l) * (template.height >> l)).sum();
    let chroma = Sections::of(&MODEL).templates + luma;
    bytes[chroma..].fill(NO_CHROMA.cast_unsigned());
    seal(&mut bytes);
    let (found, stats) = detect(&Model::parse(&bytes).unwrap());
    assert!(stats.stages[Stage::Accept as usize].seen > 0);
    assert!(found.iter().all(|d| d.appearance.chroma == 0.0), "{found:?}");
}
