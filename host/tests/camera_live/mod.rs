//! `keygraph camera` (and `train --from-camera`) as a running process, with requests over
//! HTTP.
//!
//! In: arguments and requests. Out: the log, standard output and answers. Every wait has a
//! generous limit, since test machines may be slow.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::program::{assets, numbers};

/// Maximum time of any wait.
pub const LIMIT: Duration = Duration::from_secs(90);

/// A running `keygraph camera`; killed when dropped.
pub struct Live {
    child: Child,
    /// Lines of the log. Threads that send requests at the same time share it.
    log: Mutex<Receiver<String>>,
    /// Lines of the log that were read so far.
    pub logged: Vec<String>,
    out: Option<ChildStdout>,
    /// Whether the log is read no more.
    deaf: Arc<AtomicBool>,
    /// Host and port of the page.
    pub place: String,
    /// Token of the page.
    pub token: Option<String>,
}

/// Sends the lines of a stream as they arrive, until `deaf`. Then the stream stays open.
fn lines(stream: ChildStderr, deaf: Arc<AtomicBool>) -> Receiver<String> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
        while let Some(line) = lines.next()
            && sender.send(line).is_ok()
        {
            while deaf.load(Ordering::Relaxed) {
                thread::park();
            }
        }
    });
    receiver
}

impl Live {
    /// Starts `keygraph camera` with `arguments`; waits for the page if one is asked for.
    pub fn start(arguments: &[&str]) -> Self {
        Self::run("camera", arguments)
    }

    /// Starts `command` with `arguments`; waits for the page if one is asked for.
    pub fn run(command: &str, arguments: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_keygraph"))
            .arg(command)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let deaf = Arc::new(AtomicBool::new(false));
        let log = Mutex::new(lines(child.stderr.take().unwrap(), Arc::clone(&deaf)));
        let out = child.stdout.take();
        let mut live = Self { child, log, logged: Vec::new(), out, deaf, place: String::new(), token: None };
        if arguments.contains(&"--web") {
            let line = live.wait_for("the page is at http://");
            let url = line.split("http://").nth(1).unwrap().trim();
            let (place, token) = url.split_once('/').unwrap();
            live.place = place.to_string();
            // A token that was given is not told.
            live.token = token.strip_prefix("#token=").filter(|t| *t != "TOKEN").map(str::to_string);
        }
        live
    }

    /// Waits for the next line of the log with `words` in it.
    pub fn wait_for(&mut self, words: &str) -> String {
        let end = Instant::now() + LIMIT;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.log.get_mut().unwrap().recv_timeout(left);
            let line = line.unwrap_or_else(|_| panic!("{words:?} was not logged; but:\n{}", self.logged.join("\n")));
            self.logged.push(line.clone());
            if line.contains(words) {
                return line;
            }
        }
    }

    /// Reads the log no more, and fills its pipe: who writes a line to it waits for ever.
    pub fn stop_reading_the_log(&self) {
        self.deaf.store(true, Ordering::Relaxed);
        let mut pipe = std::fs::File::options().write(true).open(format!("/proc/{}/fd/2", self.id())).unwrap();
        let written = Arc::new(AtomicUsize::new(0));
        thread::spawn({
            let written = Arc::clone(&written);
            move || {
                // Whole pages, so that no room is left in one.
                let line = [&[b'.'; 4095][..], b"\n"].concat();
                while pipe.write_all(&line).is_ok() {
                    written.fetch_add(1, Ordering::Relaxed);
                }
            }
        });
        let mut before = usize::MAX;
        while std::mem::replace(&mut before, written.load(Ordering::Relaxed)) != before || before == 0 {
            thread::sleep(Duration::from_millis(200));
        }
    }

    /// Sends the signal with this name.
    pub fn signal(&self, name: &str) {
        let status = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status().unwrap();
        assert!(status.success());
    }

    /// The id of the process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// A size of the process from `/proc/PID/status`, such as `VmHWM`, kB.
    pub fn memory_kb(&self, name: &str) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/status", self.id())).unwrap();
        let line = text.lines().find(|l| l.starts_with(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    }

    /// Waits until the process has ended, without reading its standard output.
    pub fn ended(&mut self) -> ExitStatus {
        let end = Instant::now() + LIMIT;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(Instant::now() < end, "it does not end");
            thread::sleep(Duration::from_millis(10));
        }
    }

    /// Waits until the process has ended. Returns its status, its standard output and the time
    /// that the wait took.
    pub fn end(&mut self) -> (ExitStatus, String, Duration) {
        let start = Instant::now();
        let mut text = String::new();
        // Reads to the end of the process.
        self.out.take().unwrap().read_to_string(&mut text).unwrap();
        let status = self.child.wait().unwrap();
        (status, text, start.elapsed())
    }

    /// Sends a request with `headers` and `body`.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut stream = self.connect();
        let host =
            if headers.iter().any(|h| h.0 == "Host") { String::new() } else { format!("Host: {}\r\n", self.place) };
        let extra: String = headers.iter().map(|(k, v)| format!("{k}: {v}\r\n")).collect();
        let bearer = self.token.as_ref().map_or_else(String::new, |t| format!("Authorization: Bearer {t}\r\n"));
        let head = format!(
            "{method} {path} HTTP/1.1\r\n{host}{bearer}{extra}Content-Length: {}\r\nConnection: close\r\n\r\n",
            body.len()
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream.write_all(body).unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        Answer::parse(&bytes)
    }

    /// Connects to the page.
    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.place).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        stream
    }

    /// Sends a GET request.
    pub fn get(&self, path: &str) -> Answer {
        self.ask("GET", path, &[], b"")
    }

    /// The newest frame that is not number `after`.
    pub fn frame(&self, after: Option<u64>, details: bool) -> Frame {
        let after = after.map_or_else(String::new, |n| format!("&after={n}"));
        let path = format!("/frame?details={}{after}", u8::from(details));
        let end = Instant::now() + LIMIT;
        loop {
            let answer = self.get(&path);
            if answer.status == 200 {
                return Frame::parse(&answer.body);
            }
            assert_eq!(answer.status, 204, "{}", answer.text());
            assert!(Instant::now() < end, "no frame");
        }
    }

    /// Waits for a frame for which `is_right` holds.
    pub fn frame_with(&self, is_right: impl Fn(&Frame) -> bool) -> Frame {
        let end = Instant::now() + LIMIT;
        let mut frame = self.frame(None, false);
        while !is_right(&frame) {
            assert!(Instant::now() < end, "no such frame; the last was {}", frame.line);
            frame = self.frame(Some(frame.number), false);
        }
        frame
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The true outline of an object in a frame of the sequence.
pub fn truth(frame: u64, name: &str, [w, h]: [f64; 2]) -> Option<[[f32; 2]; 4]> {
    let all: Value = serde_json::from_slice(&std::fs::read(assets().join("sequence/truth.json")).unwrap()).unwrap();
    let map = &all[frame as usize % all.as_array().unwrap().len()]["objects"][name];
    let m = if map.is_null() { return None } else { numbers::<9>(map) };
    Some([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|[x, y]| {
        let z = m[6] * x + m[7] * y + m[8];
        [((m[0] * x + m[1] * y + m[2]) / z) as f32, ((m[3] * x + m[4] * y + m[5]) / z) as f32]
    }))
}

/// The outline of a detection.
pub fn outline(detection: &Value) -> [[f32; 2]; 4] {
    let corners = detection["corners"].as_array().unwrap();
    std::array::from_fn(|i| numbers::<2>(&corners[i]).map(|v| v as f32))
}

/// An answer over HTTP.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    fn parse(bytes: &[u8]) -> Self {
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").expect("no answer");
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Self { status, head, body: bytes[end + 4..].to_vec() }
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_str(&self.text()).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }
}

/// A frame in the form that the page gets.
pub struct Frame {
    pub number: u64,
    pub header: Value,
    pub line: Value,
    pub jpeg: Vec<u8>,
    /// Number of bytes after the picture.
    pub details: usize,
}

impl Frame {
    fn parse(body: &[u8]) -> Self {
        let end = 4 + u32::from_le_bytes(body[..4].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&body[4..end]).unwrap();
        let jpeg = header["jpeg"].as_u64().unwrap() as usize;
        Self {
            number: header["number"].as_u64().unwrap(),
            line: header["line"].clone(),
            jpeg: body[end..end + jpeg].to_vec(),
            details: body.len() - end - jpeg,
            header,
        }
    }

    /// The detection of an object; `None` when it is not found.
    pub fn detection(&self, name: &str) -> Option<&Value> {
        self.line["detections"].as_array().unwrap().iter().find(|d| d["object"] == name)
    }
}
