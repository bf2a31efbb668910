//! The part of a frame that is searched, as the command line names it.
//!
//! In: the value of `--roi`, four lengths in px or in percent, and the size of a frame. Out: the
//! [`Part`] of the frame, or what is wrong with the region. Memory and cost: none.

use std::error::Error;
use std::fmt;
use std::str::FromStr;

use keygraph_core::stages::frame::MIN_SIDE;

use crate::picture::{Part, Picture, Pixels};

/// What to give, for the messages of errors.
const GIVE: &str = "give X,Y,WIDTH,HEIGHT inside of the frame, in px or in percent: 100,50,320,240 or 25%,0,50%,100%";

/// A place or a length within a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Length {
    Px(u32),
    /// Percent of the frame's width or height, 0 to 100.
    Percent(f64),
}

impl Length {
    fn parse(text: &str) -> Option<Self> {
        match text.strip_suffix('%') {
            None => text.parse().ok().map(Self::Px),
            Some(number) => number.trim().parse().ok().filter(|v| (0.0..=100.0).contains(v)).map(Self::Percent),
        }
    }

    /// The length in px of a side of `side` px.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the side")]
    fn px(self, side: u32) -> u64 {
        match self {
            Self::Px(px) => px.into(),
            Self::Percent(percent) => (f64::from(side) * percent / 100.0).round() as u64,
        }
    }

    /// Where a part of this length ends that starts at `start`, px of a side of `side` px. Two shares
    /// are added before they are rounded, so that neighbouring regions leave no gap.
    fn end(self, start: Self, side: u32) -> u64 {
        match (start, self) {
            (Self::Percent(start), Self::Percent(length)) => Self::Percent(start + length).px(side),
            _ => start.px(side) + self.px(side),
        }
    }

    fn is_zero(self) -> bool {
        matches!(self, Self::Px(0)) || self == Self::Percent(0.0)
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Px(px) => write!(f, "{px}"),
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

/// The part of a frame that is searched: x, y, width and height, each in px or in percent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    place: [Length; 2],
    size: [Length; 2],
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([x, y], [width, height]) = (self.place, self.size);
        write!(f, "{x},{y},{width},{height}")
    }
}

impl FromStr for Region {
    type Err = String;

    /// Reads a region from `x,y,width,height`.
    fn from_str(text: &str) -> Result<Self, String> {
        let lengths: Option<Vec<Length>> = text.split(',').map(|n| Length::parse(n.trim())).collect();
        let Some(&[x, y, width, height]) = lengths.as_deref() else {
            return Err(format!("{GIVE} (px are whole numbers, percent go from 0 to 100)"));
        };
        let beyond =
            |start, length| matches!((start, length), (Length::Percent(a), Length::Percent(b)) if a + b > 100.0 + 1e-9);
        if width.is_zero() || height.is_zero() {
            return Err(format!("width and height are above 0: {GIVE}"));
        }
        if beyond(x, width) || beyond(y, height) {
            return Err(format!("the region ends beyond 100 % of the frame: {GIVE}"));
        }
        Ok(Self { place: [x, y], size: [width, height] })
    }
}

/// Arguments that say which pixels of a frame are searched.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct Look {
    /// Search this part of each frame alone, at its own resolution: px of the frame, or percent such as
    /// 25%,0,50%,100%. Results stay in px of the whole frame
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
    pub roi: Option<Region>,
    /// Search frames mirrored left to right: those of a selfie camera, or of a print seen through glass.
    /// Results stay in px of the frame as it came
    #[arg(long)]
    pub mirror: bool,
}

/// A region that does not suit a frame. The message says what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unsuitable(pub(crate) String);

impl fmt::Display for Unsuitable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Error for Unsuitable {}

impl Region {
    /// The part of `picture` that the region names. Where pixels share chroma, the part is widened to
    /// even places.
    ///
    /// # Errors
    /// When the region leaves the picture, or is too small to be searched.
    pub fn part(&self, picture: &Picture) -> Result<Part, Unsuitable> {
        let sides = [picture.width, picture.height];
        let shared = matches!(picture.pixels, Pixels::I420(_));
        let whole = || format!("the frame, which has {}x{} px", sides[0], sides[1]);
        let mut spans = [(0, 0); 2];
        for (i, span) in spans.iter_mut().enumerate() {
            let (start, end) = (self.place[i].px(sides[i]), self.size[i].end(self.place[i], sides[i]));
            let (Ok(start), Ok(end)) = (u32::try_from(start), u32::try_from(end.max(start))) else {
                return Err(Unsuitable(format!("--roi {self} leaves {}: {GIVE}", whole())));
            };
            if end > sides[i] {
                return Err(Unsuitable(format!("--roi {self} leaves {}: {GIVE}", whole())));
            }
            *span = if shared { (start & !1, end.next_multiple_of(2)) } else { (start, end) };
        }
        let [(x, right), (y, bottom)] = spans;
        let part = Part { x, y, width: right - x, height: bottom - y };
        if (part.width.min(part.height) as usize) < MIN_SIDE {
            let (width, height) = (part.width, part.height);
            let text = format!(
                "--roi {self} is {width}x{height} px of {}: give a region with {MIN_SIDE} px or more on each side",
                whole()
            );
            return Err(Unsuitable(text));
        }
        Ok(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(text: &str) -> Region {
        text.parse().expect("a region")
    }

    fn frame(width: u32, height: u32) -> Picture {
        Picture { width, height, pixels: Pixels::Gray8(Vec::new()) }
    }

    #[test]
    fn px_and_percent() {
        let part =
            |text, width, height| region(text).part(&frame(width, height)).map(|p| (p.x, p.y, p.width, p.height));
        assert_eq!(part("10,20,300,200", 640, 480), Ok((10, 20, 300, 200)));
        assert_eq!(part("25%,0,50%,100%", 640, 480), Ok((160, 0, 320, 480)));
        assert_eq!(part(" 12.5% , 10 , 100 , 50 % ", 640, 480), Ok((80, 10, 100, 240)));
        assert_eq!(part("0,0,640,480", 640, 480), Ok((0, 0, 640, 480)));
        // Thirds of a side that three does not divide.
        let thirds = ["0,0,33.3%,100%", "33.3%,0,33.3%,100%", "66.6%,0,33.4%,100%"];
        assert_eq!(thirds.map(|t| part(t, 101, 20)), [Ok((0, 0, 34, 20)), Ok((34, 0, 33, 20)), Ok((67, 0, 34, 20))]);
    }

    #[test]
    fn what_is_no_region_says_what_is() {
        for text in ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "-1,0,20,20", "0,0,20.5,20", "0,0,101%,20", "nan%,0,9,9"] {
            assert!(text.parse::<Region>().is_err_and(|e| e.contains("25%,0,50%,100%")), "{text:?}");
        }
        assert!("0,0,0,20".parse::<Region>().is_err_and(|e| e.contains("above 0")));
        assert!("60%,0,50%,20".parse::<Region>().is_err_and(|e| e.contains("beyond 100 %")));
    }

    #[test]
    fn a_region_lies_in_the_frame_and_can_be_searched() {
        let said = |text: &str, width, height| region(text).part(&frame(width, height)).expect_err("refused").0;
        for text in ["600,0,100,100", "0,400,100,100", "50%,0,400,100", "4294967295,0,4294967295,20"] {
            let said = said(text, 640, 480);
            assert!(said.contains(&format!("--roi {text} leaves")) && said.contains("640x480"), "{said}");
        }
        assert!(said("0,0,15,100", 640, 480).contains("16 px or more"));
        assert!(said("0,0,1%,100%", 640, 480).contains("6x480 px"));
    }

    #[test]
    fn a_region_of_shared_chroma_is_widened_to_even_places() {
        let video = Picture { pixels: Pixels::I420(Vec::new()), ..frame(640, 480) };
        assert_eq!(region("11,21,30,31").part(&video), Ok(Part { x: 10, y: 20, width: 32, height: 32 }));
        assert_eq!(region("609,449,31,31").part(&video), Ok(Part { x: 608, y: 448, width: 32, height: 32 }));
    }
}
