//! `keygraph camera --mqtt` with a real broker, Mosquitto, which is restarted during the
//! test.
//!
//! In: the sequence of the repository. Out: the messages that a subscriber receives. Skipped
//! when there is no Mosquitto.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live};
use program::{Folder, keygraph, picture};
use serde_json::Value;

/// A process that is killed when dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn broker(port: u16) -> Option<Process> {
    // Debian installs servers in a folder that is in the path of root only.
    let start = |program: &str| {
        let port = port.to_string();
        Command::new(program)
            .args(["-p", &port])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .ok()
    };
    let broker = start("mosquitto").or_else(|| start("/usr/sbin/mosquitto"));
    let subscriber = Command::new("mosquitto_sub").arg("--help").output().is_ok();
    let Some(broker) = broker.map(Process).filter(|_| subscriber) else {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no Mosquitto, and nothing may be skipped");
        let _ = writeln!(std::io::stderr(), "SKIPPED: no Mosquitto: sudo apt-get install mosquitto mosquitto-clients");
        return None;
    };
    let end = Instant::now() + LIMIT;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "the broker does not listen");
        thread::sleep(Duration::from_millis(50));
    }
    Some(broker)
}

/// The messages published under `test/`: topic, whether retained, payload.
struct Subscriber {
    _process: Process,
    messages: Receiver<String>,
}

impl Subscriber {
    fn new(port: u16) -> Self {
        let mut child = Command::new("mosquitto_sub")
            .args(["-p", &port.to_string(), "-t", "test/#", "-q", "1", "-F", "%t %r %p"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let out = child.stdout.take().unwrap();
        let (sender, messages) = channel();
        thread::spawn(move || BufReader::new(out).lines().map_while(Result::ok).try_for_each(|l| sender.send(l)));
        Self { _process: Process(child), messages }
    }

    /// The payload of the next message of a topic for which `is_right` holds.
    fn wait_for(&self, topic: &str, is_right: impl Fn(&str) -> bool) -> String {
        let end = Instant::now() + LIMIT;
        let mut seen: Vec<String> = Vec::new();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let message = self.messages.recv_timeout(left);
            let message = message.unwrap_or_else(|_| panic!("nothing right under {topic}; but:\n{}", seen.join("\n")));
            let mut parts = message.splitn(3, ' ');
            let (at, payload) = (parts.next().unwrap(), parts.nth(1).unwrap());
            if at == topic && is_right(payload) {
                return payload.to_string();
            }
            seen.push(message.chars().take(160).collect());
        }
    }
}

#[test]
fn a_broker_that_is_restarted() {
    let folder = Folder::new("broker");
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let Some(first) = broker(port) else { return };
    let model = folder.join("astronaut.kgm");
    let model = model.to_str().unwrap();
    keygraph(&["train", picture("astronaut").to_str().unwrap(), "--preset", "compact", "-o", model]).ended_with(0);
    std::fs::create_dir(folder.join("frames")).unwrap();
    std::fs::copy(program::frame(2), folder.join("frames/0.jpg")).unwrap();
    let frames = folder.join("frames");
    let url = format!("mqtt://127.0.0.1:{port}/test");
    let subscriber = Subscriber::new(port);
    let arguments = ["--replay", frames.to_str().unwrap(), "--fps", "5", "-m", model, "--mqtt", &url];
    let mut live = Live::start(&arguments);
    let is_found = |payload: &str| {
        let payload: Value = serde_json::from_str(payload).unwrap();
        payload["state"] == "found" || payload["state"] == "tracked"
    };
    subscriber.wait_for("test/status", |p| p == "online");
    subscriber.wait_for("test/objects/astronaut", is_found);
    let line = subscriber.wait_for("test/detections", |_| true);
    let line: Value = serde_json::from_str(&line).unwrap();
    assert_eq!(line["detections"][0]["object"], "astronaut");

    drop(first);
    live.wait_for("no broker at");
    let Some(_second) = broker(port) else { panic!("the broker was there before") };
    let subscriber = Subscriber::new(port);
    live.wait_for("connected to the broker");
    subscriber.wait_for("test/status", |p| p == "online");
    // The new broker has no messages, and no state has changed since.
    subscriber.wait_for("test/objects/astronaut", is_found);
    let frame = |payload: String| serde_json::from_str::<Value>(&payload).unwrap()["frame"].as_u64().unwrap();
    let after = frame(subscriber.wait_for("test/detections", |_| true));
    assert!(after > line["frame"].as_u64().unwrap(), "frames go on while the broker is away");

    live.signal("TERM");
    subscriber.wait_for("test/status", |p| p == "offline");
    assert!(live.end().0.success());

    // When the program is killed, the broker publishes its last will.
    let live = Live::start(&arguments);
    subscriber.wait_for("test/status", |p| p == "online");
    live.signal("KILL");
    subscriber.wait_for("test/status", |p| p == "offline");
}
