//! Draws results into a picture.
//!
//! In: a [`Canvas`], and results in its pixels, with (0, 0) at the centre of the top
//! left pixel. Out: the canvas with lines, points and labels on it.
//!
//! Lines and letters grow with the picture. Coordinates that lie outside of it, are
//! infinite or not a number are cut away before drawing: a wild result costs no more
//! than a good one. Cost: at most the area of the picture for each line.

use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle, iso_8859_1};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Baseline, Text};

pub use crate::canvas::Canvas;
use keygraph_core::Surface;
use keygraph_core::stages::surface::SIDE;

use crate::picture::Part;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Colours that can be told apart, on each other and on most pictures.
pub const PALETTE: [Colour; 8] = [
    [64, 220, 80],   // green
    [255, 80, 70],   // red
    [70, 150, 255],  // blue
    [255, 210, 40],  // yellow
    [235, 90, 235],  // magenta
    [50, 220, 225],  // cyan
    [255, 150, 40],  // orange
    [170, 120, 255], // violet
];

const DARK: Colour = [16, 16, 16];
const WHITE: Colour = [255, 255, 255];
/// The colour of the border of what was searched: none of an object's.
const PART: Colour = [200, 200, 200];

/// The colour of the object with this index. Colours repeat after eight objects.
#[must_use]
pub fn colour(index: usize) -> Colour {
    PALETTE[index % PALETTE.len()]
}

/// An object that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// The object's top left, top right, bottom right and bottom left corner, px.
    pub corners: [[f32; 2]; 4],
    /// The surface on which it lies; `None` where that is a plane.
    pub surface: Option<Surface>,
    /// The text of the label, such as name and score. Characters outside of ISO 8859-1
    /// become question marks.
    pub label: String,
    /// Index into [`PALETTE`]; see [`colour`].
    pub colour_index: usize,
}

/// Width of an outline's lines, px.
fn line_px(canvas: &Canvas) -> u32 {
    (canvas.longer_side() / 300).max(2)
}

/// Draws the sides of an outline with a dark rim, and the grid of a surface. A white line runs along the
/// object's top side, from a dot on its top left corner: it shows the rotation.
pub fn draw_outline(canvas: &mut Canvas, outline: &Outline) {
    let line_px = line_px(canvas);
    let rim_px = (line_px / 2).max(1);
    let colour = colour(outline.colour_index);
    let border: Vec<[f32; 2]> = match &outline.surface {
        None => outline.corners.to_vec(),
        Some(surface) => {
            draw_grid(canvas, surface, colour);
            surface.border().collect()
        }
    };
    // The top side comes last.
    let (n, top) = (border.len(), border.len() / 4);
    let sides: Vec<_> = (top..n + top).map(|i| [border[i % n], border[(i + 1) % n]]).collect();
    for (colour, width_px) in [(DARK, line_px + 2 * rim_px), (colour, line_px)] {
        for &side in &sides {
            stroke(canvas, side, colour, width_px);
        }
    }
    for &side in &sides[n - top..] {
        stroke(canvas, side, WHITE, line_px.div_ceil(2));
    }
    let a = border[0];
    disc(canvas, a, DARK, 3 * line_px + 2 * rim_px);
    disc(canvas, a, colour, 3 * line_px);
    disc(canvas, a, WHITE, 2 * line_px);
}

/// Draws outlines, and then their labels on top.
pub fn draw_outlines(canvas: &mut Canvas, outlines: &[Outline]) {
    outlines.iter().for_each(|o| draw_outline(canvas, o));
    outlines.iter().for_each(|o| draw_label(canvas, o));
}

/// Draws the lines of a surface's grid.
fn draw_grid(canvas: &mut Canvas, surface: &Surface, colour: Colour) {
    for (i, &p) in surface.points.iter().enumerate() {
        let right = (i % SIDE + 1 < SIDE).then_some(i + 1);
        let below = (i + SIDE < surface.points.len()).then_some(i + SIDE);
        for next in [right, below].into_iter().flatten() {
            stroke(canvas, [p, surface.points[next]], colour, 1);
        }
    }
}

/// Writes the label on a filled box above the object's highest corner, or as near to it as
/// fits into the picture. A label that is too long loses its end.
pub fn draw_label(canvas: &mut Canvas, outline: &Outline) {
    let [left, top] = outline
        .corners
        .into_iter()
        .filter(|corner| corner.iter().all(|v| v.is_finite()))
        .fold([f32::INFINITY; 2], |[left, top], [x, y]| [left.min(x), top.min(y)]);
    if !left.is_finite() {
        return;
    }
    let (font, scale) = label_font(canvas.longer_side());
    let letter = font.character_size * scale;
    let padding_px = 2 * scale;
    let room_px = canvas.width().saturating_sub(2 * padding_px);
    let text: String = outline.label.chars().take((room_px / letter.width) as usize).collect();
    let letters = u32::try_from(text.chars().count()).unwrap_or(0);
    let size = Size::new(letters * letter.width + 2 * padding_px, letter.height + 2 * padding_px);
    if letters == 0 || size.height > canvas.height() {
        return;
    }
    let gap_px = 2 * line_px(canvas);
    let place = |wanted: i32, size: u32, room: u32| {
        let last = i32::try_from(room - size).unwrap_or(i32::MAX);
        wanted.clamp(0, last)
    };
    let above = nearest_pixel(top).saturating_sub_unsigned(size.height).saturating_sub_unsigned(gap_px);
    let corner =
        Point::new(place(nearest_pixel(left), size.width, canvas.width()), place(above, size.height, canvas.height()));
    let fill = colour(outline.colour_index);
    let Ok(()) = canvas.fill_solid(&Rectangle::new(corner, size), rgb888(fill));
    let inset = i32::try_from(padding_px).unwrap_or(0);
    let mut enlarged = Enlarged { canvas, origin: corner + Point::new(inset, inset), scale };
    let style = MonoTextStyle::new(font, rgb888(DARK));
    let Ok(_) = Text::with_baseline(&text, Point::zero(), style, Baseline::Top).draw(&mut enlarged);
}

/// Draws a small circle at each point.
pub fn draw_corners(canvas: &mut Canvas, corners: &[[f32; 2]], colour: Colour) {
    let diameter_px = 2 * (canvas.longer_side() / 300).max(2) + 1;
    let style = PrimitiveStyle::with_stroke(rgb888(colour), diameter_px.div_ceil(8));
    for &corner in corners {
        if let Some(centre) = visible_point(canvas, corner, diameter_px) {
            let Ok(()) = Circle::with_center(centre, diameter_px).into_styled(style).draw(canvas);
        }
    }
}

/// Draws the border of a part of the picture with a thin line: the part that was searched.
pub fn draw_part(canvas: &mut Canvas, part: Part) {
    let [left, top] = [part.x, part.y].map(|v| v as f32);
    let [right, bottom] = [part.x + part.width, part.y + part.height].map(|v| v as f32 - 1.0);
    let (a, b, c, d) = ([left, top], [right, top], [right, bottom], [left, bottom]);
    let width_px = (canvas.longer_side() / 1200).max(1);
    for side in [[a, b], [b, c], [c, d], [d, a]] {
        stroke(canvas, side, PART, width_px);
    }
}

/// Draws the axes of a pose from `origin`: x red, y green, z blue.
pub fn draw_axes(canvas: &mut Canvas, [origin, x, y, z]: [[f32; 2]; 4]) {
    let width_px = line_px(canvas);
    for (end, colour) in [(z, PALETTE[2]), (y, PALETTE[0]), (x, PALETTE[1])] {
        stroke(canvas, [origin, end], DARK, 2 * width_px);
        stroke(canvas, [origin, end], colour, width_px);
    }
}

/// Draws lines of this width, px.
pub fn draw_lines(canvas: &mut Canvas, lines: &[[[f32; 2]; 2]], colour: Colour, width_px: u32) {
    lines.iter().for_each(|&line| stroke(canvas, line, colour, width_px));
}

/// Draws a disc of this diameter, px, at each point.
pub fn draw_dots(canvas: &mut Canvas, points: &[[f32; 2]], colour: Colour, diameter_px: u32) {
    points.iter().for_each(|&point| disc(canvas, point, colour, diameter_px));
}

/// Draws the sides of triangles with thin lines.
pub fn draw_triangles(canvas: &mut Canvas, triangles: &[[[f32; 2]; 3]], colour: Colour) {
    let width_px = (canvas.longer_side() / 1200).max(1);
    for &[a, b, c] in triangles {
        for side in [[a, b], [b, c], [c, a]] {
            stroke(canvas, side, colour, width_px);
        }
    }
}

/// The font of labels and its enlargement, for a picture with this longer side, px.
fn label_font(longer_side: u32) -> (&'static MonoFont<'static>, u32) {
    match longer_side {
        0..400 => (&iso_8859_1::FONT_6X10, 1),
        400..800 => (&iso_8859_1::FONT_7X13_BOLD, 1),
        _ => (&iso_8859_1::FONT_10X20, longer_side.div_ceil(1600)),
    }
}

/// A draw target that draws every pixel as a square of `scale` pixels.
struct Enlarged<'a> {
    canvas: &'a mut Canvas,
    origin: Point,
    scale: u32,
}

impl Dimensions for Enlarged<'_> {
    fn bounding_box(&self) -> Rectangle {
        let size = self.canvas.size();
        Rectangle::new(Point::zero(), Size::new(size.width / self.scale, size.height / self.scale))
    }
}

impl DrawTarget for Enlarged<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = Pixel<Rgb888>>,
    {
        let scale = i32::try_from(self.scale).unwrap_or(1);
        for Pixel(point, colour) in pixels {
            let square = Rectangle::new(self.origin + point * scale, Size::new_equal(self.scale));
            self.canvas.fill_solid(&square, colour)?;
        }
        Ok(())
    }
}
// -------------------------------------------------------------------- shapes

/// Fills all pixels whose centres are within half a line width of a segment: a line with
/// round ends, or a disc when both ends are the same. Works row by row on the rows of the
/// picture, so that the area of the picture bounds the cost.
///
/// The thick lines of embedded-graphics are not used: their arithmetic overflows where
/// width times length is above some 20,000 pixels.
fn stroke(canvas: &mut Canvas, ends: [[f32; 2]; 2], colour: Colour, width_px: u32) {
    let [a, b] = ends.map(|end| end.map(f64::from));
    if !a.iter().chain(&b).all(|v| v.is_finite()) {
        return;
    }
    let radius = f64::from(width_px) / 2.0;
    let along = [b[0] - a[0], b[1] - a[1]];
    let length = along[0].hypot(along[1]);
    // Half the width, across the line. The value does not matter for a line of length 0.
    let [nx, ny] = [-along[1], along[0]].map(|v| v / length.max(f64::MIN_POSITIVE) * radius);
    let sides = [[a[0] + nx, a[1] + ny], [b[0] + nx, b[1] + ny], [b[0] - nx, b[1] - ny], [a[0] - nx, a[1] - ny]];
    let last = [canvas.width(), canvas.height()].map(|size| f64::from(size) - 1.0);
    let top = (a[1].min(b[1]) - radius).ceil().max(0.0);
    let bottom = (a[1].max(b[1]) + radius).floor().min(last[1]);
    for row in nearest_pixel(top)..=nearest_pixel(bottom) {
        let y = f64::from(row);
        // The shape is convex: in a row, it lies between the first and the last crossing
        // with its parts.
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut crossing = |x: f64| (from, to) = (from.min(x), to.max(x));
        for centre in [a, b] {
            let half_squared = radius * radius - (y - centre[1]) * (y - centre[1]);
            if half_squared > 0.0 {
                crossing(centre[0] - half_squared.sqrt());
                crossing(centre[0] + half_squared.sqrt());
            }
        }
        for (p, q) in sides.iter().zip(sides.iter().cycle().skip(1)) {
            if (p[1] <= y) != (q[1] <= y) {
                crossing(p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0]));
            }
        }
        let (from, to) = (from.ceil().max(0.0), to.floor().min(last[0]));
        if from <= to {
            let start = Point::new(nearest_pixel(from), row);
            let end = Point::new(nearest_pixel(to), row);
            let Ok(()) = canvas.fill_solid(&Rectangle::with_corners(start, end), rgb888(colour));
        }
    }
}

fn disc(canvas: &mut Canvas, centre: [f32; 2], colour: Colour, diameter_px: u32) {
    stroke(canvas, [centre, centre], colour, diameter_px);
}

/// The pixel under a point; `None` when it lies more than `margin_px` outside of the
/// picture.
fn visible_point(canvas: &Canvas, [x, y]: [f32; 2], margin_px: u32) -> Option<Point> {
    let margin = f64::from(margin_px);
    let inside = |v: f32, size: u32| {
        let v = f64::from(v);
        v >= -margin && v <= f64::from(size) + margin
    };
    (inside(x, canvas.width()) && inside(y, canvas.height())).then(|| Point::new(nearest_pixel(x), nearest_pixel(y)))
}

/// The nearest whole number. Saturates; NaN becomes 0.
#[expect(clippy::cast_possible_truncation, reason = "saturation is wanted")]
fn nearest_pixel(coordinate: impl Into<f64>) -> i32 {
    coordinate.into().round() as i32
}

fn rgb888([r, g, b]: Colour) -> Rgb888 {
    Rgb888::new(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{Picture, Pixels};

    fn canvas(width: u32, height: u32, gray: u8) -> Canvas {
        let size = width as usize * height as usize;
        Canvas::from_picture(&Picture { width, height, pixels: Pixels::Gray8(vec![gray; size]) })
    }

    fn outline(corners: [[f32; 2]; 4]) -> Outline {
        Outline { corners, surface: None, label: "box 0.93".into(), colour_index: 0 }
    }

    fn pixel(canvas: &Canvas, x: u32, y: u32) -> Colour {
        let at = 3 * (y * canvas.width() + x) as usize;
        [canvas.rgb()[at], canvas.rgb()[at + 1], canvas.rgb()[at + 2]]
    }

    /// One letter per pixel: `.` gray 128, `#` dark, `w` white, `c` green.
    fn ascii(canvas: &Canvas) -> String {
        let letter = |p: &[u8]| match p {
            [128, 128, 128] => '.',
            p if p == DARK => '#',
            p if p == WHITE => 'w',
            p if p == PALETTE[0] => 'c',
            _ => '?',
        };
        canvas
            .rgb()
            .chunks_exact(3 * canvas.width() as usize)
            .map(|row| row.chunks_exact(3).map(letter).collect::<String>() + "\n")
            .collect()
    }

    #[test]
    fn an_outline_shows_its_first_corner_and_its_top() {
        let mut canvas = canvas(28, 18, 128);
        let corners = [[6.0, 6.0], [22.0, 6.0], [22.0, 13.0], [6.0, 13.0]];
        draw_outline(&mut canvas, &outline(corners));
        let expected = "\
............................
............................
............................
....#####...................
...#ccccc##############.....
...#cwwwc#ccccccccccccc#....
..#cwwwwwc#wwwwwwwwwwwwc#...
...#cwwwc############ccc#...
...#ccccc#..........#ccc#...
....#####...........#ccc#...
....#ccc#...........#ccc#...
....#ccc#############ccc#...
....#ccccccccccccccccccc#...
....#ccccccccccccccccccc#...
.....###################....
............................
............................
............................
";
        assert_eq!(ascii(&canvas), expected, "\n{}", ascii(&canvas));
    }

    #[test]
    fn the_border_of_a_part_lies_in_it() {
        let mut canvas = canvas(8, 6, 0);
        draw_part(&mut canvas, Part { x: 2, y: 1, width: 5, height: 4 });
        for (y, row) in (0..).zip(["........", "..#####.", "..#...#.", "..#...#.", "..#####.", "........"]) {
            for (x, c) in (0..).zip(row.chars()) {
                let drawn = pixel(&canvas, x, y) == PART;
                assert_eq!(drawn, c == '#', "{x}, {y}");
            }
        }
    }

    #[test]
    fn axes_are_red_green_and_blue() {
        let mut canvas = canvas(64, 48, 128);
        draw_axes(&mut canvas, [[20.0, 20.0], [50.0, 20.0], [20.0, 40.0], [10.0, 10.0]]);
        for ([x, y], colour) in [([40, 20], PALETTE[1]), ([20, 30], PALETTE[0]), ([13, 13], PALETTE[2])] {
            assert_eq!(pixel(&canvas, x, y), colour, "at {x}, {y}");
        }
    }

    #[test]
    fn a_line_that_leaves_the_picture_is_the_same_inside() {
        // On a wide canvas, against on the small one, up to long thick lines.
        for width_px in [1, 2, 13, 40] {
            let (mut wide, mut small) = (canvas(5000, 100, 0), canvas(100, 100, 0));
            let ends = [[-20.0, 10.0], [4980.0, 270.0]];
            stroke(&mut wide, ends, WHITE, width_px);
            stroke(&mut small, ends, WHITE, width_px);
            for (y, row) in small.rgb().chunks_exact(300).enumerate() {
                assert_eq!(row, &wide.rgb()[y * 15000..][..300], "row {y}");
            }
        }
    }

    #[test]
    fn a_thin_line_has_no_gaps() {
        for (x, y) in [(30.0, 0.0), (30.0, 7.3), (21.7, 22.1), (3.3, 29.9), (0.0, 30.0)] {
            let mut canvas = canvas(40, 40, 128);
            stroke(&mut canvas, [[4.2, 4.6], [4.2 + x, 4.6 + y]], WHITE, 1);
            let white = |x, y| pixel(&canvas, x, y) == WHITE;
            let columns = (0..40).filter(|&x| (0..40).any(|y| white(x, y))).count();
            let rows = (0..40).filter(|&y| (0..40).any(|x| white(x, y))).count();
            assert!(columns.max(rows) as f32 >= x.max(y), "{}", ascii(&canvas));
        }
    }

    #[test]
    fn coordinates_outside_of_the_picture_are_clipped() {
        let wild = [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            f32::MIN,
            -1e9,
            -1.0,
            0.0,
            40.0,
            1e9,
            f32::MIN_POSITIVE,
        ];
        let mut canvas = canvas(64, 48, 128);
        for x in wild {
            for y in wild {
                let corners = [[x, y], [y, 50.0], [10.0, x], [y, x]];
                draw_outline(&mut canvas, &outline(corners));
                draw_label(&mut canvas, &outline(corners));
                draw_corners(&mut canvas, &corners, WHITE);
                draw_triangles(&mut canvas, &[[[x, y], [y, x], [3.0, x]]], WHITE);
                draw_axes(&mut canvas, corners);
            }
        }
    }

    #[test]
    fn labels_stay_inside_of_the_picture() {
        for [x, y] in [[-500.0, -500.0], [500.0, 500.0], [60.0, 2.0]] {
            let mut canvas = canvas(120, 60, 128);
            draw_label(&mut canvas, &outline([[x, y]; 4]));
            let green = canvas.rgb().chunks_exact(3).filter(|p| *p == PALETTE[0]).count();
            let dark = canvas.rgb().chunks_exact(3).filter(|p| *p == DARK).count();
            // 8 letters of 6 x 10 pixels and 2 pixels around.
            assert_eq!(green + dark, (8 * 6 + 4) * (10 + 4), "at {x}, {y}");
            assert!(dark > 50, "there are letters at {x}, {y}");
        }
    }

    #[test]
    fn labels_that_do_not_fit_are_shortened_or_left_out() {
        let long = Outline { label: "x".repeat(1000), ..outline([[5.0, 30.0]; 4]) };
        let mut picture = canvas(50, 40, 128);
        draw_label(&mut picture, &long);
        assert_ne!(picture, canvas(50, 40, 128));
        for (width, height) in [(3, 40), (40, 3), (0, 0)] {
            let mut picture = canvas(width, height, 128);
            draw_label(&mut picture, &long);
            assert_eq!(picture, canvas(width, height, 128));
        }
    }
}
