//! What a file or a stream holds, by its first bytes and by its name.
//!
//! In: a path, or the first bytes of a stream. Out: the kind of [`Content`]. Memory: 16 bytes. Cost: one read.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Extensions of pictures that are read.
const PICTURES: [&str; 10] = ["png", "jpg", "jpeg", "webp", "bmp", "tif", "tiff", "avif", "heic", "heif"];

/// Extensions of videos. An animated GIF is one.
const VIDEOS: [&str; 16] =
    ["mp4", "m4v", "avi", "mkv", "mov", "webm", "mpg", "mpeg", "ogv", "y4m", "wmv", "flv", "ts", "mts", "3gp", "gif"];

/// Schemes of the addresses that ffmpeg opens for us.
const SCHEMES: [&str; 4] = ["rtsp", "rtsps", "http", "https"];

/// Parts of names of values in a query that are secret.
const SECRETS: [&str; 5] = ["pass", "pwd", "token", "auth", "key"];

/// Number of bytes that tell what something is.
pub(crate) const START_BYTES: usize = 16;

/// The content of a file or a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// A picture that is decoded here: PNG, JPEG, WebP, BMP or TIFF.
    Picture,
    /// A picture that ffmpeg decodes: AVIF or HEIC.
    Foreign,
    /// A YUV4MPEG2 stream.
    Yuv4Mpeg,
    /// Anything else.
    Other,
}

impl Content {
    /// Reads the first bytes of a plain file. Anything else is `Other`: reading from a pipe
    /// would take its first bytes away.
    pub(crate) fn of(path: &Path) -> Self {
        let mut start = Vec::new();
        if path.is_file()
            && let Ok(file) = File::open(path)
            && file.take(START_BYTES as u64).read_to_end(&mut start).is_ok()
        {
            return Self::told_by(&start);
        }
        Self::Other
    }

    /// The content that starts with these bytes, at least [`START_BYTES`] where there are so many.
    pub(crate) fn told_by(start: &[u8]) -> Self {
        let is_boxed = |brands: &[&[u8; 4]]| {
            start.get(4..8) == Some(b"ftyp") && brands.iter().any(|&brand| start.get(8..12) == Some(brand))
        };
        let is_webp = start.starts_with(b"RIFF") && start.get(8..12) == Some(b"WEBP");
        let tells = |magic: &&[u8]| start.starts_with(magic);
        if start.starts_with(YUV4MPEG2_MAGIC) {
            Self::Yuv4Mpeg
        } else if is_webp || [PNG, JPEG, b"II*\0", b"MM\0*"].iter().any(tells) || is_bitmap(start) {
            Self::Picture
        } else if is_boxed(&[b"avif", b"avis", b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1", b"miaf"])
        {
            Self::Foreign
        } else {
            Self::Other
        }
    }
}

/// First bytes of a YUV4MPEG2 stream.
pub(crate) const YUV4MPEG2_MAGIC: &[u8] = b"YUV4MPEG2";
/// First bytes of a PNG.
pub(crate) const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// First bytes of a JPEG.
pub(crate) const JPEG: &[u8] = b"\xff\xd8\xff";

/// Whether a BMP starts so: two letters, a size, and four bytes of 0.
fn is_bitmap(start: &[u8]) -> bool {
    start.starts_with(b"BM") && start.get(6..10) == Some(&[0; 4])
}

/// Whether `path` is `-`, which stands for standard input.
#[must_use]
pub fn is_stdin(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Whether `path` is an address such as `rtsp://camera/stream`.
#[must_use]
pub fn is_url(path: &Path) -> bool {
    scheme(path).is_some_and(|scheme| SCHEMES.iter().any(|s| s.eq_ignore_ascii_case(scheme)))
}

/// The scheme of an address of any kind. A file of such a name can be given as `./name`.
pub(crate) fn scheme(path: &Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_scheme = !scheme.is_empty() && scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b"+-.".contains(&b));
    is_scheme.then_some(scheme)
}

/// A path, or an address without what is secret in it: for lines, logs and messages.
#[must_use]
pub fn shown(path: &Path) -> String {
    let text = path.display().to_string();
    if scheme(path).is_none() {
        return text;
    }
    hide(path, &text)
}

/// Hides in a text what is secret in an address: its password, and the values of a query that are named so.
pub(crate) fn hide(address: &Path, text: &str) -> String {
    let mut hidden = text.to_string();
    let own = address.to_string_lossy();
    let Some((_, rest)) = own.split_once("://") else { return hidden };
    if let Some((name, password)) = login(rest).and_then(|login| login.split_once(':')) {
        hidden = hidden.replace(&format!("{name}:{password}@"), &format!("{name}:***@"));
    }
    for (name, value) in own.split(['?', '&']).skip(1).filter_map(|pair| pair.split_once('=')) {
        let name = name.to_ascii_lowercase();
        if !value.is_empty() && SECRETS.iter().any(|secret| name.contains(secret)) {
            hidden = hidden.replace(&format!("={value}"), "=***");
        }
    }
    hidden
}

/// Who logs in, and with which password, in an address without its scheme.
fn login(address: &str) -> Option<&str> {
    let host = &address[..address.find(['/', '?']).unwrap_or(address.len())];
    if let Some((login, _)) = host.rsplit_once('@') {
        return Some(login);
    }
    // A password may have such a character in it, though it should not. Then what is behind the colon is no port.
    let (_, port) = host.split_once(':').filter(|_| !host.starts_with('['))?;
    let is_port = port.bytes().all(|b| b.is_ascii_digit());
    address.rsplit_once('@').filter(|_| !is_port).map(|(login, _)| login)
}

/// Whether an address is that of a camera by RTSP.
pub(crate) fn is_rtsp(path: &Path) -> bool {
    is_url(path) && scheme(path).is_some_and(|s| s.to_ascii_lowercase().starts_with("rtsp"))
}

/// The part of an address before its query.
pub(crate) fn without_query(address: &Path) -> &str {
    address.to_str().and_then(|text| text.split(['?', '#']).next()).unwrap_or_default()
}

/// Whether frames of an address come when they are taken: those of a camera. Those of a video file, and of one in
/// pieces (HLS), come as fast as they are read.
pub(crate) fn is_live(path: &Path) -> bool {
    let file = Path::new(without_query(path));
    is_url(path) && (is_rtsp(path) || !(is_named_video(file) || extension(file) == "m3u8"))
}

/// The extension of a path in small letters; empty when it has none.
#[must_use]
pub fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether a name has the extension of a picture.
pub(crate) fn is_named_picture(path: &Path) -> bool {
    has_extension(path, &PICTURES)
}

/// Whether a name has the extension of a video.
pub(crate) fn is_named_video(path: &Path) -> bool {
    has_extension(path, &VIDEOS)
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    extensions.contains(&extension(path).as_str())
}

/// Whether a path is read as a video: `-`, an address, a file that starts like a YUV4MPEG2 stream, a
/// name with a video's extension, and a file that exists and has no extension of a
/// picture.
#[must_use]
pub fn is_video(path: &Path) -> bool {
    if is_stdin(path) || is_url(path) {
        return true;
    }
    match Content::of(path) {
        Content::Picture | Content::Foreign => false,
        Content::Yuv4Mpeg => true,
        Content::Other => is_named_video(path) || (!is_named_picture(path) && path.exists() && !path.is_dir()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scratch::Folder;
    use std::fs;

    #[test]
    fn first_bytes_tell_what_it_is() {
        for (start, expected) in [
            (&b"YUV4MPEG2 W2"[..], Content::Yuv4Mpeg),
            (b"\xff\xd8\xff\xe0", Content::Picture),
            (b"\x89PNG\r\n\x1a\n\0\0", Content::Picture),
            (b"RIFF\x10\0\0\0WEBPVP8 ", Content::Picture),
            (b"RIFF\x10\0\0\0AVI LIST", Content::Other),
            (b"BM\x46\0\0\0\0\0\0\0\x36\0\0\0", Content::Picture),
            (b"BMX is no bitmap", Content::Other),
            (b"II*\0\x08\0\0\0", Content::Picture),
            (b"MM\0*\0\0\0\x08", Content::Picture),
            (b"\0\0\0\x1cftypavif\0\0\0\0", Content::Foreign),
            (b"\0\0\0\x18ftypheic\0\0\0\0", Content::Foreign),
            (b"\0\0\0\x18ftypisom\0\0\0\0", Content::Other),
            (b"GIF89a", Content::Other),
            (b"", Content::Other),
        ] {
            assert_eq!(Content::told_by(start), expected, "{start:?}");
        }
    }

    #[test]
    fn videos_are_told_from_pictures() {
        let folder = Folder::new("told");
        let other = folder.0.join("clip.xyz");
        fs::write(&other, "?").expect("writes");
        for (path, expected) in [
            (Path::new("-"), true),
            (Path::new("not-there.MP4"), true),
            (Path::new("rtsp://camera.lan/1.jpg"), true),
            (Path::new("not-there.jpg"), false),
            (Path::new("not-there"), false),
            (&folder.0, false),
            (&other, true),
        ] {
            assert_eq!(is_video(path), expected, "{}", path.display());
        }
    }

    #[test]
    fn addresses_are_told_and_shown_without_their_password() {
        for (text, url, expected) in [
            ("rtsp://me:secret@camera.lan:554/a@b", true, "rtsp://me:***@camera.lan:554/a@b"),
            ("rtsp://me:se@cret@camera.lan", true, "rtsp://me:***@camera.lan"),
            ("rtsp://me:se/cr?e@t@camera.lan/a", true, "rtsp://me:***@camera.lan/a"),
            ("rtsp://camera.lan:554/a@b", true, "rtsp://camera.lan:554/a@b"),
            ("http://[::1]:80/a@b", true, "http://[::1]:80/a@b"),
            ("HTTP://me@camera.lan/x", true, "HTTP://me@camera.lan/x"),
            ("https://camera.lan/x?y=a:b@c", true, "https://camera.lan/x?y=a:b@c"),
            ("ftp://me:secret@host", false, "ftp://me:***@host"),
            ("http://h/x.jpg?user=me&password=a1&z=2", true, "http://h/x.jpg?user=me&password=***&z=2"),
            ("a folder/b.mp4", false, "a folder/b.mp4"),
        ] {
            assert_eq!((is_url(Path::new(text)), shown(Path::new(text)).as_str()), (url, expected), "{text}");
        }
    }
}
