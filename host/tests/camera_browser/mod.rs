//! A headless Chromium that shows the page, driven over the DevTools protocol through a pair of
//! pipes.
//!
//! In: the address of a page, clicks and keys. Out: what the page computes, screenshots. They go to
//! the folder that KEYGRAPH_SCREENSHOTS names, if it is set. A test is skipped when there is no
//! Chromium.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::camera_live::LIMIT;
use crate::program::{self, Folder, assets, keygraph, numbers, picture};

/// A headless Chromium; killed when dropped.
pub struct Browser {
    child: Child,
    input: File,
    messages: Receiver<Value>,
    id: u64,
}

/// A tab of the browser, of a given size.
pub struct Tab<'a> {
    browser: &'a mut Browser,
    pub session: String,
}

/// A mouse that hovers: a headless browser has none.
const POINTER: &str =
    "--blink-settings=primaryPointerType=4,availablePointerTypes=4,primaryHoverType=2,availableHoverTypes=2";

/// Starts the browser. Returns `None`, and prints a line, when there is none.
pub fn browser(folder: &Folder) -> Option<Browser> {
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
        .arg(POINTER)
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

    pub fn tab(&mut self, url: &str, (width, height, ratio): (u32, u32, u32)) -> Tab<'_> {
        let session = self.open(url);
        let tab = Tab { browser: self, session };
        tab.resized(width, height, ratio)
    }

    pub fn open(&mut self, url: &str) -> String {
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

    /// Makes the tab that of a telephone: fingers, no keyboard.
    pub fn touched(mut self, width: u32, height: u32) -> Self {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 3, "mobile": true});
        self.call("Emulation.setDeviceMetricsOverride", &size);
        self.call("Emulation.setTouchEmulationEnabled", &json!({"enabled": true, "maxTouchPoints": 5}));
        self
    }

    /// Chooses a file, as a user does in the dialog of `<input type=file>`.
    pub fn choose(&mut self, selector: &str, file: &Path) {
        let input =
            self.call("Runtime.evaluate", &json!({"expression": format!("document.querySelector('{selector}')")}));
        let object = &input["result"]["objectId"];
        self.call("DOM.setFileInputFiles", &json!({"files": [file], "objectId": object}));
    }

    pub fn evaluate(&mut self, expression: &str) -> Value {
        let wanted = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let answer = self.call("Runtime.evaluate", &wanted);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    pub fn wait_for(&mut self, expression: &str) -> Value {
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

    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let buttons = u8::from(kind != "mouseReleased");
        let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
        self.call("Input.dispatchMouseEvent", &event);
    }

    pub fn key(&mut self, key: &str, text: &str) {
        let code = if key == "Enter" { 13 } else { 0 };
        let event = |kind: &str| json!({"type": kind, "key": key, "text": text, "windowsVirtualKeyCode": code});
        self.call("Input.dispatchKeyEvent", &event("keyDown"));
        self.call("Input.dispatchKeyEvent", &json!({"type": "keyUp", "key": key, "windowsVirtualKeyCode": code}));
    }

    pub fn type_text(&mut self, text: &str) {
        self.call("Input.insertText", &json!({"text": text}));
    }

    /// Writes a screenshot when KEYGRAPH_SCREENSHOTS is set.
    pub fn shoot(&mut self, name: &str) {
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

/// The outline of the astronaut in a frame of the sequence, as it was rendered.
pub fn truth(frame: usize) -> [[f64; 2]; 4] {
    let all: Value = serde_json::from_slice(&std::fs::read(assets().join("sequence/truth.json")).unwrap()).unwrap();
    let m = numbers::<9>(&all[frame]["objects"]["astronaut"]);
    [[0.0, 0.0], [512.0, 0.0], [512.0, 512.0], [0.0, 512.0]].map(|[x, y]| {
        let z = m[6] * x + m[7] * y + m[8];
        [(m[0] * x + m[1] * y + m[2]) / z, (m[3] * x + m[4] * y + m[5]) / z]
    })
}

/// Makes a folder with one frame of the sequence: an object that does not move.
pub fn still(folder: &Folder) -> String {
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::copy(program::frame(2), frames.join("0.jpg")).unwrap();
    frames.to_str().unwrap().to_string()
}

pub fn model(folder: &Folder) -> String {
    let path = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    let picture = picture("astronaut");
    keygraph(&["train", picture.to_str().unwrap(), "--preset", "standard", "-o", &path]).ended_with(0);
    path
}

pub const DESK: (u32, u32, u32) = (1280, 800, 1);
