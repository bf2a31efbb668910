//! The command line of `keygraph camera`, and of `keygraph train --from-camera`.
//!
//! In: words. Out: [`Arguments`], [`Lesson`]. Costs nothing.

use std::net::SocketAddr;
use std::path::PathBuf;

use keygraph_core::detect::DEFAULT_THRESHOLD;
use tracing::level_filters::LevelFilter;

use super::cutout::{Outline, parse_outline};
use super::mode::Format;
use crate::search::{Profile, parse_threshold};

/// The address of the page if none is given.
const USUAL_ADDRESS: &str = "127.0.0.1:8080";

/// Where frames come from.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Origin {
    /// The camera [default: the first that gives pictures]
    #[arg(long, value_name = "/dev/videoN|N", conflicts_with = "replay")]
    pub device: Option<String>,
    /// A video or a folder of pictures in place of a camera, again and again
    #[arg(long, value_name = "VIDEO|FOLDER")]
    pub replay: Option<PathBuf>,
    /// Size to ask the camera for [default: the nearest to 640x480]
    #[arg(long, value_name = "WxH", value_parser = size, conflicts_with = "replay")]
    pub size: Option<(u32, u32)>,
    /// Pixel format to ask the camera for: YUYV, MJPG or GREY [default: the one with the highest rate]
    #[arg(long, value_name = "FOURCC", conflicts_with = "replay")]
    pub format: Option<Format>,
    /// Frames a second [default: the camera's highest, the file's own]
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
    /// Whether anything is asked for.
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

/// What `keygraph camera` is asked to do.
#[derive(Clone, Debug, clap::Args)]
pub struct Arguments {
    /// List cameras, their formats, sizes and rates
    #[arg(long)]
    pub list: bool,
    /// Where frames come from.
    #[command(flatten)]
    pub origin: Origin,
    /// Model with the objects to find; several are searched at once
    #[arg(short, long = "model", value_name = "MODEL.kgm")]
    pub models: Vec<PathBuf>,
    /// Folder of models to find too; what is learned or loaded on the page is kept there
    #[arg(long = "models", value_name = "DIR")]
    pub folder: Option<PathBuf>,
    /// Size that frames are searched at; larger ones are scaled down
    #[arg(long, value_enum, default_value = "vga")]
    pub profile: Profile,
    /// Least score of a detection, 0 to 1
    #[arg(long, default_value_t = DEFAULT_THRESHOLD, value_parser = parse_threshold)]
    pub threshold: f32,
    /// Search all of a frame for all of the models whenever it is searched
    #[arg(long)]
    pub thorough: bool,
    /// Serve a page that shows what the camera sees [default address: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = USUAL_ADDRESS)]
    pub web: Option<SocketAddr>,
    /// What the page and its users must know [default: none on 127.0.0.1, else random]
    #[arg(long, requires = "web", env = "KEYGRAPH_TOKEN", hide_env_values = true)]
    pub token: Option<String>,
    /// Publish what is found to a broker: `mqtt://[USER:PASSWORD@]HOST[:PORT][/PREFIX]`
    #[arg(long, value_name = "URL", env = "KEYGRAPH_MQTT", hide_env_values = true)]
    pub mqtt: Option<String>,
    /// Print one JSON line a frame
    #[arg(long)]
    pub json: bool,
    /// End after so many frames
    #[arg(long, value_name = "N")]
    pub frames: Option<u64>,
    /// What to log: error, warn, info, debug or trace
    #[arg(long, value_name = "LEVEL", default_value = "info", env = "KEYGRAPH_LOG")]
    pub log: LevelFilter,
}

/// How `keygraph train --from-camera` comes by its picture.
#[derive(Clone, Debug, clap::Args)]
pub struct Lesson {
    /// Learn what is held up to a camera: its outline is marked on a page, or given by
    /// --outline
    #[arg(long, conflicts_with = "crop")]
    pub from_camera: bool,
    /// Where frames come from.
    #[command(flatten)]
    pub origin: Origin,
    /// Address of the page on which the outline is marked
    #[arg(long, value_name = "ADDR", requires = "from_camera", default_value = USUAL_ADDRESS)]
    pub web: SocketAddr,
    /// What the page and its users must know [default: none on 127.0.0.1, else random]
    #[arg(long, env = "KEYGRAPH_TOKEN", hide_env_values = true)]
    pub token: Option<String>,
    /// No page: the object's corners, px of the frame, from its top left clockwise
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", requires = "from_camera", value_parser = outline, allow_hyphen_values = true)]
    pub outline: Option<Outline>,
    /// With --outline: seconds until the picture is taken
    #[arg(long, value_name = "SECONDS", requires = "outline", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=60))]
    pub countdown: u8,
}

fn outline(s: &str) -> Result<Outline, String> {
    parse_outline(s).map_err(|e| e.to_string())
}

fn size(s: &str) -> Result<(u32, u32), String> {
    let parts = s.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parts.filter(|&(w, h)| w >= 16 && h >= 16).ok_or_else(|| "a size is like 640x480, at least 16x16".into())
}

fn rate(s: &str) -> Result<f64, String> {
    let rate = s.parse().ok().filter(|r| (0.1..=10_000.0).contains(r));
    rate.ok_or_else(|| "a rate lies between 0.1 and 10000 frames a second".into())
}
