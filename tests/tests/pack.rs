//! Tests packing. A model merged from many models must hold every keygraph of each, and must find
//! what each of them finds.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

use std::sync::{LazyLock, Mutex, PoisonError};

use keygraph::input::{Picture, Pixels, read_picture};
use keygraph::learn::{Preset, merge, slimmed, train};
use keygraph::search::{Profile, search};
use keygraph_core::stages::keygraph::CELLS;
use keygraph_core::stages::model::Tier;
use keygraph_core::{
    FeatureKind, Frame, Method, Model, PackError, Part, PixelFormat, TrainParams, VgaDetector, VgaTrainer, ViewSpec,
    pack, pack_parts, packed_len, packed_parts_len, slim,
};
use keygraph_tests::{Poses, Sections, file, seal, small_model};

/// Small models of three pictures, each with some thousand keygraphs on five views.
static MODELS: LazyLock<[Vec<u8>; 3]> =
    LazyLock::new(|| ["astronaut", "coffee", "rocket"].map(|name| model_of(name, 6000)));

/// A model of at most so many keygraphs. With 6000 it has a second tier, with 2000 it has none.
fn model_of(name: &str, keygraphs: usize) -> Vec<u8> {
    static TRAINER: Mutex<VgaTrainer> = Mutex::new(VgaTrainer::new());
    let picture = picture(&format!("pictures/{name}"));
    let Pixels::Rgb8(rgb) = &picture.pixels else { panic!("{name} has no colour") };
    let (w, h) = (picture.width as usize, picture.height as usize);
    let frame = Frame::new(PixelFormat::Rgb8, w, h, rgb).unwrap();
    let views = [400.0, 280.0, 200.0, 140.0, 100.0].map(|side_px| ViewSpec {
        side_px,
        squeeze: 1.0,
        direction_deg: 0.0,
        keypoints: 60,
    });
    let params = TrainParams::new(name, Method::Keygraph, FeatureKind::Both, &views).capped(keygraphs, 4000);
    let mut model = vec![0; 1 << 20];
    let mut trainer = TRAINER.lock().unwrap_or_else(PoisonError::into_inner);
    let trained = trainer.train(&frame, (picture.width, picture.height), &params, &mut model).unwrap();
    model.truncate(trained.bytes);
    model
}

fn picture(name: &str) -> Picture {
    read_picture(&file("assets").join(name).with_extension("jpg")).unwrap()
}

fn parse(models: &[Vec<u8>]) -> Vec<Model<'_>> {
    models.iter().map(|m| Model::parse(m).unwrap()).collect()
}

fn packed(models: &[Vec<u8>]) -> Vec<u8> {
    let models = parse(models);
    let mut out = vec![0x5a; packed_len(&models).unwrap()];
    assert_eq!(pack(&models, &mut out).unwrap(), out.len(), "pack says how long the model is");
    out
}

/// Packs the objects `chosen` of a model, each by itself.
fn part_of(model: &[u8], chosen: &[usize]) -> Vec<u8> {
    let model = Model::parse(model).unwrap();
    let parts: Vec<_> = chosen.iter().map(|&i| Part::of(model, i..i + 1).unwrap()).collect();
    packed_parts(&parts)
}

fn packed_parts(parts: &[Part<'_>]) -> Vec<u8> {
    let mut out = vec![0x5a; packed_parts_len(parts, usize::MAX).unwrap()];
    assert_eq!(pack_parts(parts, usize::MAX, &mut out).unwrap(), out.len(), "packing says how long the model is");
    out
}

/// Contents of a keygraph, without the indices that packing changes: key, feature and place.
type Content = (Vec<u8>, Vec<u8>, String);

/// Returns all bytes of the key of keygraph `i`.
fn key(model: &Model<'_>, i: usize) -> Vec<u8> {
    let keys = model.keys();
    [keys.sizes, keys.angles].into_iter().chain(keys.signatures).map(|plane| plane[i]).collect()
}

/// Returns the keygraphs of a subset of a tier, sorted. `first` is added to the numbers of the objects.
fn cell(model: &Model<'_>, tier: Tier, cell: usize, first: usize) -> Vec<Content> {
    let each = model.feature_bytes();
    let mut all: Vec<Content> = model
        .cell(tier, cell)
        .map(|i| {
            let (view, points) = model.keygraph(i);
            let v = model.view(view);
            let object = first + usize::from(v.object);
            let place = format!("{object} {:?} {:?} {} {points:?}", v.to_picture, v.centre, v.scale);
            (key(model, i), model.features()[each * i..][..each].to_vec(), place)
        })
        .collect();
    all.sort();
    all
}

/// Checks that `merged` holds the contents of `parts` in their order, and that its subsets are sorted.
#[track_caller]
fn assert_holds(merged: &[u8], parts: &[Vec<u8>]) {
    let (merged, parts) = (Model::parse(merged).unwrap(), parse(parts));
    assert_eq!(merged.objects(), parts.iter().map(Model::objects).sum::<usize>(), "objects");
    assert_eq!(merged.views(), parts.iter().map(Model::views).sum::<usize>(), "views");
    assert_eq!(merged.keypoints(), parts.iter().map(Model::keypoints).sum::<usize>(), "keypoints");
    let own = |m: &Model<'_>| m.keygraphs() - lists(m).map(|list| m.tier(list).len()).sum::<usize>();
    assert_eq!(own(&merged), parts.iter().map(own).sum::<usize>(), "keygraphs");
    assert!(parts.iter().all(|p| (p.method(), p.feature()) == (merged.method(), merged.feature())));

    let objects = |m: &Model<'_>| (0..m.objects()).map(|i| format!("{:?}", m.object(i))).collect::<Vec<_>>();
    let expected: Vec<_> = parts.iter().flat_map(objects).collect();
    assert!(objects(&merged) == expected, "objects with their names, sizes and templates, in order");

    let (mut view, mut first) = (0, 0);
    for part in &parts {
        for i in 0..part.views() {
            let (mine, theirs) = (merged.view(view), part.view(i));
            assert_eq!(usize::from(mine.object), first + usize::from(theirs.object), "object of view {view}");
            assert_eq!(mine.keypoints, theirs.keypoints, "keypoints of view {view}");
            for k in 0..usize::from(mine.keypoints) {
                let at = |m: &Model<'_>, start: u32| m.keypoint(start as usize + k);
                assert_eq!(at(&merged, mine.first), at(part, theirs.first), "keypoint {k} of view {view}");
            }
            view += 1;
        }
        first += part.objects();
    }

    let sorted = |range: std::ops::Range<usize>| range.map(|i| key(&merged, i)).is_sorted();
    let mut object = 0;
    for (part, before) in parts.iter().scan(0, |n, p| Some((p, std::mem::replace(n, *n + p.objects())))) {
        for i in 0..part.objects() {
            for c in 0..CELLS {
                for tier in [Tier::First, Tier::Second] {
                    let (mine, theirs) = (tier(object), tier(i as u16));
                    let of = |m: &Model<'_>, tier, first| match tier {
                        Tier::Second(_) if !m.has_second_tiers() => vec![],
                        _ => cell(m, tier, c, first),
                    };
                    let expected = of(part, theirs, before);
                    assert!(of(&merged, mine, 0) == expected, "subset {c} of {mine:?} is not that of the part");
                    assert!(
                        expected.is_empty() || sorted(merged.cell(mine, c)),
                        "subset {c} of {mine:?} is out of order"
                    );
                }
            }
            object += 1;
        }
    }
    let listed = merged.objects() > 1 && merged.method() == Method::Keygraph;
    assert_eq!(merged.has_lists(), listed);
    if listed {
        assert_lists(&merged);
    }
}

/// Returns the tiers that hold keygraphs of all objects.
fn lists(m: &Model<'_>) -> impl Iterator<Item = Tier> {
    [Tier::Shortlist, Tier::Longlist].into_iter().take(2 * usize::from(m.has_lists()))
}

/// Checks that the lists hold the right number of keygraphs of each object, hold each keygraph
/// once, and are sorted.
#[track_caller]
fn assert_lists(merged: &Model<'_>) {
    let mut counts = vec![[0; 3]; merged.objects()];
    for c in 0..CELLS {
        let mut own = vec![];
        for object in 0..merged.objects() as u16 {
            for tier in
                [Tier::First(object), Tier::Second(object)].into_iter().take(1 + usize::from(merged.has_second_tiers()))
            {
                own.extend(cell(merged, tier, c, 0));
                counts[usize::from(object)][2] += merged.cell(tier, c).len();
            }
        }
        own.sort();
        for (n, list) in lists(merged).enumerate() {
            let range = merged.cell(list, c);
            assert!(range.clone().map(|i| key(merged, i)).is_sorted(), "subset {c} of {list:?} is out of order");
            for i in range {
                counts[usize::from(merged.view(merged.keygraph(i).0).object)][n] += 1;
            }
            for k in cell(merged, list, c, 0) {
                let at = own
                    .binary_search(&k)
                    .unwrap_or_else(|_| panic!("subset {c} of {list:?} holds a foreign keygraph, or one twice"));
                own.remove(at);
            }
        }
    }
    let features: Vec<_> = merged.features().chunks(merged.feature_bytes()).collect();
    assert_eq!(merged.sketches().len(), merged.tier(Tier::Longlist).end, "one sketch for each keygraph of the lists");
    for (i, (bytes, feature)) in merged.sketches().iter().zip(features).enumerate() {
        // This is the definition of sketches in `docs/model-format.md`.
        for (bit, &v) in feature.iter().rev().take(32).enumerate() {
            let is_set = |bit: usize| bytes[bit / 8] >> (bit % 8) & 1 == 1;
            assert_eq!([is_set(bit), is_set(32 + bit)], [v > 148, v < 108], "bit {bit} of sketch {i}");
        }
    }
    let share = |each: usize, all: usize| each.min(all / merged.objects());
    for [short, long, own] in counts {
        let first = share(704, 384 << 10).min(own);
        assert_eq!([short, long], [first, share(6144, 6144 << 10).min(own - first)], "of {own} keygraphs");
    }
}

#[test]
fn the_models_are_worth_merging() {
    for model in parse(&*MODELS) {
        assert!(model.keygraphs() >= 2000, "{} keygraphs", model.keygraphs());
        assert_eq!((model.objects(), model.views()), (1, 5));
        assert!(model.occupancy().1 >= 10, "subsets of up to {}", model.occupancy().1);
    }
}

#[test]
fn two_and_three_models_keep_all_their_keygraphs() {
    for models in [&MODELS[..2], &MODELS[1..], &MODELS[..]] {
        let merged = packed(models);
        assert_holds(&merged, models);
        assert_eq!(merge(models).unwrap(), merged, "the host merges as the core packs");
        assert_eq!(Sections::of(&merged).end, merged.len(), "the counts of the header");
    }
}

#[test]
fn objects_keep_their_order() {
    let [a, b, c] = &*MODELS;
    for (order, expected) in [
        ([a, b, c], ["astronaut", "coffee", "rocket"]),
        ([c, a, b], ["rocket", "astronaut", "coffee"]),
        ([b, b, a], ["coffee", "coffee", "astronaut"]),
    ] {
        let merged = merge(&order.map(Clone::clone)).unwrap();
        let model = Model::parse(&merged).unwrap();
        let names: Vec<_> = (0..model.objects()).map(|i| model.object(i).name).collect();
        assert_eq!(names, expected);
    }
}

#[test]
fn one_model_packed_is_the_same_model() {
    for model in &*MODELS {
        let again = packed(std::slice::from_ref(model));
        assert_eq!(again.len(), model.len());
        assert_holds(&again, std::slice::from_ref(model));
    }
}

#[test]
fn a_packed_model_can_be_packed_again() {
    let [a, b, c] = &*MODELS;
    let pair = packed(&[a.clone(), b.clone()]);
    let (left, right) = (packed(&[pair.clone(), c.clone()]), packed(&[c.clone(), pair.clone()]));
    assert_holds(&left, &MODELS[..]);
    assert_holds(&left, &[pair.clone(), c.clone()]);
    assert_holds(&right, &[c.clone(), a.clone(), b.clone()]);
    let four = packed(&[pair.clone(), pair.clone()]);
    assert_holds(&four, &[a.clone(), b.clone(), a.clone(), b.clone()]);
    let twenty = packed(&vec![four.clone(); 5]);
    assert_holds(&twenty, &vec![four.clone(); 5]);
    assert_holds(&packed(&[twenty.clone(), c.clone()]), &[twenty, c.clone()]);
}

/// Returns whether the same objects lie at the same places, within 2 px.
fn alike(a: &[(String, [[f32; 2]; 4])], b: &[(String, [[f32; 2]; 4])]) -> bool {
    let near =
        |a: &[[f32; 2]; 4], b: &[[f32; 2]; 4]| a.iter().zip(b).all(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]) < 2.0);
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.0 == b.0 && near(&a.1, &b.1))
}

/// Returns name and outline of all detections of a model in a frame of the sequence, sorted by name.
fn found(model: &[u8], frame: &str, profile: Profile, slot: usize) -> Vec<(String, [[f32; 2]; 4])> {
    let (model, picture) = (Model::parse(model).unwrap(), picture(&format!("sequence/{frame}")));
    let found = search(&picture, &model, profile, 0.5, false, slot).unwrap();
    let name = |object: u16| model.object(usize::from(object)).name.to_string();
    let mut all: Vec<_> = found.detections.iter().map(|d| (name(d.object), d.corners)).collect();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

#[test]
fn the_merged_model_finds_what_the_models_find() {
    let merged = merge(&MODELS[..]).unwrap();
    // This model has 20 objects, more than are all looked for to the end.
    let [a, b, c] = &*MODELS;
    let mut many = vec![a, b];
    many.resize(20, c);
    let many = merge(&many.into_iter().cloned().collect::<Vec<_>>()).unwrap();
    let slim = [&merged, &many].map(|model| slimmed(&Model::parse(model).unwrap()).unwrap());
    for (frame, profile, objects) in [
        ("0001", Profile::Vga, &["astronaut"][..]),
        ("0017", Profile::Vga, &["astronaut", "coffee"]),
        ("0019", Profile::Vga, &["astronaut", "coffee"]),
        ("0024", Profile::Vga, &[]),
        ("0002", Profile::Qqvga, &["astronaut"]),
    ] {
        let mut alone: Vec<_> = MODELS.iter().flat_map(|m| found(m, frame, profile, 0)).collect();
        alone.sort_by(|a, b| a.0.cmp(&b.0));
        let names: Vec<_> = alone.iter().map(|d| d.0.clone()).collect();
        assert_eq!(names, objects, "{frame} {profile:?}: found by the models alone");
        for (model, what) in [
            (&merged, "the merged model"),
            (&many, "a model of many"),
            (&slim[0], "the slim form of the merged model"),
            (&slim[1], "the slim form of many"),
        ] {
            let together = found(model, frame, profile, 0);
            assert!(alike(&together, &alone), "{frame} {profile:?}: {what} finds {together:?}, not {alone:?}");
        }
    }
}

#[test]
fn a_slim_model_holds_what_a_search_by_lists_reads() {
    let merged = packed(&MODELS[..]);
    let whole = Model::parse(&merged).unwrap();
    let bytes = slimmed(&whole).unwrap();
    let model = Model::parse(&bytes).unwrap();
    assert!(model.is_slim() && !whole.is_slim() && model.has_lists() && !model.has_second_tiers());
    assert_eq!((model.method(), model.feature(), model.views()), (whole.method(), whole.feature(), whole.views()));
    let objects = |m: &Model<'_>| (0..m.objects()).map(|i| format!("{:?}", m.object(i))).collect::<Vec<_>>();
    assert_eq!(objects(&model), objects(&whole));
    let content = |m: &Model<'_>, list, c| m.cell(list, c).map(|i| (key(m, i), m.keygraph(i))).collect::<Vec<_>>();
    for (list, c) in lists(&whole).flat_map(|list| (0..CELLS).map(move |c| (list, c))) {
        assert_eq!(content(&model, list, c), content(&whole, list, c), "subset {c} of {list:?}");
    }
    let n = whole.tier(Tier::Longlist).end;
    assert_eq!((model.keygraphs(), model.sketches()), (n, whole.sketches()));
    assert!(model.features() == &whole.features()[..n * whole.feature_bytes()]);
    assert!((0..model.objects() as u16).all(|i| model.tier(Tier::First(i)).is_empty()));
    assert_eq!(Sections::of(&bytes).end, bytes.len(), "the counts of the header");
    assert!(slimmed(&model).unwrap() == bytes, "once slim, slim");
    assert!(model.occupancy().0 > 100 && model.occupancy().1 > 10, "{:?}", model.occupancy());

    // A thorough search goes by the lists to their end.
    let found = search(&picture("sequence/0001"), &model, Profile::Vga, 0.5, true, 0).unwrap();
    assert_eq!(found.detections.iter().map(|d| d.object).collect::<Vec<_>>(), [0]);
}

#[test]
fn lists_hold_as_many_keygraphs_of_an_object_as_asked_for() {
    let models = parse(&MODELS[..]);
    let parts: Vec<_> = models.iter().copied().map(Part::from).collect();
    let own: Vec<_> = models.iter().map(Model::keygraphs).collect();
    for most in [1, 500, 1000, usize::MAX] {
        let mut bytes = vec![0; packed_parts_len(&parts, most).unwrap()];
        pack_parts(&parts, most, &mut bytes).unwrap();
        let model = Model::parse(&bytes).unwrap();
        let mut counts = vec![0; 3];
        for i in lists(&model).flat_map(|list| model.tier(list)) {
            counts[usize::from(model.view(model.keygraph(i).0).object)] += 1;
        }
        let expected: Vec<_> = own.iter().map(|&n| n.min(most)).collect();
        assert_eq!(counts, expected);
        let first = model.tier(Tier::Shortlist).len();
        assert_eq!(first, own.iter().map(|&n| n.min(most).min(704)).sum::<usize>());
    }
}

#[test]
fn what_cannot_be_slim_or_packed_again_is_told() {
    let paper = small_model(Method::Paper, FeatureKind::Both, 10);
    for model in [&MODELS[0], &packed(&[paper.clone(), paper])] {
        assert_eq!(slimmed(&Model::parse(model).unwrap()).unwrap_err(), PackError::NoLists);
    }
    let merged = packed(&MODELS[..]);
    let bytes = slimmed(&Model::parse(&merged).unwrap()).unwrap();
    let (model, single) = (Model::parse(&bytes).unwrap(), Model::parse(&MODELS[0]).unwrap());
    let mut short = vec![0; bytes.len() - 1];
    let no_room = PackError::NoRoom { needed: bytes.len(), given: bytes.len() - 1 };
    assert_eq!(slim(&Model::parse(&merged).unwrap(), &mut short), Err(no_room));
    assert_eq!(packed_len(&[single, model]), Err(PackError::Slim { index: 1 }));
    assert_eq!(packed_len(&[model]), Err(PackError::Slim { index: 0 }));
    assert_eq!(PackError::Slim { index: 1 }.to_string(), "model 2 is slim: pack the models that it was made of");
}

#[test]
fn a_gray_picture_is_found_beside_coloured_ones() {
    let gray = train(&picture("pictures/astronaut"), "gray", Preset::Compact, true).unwrap().0;
    assert_eq!(Model::parse(&gray).unwrap().feature(), FeatureKind::Luma);
    let [_, coffee, rocket] = &*MODELS;
    for models in [vec![&gray, coffee], vec![coffee, rocket, &gray]] {
        let n = models.len();
        let merged = merge(&models.into_iter().cloned().collect::<Vec<_>>()).unwrap();
        let model = Model::parse(&merged).unwrap();
        assert_eq!((model.feature(), model.objects()), (FeatureKind::Both, n));
        for (frame, objects) in [("0001", &["gray"][..]), ("0017", &["coffee", "gray"]), ("0024", &[])] {
            let names: Vec<_> = found(&merged, frame, Profile::Vga, 0).into_iter().map(|d| d.0).collect();
            assert_eq!(names, objects, "{frame}, {n} objects");
        }
    }
}

#[test]
fn models_that_differ_are_refused_with_advice() {
    let first = small_model(Method::Keygraph, FeatureKind::Both, 10);
    let others =
        [small_model(Method::Keygraph, FeatureKind::Chroma, 10), small_model(Method::Paper, FeatureKind::Both, 10)];
    for other in others {
        for (models, index) in
            [(vec![first.clone(), other.clone()], 1), (vec![first.clone(), first.clone(), other.clone()], 2)]
        {
            let parsed = parse(&models);
            assert_eq!(packed_len(&parsed), Err(PackError::Different { index }));
            assert_eq!(pack(&parsed, &mut [0; 1 << 16]), Err(PackError::Different { index }));
            let message = format!("{:#}", merge(&models).unwrap_err());
            for word in [&format!("model {}", index + 1), "train all with `--preset paper`, or none"] {
                assert!(message.contains(word), "{word:?} is not in {message:?}");
            }
        }
        // Two models of the same kind can be packed.
        assert_holds(&packed(&[other.clone(), other.clone()]), &[other.clone(), other]);
    }
}

#[test]
fn a_buffer_without_room_is_told_what_is_needed() {
    let models = parse(&MODELS[..2]);
    let needed = packed_len(&models).unwrap();
    for given in [0, 1, needed / 2, needed - 1] {
        let error = pack(&models, &mut vec![0; given]).unwrap_err();
        assert_eq!(error, PackError::NoRoom { needed, given });
        let message = error.to_string();
        assert!(message.contains(&needed.to_string()) && message.contains(&given.to_string()), "{message}");
    }
    // The bytes behind the model must stay as they are.
    let mut large = vec![0x5a; needed + 100];
    assert_eq!(pack(&models, &mut large), Ok(needed));
    assert!(large[needed..].iter().all(|&b| b == 0x5a), "written behind the end");
    assert_eq!(large[..needed], packed(&MODELS[..2]), "whatever was in the buffer before");
}

#[test]
fn nothing_and_too_many_are_refused() {
    assert_eq!(packed_len(&[]), Err(PackError::Nothing));
    assert_eq!(pack(&[], &mut [0; 1 << 12]), Err(PackError::Nothing));
    assert!(format!("{:#}", merge(&[] as &[Vec<u8>]).unwrap_err()).contains("no model"));

    // Each copy of the model adds two views.
    let small = small_model(Method::Keygraph, FeatureKind::Luma, 8);
    let model = Model::parse(&small).unwrap();
    assert_eq!(model.views(), 2);
    assert!(packed_len(&vec![model; 32_767]).is_ok(), "65,534 views fit");
    assert_eq!(packed_len(&vec![model; 32_768]), Err(PackError::TooMany), "65,536 views");
    assert!(PackError::TooMany.to_string().contains("split"), "{}", PackError::TooMany);
}

#[test]
fn a_damaged_model_is_not_merged() {
    let mut models = MODELS[..2].to_vec();
    let middle = models[1].len() / 2;
    models[1][middle] ^= 1;
    let message = format!("{:#}", merge(&models).unwrap_err());
    assert!(message.contains("copy it again"), "{message}");
}

// ---------------------------------------------------------- parts of a model

#[test]
fn objects_of_a_pack_are_packed_as_their_models_are() {
    let models = &*MODELS;
    let all = packed(models);
    for chosen in [&[0][..], &[1], &[2], &[0, 1], &[1, 2], &[0, 2], &[0, 1, 2], &[2, 0, 1], &[1, 1]] {
        let singles: Vec<_> = chosen.iter().map(|&i| models[i].clone()).collect();
        let expected = if singles.len() == 1 { singles[0].clone() } else { packed(&singles) };
        assert!(part_of(&all, chosen) == expected, "objects {chosen:?} of the pack");
    }
    // Several objects of a pack beside other models, and between them.
    let (pack_of_all, [a, b, c]) = (Model::parse(&all).unwrap(), models);
    let last = Part::of(pack_of_all, 1..3).unwrap();
    let parts = [Part::from(Model::parse(c).unwrap()), last, Part::from(pack_of_all)];
    assert!(packed_parts(&parts) == packed(&[c, b, c, a, b, c].map(Clone::clone)));
    for none in [0..0, 1..1, 3..4, 2..4] {
        assert!(Part::of(pack_of_all, none.clone()).is_none(), "{none:?} of three objects");
    }
}

#[test]
fn models_of_the_paper_come_out_of_a_pack_as_they_were() {
    let paper = [FeatureKind::Both, FeatureKind::Chroma].map(|kind| small_model(Method::Paper, kind, 10));
    for model in paper {
        let three = packed(&vec![model.clone(); 3]);
        assert!(part_of(&three, &[1]) == model);
        assert!(part_of(&three, &[2, 0]) == packed(&[model.clone(), model]));
    }
}

#[test]
fn models_without_colour_or_second_tiers_come_out_of_a_pack_as_they_were() {
    let [coloured, ..] = &*MODELS;
    let gray = train(&picture("pictures/brick"), "brick", Preset::Compact, false).unwrap().0;
    let small = small_model(Method::Keygraph, FeatureKind::Both, 10);
    assert_eq!(Model::parse(&gray).unwrap().feature(), FeatureKind::Luma);
    assert!(!Model::parse(&small).unwrap().has_second_tiers());
    let three = packed(&[gray.clone(), coloured.clone(), small.clone()]);
    assert!(part_of(&three, &[0]) == gray);
    assert!(part_of(&three, &[1]) == *coloured);
    assert!(part_of(&three, &[2]) == small);
    assert!(part_of(&three, &[2, 0]) == packed(&[small, gray.clone()]));
    assert!(
        part_of(&packed(&[coloured.clone(), gray.clone(), gray.clone()]), &[1, 2]) == packed(&[gray.clone(), gray])
    );

    // A coloured picture that was trained on luma has a template in colour. Beside models in colour it has none.
    let luma = train(&picture("pictures/coffee"), "coffee", Preset::Compact, true).unwrap().0;
    let mut without = luma.clone();
    let sections = Sections::of(&luma);
    let model = Model::parse(&luma).unwrap();
    let (w, h) = (model.object(0).template.width, model.object(0).template.height);
    let bytes: usize = (0..4).map(|level| (w >> level) * (h >> level)).sum();
    without[sections.templates + bytes..].fill(0x80);
    seal(&mut without);
    let two = packed(&[coloured.clone(), luma.clone()]);
    assert!(luma != without && part_of(&two, &[1]) == without);
}

#[test]
fn records_that_do_not_lie_together_are_no_part() {
    let small = small_model(Method::Keygraph, FeatureKind::Luma, 8);
    let two = packed(&[small.clone(), small]);
    let sections = Sections::of(&two);
    let changed = |changes: &[(usize, u8)]| {
        let mut model = two.clone();
        for &(at, byte) in changes {
            model[at] = byte;
        }
        seal(&mut model);
        model
    };
    let (view, keypoints) = (|i: usize| sections.views + Sections::VIEW * i, two[sections.views + 2]);
    for (what, model) in [
        ("views of both objects by turns", changed(&[(view(1), 1), (view(2), 0)])),
        ("keypoints that leave a gap", changed(&[(view(1) + 4, keypoints + 1)])),
        ("keygraphs on a view of the other object", changed(&[(view(1), 1)])),
    ] {
        let model = Model::parse(&model).unwrap();
        assert!(Part::of(model, 0..1).is_none(), "{what}");
        // What is a part gives a model that can be read.
        if let Some(part) = Part::of(model, 1..2) {
            Model::parse(&packed_parts(&[part])).unwrap();
        }
    }
}

/// A frame of the sequence, of which spots of `side` px hide a quarter here and there.
fn spotted(name: &str, side: u32) -> Picture {
    let mut picture = picture(&format!("sequence/{name}"));
    let Pixels::Rgb8(rgb) = &mut picture.pixels else { panic!("{name} has no colour") };
    for (i, v) in rgb.iter_mut().enumerate() {
        let [x, y] = [i as u32 / 3 % picture.width, i as u32 / 3 / picture.width].map(|v| v % (2 * side) < side);
        if x && y {
            *v = 120;
        }
    }
    picture
}

#[test]
fn among_many_a_pose_in_doubt_has_the_votes_that_it_has_alone() {
    static DETECTOR: Mutex<VgaDetector> = Mutex::new(VgaDetector::new());
    let small = ["astronaut", "rocket"].map(|name| model_of(name, 2000));
    let [large, .., other] = &*MODELS;
    let mut detector = DETECTOR.lock().unwrap();
    let mut poses = |model: &[u8], frame: &Picture, threshold: f32| {
        let (model, mut poses) = (Model::parse(model).unwrap(), Poses::default());
        let Pixels::Rgb8(rgb) = &frame.pixels else { panic!("the frame has no colour") };
        let frame = Frame::new(PixelFormat::Rgb8, frame.width as usize, frame.height as usize, rgb).unwrap();
        detector.detect(&frame, &model, threshold, &mut poses).unwrap();
        let last = model.objects() - 1;
        poses.0.into_iter().map(|(d, _)| d).filter(|d| usize::from(d.object) == last).collect::<Vec<_>>()
    };
    for (second_tier, alone, other) in [(true, large, other), (false, &small[0], &small[1])] {
        assert_eq!(Model::parse(alone).unwrap().has_second_tiers(), second_tier);
        // The tiers of the last object end the index.
        let many = packed(&[vec![other.clone(); 19], vec![alone.clone()]].concat());
        for name in ["0001", "0002"] {
            let frame = spotted(name, 4);
            // With this threshold a search goes on to its last step.
            let [alone, among] = [poses(alone, &frame, 0.94), poses(&many, &frame, 0.94)];
            let [alone, early, among] = [alone.last(), among.first(), among.last()].map(Option::unwrap);
            assert!(alone.score < 0.94 && early.votes < alone.votes, "{name}: in doubt, and the lists hold a part");
            assert_eq!((among.votes, among.score), (alone.votes, alone.score), "{name}");
        }
    }
}
