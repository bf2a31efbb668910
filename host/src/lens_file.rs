//! Lenses in files: OpenCV's calibrations and those of ROS.
//!
//! In: YAML or JSON. Out: the lens, and the size of the frames that it belongs to. Known are
//! `camera_matrix` and `distortion_coefficients` as `cv2.FileStorage` writes them, `camera_matrix` and
//! `dist_coeffs` as lists, and the `camera_info` of ROS. Memory and cost: those of the file.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use keygraph_core::{Distortion, Lens};
use yaml_rust2::{Yaml, YamlLoader};

use crate::calibrate::{Calibrated, Kind};
use crate::lens::{Optics, distortion};
use crate::output::plain;

/// Maximum number of bytes of such a file.
const MOST_BYTES: u64 = 1 << 20;

/// Names of the camera matrix, of the coefficients, of the kind of lens, and of the sides of the frames.
const MATRIX: [&str; 6] = ["camera_matrix", "cameraMatrix", "K", "k", "mtx", "intrinsic_matrix"];
const COEFFICIENTS: [&str; 7] =
    ["distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "d", "dist_coeff", "dist"];
const MODEL: [&str; 3] = ["distortion_model", "camera_model", "model"];
const SIDES: [[&str; 2]; 2] = [["image_width", "width"], ["image_height", "height"]];

/// Reads a file.
///
/// # Errors
/// When it cannot be read, or holds no camera matrix and coefficients.
pub fn read(path: &Path) -> Result<Optics> {
    let told = || plain(&path.display().to_string()).into_owned();
    let bytes = fs::metadata(path).with_context(told)?.len();
    ensure!(bytes <= MOST_BYTES, "{}: too large for a calibration", told());
    parse(&fs::read_to_string(path).with_context(told)?).with_context(told)
}

/// Parses the text of a file.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str) -> Result<Optics> {
    // The first line of OpenCV's YAML is no directive that YAML knows.
    let text = match text.strip_prefix("%YAML:1.0") {
        Some(rest) => rest.trim_start().strip_prefix("---").unwrap_or(rest),
        None => text,
    };
    let documents = YamlLoader::load_from_str(text).map_err(|e| anyhow!("neither YAML nor JSON: {e}"))?;
    let root = documents.first().context("the file is empty")?;
    let matrix = numbers(root, &MATRIX)?.context("no camera_matrix: give a calibration of OpenCV or ROS")?;
    let &[fx, skew, cx, _, fy, cy, _, _, scale] = matrix.as_slice() else {
        bail!("camera_matrix has {} numbers, not 9", matrix.len());
    };
    ensure!(skew.abs() <= 1e-3 * fx.abs(), "camera_matrix has a skew of {skew}: there is none in this model");
    ensure!((scale - 1.0).abs() < 1e-6, "the last number of camera_matrix is {scale}, not 1");
    let coefficients =
        numbers(root, &COEFFICIENTS)?.context("no distortion_coefficients: give four zeros for a lens without")?;
    let lens = Lens::new([fx, fy, cx, cy], of_kind(is_fisheye(root)?, &coefficients)?)?;
    let [width, height] =
        SIDES.map(|names| names.iter().find_map(|name| root[*name].as_i64()).and_then(|v| u32::try_from(v).ok()));
    Ok(Optics::new(lens, width.zip(height).map(|(w, h)| [w, h])))
}

/// The text of a calibration, as `cv2.FileStorage` writes it. `size` is that of the frames, px.
///
/// # Errors
/// When the numbers are those of no lens.
pub fn written(found: &Calibrated, [width, height]: [u32; 2]) -> Result<String> {
    let (camera, k) = found.numbers.split_at(4);
    // Numbers of no lens are not written.
    found.lens()?;
    let list = |v: &[f64]| v.iter().map(|v| format!("{v:.10}")).collect::<Vec<_>>().join(", ");
    let matrix = list(&[camera[0], 0.0, camera[2], 0.0, camera[1], camera[3], 0.0, 0.0, 1.0]);
    let model = match found.kind {
        Kind::Brown => "plumb_bob",
        Kind::Fisheye => "fisheye",
    };
    let of = |rows: usize, cols: usize, data: &str| {
        format!("!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n")
    };
    Ok(format!(
        "%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\ncamera_matrix: {}distortion_model: {model}\n\
         distortion_coefficients: {}avg_reprojection_error: {:.6}\nnr_of_views: {}\n",
        of(3, 3, &matrix),
        of(1, k.len(), &list(k)),
        found.error_px,
        found.views.iter().flatten().count()
    ))
}

/// The distortion of a kind of lens, of the coefficients in a file.
fn of_kind(is_fisheye: bool, k: &[f32]) -> Result<Distortion> {
    // OpenCV's thin prism and tilted sensor, where they do nothing.
    let k = if !is_fisheye && matches!(k.len(), 12 | 14) && k[8..].iter().all(|&v| v == 0.0) { &k[..8] } else { k };
    distortion(is_fisheye, k).with_context(|| match is_fisheye {
        true => format!("a fisheye lens has 4 coefficients, not {}", k.len()),
        false => format!("{} coefficients: known are k1 k2 p1 p2 [k3 [k4 k5 k6]], and 4 of a fisheye lens", k.len()),
    })
}

/// Whether the lens of a file is a fisheye lens.
fn is_fisheye(root: &Yaml) -> Result<bool> {
    // Of OpenCV's own calibration program.
    if root["fisheye_model"].as_i64() == Some(1) {
        return Ok(true);
    }
    match MODEL.iter().find_map(|name| root[*name].as_str()).map(str::to_lowercase).as_deref() {
        None
        | Some("plumb_bob" | "rational_polynomial" | "brown_conrady" | "brown" | "pinhole" | "radtan" | "opencv") => {
            Ok(false)
        }
        Some("fisheye" | "equidistant" | "kannala_brandt" | "kannala_brandt4" | "equi" | "opencv_fisheye") => Ok(true),
        Some(other) => {
            bail!("the lens is of the kind {}: known are plumb_bob, rational_polynomial and fisheye", plain(other))
        }
    }
}

/// The numbers under the first of these names that is there: a list, a list of rows, or a matrix with its data.
fn numbers(root: &Yaml, names: &[&str]) -> Result<Option<Vec<f32>>> {
    let Some((name, value)) = names.iter().map(|name| (name, &root[*name])).find(|(_, v)| !v.is_badvalue()) else {
        return Ok(None);
    };
    let list = if value["data"].is_badvalue() { value } else { &value["data"] };
    let mut all = Vec::new();
    flatten(list, &mut all).with_context(|| format!("{name} is no list of numbers"))?;
    Ok(Some(all))
}

#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a calibration's numbers")]
fn flatten(value: &Yaml, into: &mut Vec<f32>) -> Option<()> {
    match value {
        Yaml::Array(list) => list.iter().try_for_each(|v| flatten(v, into))?,
        Yaml::Integer(v) => into.push(*v as f32),
        Yaml::Real(_) => into.push(value.as_f64()? as f32),
        _ => return None,
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BROWN: Distortion = Distortion::Brown([-0.25, 0.06, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0]);

    #[test]
    fn calibrations_of_opencv_and_ros_are_read() {
        let opencv = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
            cols: 3\n   dt: d\n   data: [ 500., 0., 3.2e+02, 0., 505., 240., 0., 0., 1. ]\ndistortion_coefficients: \
            !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.25, 0.06, 0, 0.001,\n       0. ]\n";
        let json = r#"{"image_width": 640, "image_height": 480,
            "camera_matrix": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": [500, 0.0, 320, 0, 505, 240, 0, 0, 1]},
            "distortion_coefficients": {"rows": 5, "cols": 1, "data": [-0.25, 0.06, 0, 0.001, 0]}}"#;
        let lists = r#"{"image_width": 640, "image_height": 480, "camera_matrix": [[500, 0, 320], [0, 505, 240], [0, 0, 1]],
            "dist_coeffs": [[-0.25, 0.06, 0, 0.001, 0]]}"#;
        let ros = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: \
            [500.0, 0, 320, 0, 505, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  \
            data: [-0.25, 0.06, 0, 0.001, 0]\n";
        let ros2 = "width: 640\nheight: 480\ndistortion_model: plumb_bob\nd: [-0.25, 0.06, 0.0, 0.001, 0.0]\nk: [500.0, 0.0, 320.0, 0.0, 505.0, 240.0, 0.0, 0.0, 1.0]\n";
        for text in [opencv, json, lists, ros, ros2] {
            let file = parse(text).expect(text);
            let lens = Lens::new([500.0, 505.0, 320.0, 240.0], BROWN).expect("a lens");
            assert_eq!(file, Optics::new(lens, Some([640, 480])), "{text}");
        }
        let fisheye = ros.replace("plumb_bob", "fisheye").replace(", 0.001, 0]", ", 0.001]");
        let file = parse(&fisheye).expect("a lens");
        assert_eq!(file.lens().distortion(), &Distortion::Fisheye([-0.25, 0.06, 0.0, 0.001]));
        // As OpenCV's calibration program tells it.
        let fisheye = fisheye.replace("distortion_model: fisheye", "fisheye_model: 1");
        assert_eq!(parse(&fisheye).expect("a lens"), file);
    }

    #[test]
    fn what_is_no_calibration_is_told() {
        let matrix = "camera_matrix: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n";
        for (text, word) in [
            ("", "empty"),
            ("a: [", "neither YAML nor JSON"),
            ("a: 1", "no camera_matrix"),
            ("camera_matrix: [1, 2, 3]", "3 numbers, not 9"),
            ("camera_matrix: [a, b]", "no list of numbers"),
            ("camera_matrix: [500, 20, 320, 0, 500, 240, 0, 0, 1]", "skew"),
            (&format!("{} [0, 0, 0, 0]", "camera_matrix: [0, 0, 320, 0, 500, 240, 0, 0, 1]\nD:"), "focal lengths"),
            (matrix, "no distortion_coefficients"),
            (&format!("{matrix}distortion_model: omni\nD: [1, 2, 3, 4]"), "of the kind omni"),
            (&format!("{matrix}dist_coeffs: [1, 2, 3]"), "3 coefficients"),
            (&format!("{matrix}distortion_model: fisheye\nD: [1, 2, 3, 4, 5]"), "4 coefficients"),
            (&format!("{matrix}D: [0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]"), "12 coefficients"),
        ] {
            let error = format!("{:#}", parse(text).expect_err("refused"));
            assert!(error.contains(word), "{word:?} is not in: {error}");
        }
    }
}
