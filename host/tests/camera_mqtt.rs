//! `keygraph camera --mqtt` with a real broker, Mosquitto, which is restarted, encrypted and
//! stopped during the tests.
//!
//! In: the sequence of the repository. Out: the messages that a subscriber receives; each of
//! them is checked against `docs/schema/mqtt.json`. Skipped when there is no Mosquitto; the
//! test of TLS also when there is no OpenSSL.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod broker;
mod camera_live;
mod program;

use std::io::{Read, Write};
use std::net::TcpListener;
use std::thread;
use std::time::Duration;

use broker::{Subscriber, broker, broker_with, free_port, make_certificates, retain, skip};
use camera_live::{LIMIT, Live};
use program::{Folder, keygraph, picture};
use serde_json::Value;

/// A folder with one frame that shows the astronaut, and a model of it under `name`.
struct Scene {
    folder: Folder,
    frames: String,
    model: String,
}

impl Scene {
    fn new(name: &str, object: &str) -> Self {
        let folder = Folder::new(name);
        let text = |name: &str| folder.join(name).to_str().unwrap().to_string();
        let (frames, model) = (text("frames"), text("model.kgm"));
        let picture = picture("astronaut");
        let arguments = ["train", picture.to_str().unwrap(), "--name", object, "--preset", "compact", "-o", &model];
        keygraph(&arguments).ended_with(0);
        std::fs::create_dir(&frames).unwrap();
        std::fs::copy(program::frame(2), folder.join("frames/0.jpg")).unwrap();
        Self { folder, frames, model }
    }

    fn start(&self, fps: &str, url: &str, more: &[&str]) -> Live {
        let arguments = ["--replay", &self.frames, "--fps", fps, "-m", &self.model, "--mqtt", url];
        Live::start(&[&arguments, more].concat())
    }

    fn path(&self, name: &str) -> String {
        self.folder.join(name).to_str().unwrap().to_string()
    }
}

fn is_state(payload: &str, states: &[&str]) -> bool {
    serde_json::from_str::<Value>(payload).is_ok_and(|p| states.iter().any(|s| p["state"] == *s))
}

fn is_found(payload: &str) -> bool {
    is_state(payload, &["found", "tracked"])
}

#[test]
fn a_broker_that_is_restarted() {
    let port = free_port();
    let Some(first) = broker(port) else { return };
    let scene = Scene::new("broker", "astronaut");
    let url = format!("mqtt://127.0.0.1:{port}/test");
    let subscriber = Subscriber::new(port);
    let mut live = scene.start("5", &url, &[]);
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
    subscriber.wait_for("test/objects/astronaut", |p| is_state(p, &["gone"]));
    subscriber.wait_for("test/status", |p| p == "offline");
    assert!(live.end().0.success());

    // When the program is killed, the broker publishes its last will.
    let live = scene.start("5", &url, &[]);
    subscriber.wait_for("test/status", |p| p == "online");
    live.signal("KILL");
    subscriber.wait_for("test/status", |p| p == "offline");
}

#[test]
fn names_of_any_kind_and_what_other_runs_left() {
    let port = free_port();
    let Some(_broker) = broker(port) else { return };
    let name = "a/b +# é";
    let scene = Scene::new("names", name);
    retain(port, "test/objects/old", "left by a program that died");
    retain(port, "home/binary_sensor/keygraph_test/old/config", "left by a program that died");
    retain(port, "test/status", "offline");
    let subscriber = Subscriber::new(port);
    let url = format!("mqtt://127.0.0.1:{port}/test");
    let mut live = scene.start("5", &url, &["--mqtt-discovery", "home"]);
    subscriber.wait_for("test/status", |p| p == "online");
    let config = subscriber.wait_for("home/binary_sensor/keygraph_test/a_2Fb_20_2B_23_20_C3_A9/config", |_| true);
    let config: Value = serde_json::from_str(&config).unwrap();
    let topic = "test/objects/a%2Fb%20%2B%23%20%C3%A9";
    assert_eq!([&config["name"], &config["state_topic"], &config["availability_topic"]], [name, topic, "test/status"]);
    let state = subscriber.wait_for(topic, is_found);
    assert_eq!(serde_json::from_str::<Value>(&state).unwrap()["object"], name);

    // A last will of an earlier run may come late.
    retain(port, "test/status", "offline");
    subscriber.wait_for("test/status", |p| p == "offline");
    subscriber.wait_for("test/status", |p| p == "online");

    live.signal("TERM");
    subscriber.wait_for(topic, |p| is_state(p, &["gone"]));
    subscriber.wait_for("test/status", |p| p == "offline");
    assert!(live.end().0.success());
    // What stays with the broker.
    let late = Subscriber::new(port);
    let mut kept: Vec<String> = (0..3).map(|_| late.messages.recv_timeout(LIMIT).unwrap()).collect();
    kept.sort();
    assert!(kept[0].starts_with("home/binary_sensor/keygraph_test/a_2F"), "{kept:?}");
    assert!(kept[1].starts_with(topic) && kept[1].contains("gone"), "{kept:?}");
    assert_eq!(kept[2], "test/status 1 offline");
    assert!(late.messages.recv_timeout(Duration::from_millis(500)).is_err(), "leftovers were not removed");
}

#[test]
fn lines_at_a_limited_rate() {
    let port = free_port();
    let Some(_broker) = broker(port) else { return };
    let scene = Scene::new("rate", "astronaut");
    let subscriber = Subscriber::new(port);
    let _live = scene.start("20", &format!("mqtt://127.0.0.1:{port}/test"), &["--mqtt-rate", "1"]);
    let frames: [u64; 3] = std::array::from_fn(|_| {
        let line = subscriber.wait_for("test/detections", |_| true);
        serde_json::from_str::<Value>(&line).unwrap()["frame"].as_u64().unwrap()
    });
    assert!(frames[2] - frames[1] >= 5, "about 20 frames apart: {frames:?}");
}

#[test]
fn a_broker_that_stops_answering_does_not_delay_the_end() {
    let scene = Scene::new("silent", "astronaut");
    // Accepts the client or not, and then says nothing.
    for accepts in [true, false] {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let silent = thread::spawn(move || {
            let mut stream = listener.accept().unwrap().0;
            stream.read_exact(&mut [0]).unwrap();
            if accepts {
                stream.write_all(&[0x20, 2, 0, 0]).unwrap();
            }
            stream
        });
        let mut live = scene.start("5", &format!("mqtt://127.0.0.1:{port}/test"), &[]);
        let _stream = silent.join().unwrap();
        live.wait_for(if accepts { "connected to the broker" } else { "found" });
        live.signal("TERM");
        let (status, _, time) = live.end();
        assert!(status.success(), "{status}");
        assert!(time < Duration::from_secs(2), "accepts: {accepts}; ended after {time:?}");
    }
}

#[test]
fn an_encrypted_broker() {
    let plain = free_port();
    let Some(_plain) = broker(plain) else { return };
    let scene = Scene::new("tls", "astronaut");
    if !make_certificates(&scene.folder) {
        return skip("openssl");
    }
    let encrypted = |certificate: &str| {
        let port = free_port();
        let file = |name: &str| scene.path(name);
        let settings = format!(
            "user root\nlistener {port} 127.0.0.1\nallow_anonymous true\nrequire_certificate true\n\
             cafile {}\ncertfile {}\nkeyfile {}\n",
            file("ca.pem"),
            file(&format!("{certificate}.pem")),
            file(&format!("{certificate}.key"))
        );
        let settings = scene.folder.file(&format!("{certificate}.conf"), settings.as_bytes());
        (port, broker_with(port, &["-c", settings.to_str().unwrap()]).unwrap())
    };
    let (port, _right) = encrypted("server");
    let (expired, _expired) = encrypted("old");
    let [ca, other, cert, key] = ["ca.pem", "other.pem", "client.pem", "client.key"].map(|name| scene.path(name));
    let own = ["--mqtt-cert", &cert, "--mqtt-key", &key];
    let with = |authority| [&["--mqtt-ca", authority], &own[..]].concat();

    let files = ["--cafile", &ca, "--cert", &cert, "--key", &key];
    let subscriber = Subscriber::with(port, &files);
    let mut live = scene.start("5", &format!("mqtts://127.0.0.1:{port}/test"), &with(&ca));
    subscriber.wait_for("test/status", |p| p == "online");
    subscriber.wait_for("test/objects/astronaut", is_found);
    live.signal("TERM");
    subscriber.wait_for("test/status", |p| p == "offline");
    assert!(live.end().0.success());

    for (scheme, port, arguments, words) in [
        ("mqtts", port, with(&other), "not signed by an authority that is trusted"),
        ("mqtts", port, vec!["--mqtt-ca", &ca], "wants a certificate from this program"),
        ("mqtts", expired, with(&ca), "has expired"),
        ("mqtts", plain, with(&ca), "use mqtt://"),
        ("mqtt", port, vec![], "no broker at"),
    ] {
        let mut live = scene.start("5", &format!("{scheme}://127.0.0.1:{port}/test"), &arguments);
        let line = live.wait_for("no broker at");
        assert!(line.contains(words), "{words}: {line}");
    }

    let camera = |url: &str, more: &[&str]| {
        let arguments = ["camera", "--replay", &scene.frames, "-m", &scene.model, "--mqtt", url];
        keygraph(&[&arguments, more].concat())
    };
    camera("mqtts://a", &["--mqtt-ca", &key]).refused_with(&["client.key", "no certificate"]);
    camera("mqtts://a", &["--mqtt-ca", &ca, "--mqtt-cert", &cert, "--mqtt-key", &cert])
        .refused_with(&["client.pem", "no private key"]);
    camera("mqtt://a", &["--mqtt-ca", &ca]).refused_with(&["mqtts://"]);
}
