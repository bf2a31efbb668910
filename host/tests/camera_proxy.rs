//! `keygraph camera` behind a proxy with TLS: a real nginx, with the configuration of
//! `docs/nginx.conf` and a certificate that is made here.
//!
//! In: frames of the repository, requests through curl. Out: what the page answers. Skipped
//! when there is no nginx, openssl or curl.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live, truth};
use program::{Folder, assets, frame};

/// A running nginx; asked to end when dropped.
struct Proxy {
    child: Child,
    folder: String,
    port: u16,
}

impl Drop for Proxy {
    fn drop(&mut self) {
        // A signal that cannot be caught would leave its workers.
        let _ = Command::new("kill").args(["-TERM", &self.child.id().to_string()]).status();
        let _ = self.child.wait();
    }
}

fn runs(program: &str, argument: &str) -> bool {
    Command::new(program).arg(argument).output().is_ok_and(|o| o.status.success())
}

/// Starts nginx in front of `place`. Returns `None`, and prints a line, when something is
/// missing.
fn proxy(folder: &Folder, place: &str) -> Option<Proxy> {
    // Debian installs servers in a folder that is in the path of root only.
    let nginx = ["nginx", "/usr/sbin/nginx"].into_iter().find(|n| runs(n, "-v"));
    let Some(nginx) = nginx.filter(|_| runs("openssl", "version") && runs("curl", "--version")) else {
        assert!(std::env::var_os("KEYGRAPH_MUST_NOT_SKIP").is_none(), "no nginx, and nothing may be skipped");
        let _ = writeln!(std::io::stderr(), "SKIPPED: no proxy: sudo apt-get install nginx-light openssl curl");
        return None;
    };
    let path = |name: &str| folder.join(name).to_str().unwrap().to_string();
    let made = Command::new("openssl")
        .args(["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=cam.example.org"])
        .args(["-addext", "subjectAltName=DNS:cam.example.org", "-keyout", &path("key.pem"), "-out", &path("cert.pem")])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let mut server = std::fs::read_to_string(assets().join("../docs/nginx.conf")).unwrap();
    for (documented, here) in [
        ("listen 443 ssl", format!("listen 127.0.0.1:{port} ssl")),
        ("/etc/ssl/certs/cam.example.org.pem", path("cert.pem")),
        ("/etc/ssl/private/cam.example.org.key", path("key.pem")),
        ("http://127.0.0.1:8080", format!("http://{place}")),
    ] {
        assert!(server.contains(documented), "{documented}");
        server = server.replace(documented, &here);
    }
    let folders: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|name| format!("{name}_temp_path {};\n", path(name)))
        .concat();
    let log = path("error.log");
    let whole = format!(
        "daemon off; pid {}; error_log {log}; worker_processes 1; events {{}}\nhttp {{ access_log off;\n{folders}{server}}}\n",
        path("pid")
    );
    let file = folder.file("nginx.conf", whole.as_bytes());
    let child = Command::new(nginx)
        .args([Path::new("-e"), Path::new(&log), Path::new("-p"), &folder.0, Path::new("-c"), &file])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let proxy = Proxy { child, folder: path(""), port };
    let end = Instant::now() + LIMIT;
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        let said = std::fs::read_to_string(&log).unwrap_or_default();
        assert!(Instant::now() < end, "nginx does not listen: {said}");
        thread::sleep(Duration::from_millis(50));
    }
    Some(proxy)
}

impl Proxy {
    /// Sends a request with curl. Returns the status and the body.
    fn ask(&self, path: &str, arguments: &[&str]) -> (u16, String) {
        let out = Command::new("curl")
            .args(["-s", "--noproxy", "*", "-w", "\n%{http_code}", "--cacert", &format!("{}/cert.pem", self.folder)])
            .args(["--resolve", &format!("cam.example.org:{}:127.0.0.1", self.port)])
            .args(arguments)
            .arg(format!("https://cam.example.org:{}{path}", self.port))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        let (body, status) = text.rsplit_once('\n').unwrap_or_else(|| panic!("{text}"));
        (status.parse().unwrap_or_else(|_| panic!("{text}")), body.to_string())
    }
}

#[test]
fn the_page_behind_a_proxy_with_tls() {
    let folder = Folder::new("nginx");
    let frames = folder.join("frames");
    std::fs::create_dir(&frames).unwrap();
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    // The port of the page is not known before it listens, and that of nginx not before it.
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let Some(proxy) = proxy(&folder, &format!("127.0.0.1:{port}")) else { return };
    let public = format!("https://cam.example.org:{}", proxy.port);
    let arguments = ["--fps", "10", "--web", &port.to_string(), "--public-url", &public];
    let mut live = Live::start(&[&["--replay", frames.to_str().unwrap()], &arguments[..]].concat());
    let token = live.token.clone().expect("behind a proxy a token is needed");
    let bearer = format!("Authorization: Bearer {token}");

    let (status, page) = proxy.ask("/", &[]);
    assert!(status == 200 && page.contains("<canvas"), "{status}");
    assert_eq!(proxy.ask("/status", &[]).0, 401);
    assert_eq!(proxy.ask("/status", &["-H", &bearer]).0, 200);

    let jpeg = format!("@{}", frame(2).display());
    let corners = truth(2, "astronaut", [512.0, 512.0]).unwrap();
    let corners: Vec<_> = corners.as_flattened().iter().map(|v| format!("{v:.1}")).collect();
    let path = format!("/learn?name=visitor&corners={}", corners.join(","));
    let learn = |origin: &str| {
        let origin = format!("Origin: {origin}");
        proxy.ask(&path, &["-X", "POST", "-H", &bearer, "-H", &origin, "--data-binary", &jpeg])
    };
    for foreign in ["https://evil.example", "http://cam.example.org", "null"] {
        assert_eq!(learn(foreign).0, 403, "{foreign}");
    }
    let (status, told) = learn(&public);
    assert!(status == 201, "{status} {told}");
    live.frame_with(|f| f.detection("visitor").is_some());
    let (_, events) = proxy.ask("/events", &["-N", "--max-time", "3", "-H", &bearer]);
    assert!(events.contains("data: {") && events.contains("visitor"), "{events}");

    // The address of the client is logged, not that of the proxy.
    let wrong = ["-H", "Authorization: Bearer wrong", "-H", "X-Forwarded-For: 192.0.2.7"];
    assert_eq!(proxy.ask("/status", &wrong).0, 401);
    live.wait_for("a wrong token from 127.0.0.1");
}
