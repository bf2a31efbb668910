//! Poses of detections in space, for cameras with known intrinsics.
//!
//! In: the values of `--intrinsics` and `--width-mm`, a model, and detections in px of the
//! input. Out: a [`PlanePose`] for each detection. Memory: a number for each object. Cost:
//! some microseconds for each detection.

use std::str::FromStr;

use anyhow::{Result, bail};
use keygraph_core::{CameraError, Detection, Distortion, Intrinsics, Lens, Model, PlanePose, Surface, plane_pose};

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
    let Some(numbers) = numbers.ok().filter(|k| matches!(k.len(), 4 | 5 | 8) && k.iter().all(|v| v.is_finite())) else {
        return Err("give 4, 5 or 8 numbers in OpenCV's order: k1,k2,p1,p2[,k3[,k4,k5,k6]]".into());
    };
    let mut all = [0.0; 8];
    all[..numbers.len()].copy_from_slice(&numbers);
    Ok(Distortion::Brown(all))
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

/// A camera's intrinsics, and the true width of each object of a model.
#[derive(Clone, Debug)]
pub struct Calibration {
    intrinsics: Intrinsics,
    lens: Option<Lens>,
    /// Width of each object, mm.
    widths_mm: Vec<f32>,
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
            Some(mm) => Ok(mm),
            None => bail!("the width of {name} is missing: add --width-mm {name}=WIDTH"),
        };
        Ok(Self { intrinsics, lens: None, widths_mm: names.iter().map(width).collect::<Result<_>>()? })
    }

    /// The same for frames of this lens, whose intrinsics count then.
    #[must_use]
    pub fn through(&self, lens: Option<Lens>) -> Self {
        let of_lens = lens.and_then(|lens| {
            let [fx, fy, cx, cy] = lens.intrinsics();
            Intrinsics::new(fx, fy, cx, cy).ok()
        });
        Self { intrinsics: of_lens.unwrap_or(self.intrinsics), lens, ..self.clone() }
    }

    /// The poses of a detection, whose homography is in px of the input, or of its plane seen through a lens.
    /// `None` when no pose gives this homography, or when the object is bent.
    #[must_use]
    pub fn pose(&self, model: &Model<'_>, detection: &Detection, surface: Option<&Surface>) -> Option<PlanePose> {
        if surface.is_some_and(|s| s.is_bent) {
            return None;
        }
        let index = usize::from(detection.object);
        let object = model.object(index);
        let size_px = [object.width as f32, object.height as f32];
        let homography = surface.map_or(&detection.homography, |s| &s.homography);
        plane_pose(homography, &self.intrinsics, size_px, self.widths_mm[index]).ok()
    }

    /// The object's axes in the input, px: the object's centre, then the ends of x (right),
    /// y (down) and z (into the picture). Each axis is half as long as the object is wide.
    #[must_use]
    pub fn axes(&self, detection: &Detection, pose: &PlanePose) -> [[f32; 2]; 4] {
        let arm = self.widths_mm[usize::from(detection.object)] / 2.0;
        [[0.0; 3], [arm, 0.0, 0.0], [0.0, arm, 0.0], [0.0, 0.0, arm]].map(|p| {
            let p = self.intrinsics.project(pose.best.apply(p));
            self.lens.map_or(p, |lens| lens.distort(p))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
