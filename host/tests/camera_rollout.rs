//! `keygraph camera --mqtt-models`: models that are ordered through a broker, Mosquitto, and
//! fetched from a web server.
//!
//! In: the sequence of the repository. Out: what each camera reports to the broker, and its
//! lines. Skipped when there is no Mosquitto; the test of HTTPS also when there is no OpenSSL.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod broker;
mod camera_live;
mod program;

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use broker::{Process, Schema, Subscriber, broker, free_port, make_certificates, retain, skip};
use camera_live::{LIMIT, Live};
use program::{Folder, assets, keygraph, picture};
use serde_json::{Value, json};

/// A web server: files by path, and the number of requests.
#[derive(Clone, Default)]
struct Web {
    files: Arc<Mutex<HashMap<String, Vec<u8>>>>,
    requests: Arc<Mutex<usize>>,
}

impl Web {
    /// Starts it; returns its URL, too.
    fn start() -> (Self, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let web = Self::default();
        let served = web.clone();
        thread::spawn(move || {
            for stream in listener.incoming() {
                let (web, stream) = (served.clone(), stream.unwrap());
                // A client that is gone is no error.
                thread::spawn(move || web.answer(stream));
            }
        });
        (web, url)
    }

    fn answer(&self, mut stream: TcpStream) -> std::io::Result<()> {
        let mut lines = BufReader::new(stream.try_clone()?).lines();
        let first = lines.next().unwrap()?;
        while lines.next().is_some_and(|line| line.is_ok_and(|l| !l.is_empty())) {}
        *self.requests.lock().unwrap() += 1;
        let file = self.files.lock().unwrap().get(first.split(' ').nth(1).unwrap()).cloned();
        let status = if file.is_some() { "200 OK" } else { "404 Not Found" };
        let body = file.unwrap_or_default();
        write!(stream, "HTTP/1.1 {status}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", body.len())?;
        stream.write_all(&body)
    }

    fn put(&self, path: &str, bytes: &[u8]) {
        self.files.lock().unwrap().insert(path.into(), bytes.into());
    }
}

/// A folder with small models of three pictures.
struct Shop {
    folder: Folder,
}

impl Shop {
    fn new(name: &str) -> Self {
        let folder = Folder::new(name);
        for name in ["astronaut", "coffee", "chelsea"] {
            let (from, to) = (picture(name), folder.join(&format!("{name}.kgm")));
            keygraph(&["train", from.to_str().unwrap(), "--preset", "compact", "-o", to.to_str().unwrap()])
                .ended_with(0);
        }
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.join(name).to_str().unwrap().to_string()
    }

    fn model(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.join(&format!("{name}.kgm"))).unwrap()
    }

    /// The order of models under a URL.
    fn order(&self, url: &str, version: &str, names: &[&str]) -> Value {
        let files: Vec<_> = names.iter().map(|name| self.path(&format!("{name}.kgm"))).collect();
        let mut arguments = vec!["order", "--url", url, "--version", version];
        arguments.extend(files.iter().map(String::as_str));
        let order = keygraph(&arguments).ended_with(0).object();
        Schema::new().check("test/order", &order.to_string());
        order
    }
}

/// Starts a camera that follows the orders under `orders`, with the prefix `test/NAME` or `test`.
fn camera(port: u16, prefix: &str, more: &[&str]) -> Live {
    let (url, frames) = (format!("mqtt://127.0.0.1:{port}/{prefix}"), assets().join("sequence"));
    let arguments =
        ["--replay", frames.to_str().unwrap(), "--fps", "5", "--mqtt", &url, "--mqtt-models", "orders", "--json"];
    Live::start(&[&arguments, more].concat())
}

/// Waits until a camera reports that it runs `version`, with the right models; returns the report.
fn running(subscriber: &Subscriber, topic: &str, order: &Value) -> Value {
    let is_run = |p: &str| report(p)["running"] == order["version"] && report(p)["error"].is_null();
    let told = report(&subscriber.wait_for(topic, is_run));
    let hashes = |models: &Value| models.as_array().unwrap().iter().map(|m| m["sha256"].clone()).collect::<Vec<_>>();
    assert_eq!(hashes(&told["models"]), hashes(&order["models"]));
    told
}

fn report(payload: &str) -> Value {
    serde_json::from_str(payload).unwrap()
}

/// Waits until a camera reports an error with `words` in it.
fn refused(subscriber: &Subscriber, topic: &str, words: &str) -> Value {
    report(&subscriber.wait_for(topic, |p| report(p)["error"].as_str().is_some_and(|e| e.contains(words))))
}

#[test]
fn three_cameras_run_what_is_ordered() {
    let port = free_port();
    let Some(_broker) = broker(port) else { return };
    let (shop, (web, url)) = (Shop::new("rollout"), Web::start());
    for name in ["astronaut", "coffee", "chelsea"] {
        web.put(&format!("/{name}.kgm"), &shop.model(name));
    }
    let first = shop.order(&url, "first", &["astronaut"]);
    retain(port, "orders", &first.to_string());
    let subscribers: Vec<_> = (0..3).map(|_| Subscriber::new(port)).collect();
    let mut cameras: Vec<_> = (0..3).map(|i| camera(port, &format!("test/{i}"), &[])).collect();
    let second = shop.order(&url, "second", &["coffee", "astronaut"]);
    let topic = |i: usize| format!("test/{i}/models");
    for (i, subscriber) in subscribers.iter().enumerate() {
        running(subscriber, &topic(i), &first);
        subscriber.wait_for(&format!("test/{i}/objects/astronaut"), |p| p.contains("tracked"));
    }
    retain(port, "orders", &second.to_string());
    for (i, subscriber) in subscribers.iter().enumerate() {
        running(subscriber, &topic(i), &second);
        subscriber.wait_for(&format!("test/{i}/objects/coffee"), |p| p.contains("tracked"));
    }
    assert_eq!(*web.requests.lock().unwrap(), 6, "what is in use is not fetched again");
    for camera in &mut cameras {
        camera.signal("TERM");
        let (status, out, _) = camera.end();
        assert!(status.success());
        let lines: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let changes: Vec<_> = lines.iter().map(|line| line["models"].as_u64().unwrap()).collect();
        assert!(changes.is_sorted() && changes.contains(&1) && changes.ends_with(&[2]), "{changes:?}");
        // Frames were searched with the models before or those after. A busy machine may drop one.
        let dropped = lines.last().unwrap()["dropped"].as_u64().unwrap();
        assert!(dropped <= 2, "{dropped} of {} frames were left out", lines.len());
    }
}

#[test]
fn what_cannot_be_run_leaves_what_is_run() {
    let port = free_port();
    let Some(_broker) = broker(port) else { return };
    let (shop, (web, url)) = (Shop::new("rollout-refused"), Web::start());
    for name in ["astronaut", "coffee"] {
        web.put(&format!("/{name}.kgm"), &shop.model(name));
    }
    let good = shop.order(&url, "good", &["astronaut"]);
    retain(port, "orders", &good.to_string());
    let subscriber = Subscriber::new(port);
    let (kept, own) = (shop.path("kept"), shop.path("chelsea.kgm"));
    let mut live = camera(port, "test", &["--models", &kept, "-m", &own, "--web", "0"]);
    running(&subscriber, "test/models", &good);

    let next = shop.order(&url, "next", &["coffee", "astronaut"]);
    let order = |models: &Value| retain(port, "orders", &json!({"version": "next", "models": models}).to_string());
    let with = |field: &str, value: Value| {
        let mut models = next["models"].clone();
        models[0][field] = value;
        models
    };
    let other = "0".repeat(64);
    for (models, words) in [
        (with("url", json!(format!("{url}/none.kgm"))), "404"),
        (with("url", json!("http://127.0.0.1:1/a.kgm?secret=1")), "http://127.0.0.1:1/a.kgm"),
        (with("sha256", json!(other)), "another file than was ordered"),
        (with("bytes", json!(7)), "more than the 7 bytes"),
        (with("bytes", json!(70_000_000)), "not 70000000 as ordered"),
        (with("url", json!("file:///etc/passwd")), "http://"),
        (json!("coffee"), "no order"),
    ] {
        order(&models);
        let told = refused(&subscriber, "test/models", words);
        assert_eq!((&told["running"], told["models"].as_array().unwrap().len()), (&json!("good"), 1), "{words}");
        assert!(!told.to_string().contains("secret"), "{told}");
    }
    // Not a model, but of the hash that was ordered.
    web.put("/notes.kgm", b"abc");
    let mut models = with("url", json!(format!("{url}/notes.kgm")));
    let hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    (models[0]["sha256"], models[0]["bytes"]) = (json!(hash), json!(3));
    order(&models);
    refused(&subscriber, "test/models", "notes.kgm");

    // It comes later: the order is tried again.
    web.files.lock().unwrap().remove("/coffee.kgm");
    retain(port, "orders", &next.to_string());
    let told = refused(&subscriber, "test/models", "404");
    assert_eq!((&told["running"], &told["wanted"]), (&json!("good"), &json!("next")));
    web.put("/coffee.kgm", &shop.model("coffee"));
    running(&subscriber, "test/models", &next);

    // The model that was given to this program alone stays; ordered ones are not removed on the page.
    let status = live.get("/status").json();
    let list = status["models"].as_array().unwrap();
    let names = list.iter().map(|m| (m["name"].as_str().unwrap(), m["ordered"].as_bool().unwrap()));
    assert_eq!(names.collect::<Vec<_>>(), [("chelsea", false), ("coffee", true), ("astronaut", true)]);
    let removed = live.ask("DELETE", &format!("/models/{}", list[1]["id"]), &[], &[]);
    assert!(removed.text().contains("change the order"), "{}", removed.text());

    // With broker and web server gone, the next start runs what was ordered last.
    live.signal("TERM");
    assert!(live.end().0.success());
    drop(_broker);
    let names = |folder: &str| {
        let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        all.sort();
        all
    };
    assert_eq!(names(&format!("{kept}/ordered")).len(), 3, "two models and the order");
    let mut live = camera(port, "test", &["--models", &kept]);
    live.wait_for("order next: 2 models, as before");
    live.wait_for("coffee found");
    live.signal("TERM");
    assert!(live.end().0.success());
    // A file that somebody changed is not run.
    let model = format!("{kept}/ordered/{}.kgm", next["models"][0]["sha256"].as_str().unwrap());
    fs::write(&model, shop.model("chelsea")).unwrap();
    camera(port, "test", &["--models", &kept, "-m", &own]).wait_for("was changed");
}

#[test]
fn models_come_encrypted() {
    let port = free_port();
    let Some(_broker) = broker(port) else { return };
    let shop = Shop::new("rollout-tls");
    if !make_certificates(&shop.folder) {
        return skip("openssl");
    }
    let web = free_port();
    // OpenSSL's own server gives the files of its folder.
    let server = Command::new("openssl")
        .args(["s_server", "-accept", &format!("127.0.0.1:{web}"), "-cert", "server.pem", "-key", "server.key", "-WWW"])
        .current_dir(&shop.folder.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let _server = Process(server);
    let end = Instant::now() + LIMIT;
    while TcpStream::connect(("127.0.0.1", web)).is_err() {
        assert!(Instant::now() < end, "the web server does not listen");
        thread::sleep(Duration::from_millis(50));
    }
    let order = shop.order(&format!("https://127.0.0.1:{web}"), "first", &["astronaut"]);
    retain(port, "orders", &order.to_string());
    let subscriber = Subscriber::new(port);
    let live = camera(port, "test", &[]);
    refused(&subscriber, "test/models", "UnknownIssuer");
    drop(live);
    let _live = camera(port, "test", &["--mqtt-ca", &shop.path("ca.pem")]);
    running(&subscriber, "test/models", &order);
}

#[test]
fn wrong_orders_and_topics_are_refused() {
    let shop = Shop::new("rollout-usage");
    let model = shop.path("coffee.kgm");
    keygraph(&["order", "--url", "ftp://a", &model]).refused_with(&["http://"]);
    keygraph(&["order", "--url", "http://a", &model, &model]).refused_with(&["twice"]);
    keygraph(&["order", "--url", "http://a", "/nowhere.kgm"]).refused_with(&["/nowhere.kgm"]);
    let camera = |topic: &str| {
        let arguments = ["camera", "--replay", &shop.path("none"), "-m", &model, "--mqtt", "mqtt://a/test"];
        keygraph(&[&arguments[..], &["--mqtt-models", topic]].concat())
    };
    camera("test/models").refused_with(&["topic of their own"]);
    camera("test/#").refused_with(&["no +"]);
}
