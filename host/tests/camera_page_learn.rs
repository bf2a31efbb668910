//! Objects that are learned on the page of `keygraph camera` from pictures, and the page on a
//! telephone meanwhile.
//!
//! In: pictures of the repository, in headless Chromium. Out: what the page says, and where its
//! controls are.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_browser;
mod camera_live;
mod program;

use camera_browser::{DESK, Tab, browser, still};
use camera_live::Live;
use program::{Folder, picture};
use serde_json::json;

/// Waits until the page says something about what was done, beside where it was done.
fn says(tab: &mut Tab<'_>, place: &str, words: &str) {
    tab.wait_for(&format!("$('{place}').checkVisibility() && $('{place}').textContent.includes({})", json!(words)));
}

#[test]
fn an_object_is_learned_from_a_picture() {
    let folder = Folder::new("from-picture");
    let Some(mut browser) = browser(&folder) else { return };
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("shown.bitmap.width > 0");

    tab.choose("#choose", &folder.file("notes.txt", b"no picture"));
    says(&mut tab, "said", "notes.txt is not a picture that this browser can show");
    image::RgbImage::from_pixel(300, 200, image::Rgb([90, 120, 60])).save(folder.join("plain.png")).unwrap();
    tab.choose("#choose", &folder.join("plain.png"));
    tab.wait_for("frozen.width === 300 && $('name').value === 'plain' && $('corners').hidden");
    tab.evaluate("$('train').click()");
    says(&mut tab, "problem", "The picture has too little to hold on to");
    tab.shoot("plain");
    // The picture stays, so that another part of it or another one can be taken.
    tab.evaluate("$('part').click(); marks.forEach((_, i) => move(i, 5 + i, 5)); $('train').click()");
    says(&mut tab, "problem", "The outline");

    tab.choose("#choose", &picture("astronaut"));
    tab.wait_for("frozen.width === 512 && $('name').value === 'astronaut' && !$('part').checked && $('problem').textContent === ''");
    tab.shoot("from-picture");
    tab.evaluate("$('train').click()");
    says(&mut tab, "said", "astronaut learned: ");
    tab.wait_for("$('seen').textContent.startsWith('astronautscore')");
    assert_eq!(tab.evaluate("document.body.className"), "");
}

#[test]
fn a_picture_is_dropped_and_a_large_one_is_made_smaller() {
    let folder = Folder::new("dropped");
    let Some(mut browser) = browser(&folder) else { return };
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("shown.bitmap.width > 0");
    // A photograph of 48 megapixels, as telephones take them: the frame of the camera, enlarged.
    tab.evaluate(
        "(async () => {
            const canvas = element('canvas', { width: 8000, height: 6000 });
            canvas.getContext('2d').drawImage(shown.bitmap, 0, 0, 8000, 6000);
            const blob = await new Promise(take => canvas.toBlob(take, 'image/jpeg'));
            globalThis.carried = new DataTransfer();
            carried.items.add(new File([blob], 'from the wall.jpg', { type: 'image/jpeg' }));
            dispatchEvent(new DragEvent('dragover', { dataTransfer: carried, cancelable: true }));
        })()",
    );
    assert_eq!(tab.evaluate("$('drop').checkVisibility()"), true);
    tab.shoot("dropping");
    tab.evaluate("dispatchEvent(new DragEvent('drop', { dataTransfer: carried, cancelable: true }))");
    tab.wait_for("frozen && $('drop').hidden && $('name').value === 'from the wall'");
    let pixels = tab.evaluate("frozen.width * frozen.height").as_f64().unwrap();
    assert!((3.9e6..4.1e6).contains(&pixels), "{pixels} px are sent");
    tab.evaluate("$('train').click()");
    says(&mut tab, "said", "from the wall learned");
    tab.wait_for("shown.line.detections.some(d => d.object === 'from the wall')");
}

/// The controls that are not wholly in the window, smaller than a finger, or over another one.
const WRONG: &str = "(() => {
    const all = [...document.querySelectorAll('#task, #lesson button, #lesson input[type=text], #lesson label.check, #problem')]
        .filter(e => e.checkVisibility() && e.textContent + e.tagName !== 'DIV').map(e => [e.id || e.className, e.getBoundingClientRect(), e.tagName]);
    const stage = $('stage').getBoundingClientRect(), handles = marks.filter(m => m.checkVisibility());
    const within = (r, o) => r.left >= o.left && r.top >= o.top && r.right <= o.right && r.bottom <= o.bottom;
    const over = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    const seen = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
    return [
        ...all.filter(([, r]) => !within(r, seen)).map(([n]) => n + ' is not in view'),
        ...all.filter(([, r, tag]) => ['BUTTON', 'INPUT', 'LABEL'].includes(tag) && r.height < 44).map(([n, r]) => `${n} is ${r.height} px high`),
        ...all.flatMap(([n, a], i) => all.slice(i + 1).filter(([, b]) => over(a, b)).map(([m]) => n + ' lies over ' + m)),
        ...all.filter(([, r]) => over(r, stage)).map(([n]) => n + ' lies over the picture'),
        ...handles.filter(m => !within(m.getBoundingClientRect(), stage)).map(m => `corner ${m.textContent} leaves the picture`),
        ...document.documentElement.scrollHeight > innerHeight ? ['the page scrolls'] : [],
        ...all.length < 4 ? [`only ${all.length} controls are seen`] : [],
    ];
})()";

#[test]
fn on_a_telephone_all_that_is_needed_to_learn_is_in_view() {
    let folder = Folder::new("telephone-learns");
    let Some(mut browser) = browser(&folder) else { return };
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let url = format!("http://{}/", live.place);
    // Upright, with a keyboard on the screen, and on its side.
    for (width, height) in [(390, 844), (390, 500), (844, 390)] {
        let mut tab = browser.tab(&url, DESK).touched(width, height);
        let fine = |tab: &mut Tab<'_>, state: &str| {
            tab.shoot(&format!("telephone-{width}x{height}-{state}"));
            assert_eq!(tab.evaluate(WRONG), json!([]), "{width}x{height}, {state}");
        };
        tab.wait_for("shown.bitmap.width > 0");
        tab.evaluate("$('learn').click()");
        tab.wait_for("frozen && $('task').textContent.startsWith('Drag the corners')");
        fine(&mut tab, "camera");
        // Corners in the corners of the picture are still whole.
        tab.evaluate("[[0, 0], [639, 0], [639, 479], [0, 479]].forEach(([x, y], i) => move(i, x, y))");
        fine(&mut tab, "corners");
        tab.evaluate("($('name').value = 'x', outline = [[0, 0], [20, 0], [20, 20], [0, 20]], $('train').click())");
        says(&mut tab, "problem", "The outline is too small");
        tab.evaluate("[[0, 0], [639, 0], [639, 479], [0, 479]].forEach(([x, y], i) => move(i, x, y))");
        fine(&mut tab, "error");
        tab.evaluate("$('cancel').click()");
        tab.choose("#choose", &picture("coffee"));
        tab.wait_for("frozen && frozen.from === 'picture'");
        fine(&mut tab, "picture");
        tab.evaluate("$('part').click()");
        fine(&mut tab, "part");
    }
}
