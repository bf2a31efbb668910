//! A real broker, Mosquitto, what a subscriber receives from it, and certificates.
//!
//! In: a port. Out: messages, each of them checked against `docs/schema/mqtt.json`.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::camera_live::LIMIT;
use crate::program::Folder;

/// A process that is killed when dropped.
pub struct Process(pub Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Whether a test may be left out since `package` is missing, which is said aloud.
pub fn skip(package: &str) {
    assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no {package}, and nothing may be skipped");
    let _ = writeln!(std::io::stderr(), "SKIPPED: no {package}: sudo apt-get install {package}");
}

/// A port that nobody uses.
pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Starts Mosquitto with `arguments`, and waits until it listens at `port`.
pub fn broker_with(port: u16, arguments: &[&str]) -> Option<Process> {
    // Debian installs servers in a folder that is in the path of root only.
    let start = |program: &str| {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().ok()
    };
    let broker = start("mosquitto").or_else(|| start("/usr/sbin/mosquitto"));
    let subscriber = Command::new("mosquitto_sub").arg("--help").output().is_ok();
    let Some(broker) = broker.map(Process).filter(|_| subscriber) else {
        skip("mosquitto mosquitto-clients");
        return None;
    };
    let end = Instant::now() + LIMIT;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "the broker does not listen");
        thread::sleep(Duration::from_millis(50));
    }
    Some(broker)
}

/// Starts Mosquitto at a port.
pub fn broker(port: u16) -> Option<Process> {
    broker_with(port, &["-p", &port.to_string()])
}

/// The schemas of messages.
pub struct Schema(Value);

impl Schema {
    pub fn new() -> Self {
        let read = |name: &str| -> Value {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/schema").join(name);
            serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
        };
        let mut all = read("mqtt.json");
        // The schema beside it becomes a part of it, under its own id.
        all["$defs"]["beside"] = read("detection.json");
        Self(all)
    }

    pub fn check(&self, topic: &str, payload: &str) {
        let level = topic.rsplit('/').next().unwrap();
        let kind = match level {
            "status" => return assert!(["online", "offline"].contains(&payload), "{payload}"),
            "detections" | "models" | "order" | "config" => level,
            _ if topic.contains("/objects/") => "object",
            _ => panic!("no message is under {topic}"),
        };
        if payload.is_empty() {
            return;
        }
        let definitions = &self.0["$defs"];
        let schema = json!({"$schema": self.0["$schema"], "$ref": format!("#/$defs/{kind}"), "$defs": definitions});
        let message = serde_json::from_str(payload).unwrap();
        let validator = jsonschema::draft202012::new(&schema).unwrap();
        let errors: Vec<_> = validator.iter_errors(&message).map(|e| format!("{} {e}", e.instance_path())).collect();
        assert!(errors.is_empty(), "{topic}: {errors:?} in {payload}");
    }
}

/// The messages published under `test/` and `home/`: topic, whether retained, payload.
pub struct Subscriber {
    _process: Process,
    /// Lines of topic, whether retained, payload.
    pub messages: Receiver<String>,
    schema: Schema,
}

impl Subscriber {
    /// Subscribes to `test/#` and `home/#` at a port.
    pub fn new(port: u16) -> Self {
        Self::with(port, &[])
    }

    /// Subscribes with more arguments of `mosquitto_sub`.
    pub fn with(port: u16, arguments: &[&str]) -> Self {
        let mut child = Command::new("mosquitto_sub")
            .args(["-h", "127.0.0.1", "-p", &port.to_string()])
            .args(["-t", "test/#", "-t", "home/#", "-q", "1", "-F", "%t %r %p"])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let out = child.stdout.take().unwrap();
        let (sender, messages) = channel();
        thread::spawn(move || BufReader::new(out).lines().map_while(Result::ok).try_for_each(|l| sender.send(l)));
        Self { _process: Process(child), messages, schema: Schema::new() }
    }

    /// The payload of the next message of a topic for which `is_right` holds.
    pub fn wait_for(&self, topic: &str, is_right: impl Fn(&str) -> bool) -> String {
        let end = Instant::now() + LIMIT;
        let mut seen: Vec<String> = Vec::new();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let message = self.messages.recv_timeout(left);
            let message = message.unwrap_or_else(|_| panic!("nothing right under {topic}; but:\n{}", seen.join("\n")));
            let mut parts = message.splitn(3, ' ');
            let (at, payload) = (parts.next().unwrap(), parts.nth(1).unwrap());
            if !payload.contains("left by") {
                self.schema.check(at, payload);
            }
            if at == topic && is_right(payload) {
                return payload.to_string();
            }
            seen.push(message.chars().take(160).collect());
        }
    }
}

/// Publishes a retained message.
pub fn retain(port: u16, topic: &str, payload: &str) {
    let port = port.to_string();
    let arguments = ["-h", "127.0.0.1", "-p", &port, "-t", topic, "-m", payload, "-r", "-q", "1"];
    assert!(Command::new("mosquitto_pub").args(arguments).status().unwrap().success());
}

/// Runs OpenSSL in a folder; false if there is none.
pub fn openssl(folder: &Folder, arguments: &str) -> bool {
    let run = Command::new("openssl").args(arguments.split_whitespace()).current_dir(&folder.0).output();
    let Ok(run) = run else { return false };
    assert!(run.status.success(), "{arguments}: {}", String::from_utf8_lossy(&run.stderr));
    true
}

/// Makes authorities `ca` and `other`, and certificates `server`, `old` (expired) and `client`
/// of `ca`. False if there is no OpenSSL.
pub fn make_certificates(folder: &Folder) -> bool {
    const KEY: &str = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes";
    let settings = "[ca]\ndefault_ca=all\n[all]\ndatabase=index.txt\nnew_certs_dir=.\ndefault_md=sha256\npolicy=names\n\
                    unique_subject=no\nrand_serial=yes\n[names]\ncommonName=supplied\n[leaf]\nsubjectAltName=IP:127.0.0.1\n\
                    basicConstraints=CA:FALSE\n";
    folder.file("ca.cnf", settings.as_bytes());
    folder.file("index.txt", b"");
    for name in ["ca", "other"] {
        if !openssl(folder, &format!("req -x509 {KEY} -keyout {name}.key -out {name}.pem -days 2 -subj /CN={name}")) {
            return false;
        }
    }
    for (name, dates) in
        [("server", "-days 2"), ("client", "-days 2"), ("old", "-startdate 20200101000000Z -enddate 20210101000000Z")]
    {
        openssl(folder, &format!("req -new {KEY} -keyout {name}.key -out {name}.csr -subj /CN={name}"));
        let authority = "ca -config ca.cnf -batch -notext -cert ca.pem -keyfile ca.key -extensions leaf";
        openssl(folder, &format!("{authority} -in {name}.csr -out {name}.pem {dates}"));
    }
    true
}
