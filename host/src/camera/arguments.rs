//! Arguments of `keygraph camera`, and of `keygraph train --from-camera`.
//!
//! In: the command line. Out: [`Arguments`], [`Lesson`]. Memory and cost: none.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::time::Duration;

use keygraph_core::DEFAULT_THRESHOLD;
use tracing::level_filters::LevelFilter;

use super::guard::parse_public;
use super::mode::Format;
use crate::cutout::{Outline, parse_outline};
use crate::pose::CameraArguments;
use crate::region::Look;
use crate::search::{MAX_THREADS, Profile, Shape, parse_budget, parse_share, parse_threshold};

/// The default address of the page.
const USUAL_ADDRESS: &str = "127.0.0.1:8080";
/// The default port of the page.
const USUAL_PORT: u16 = 8080;

/// The source of frames.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Origin {
    /// Camera to use [default: the first that gives pictures]
    #[arg(long, value_name = "/dev/videoN|N", conflicts_with = "replay")]
    pub device: Option<String>,
    /// Frames in place of a camera: a video or a folder of pictures, played again and again; the address of a
    /// camera (rtsp://, http://, ...); or - for standard input
    #[arg(long, value_name = "VIDEO|FOLDER|ADDRESS|-")]
    pub replay: Option<PathBuf>,
    /// Size to ask the camera for [default: the nearest to 640x480]
    #[arg(long, value_name = "WxH", value_parser = size, conflicts_with = "replay")]
    pub size: Option<(u32, u32)>,
    /// Pixel format to ask the camera for: YUYV, MJPG or GREY [default: the one with the highest rate]
    #[arg(long, value_name = "FOURCC", conflicts_with = "replay")]
    pub format: Option<Format>,
    /// Frames per second [default: the camera's maximum, or the file's own rate]
    #[arg(long, value_parser = rate)]
    pub fps: Option<f64>,
    /// Keep exposure and gain as they are two seconds after the start
    #[arg(long, conflicts_with = "replay")]
    pub lock_exposure: bool,
    /// Keep the white balance as it is two seconds after the start
    #[arg(long, conflicts_with = "replay")]
    pub lock_white_balance: bool,
}

impl Origin {
    /// Whether any of these arguments was given.
    #[must_use]
    pub const fn is_given(&self) -> bool {
        self.device.is_some()
            || self.replay.is_some()
            || self.size.is_some()
            || self.format.is_some()
            || self.fps.is_some()
            || self.lock_exposure
            || self.lock_white_balance
    }
}

/// The broker that results are published to.
#[derive(Clone, Debug, clap::Args)]
pub struct Publishing {
    /// Publish results to a broker: `mqtt://[USER:PASSWORD@]HOST[:PORT][/PREFIX]`, or `mqtts://`
    /// for TLS
    #[arg(long, value_name = "URL", env = "KEYGRAPH_MQTT", hide_env_values = true)]
    pub mqtt: Option<String>,
    /// Run the models that are ordered under this topic of the broker (see `keygraph order`)
    /// [default: keygraph/models]
    #[arg(long, value_name = "TOPIC", requires = "mqtt", num_args = 0..=1, default_missing_value = "keygraph/models")]
    pub mqtt_models: Option<String>,
    /// Authorities to trust, in PEM, for the broker and for servers of ordered models
    /// [default: those of the system]
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    pub mqtt_ca: Option<PathBuf>,
    /// Certificate of this program, in PEM
    #[arg(long, value_name = "FILE", requires_all = ["mqtt", "mqtt_key"])]
    pub mqtt_cert: Option<PathBuf>,
    /// Key of this program's certificate, in PEM
    #[arg(long, value_name = "FILE", requires_all = ["mqtt", "mqtt_cert"])]
    pub mqtt_key: Option<PathBuf>,
    /// Maximum number of lines published a second; the newest are published
    #[arg(long, value_name = "HZ", requires = "mqtt", default_value_t = 10.0, value_parser = line_rate)]
    pub mqtt_rate: f64,
    /// Describe objects for Home Assistant, under this prefix [default: homeassistant]
    #[arg(long, value_name = "PREFIX", requires = "mqtt", num_args = 0..=1, default_missing_value = "homeassistant")]
    pub mqtt_discovery: Option<String>,
}

/// Arguments of `keygraph camera`.
#[derive(Clone, Debug, clap::Args)]
pub struct Arguments {
    /// List cameras, their formats, sizes and rates
    #[arg(long)]
    pub list: bool,
    /// The source of frames.
    #[command(flatten)]
    pub origin: Origin,
    /// Model with the objects to find, or a folder of models; several are searched at once
    #[arg(short, long = "model", value_name = "MODEL.kgm|DIR")]
    pub models: Vec<PathBuf>,
    /// Folder of more models to find, also of those that come, change and go while the program runs; models
    /// learned or loaded on the page are kept there
    #[arg(long = "models", value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// Size that frames are searched at; larger ones are scaled down
    #[arg(long, value_enum, default_value = "vga")]
    pub profile: Profile,
    /// Minimum score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD, value_parser = parse_threshold)]
    pub threshold: f32,
    /// Minimum share of an object that must be seen and agree, 0 to 1: keeps siblings that share
    /// less from being taken for each other
    #[arg(long, default_value_t = 0.0, value_name = "SHARE", value_parser = parse_share)]
    pub min_visible: f32,
    /// Stop the search of a frame after this time, ms, and report what was found; followed objects are
    /// followed all the same
    #[arg(long, value_name = "MS", value_parser = parse_budget)]
    pub budget_ms: Option<Duration>,
    /// Shape that objects may have: with `any`, an object that a plane does not explain is laid on a surface
    /// that bends along one direction, as a label on a can or a page does
    #[arg(long, value_enum, default_value = "any", value_name = "SHAPE")]
    pub surface: Shape,
    /// Threads that search a frame together [default: one a processor, at most 8]
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=MAX_THREADS as i64))]
    pub threads: Option<u8>,
    /// Average outlines over this many frames while they stand still [default: 8]: they tremble less, and lag by less
    /// than a pixel of the searched frame
    #[arg(long, value_name = "FRAMES", num_args = 0..=1, require_equals = true, default_missing_value = "8", value_parser = clap::value_parser!(u8).range(1..))]
    pub smooth: Option<u8>,
    /// Search all of a frame for all of the models whenever it is searched
    #[arg(long)]
    pub thorough: bool,
    /// Which pixels of a frame are searched.
    #[command(flatten)]
    pub look: Look,
    /// The camera and its lens, for poses.
    #[command(flatten)]
    pub camera: CameraArguments,
    /// Serve a page that shows what the camera sees: HOST:PORT, or a port of this machine alone
    /// [default address: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = USUAL_ADDRESS, value_parser = place)]
    pub web: Option<SocketAddr>,
    /// Address of the page behind a proxy, such as `https://cam.example.org`: its users may
    /// change something. A token is needed then
    #[arg(long, value_name = "URL", requires = "web", value_parser = parse_public)]
    pub public_url: Option<String>,
    /// Secret that the users of the page must give, 16 characters or more [default: none on
    /// 127.0.0.1, else random]
    #[arg(long, requires = "web", env = "KEYGRAPH_TOKEN", hide_env_values = true)]
    pub token: Option<String>,
    /// The broker that results are published to.
    #[command(flatten)]
    pub publishing: Publishing,
    /// Print one JSON line a frame
    #[arg(long)]
    pub json: bool,
    /// Stop after N frames
    #[arg(long, value_name = "N")]
    pub frames: Option<u64>,
    /// Level of the log: error, warn, info, debug or trace
    #[arg(long, value_name = "LEVEL", default_value = "info", env = "KEYGRAPH_LOG")]
    pub log: LevelFilter,
}

/// Arguments of `keygraph train --from-camera`.
#[derive(Clone, Debug, clap::Args)]
pub struct Lesson {
    /// Train on an object held up to a camera: its outline is marked on a page, or given by
    /// --outline
    #[arg(long, conflicts_with = "crop")]
    pub from_camera: bool,
    /// The source of frames.
    #[command(flatten)]
    pub origin: Origin,
    /// Address of the page on which the outline is marked
    #[arg(long, value_name = "ADDR", requires = "from_camera", default_value = USUAL_ADDRESS, value_parser = place)]
    pub web: SocketAddr,
    /// Secret that the users of the page must give, 16 characters or more [default: none on
    /// 127.0.0.1, else random]
    #[arg(long, env = "KEYGRAPH_TOKEN", hide_env_values = true)]
    pub token: Option<String>,
    /// The object's corners, px of the frame, clockwise from its top left: no page is served
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", requires = "from_camera", value_parser = outline, allow_hyphen_values = true)]
    pub outline: Option<Outline>,
    /// With --outline: seconds until the picture is taken
    #[arg(long, value_name = "SECONDS", requires = "outline", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=60))]
    pub countdown: u8,
}

fn outline(s: &str) -> Result<Outline, String> {
    parse_outline(s).map_err(|e| e.to_string())
}

/// The address on which the page listens: HOST:PORT, HOST, :PORT or PORT. Without a host, it
/// is this machine alone.
fn place(s: &str) -> Result<SocketAddr, String> {
    if let Ok(address) = s.parse() {
        return Ok(address);
    }
    let port = s.strip_prefix(':').unwrap_or(s);
    let found = if let Ok(address) = s.parse() {
        return Ok(SocketAddr::new(address, USUAL_PORT));
    } else if port.bytes().all(|b| b.is_ascii_digit()) {
        port.parse().ok().and_then(|port: u16| ("127.0.0.1", port).to_socket_addrs().ok())
    } else if let Some((host, port)) = s.rsplit_once(':') {
        port.parse().ok().and_then(|port: u16| (host, port).to_socket_addrs().ok())
    } else {
        (s, USUAL_PORT).to_socket_addrs().ok()
    };
    // A name may have both kinds of addresses: most programs try this one.
    let all: Vec<_> = found.into_iter().flatten().collect();
    let address = all.iter().find(|a| a.is_ipv4()).or(all.first());
    address.copied().ok_or_else(|| format!("{s} is no address: give one such as {USUAL_ADDRESS}, 8080 or 0.0.0.0:8080"))
}

fn size(s: &str) -> Result<(u32, u32), String> {
    let parts = s.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parts.filter(|&(w, h)| w >= 16 && h >= 16).ok_or_else(|| "a size is like 640x480, at least 16x16".into())
}

fn rate(s: &str) -> Result<f64, String> {
    let rate = s.parse().ok().filter(|r| (0.1..=10_000.0).contains(r));
    rate.ok_or_else(|| "a rate lies between 0.1 and 10000 frames a second".into())
}

fn line_rate(s: &str) -> Result<f64, String> {
    let rate = s.parse().ok().filter(|r| (0.001..=1000.0).contains(r));
    rate.ok_or_else(|| "a rate lies between 0.001 and 1000 lines a second".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_the_page() {
        for (text, address) in [
            ("8080", "127.0.0.1:8080"),
            (":81", "127.0.0.1:81"),
            ("localhost:8080", "127.0.0.1:8080"),
            ("localhost", "127.0.0.1:8080"),
            ("0.0.0.0:0", "0.0.0.0:0"),
            ("0.0.0.0", "0.0.0.0:8080"),
            ("[::1]:9", "[::1]:9"),
        ] {
            assert_eq!(place(text).map(|a| a.to_string()).as_deref(), Ok(address), "{text}");
        }
        for wrong in ["", ":", "99999", "localhost:x", "no such host"] {
            assert!(place(wrong).is_err_and(|e| e.contains("127.0.0.1:8080")), "{wrong}");
        }
    }
}
