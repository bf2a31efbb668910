//! Pictures of `keygraph camera` for other programs: `/snapshot.jpg` and `/stream.mjpg`, read as
//! curl, VLC and Home Assistant read them.
//!
//! In: frames of the repository. Out: JPEGs, how many come, and what the program does when viewers
//! are many, or slow.
#![allow(clippy::unwrap_used, clippy::panic, clippy::cast_possible_truncation, clippy::cast_sign_loss)]

mod camera_live;
mod program;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

use camera_live::{LIMIT, Live, truth};
use image::RgbImage;
use program::{Folder, assets, frame, keygraph, picture};

fn still(folder: &Folder) -> String {
    let frames = folder.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::copy(frame(2), frames.join("0.jpg")).unwrap();
    frames.to_str().unwrap().to_string()
}

fn model(folder: &Folder) -> String {
    let path = folder.join("astronaut.kgm").to_str().unwrap().to_string();
    keygraph(&["train", picture("astronaut").to_str().unwrap(), "--preset", "compact", "-o", &path]).ended_with(0);
    path
}

fn decode(jpeg: &[u8]) -> RgbImage {
    image::load_from_memory(jpeg).unwrap().into_rgb8()
}

/// Number of points, of 40 along the true outline in frame 2, that have the colour of the first
/// object within 3 px.
fn on_outline(image: &RgbImage) -> usize {
    let corners = truth(2, "astronaut", [512.0, 512.0]).unwrap();
    let is_green = |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < i64::from(image.width()) && y < i64::from(image.height());
        inside && {
            let [r, g, b] = image.get_pixel(x as u32, y as u32).0.map(i32::from);
            g - r > 60 && g - b > 60
        }
    };
    (0..40)
        .filter(|i| {
            let (a, b, t) = (corners[i % 4], corners[(i + 1) % 4], (1 + i / 4) as f32 / 11.0);
            let [x, y] = [0, 1].map(|k| (a[k] + (b[k] - a[k]) * t) as i64);
            (-3..=3).any(|dx| (-3..=3).any(|dy| is_green(x + dx, y + dy)))
        })
        .count()
}

/// A stream that is read part by part.
struct Stream(BufReader<TcpStream>);

impl Stream {
    /// Opens a stream, and reads the head of the answer.
    fn open(live: &Live, query: &str) -> Self {
        let mut stream = live.connect();
        // HTTP 1.0, as simple cameras' clients speak it: the body comes as it is.
        write!(stream, "GET /stream.mjpg{query} HTTP/1.0\r\nHost: {}\r\n\r\n", live.place).unwrap();
        let mut stream = Self(BufReader::new(stream));
        let head = stream.head();
        assert!(head[0].contains(" 200 "), "{head:?}");
        let kind = "content-type: multipart/x-mixed-replace; boundary=keygraph-frame";
        assert!(head.iter().any(|l| l == kind), "{head:?}");
        stream
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).unwrap();
        line.trim_end().to_string()
    }

    /// Lines up to an empty one.
    fn head(&mut self) -> Vec<String> {
        let mut lines = Vec::new();
        while lines.last().is_none_or(|l: &String| !l.is_empty()) {
            lines.push(self.line());
        }
        lines
    }

    /// The next JPEG.
    fn picture(&mut self) -> Vec<u8> {
        let head = self.head();
        assert_eq!(head[..2], ["--keygraph-frame", "Content-Type: image/jpeg"]);
        let length = head[2].strip_prefix("Content-Length: ").unwrap().parse().unwrap();
        let mut jpeg = vec![0; length];
        self.0.read_exact(&mut jpeg).unwrap();
        assert_eq!(self.line(), "", "a part ends with a line break");
        jpeg
    }
}

#[test]
fn a_snapshot_is_the_frame_with_outlines_or_without() {
    let folder = Folder::new("snapshot");
    let mut live =
        Live::start(&["--replay", &still(&folder), "--fps", "20", "-m", &model(&folder), "--web", "0.0.0.0:0"]);
    live.frame_with(|f| f.detection("astronaut").is_some());
    let plain = live.get("/snapshot.jpg?outlines=0");
    assert!(plain.status == 200 && plain.head.contains("content-type: image/jpeg"), "{}", plain.head);
    assert!(plain.head.contains("cross-origin-resource-policy: cross-origin"), "{}", plain.head);
    assert_eq!(plain.body, live.frame(None, false).jpeg, "the JPEG is that of the page");
    let drawn = live.get("/snapshot.jpg");
    let [plain, drawn] = [plain, drawn].map(|answer| decode(&answer.body));
    assert_eq!((drawn.dimensions(), plain.dimensions()), ((640, 480), (640, 480)));
    let counts = [&drawn, &plain].map(on_outline);
    assert!(counts[0] >= 36 && counts[1] <= 4, "{counts:?} of 40 points of the outline are drawn on");
    let token = live.token.take().unwrap();
    for path in ["/snapshot.jpg", "/stream.mjpg"] {
        assert_eq!(live.get(path).status, 401, "{path}");
    }
    assert_eq!(live.get(&format!("/snapshot.jpg?token={token}")).status, 200, "as <img> sends it");
}

#[test]
fn a_camera_without_frames_has_no_snapshot() {
    let folder = Folder::new("no-snapshot");
    let frames = still(&folder);
    let mut live = Live::start(&["--replay", &frames, "--fps", "20", "--web", "127.0.0.1:0"]);
    let local = live.get("/snapshot.jpg");
    assert!(local.head.contains("cross-origin-resource-policy: same-origin"), "other pages get none: {}", local.head);
    std::fs::remove_file(format!("{frames}/0.jpg")).unwrap();
    live.wait_for("trying again");
    let refused = live.get("/snapshot.jpg");
    assert!(refused.status == 503 && refused.text().contains("cannot replay"), "{}", refused.text());
}

#[test]
fn a_stream_gives_new_frames_at_the_rate_that_is_asked_for() {
    let sequence = assets().join("sequence");
    // A picture in ten frames of 48, which then start anew: with sixty a second, in twelve, there would be four.
    let live = Live::start(&["--replay", sequence.to_str().unwrap(), "--fps", "50", "--web", "127.0.0.1:0"]);
    for query in ["?outlines=0&fps=5", "?fps=5"] {
        let start = Instant::now();
        let mut stream = Stream::open(&live, query);
        let mut pictures: Vec<_> = (0..11).map(|_| stream.picture()).collect();
        let time = start.elapsed();
        assert!(time > Duration::from_millis(1990), "11 frames in {time:?} at 5 a second");
        assert!(pictures.iter().all(|jpeg| decode(jpeg).dimensions() == (640, 480)));
        pictures.sort();
        pictures.dedup();
        assert!(pictures.len() > 4, "{} different pictures of 11, {query}", pictures.len());
    }
    for query in ["?fps=0", "?fps=26", "?fps=NaN", "?fps=x"] {
        let refused = live.get(&format!("/stream.mjpg{query}"));
        assert_eq!(refused.status, 400, "{query}: {}", refused.text());
    }
}

#[test]
fn viewers_that_do_not_read_hold_nothing_up_and_their_number_is_bounded() {
    let folder = Folder::new("slow-viewers");
    let sequence = assets().join("sequence");
    let arguments = ["--fps", "60", "-m", &model(&folder), "--web", "127.0.0.1:0"];
    let mut live = Live::start(&[&["--replay", sequence.to_str().unwrap()], &arguments[..]].concat());
    let sleepers: Vec<_> = (0..7).map(|_| Stream::open(&live, "?fps=25")).collect();
    let mut reader = Stream::open(&live, "?fps=25");
    let refused = live.get("/stream.mjpg");
    assert!(refused.status == 503 && refused.text().contains("8 streams"), "{}", refused.text());
    // By far more than the sockets of those who do not read hold.
    for _ in 0..60 {
        reader.picture();
    }
    let frames = || live.frame(None, false).number;
    let before = frames();
    thread::sleep(Duration::from_secs(1));
    assert!(frames() > before + 3, "the search stands still");
    // Who leaves makes room.
    drop(sleepers);
    let end = Instant::now() + LIMIT;
    while live.get("/snapshot.jpg").status != 200 || {
        let mut stream = live.connect();
        write!(stream, "GET /stream.mjpg HTTP/1.0\r\nHost: {}\r\n\r\n", live.place).unwrap();
        let mut status = [0; 12];
        stream.read_exact(&mut status).unwrap();
        !status.ends_with(b"200")
    } {
        assert!(Instant::now() < end, "places are not given back");
        thread::sleep(Duration::from_millis(100));
    }
    // Streams end with the program.
    live.signal("TERM");
    let (status, _, time) = live.end();
    assert!(status.success() && time < Duration::from_secs(20), "{status} after {time:?}");
    let mut rest = Vec::new();
    let _ = reader.0.read_to_end(&mut rest);
}
