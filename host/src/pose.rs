//! Poses of detections in space, for cameras with known intrinsics.
//!
//! In: the values of `--intrinsics` and `--width-mm`, a model, and detections in px of the
//! input. Out: a [`PlanePose`] for each detection. Memory: a number for each object. Cost:
//! some microseconds for each detection.

use std::collections::HashMap;
use std::str::FromStr;

use anyhow::{Result, bail};
use keygraph_core::{
    CameraError, Cylinder, Detection, Distortion, Intrinsics, Lens, Model, PlanePose, Surface, cylinder, plane_pose,
};

use crate::lens::{Optics, distortion};
use crate::search::Found;

/// Parses the intrinsics `fx,fy,cx,cy`, px of the input.
///
/// # Errors
/// When `text` is not four numbers, or no camera has these intrinsics.
pub fn parse_intrinsics(text: &str) -> Result<Intrinsics, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let Ok(&[fx, fy, cx, cy]) = numbers.as_deref() else {
        return Err("give four numbers in px of the input: fx,fy,cx,cy".into());
    };
    Intrinsics::new(fx, fy, cx, cy).map_err(|e: CameraError| e.to_string())
}

/// Parses coefficients of a lens in OpenCV's order: `k1,k2,p1,p2[,k3[,k4,k5,k6]]`.
///
/// # Errors
/// When `text` is not 4, 5 or 8 numbers.
pub fn parse_distortion(text: &str) -> Result<Distortion, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let distortion = numbers.ok().filter(|k| k.iter().all(|v: &f32| v.is_finite())).and_then(|k| distortion(false, &k));
    distortion.ok_or_else(|| "give 4, 5 or 8 numbers in OpenCV's order: k1,k2,p1,p2[,k3[,k4,k5,k6]]".into())
}

/// The true width of every object (`W`) or of one object (`NAME=W`), mm.
#[derive(Clone, Debug, PartialEq)]
pub struct Width {
    name: Option<String>,
    mm: f32,
}

impl FromStr for Width {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, mm) = text.rsplit_once('=').map_or((None, text), |(name, mm)| (Some(name.to_string()), mm));
        match mm.trim().parse::<f32>() {
            Ok(mm) if mm > 0.0 && mm.is_finite() => Ok(Self { name, mm }),
            _ => Err("a width is a number of millimetres above 0, or NAME=WIDTH for one object".into()),
        }
    }
}

/// The camera, its lens and the widths of objects, as command lines give them.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct CameraArguments {
    /// The camera's focal lengths and principal point, px of the input: reports the
    /// pose of each object
    #[arg(long, value_name = "FX,FY,CX,CY", group = "camera_of", conflicts_with = "mirror", value_parser = parse_intrinsics, allow_hyphen_values = true)]
    intrinsics: Option<Intrinsics>,
    /// Distortion of the camera's lens, in OpenCV's order
    #[arg(long, value_name = "K1,K2,P1,P2[,K3[,K4,K5,K6]]", requires = "intrinsics", value_parser = parse_distortion, allow_hyphen_values = true)]
    distortion: Option<Distortion>,
    /// Calibration of the camera and its lens, as `keygraph calibrate`, OpenCV or ROS write it: outlines are
    /// bent as the lens bends them
    #[cfg(feature = "calibrate")]
    #[arg(long, value_name = "FILE", group = "camera_of", conflicts_with_all = ["mirror", "intrinsics"])]
    lens: Option<std::path::PathBuf>,
    /// True width of every object, mm, or of the object NAME; may be repeated
    #[arg(long, value_name = "[NAME=]W", requires = "camera_of", allow_hyphen_values = true)]
    width_mm: Vec<Width>,
}

impl CameraArguments {
    /// What is missing, for a message.
    #[must_use]
    pub const fn lacks(&self) -> Option<&'static str> {
        let is_idle = self.intrinsics.is_some() && self.distortion.is_none() && self.width_mm.is_empty();
        if is_idle { Some("--intrinsics needs --width-mm, or --distortion") } else { None }
    }

    /// Whether the lens is given.
    #[must_use]
    pub const fn has_lens(&self) -> bool {
        #[cfg(feature = "calibrate")]
        if self.lens.is_some() {
            return true;
        }
        self.distortion.is_some()
    }

    /// The camera's lens.
    ///
    /// # Errors
    /// When its file cannot be read.
    pub fn optics(&self) -> Result<Option<Optics>> {
        #[cfg(feature = "calibrate")]
        if let Some(path) = &self.lens {
            return Ok(Some(crate::lens_file::read(path)?));
        }
        let lens = self.distortion.zip(self.intrinsics).map(|(d, i)| Lens::new(i.numbers(), d)).transpose()?;
        Ok(lens.map(|lens| Optics::new(lens, None)))
    }

    /// Intrinsics, when poses are asked for.
    ///
    /// # Errors
    /// When no camera has those of the lens.
    pub fn intrinsics(&self, optics: Option<&Optics>) -> Result<Option<Intrinsics>> {
        let of_lens = optics.map(|o| o.lens().intrinsics()).map(|[fx, fy, cx, cy]| Intrinsics::new(fx, fy, cx, cy));
        let known = self.intrinsics.map_or_else(|| of_lens.transpose(), |i| Ok(Some(i)))?;
        Ok(known.filter(|_| !self.width_mm.is_empty()))
    }

    /// True widths.
    #[must_use]
    pub fn widths(&self) -> &[Width] {
        &self.width_mm
    }
}

/// Where a detection is in space.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The pose of a flat object, when there is one.
    pub pose: Option<PlanePose>,
    /// The cylinder that a bent object lies on.
    pub cylinder: Option<Cylinder>,
}

impl Place {
    /// The middle of the picture, mm before the camera.
    #[must_use]
    pub fn middle_mm(&self) -> Option<[f32; 3]> {
        let pose = self.pose.map(|p| p.best).or_else(|| self.cylinder.map(|c| c.pose))?;
        Some(pose.translation_mm)
    }
}

/// A camera's intrinsics, and the true width of each object of a model.
#[derive(Clone, Debug)]
pub struct Calibration {
    intrinsics: Intrinsics,
    lens: Option<Lens>,
    /// Width of each object, mm; `None` for one whose width is not known.
    widths_mm: Vec<Option<f32>>,
}

impl Calibration {
    /// Gives each object of `model` the width with its name, or else the width without a
    /// name.
    ///
    /// # Errors
    /// When an object has no width or two widths, or a width names no object of the model.
    pub fn new(intrinsics: Intrinsics, widths: &[Width], model: &Model<'_>) -> Result<Self> {
        let names: Vec<&str> = (0..model.objects()).map(|i| model.object(i).name).collect();
        for name in widths.iter().filter_map(|w| w.name.as_deref()) {
            if !names.contains(&name) {
                bail!("--width-mm {name}=...: there is no such object, only {}", names.join(", "));
            }
        }
        let of = |name: Option<&str>| {
            let mut all = widths.iter().filter(|w| w.name.as_deref() == name).map(|w| w.mm);
            match (all.next(), all.next()) {
                (_, Some(_)) => bail!(
                    "--width-mm is given twice for {}: give NAME=WIDTH for each object",
                    name.unwrap_or("all objects")
                ),
                (width, None) => Ok(width),
            }
        };
        let shared = of(None)?;
        let width = |name: &&str| match of(Some(name))?.or(shared) {
            Some(mm) => Ok(Some(mm)),
            None => bail!("the width of {name} is missing: add --width-mm {name}=WIDTH"),
        };
        Ok(Self { intrinsics, lens: None, widths_mm: names.iter().map(width).collect::<Result<_>>()? })
    }

    /// Gives each object of `model` the last width with its name, or else the last width without a name, or none: for
    /// models that come and go.
    #[must_use]
    pub fn of_any(intrinsics: Intrinsics, widths: &[Width], model: &Model<'_>) -> Self {
        let last = |name: Option<&str>| widths.iter().rev().find(|w| w.name.as_deref() == name).map(|w| w.mm);
        let width = |i: usize| last(Some(model.object(i).name)).or_else(|| last(None));
        Self { intrinsics, lens: None, widths_mm: (0..model.objects()).map(width).collect() }
    }

    /// Returns the calibration for frames of this lens, whose intrinsics then count.
    #[must_use]
    pub fn through(&self, lens: Option<Lens>) -> Self {
        let of_lens = lens.and_then(|lens| {
            let [fx, fy, cx, cy] = lens.intrinsics();
            Intrinsics::new(fx, fy, cx, cy).ok()
        });
        Self { intrinsics: of_lens.unwrap_or(self.intrinsics), lens, ..self.clone() }
    }

    /// The poses of a detection, whose homography is in px of the input, or of its plane seen through a lens.
    /// `None` when no pose gives this homography, when the object is bent or not seen through its lens, or when its
    /// width is not known.
    fn pose(&self, model: &Model<'_>, detection: &Detection, surface: Option<&Surface>) -> Option<PlanePose> {
        // Through a lens the homography of the frame is none of a plane.
        if surface.map_or(self.lens.is_some(), |s| s.is_bent) {
            return None;
        }
        let index = usize::from(detection.object);
        let object = model.object(index);
        let size_px = [object.width as f32, object.height as f32];
        let homography = surface.map_or(&detection.homography, |s| &s.homography);
        plane_pose(homography, &self.intrinsics, size_px, self.widths_mm[index]?).ok()
    }

    /// The cylinder that a bent object lies on. `None` for a flat one, one whose width is not known, and where no cylinder
    /// gives this surface.
    fn cylinder(&self, model: &Model<'_>, detection: &Detection, surface: Option<&Surface>) -> Option<Cylinder> {
        let surface = surface.filter(|s| s.is_bent)?;
        let index = usize::from(detection.object);
        let object = model.object(index);
        let size_px = [object.width as f32, object.height as f32];
        cylinder(surface, &self.intrinsics, self.lens.as_ref(), size_px, self.widths_mm[index]?).ok()
    }

    /// Where all detections of a frame are.
    #[must_use]
    pub fn places(&self, model: &Model<'_>, found: &Found) -> Vec<Place> {
        let all = found.detections.iter().enumerate();
        all.map(|(i, d)| {
            let surface = found.surface(i);
            Place { pose: self.pose(model, d, surface), cylinder: self.cylinder(model, d, surface) }
        })
        .collect()
    }

    /// The object's axes in the input, px: the object's centre, then the ends of x (right),
    /// y (down) and z (into the picture). Each axis is half as long as the object is wide.
    #[must_use]
    pub fn axes(&self, detection: &Detection, pose: &PlanePose) -> [[f32; 2]; 4] {
        let arm = self.widths_mm[usize::from(detection.object)].unwrap_or(0.0) / 2.0;
        [[0.0; 3], [arm, 0.0, 0.0], [0.0, arm, 0.0], [0.0, 0.0, arm]].map(|p| {
            let p = self.intrinsics.project(pose.best.apply(p));
            self.lens.map_or(p, |lens| lens.distort(p))
        })
    }
}

/// Poses from frame to frame: of two that look alike, the one that goes on from the frame before.
#[derive(Debug, Default)]
pub struct Steady {
    /// Rotation of each instance in the last frame.
    before: HashMap<u32, [f32; 9]>,
}

impl Steady {
    /// Orders the two poses of each instance, of which `id` is the number; `None` for one without a pose.
    pub fn order<'a>(&mut self, poses: impl Iterator<Item = (u32, Option<&'a mut PlanePose>)>) {
        let mut now = HashMap::new();
        for (id, pose) in poses {
            let Some(pose) = pose else { continue };
            if let Some(before) = self.before.get(&id)
                && pose.is_ambiguous()
                && alike(before, &pose.mirrored.rotation) > alike(before, &pose.best.rotation)
            {
                std::mem::swap(&mut pose.best, &mut pose.mirrored);
            }
            now.insert(id, pose.best.rotation);
        }
        self.before = now;
    }
}

/// How near two rotations are: the trace of one after the other turned back.
fn alike(a: &[f32; 9], b: &[f32; 9]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use keygraph_core::Homography;

    #[test]
    fn intrinsics_are_four_numbers() {
        assert!(parse_intrinsics("600, 600.5,320,-1").is_ok());
        for text in ["", "600", "600,600,320", "600,600,320,240,1", "600,600,320,x", "600 600 320 240"] {
            assert!(parse_intrinsics(text).is_err_and(|e| e.contains("fx,fy,cx,cy")), "{text:?}");
        }
        for text in ["0,600,320,240", "600,-1,320,240", "NaN,600,320,240", "600,600,inf,240"] {
            assert!(parse_intrinsics(text).is_err_and(|e| e.contains("focal lengths above 0")), "{text:?}");
        }
    }

    #[test]
    fn of_two_poses_the_one_that_goes_on_is_told() {
        // A small plane that is seen nearly from the front, and tilted a little.
        let camera = Intrinsics::new(600.0, 600.0, 320.0, 240.0).expect("a camera");
        let tilted = |degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            // 100 px wide and high, 100 mm, 600 mm away, turned about y.
            let h = Homography([cos, 0.0, 320.0, 0.0, 1.0, 240.0, -sin / 600.0, 0.0, 1.0]);
            let h = h.after(&Homography::affine([1.0, 0.0, -50.0, 0.0, 1.0, -50.0]));
            let h = Homography([
                h.0[0] + 320.0 * h.0[6],
                h.0[1],
                h.0[2],
                h.0[3] + 240.0 * h.0[6],
                h.0[4],
                h.0[5],
                h.0[6],
                h.0[7],
                h.0[8],
            ]);
            plane_pose(&h.normalised(), &camera, [100.0; 2], 100.0).expect("a pose")
        };
        let (mut steady, first) = (Steady::default(), tilted(12.0));
        let mut kept = first;
        steady.order([(7, Some(&mut kept))].into_iter());
        assert_eq!(kept, first, "the first is as it comes");
        let mut swapped = first;
        std::mem::swap(&mut swapped.best, &mut swapped.mirrored);
        assert!(swapped.is_ambiguous(), "{swapped:?}");
        steady.order([(7, Some(&mut swapped))].into_iter());
        assert_eq!(swapped, first, "the second goes on");
        let mut other = first;
        std::mem::swap(&mut other.best, &mut other.mirrored);
        let before = other;
        steady.order([(8, Some(&mut other))].into_iter());
        assert_eq!(other, before, "another instance");
    }

    #[test]
    fn coefficients_are_four_five_or_eight_numbers() {
        let k = |n: usize| vec!["0.1"; n].join(", ");
        assert!([4, 5, 8].iter().all(|&n| parse_distortion(&k(n)).is_ok()));
        assert!([0, 1, 3, 6, 7, 9].iter().all(|&n| parse_distortion(&k(n)).is_err()));
        assert!(parse_distortion("0,0,0,inf").is_err_and(|e| e.contains("OpenCV's order")));
    }

    #[test]
    fn widths_are_positive_and_may_bear_a_name() {
        assert_eq!("210".parse(), Ok(Width { name: None, mm: 210.0 }));
        assert_eq!("a=b=21.5".parse(), Ok(Width { name: Some("a=b".into()), mm: 21.5 }));
        for text in ["", "0", "-1", "NaN", "inf", "wide", "book=", "book=0"] {
            assert!(text.parse::<Width>().is_err_and(|e| e.contains("millimetres above 0")), "{text:?}");
        }
    }
}
