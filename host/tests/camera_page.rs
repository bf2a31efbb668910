//! The page of `keygraph camera` in a real browser: headless Chromium.
//!
//! In: frames of the repository. Out: the pixels that the page draws, and what it does on
//! clicks and keys.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_browser;
mod camera_live;
mod program;

use std::io::Write;
use std::thread;
use std::time::Duration;

use camera_browser::{DESK, Tab, browser, model, still, truth};
use camera_live::Live;
use program::{Folder, assets, keygraph, numbers, picture};
use serde_json::json;

/// Counts the points, of 40 along the true outline, that have the outline's colour within
/// 2 px.
const ON_OUTLINE: &str = "(() => {
    const scale = view.width / shown.line.width;
    let on = 0;
    for (let i = 0; i < 40; i++) {
        const a = TRUTH[i % 4], b = TRUTH[(i + 1) % 4], t = (1 + Math.floor(i / 4)) / 11;
        const x = (a[0] + (b[0] - a[0]) * t + .5) * scale, y = (a[1] + (b[1] - a[1]) * t + .5) * scale;
        const p = context.getImageData(Math.round(x) - 2, Math.round(y) - 2, 5, 5).data;
        const is = k => Math.abs(p[k] - 76) + Math.abs(p[k + 1] - 194) + Math.abs(p[k + 2] - 255) < 60;
        if (Array.from({ length: 25 }, (_, k) => 4 * k).some(is)) on++;
    }
    return on;
})()";

/// Prints the time from the arrival of a frame to its outline on the canvas.
fn tell_delay(tab: &mut Tab<'_>) {
    let mut delays: Vec<[f64; 2]> = (0..30)
        .map(|_| {
            let before = tab.evaluate("shown.number");
            numbers(&tab.wait_for(&format!("shown.number !== {before} && [latency, shown.line.time_ms.total]")))
        })
        .collect();
    delays.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let ([median, search], [worst, _]) = (delays[15], delays[29]);
    assert!(median > search, "drawn {median} ms after the camera gave it, but searched for {search} ms");
    let _ = writeln!(
        std::io::stderr(),
        "from frame to drawn outline: median {median:.0} ms (its search took {search:.0} ms), worst of 30 {worst:.0} ms"
    );
}

#[test]
fn the_outline_lies_on_the_object_and_the_picture_moves() {
    let folder = Folder::new("outline");
    let Some(mut browser) = browser(&folder) else { return };
    let astronaut = model(&folder);
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "-m", &astronaut, "--web", "127.0.0.1:0"]);
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("shown.line.detections.length === 1");
    tell_delay(&mut tab);
    let on_outline = ON_OUTLINE.replace("TRUTH", &json!(truth(2)).to_string());
    let on = tab.evaluate(&on_outline).as_i64().unwrap();
    assert!(on >= 36, "{on} of 40 points of the true outline are drawn on");
    tab.shoot("found");
    tab.key("o", "o");
    let on = tab.evaluate(&on_outline).as_i64().unwrap();
    assert!(on <= 4, "{on} of 40 points have the outline's colour without an outline");
    tab.key("o", "o");
    for key in ["c", "t", "v"] {
        tab.key(key, key);
    }
    tab.wait_for("shown.corners.length > 100 && shown.keygraphs.length > 100 && shown.votes.length >= 6");
    tab.shoot("details");

    let sequence = assets().join("sequence");
    let moving =
        Live::start(&["--replay", sequence.to_str().unwrap(), "--fps", "10", "-m", &astronaut, "--web", "127.0.0.1:0"]);
    let url = format!("http://{}/", moving.place);
    const PRINT: &str = "[shown.number, context.getImageData(0, 0, view.width, view.height).data.reduce((a, v, i) => (a * 31 + v) | 0, 0)]";
    let second = browser.open(&url);
    let mut tab = browser.tab(&url, DESK);
    for viewer in 0..2 {
        let print = tab.wait_for(PRINT);
        let later = tab.wait_for(&format!("(now => now[0] !== {} && now)({PRINT})", print[0]));
        assert_ne!(print[1], later[1], "viewer {viewer}: the picture of another frame is the same");
        tab.session.clone_from(&second);
    }
}

#[test]
fn an_object_is_learned_with_the_mouse() {
    let folder = Folder::new("learned");
    let Some(mut browser) = browser(&folder) else { return };
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("shown.bitmap.width > 0");
    tab.key("l", "l");
    tab.wait_for("frozen !== null");
    for (i, [x, y]) in truth(2).into_iter().enumerate() {
        let place = format!(
            "(() => {{ const v = view.getBoundingClientRect(), m = marks[{i}].getBoundingClientRect(), s = v.width / frozen.width;
                return [m.x + m.width / 2, m.y + m.height / 2, v.x + ({x} + .5) * s, v.y + ({y} + .5) * s]; }})()"
        );
        let [x0, y0, x1, y1] = numbers::<4>(&tab.evaluate(&place));
        tab.mouse("mousePressed", [x0, y0]);
        tab.mouse("mouseMoved", [(x0 + x1) / 2.0, y1]);
        tab.mouse("mouseMoved", [x1, y1]);
        tab.mouse("mouseReleased", [x1, y1]);
    }
    // Arrow keys move a corner by one pixel, there and back.
    tab.evaluate("marks[0].focus()");
    let before = tab.evaluate("outline[0][0]").as_f64().unwrap();
    tab.key("ArrowRight", "");
    assert!((tab.evaluate("outline[0][0]").as_f64().unwrap() - before - 1.0).abs() < 1e-6);
    tab.key("ArrowLeft", "");
    tab.shoot("learning");
    tab.evaluate("$('name').focus()");
    tab.type_text("visitor");
    tab.key("Enter", "\r");
    tab.wait_for("shown.line.detections.some(d => d.object === 'visitor')");
    tab.wait_for("$('said').textContent.startsWith('visitor learned')");
    let on = tab.wait_for(&ON_OUTLINE.replace("TRUTH", &json!(truth(2)).to_string())).as_i64().unwrap();
    assert!(on >= 36, "{on} of 40 points of the true outline are drawn on");
    tab.shoot("learned");
    let press = |label: &str| {
        format!("[...document.querySelectorAll('#models button')].find(b => b.textContent === '{label}').click()")
    };
    tab.evaluate(&press("Remove"));
    tab.wait_for("$('said').textContent === 'Press again to remove visitor.'");
    assert_eq!(tab.evaluate("$('models').children.length"), 1, "removed without being asked");
    tab.evaluate(&press("Really?"));
    tab.wait_for("shown.line.detections.length === 0 && $('models').children.length === 0");
}

#[test]
fn training_from_a_camera_ends_with_the_page() {
    let folder = Folder::new("train");
    let Some(mut browser) = browser(&folder) else { return };
    let output = folder.join("poster.kgm");
    let mut live = Live::run(
        "train",
        &[
            "--from-camera",
            "--replay",
            &still(&folder),
            "--fps",
            "10",
            "--web",
            "127.0.0.1:0",
            "-o",
            output.to_str().unwrap(),
        ],
    );
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("shown.bitmap.width > 0 && $('said').textContent.includes('poster.kgm')");
    tab.key("l", "l");
    tab.evaluate(&format!("(outline = {}, draw(), $('train').click())", json!(truth(2))));
    tab.wait_for("done && $('notice').textContent.includes('poster was saved as')");
    let (status, out, _) = live.end();
    assert!(status.success() && out.contains("the picture of poster, "), "{status}: {out}");
    // The page knows that the program has ended, and shows no error.
    thread::sleep(Duration::from_secs(2));
    assert_eq!(tab.evaluate("$('notice').textContent.includes('poster was saved as')"), true);
    tab.shoot("trained");
}

#[test]
fn a_telephone_with_a_token() {
    let folder = Folder::new("telephone");
    let Some(mut browser) = browser(&folder) else { return };
    let astronaut = model(&folder);
    let frames = still(&folder);
    let source = ["--replay", &frames, "--fps", "10", "-m", &astronaut];
    let live = Live::start(&[&source[..], &["--web", "0.0.0.0:0", "--token", "open-sesame-12345"]].concat());
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK).touched(390, 844);
    tab.wait_for("!$('key').hidden && shown === null");
    tab.evaluate("$('token').focus()");
    tab.type_text("open-sesame-12345");
    tab.key("Enter", "\r");
    tab.wait_for("$('key').hidden && shown.line.detections.length === 1");
    let widths = tab.evaluate("[document.documentElement.scrollWidth, innerWidth, view.width / view.clientWidth]");
    let [wide, window, ratio] = numbers::<3>(&widths);
    assert!(wide <= window, "the page is {wide} px wide on a screen of {window}");
    assert!((ratio - 3.0).abs() < 0.02, "{ratio} pixels of the canvas for one of the page");
    tab.shoot("telephone");
}

#[test]
fn a_token_that_is_missing_wrong_or_new_is_named() {
    let folder = Folder::new("tokens");
    let Some(mut browser) = browser(&folder) else { return };
    let frames = still(&folder);
    let start =
        |web: &str, token: &str| Live::start(&["--replay", &frames, "--fps", "10", "--web", web, "--token", token]);
    let live = start("127.0.0.1:0", "open-sesame-12345");
    let place = live.place.clone();
    let mut tab = browser.tab(&format!("http://{place}/"), DESK);
    let says = |tab: &mut Tab<'_>, words: &str| {
        tab.wait_for(&format!(
            "$('refusal').textContent.includes('{words}: open the address that the program printed')"
        ));
        assert_eq!(tab.evaluate("!$('key').hidden && $('notice').textContent === $('refusal').textContent"), true);
    };
    says(&mut tab, "needs a token");
    // The address of another start in the same tab changes what stands after # alone.
    tab.evaluate("location.hash = '#token=a-token-of-before'");
    says(&mut tab, "The token is wrong");
    tab.shoot("token");
    tab.evaluate("location.hash = '#token=open-sesame-12345'");
    tab.wait_for("$('key').hidden && shown.bitmap.width > 0 && $('notice').textContent === ''");
    drop(live);
    tab.wait_for("$('notice').textContent.includes('does not answer')");
    let live = start(&place, "another-token-12345");
    says(&mut tab, "The token has changed, since the program was started anew");
    tab.evaluate("$('token').focus()");
    tab.type_text("another-token-12345");
    tab.key("Enter", "\r");
    tab.wait_for("$('key').hidden && shown.bitmap.width > 0 && $('notice').textContent === ''");
    drop(live);
}

#[test]
fn what_is_in_view_and_what_was_are_told_apart() {
    let folder = Folder::new("in-view");
    let Some(mut browser) = browser(&folder) else { return };
    let (astronaut, coffee) = (model(&folder), folder.join("coffee.kgm").to_str().unwrap().to_string());
    keygraph(&["train", picture("coffee").to_str().unwrap(), "--preset", "compact", "-o", &coffee]).ended_with(0);
    let frames = still(&folder);
    // The astronaut is there for two frames, and away for two.
    for (i, frame) in [2, 22, 22].into_iter().enumerate() {
        std::fs::copy(program::frame(frame), format!("{frames}/{}.jpg", i + 1)).unwrap();
    }
    let source = ["--replay", &frames, "--fps", "1", "-m", &astronaut, "-m", &coffee];
    let live = Live::start(&[&source[..], &["--web", "127.0.0.1:0"]].concat());
    let mut tab = browser.tab(&format!("http://{}/", live.place), DESK);
    tab.wait_for("/^astronautscore [01]\\.\\d\\d$/.test($('seen').textContent) && $('before').textContent === ''");
    tab.wait_for(
        "$('seen').textContent === 'nothing' && /^astronaut(just now|\\d s ago)$/.test($('before').textContent)",
    );
    tab.shoot("seen-before");
    assert_eq!(tab.evaluate("$('earlier').hidden"), false);
    assert_eq!(tab.evaluate("$('spoken').textContent"), "In view: nothing");
    // Another page that is opened now knows it too.
    assert_eq!(
        tab.evaluate("[ago(400), ago(61000), ago(130000), ago(7.2e6), ago(3e8)].join()"),
        "just now,61 s ago,2 min ago,2 h ago,3 days ago"
    );
    drop(live);
    tab.wait_for("$('seen').textContent.startsWith('unknown') && $('earlier').hidden");
}

#[test]
fn keys_are_named_where_there_is_a_keyboard() {
    let folder = Folder::new("keys");
    let Some(mut browser) = browser(&folder) else { return };
    let live = Live::start(&["--replay", &still(&folder), "--fps", "10", "--web", "127.0.0.1:0"]);
    let url = format!("http://{}/", live.place);
    let count = "shown && [...document.querySelectorAll('kbd')].filter(k => k.checkVisibility()).length";
    assert_eq!(browser.tab(&url, DESK).wait_for(&format!("(n => n === 6 && n)({count})")), 6);
    assert_eq!(browser.tab(&url, DESK).touched(390, 844).wait_for(&format!("shown && [{count}]")), json!([0]));
}
