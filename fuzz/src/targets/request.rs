//! Any headers, tokens and outlines of a request to the page. What is not ours must be refused, and
//! an outline that is accepted must give a picture.
//!
//! In: whether there is a token and a proxy, the kind of request, then lines: host, origin, authorization, the
//! token of the query, the outline. Out: nothing. The sides of the frame are at most 255 px. Cost:
//! cutting out, some 20 ns a pixel. The HTTP parser itself is that of hyper, and is not run here.

use http::header::{AUTHORIZATION, HOST, ORIGIN};
use http::{HeaderMap, HeaderValue};
use keygraph::camera::guard::{Action, Guard, Refusal};
use keygraph::cutout::{cut_out, parse_outline};
use keygraph::picture::{Picture, Pixels};

use crate::Input;

const SECRET: &str = "5ecret";
const PUBLIC: &str = "https://cam.example.org";

/// Runs the target on one input.
pub fn request(data: &[u8]) {
    let mut input = Input(data);
    let (kind, width, height) = (input.byte(), 1 + u32::from(input.byte()), 1 + u32::from(input.byte()));
    let mut lines = input.0.split(|&b| b == b'\n');
    let mut line = || lines.next().unwrap_or_default();
    let mut headers = HeaderMap::new();
    for name in [HOST, ORIGIN, AUTHORIZATION] {
        let value = line();
        if let (false, Ok(value)) = (value.is_empty(), HeaderValue::from_bytes(value)) {
            headers.insert(name, value);
        }
    }
    let token = String::from_utf8_lossy(line()).into_owned();
    let action = if kind & 1 == 0 { Action::Look } else { Action::Change };
    let secret = (kind & 2 == 0).then(|| SECRET.to_string());
    let public = (kind & 4 == 0).then(|| PUBLIC.to_string());
    let answer = Guard::new(secret.clone(), public.clone()).check(&headers, Some(&token), action);
    let is = |name, wanted: &str| headers.get(name).is_some_and(|v: &HeaderValue| v.as_bytes() == wanted.as_bytes());
    if secret.is_some() {
        let told = match headers.get(AUTHORIZATION).and_then(|v| v.to_str().ok()?.strip_prefix("Bearer ")) {
            Some(given) => given == SECRET,
            None => token == SECRET,
        };
        let refused = matches!(answer, Err(Refusal::Token | Refusal::Wrong));
        assert_eq!(refused, !told, "{headers:?} {token:?}");
    }
    if answer.is_ok() && action == Action::Change && headers.contains_key(ORIGIN) {
        let host = headers.get(HOST).and_then(|v| v.to_str().ok()).unwrap_or_default();
        let origin = headers.get(ORIGIN).and_then(|v| v.to_str().ok()).unwrap_or_default();
        let is_public = public.is_some_and(|public| public == origin);
        assert!(is_public || origin.ends_with(&format!("://{host}")), "{origin} may change {host}");
    }
    assert!(!(secret.is_none() && answer.is_ok() && is(HOST, "evil.example")));

    if let Ok(outline) = parse_outline(&String::from_utf8_lossy(line())) {
        let rgb = vec![128; (3 * width * height) as usize];
        if let Ok(cut) = cut_out(&Picture { width, height, pixels: Pixels::Rgb8(rgb) }, &outline) {
            let Pixels::Rgb8(rgb) = cut.pixels else { unreachable!("it was cut out of RGB") };
            assert_eq!(rgb.len(), (3 * cut.width * cut.height) as usize);
            assert!(rgb.iter().all(|&v| v == 128), "a part of a gray frame is gray");
        }
    }
}
