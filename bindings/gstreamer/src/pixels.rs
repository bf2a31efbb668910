//! Buffers of GStreamer as pictures of the host.
//!
//! In: a mapped frame: I420, NV12, RGB or GRAY8, with padding at the end of its rows. Out: a picture.
//! Memory: the picture. Cost: a pass over the pixels. YUV of odd sides loses its last column or row.

use gstreamer_video::{VideoFormat, VideoFrameExt, VideoFrameRef};
use keygraph::picture::{Picture, Pixels};

/// The formats that are searched without a conversion before.
pub const FORMATS: [VideoFormat; 4] = [VideoFormat::I420, VideoFormat::Nv12, VideoFormat::Rgb, VideoFormat::Gray8];

/// Rows of a plane, without their padding.
fn rows<T>(frame: &VideoFrameRef<T>, plane: u32, bytes: usize, count: usize) -> impl Iterator<Item = &[u8]>
where
    VideoFrameRef<T>: VideoFrameExt,
{
    let stride = usize::try_from(frame.plane_stride()[plane as usize]).unwrap_or(bytes);
    let data = frame.plane_data(plane).unwrap_or_default();
    data.chunks(stride.max(1)).take(count).map(move |row| &row[..bytes.min(row.len())])
}

/// The picture that a frame shows.
pub fn picture<T>(frame: &VideoFrameRef<T>) -> Picture
where
    VideoFrameRef<T>: VideoFrameExt,
{
    let (mut width, mut height) = (frame.width(), frame.height());
    let format = frame.format();
    if matches!(format, VideoFormat::I420 | VideoFormat::Nv12) {
        (width, height) = (width & !1, height & !1);
    }
    let (w, h) = (width as usize, height as usize);
    let plane = |plane, bytes, count| rows(frame, plane, bytes, count).collect::<Vec<_>>().concat();
    let pixels = match format {
        VideoFormat::I420 => Pixels::I420([plane(0, w, h), plane(1, w / 2, h / 2), plane(2, w / 2, h / 2)].concat()),
        VideoFormat::Nv12 => {
            let (mut planes, pairs) = (plane(0, w, h), plane(1, w, h / 2));
            for at in 0..2 {
                planes.extend(pairs.as_chunks::<2>().0.iter().map(|pair| pair[at]));
            }
            Pixels::I420(planes)
        }
        VideoFormat::Rgb => Pixels::Rgb8(plane(0, 3 * w, h)),
        _ => Pixels::Gray8(plane(0, w, h)),
    };
    Picture { width, height, pixels }
}
