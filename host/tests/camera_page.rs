//! The page of `keygraph camera` in a real browser: headless Chromium, driven over the
//! DevTools protocol through a pair of pipes.
//!
//! In: frames of the repository. Out: the pixels that the page draws, and what it does on
//! clicks and keys. Screenshots go to the folder that KEYGRAPH_SCREENSHOTS names, if it is
//! set. Skipped when there is no Chromium.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live};
use program::{Folder, assets, keygraph, numbers, picture};
use serde_json::{Value, json};

// ------------------------------------------------------------------- browser

/// A headless Chromium; killed when dropped.
struct Browser {
    child: Child,
    input: File,
    messages: Receiver<Value>,
    id: u64,
}

/// A tab of the browser, of a given size.
struct Tab<'a> {
    browser: &'a mut Browser,
    session: String,
}

/// Starts the browser. Returns `None`, and prints a line, when there is none.
fn browser(folder: &Folder) -> Option<Browser> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|n| Command::new(n).arg("--version").output().is_ok_and(|o| o.status.success()));
    let Some(program) = found else {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no Chromium, and nothing may be skipped");
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: the page is not looked at without Chromium: sudo apt-get install chromium"
        );
        return None;
    };
    let [input, output] = ["in", "out"].map(|n| folder.join(n));
    assert!(Command::new("mkfifo").args([&input, &output]).status().unwrap().success());
    // The protocol uses the descriptors 3 and 4.
    let child = Command::new("sh")
        .args(["-c", "exec \"$0\" \"$@\" 3<\"$IN\" 4>\"$OUT\"", program])
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-pipe"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .env("IN", &input)
        .env("OUT", &output)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let input = OpenOptions::new().write(true).open(&input).unwrap();
    let output = File::open(&output).unwrap();
    let (sender, messages) = channel();
    thread::spawn(move || {
        for message in BufReader::new(output).split(0).map_while(Result::ok) {
            let _ = sender.send(serde_json::from_slice::<Value>(&message).unwrap());
        }
    });
    Some(Browser { child, input, messages, id: 0 })
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Browser {
    fn call(&mut self, session: Option<&str>, method: &str, parameters: &Value) -> Value {
        self.id += 1;
        let mut message = json!({"id": self.id, "method": method, "params": parameters});
        if let Some(session) = session {
            message["sessionId"] = json!(session);
        }
        self.input.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.messages.recv_timeout(LIMIT).unwrap_or_else(|_| panic!("no answer to {method}"));
            if answer["id"] == self.id {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    fn tab(&mut self, url: &str, (width, height, ratio): (u32, u32, u32)) -> Tab<'_> {
        let session = self.open(url);
        let tab = Tab { browser: self, session };
        tab.resized(width, height, ratio)
    }

    fn open(&mut self, url: &str) -> String {
        let target = self.call(None, "Target.createTarget", &json!({"url": url}))["targetId"].clone();
        let attached = self.call(None, "Target.attachToTarget", &json!({"targetId": target, "flatten": true}));
        attached["sessionId"].as_str().unwrap().to_string()
    }
}

impl Tab<'_> {
    fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.browser.call(Some(&self.session), method, parameters)
    }

    fn resized(mut self, width: u32, height: u32, ratio: u32) -> Self {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": false});
        self.call("Emulation.setDeviceMetricsOverride", &size);
        self
    }

    fn evaluate(&mut self, expression: &str) -> Value {
        let wanted = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let answer = self.call("Runtime.evaluate", &wanted);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    fn wait_for(&mut self, expression: &str) -> Value {
        let end = Instant::now() + LIMIT;
        loop {
            // The page may not have defined the names yet.
            let value =
                self.evaluate(&format!("(() => {{ try {{ return {expression}; }} catch {{ return null; }} }})()"));
            if !matches!(value, Value::Null | Value::Bool(false)) {
                return value;
            }
            if Instant::now() > end {
                self.shoot("failed");
                panic!("did not become true: {expression}");
            }
            thread::sleep(Duration::from_millis(100));
        }
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let buttons = u8::from(kind != "mouseReleased");
        let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
        self.call("Input.dispatchMouseEvent", &event);
    }

    fn key(&mut self, key: &str, text: &str) {
        let code = if key == "Enter" { 13 } else { 0 };
        let event = |kind: &str| json!({"type": kind, "key": key, "text": text, "windowsVirtualKeyCode": code});
        self.call("Input.dispatchKeyEvent", &event("keyDown"));
        self.call("Input.dispatchKeyEvent", &json!({"type": "keyUp", "key": key, "windowsVirtualKeyCode": code}));
    }

    fn type_text(&mut self, text: &str) {
        self.call("Input.insertText", &json!({"text": text}));
    }

    /// Writes a screenshot when KEYGRAPH_SCREENSHOTS is set.
    fn shoot(&mut self, name: &str) {
        let Some(folder) = std::env::var_os("KEYGRAPH_SCREENSHOTS") else { return };
        let shot = self.call("Page.captureScreenshot", &json!({"format": "png"}));
        let bytes = decode_base64(shot["data"].as_str().unwrap());
        std::fs::write(Path::new(&folder).join(name).with_extension("png"), bytes).unwrap();
    }
}

fn decode_base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bytes = Vec::new();
    let (mut held, mut bits) = (0_u32, 0);
    for digit in text.bytes().filter_map(|b| DIGITS.iter().position(|d| *d == b)) {
        held = held << 6 | digit as u32;
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            bytes.push((held >> bits) as u8);
        }
    }
    bytes
}

// --------------------------------------------------------------------- tests

/// The outline of the astronaut in a frame of the sequence, as it was rendered.
fn truth(frame: usize) -> [[f64; 2]; 4] {
    let all: Value = serde_json::from_slice(&std::fs::read(assets().join("sequence/truth.json")).unwrap()).unwrap();
    let m = numbers::<9>(&all[frame]["objects"]["astronaut"]);
    [[0.0, 0.0], [512.0, 0.0], [512.0, 512.0], [0.0, 512.0]].map(|[x, y]| {
        let z = m[6] * x + m[7] * y + m[8];
        [(m[0] * x + m[1] * y + m[2]) / z, (m[3] * x + m[4] * y + m[5]) / z]
    })
}

/// Makes a folder with one frame of the sequence: an object that does not move.
fn still(folder: &Folder) -> String {
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::copy(program::frame(2), frames.join("0.jpg")).unwrap();
    frames.to_str().unwrap().to_string()
}

fn model(folder: &Folder) -> String {
    let path = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    let picture = picture("astronaut");
    keygraph(&["train", picture.to_str().unwrap(), "--preset", "standard", "-o", &path]).ended_with(0);
    path
}

const DESK: (u32, u32, u32) = (1280, 800, 1);

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
            "(() => {{ const v = view.getBoundingClientRect(), m = marks[{i}].getBoundingClientRect(), s = v.width / frozen.line.width;
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
    let live = Live::start(&[
        "--replay",
        &still(&folder),
        "--fps",
        "10",
        "-m",
        &astronaut,
        "--web",
        "0.0.0.0:0",
        "--token",
        "open-sesame-12345",
    ]);
    let mut tab = browser.tab(&format!("http://{}/", live.place), (390, 844, 3));
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
