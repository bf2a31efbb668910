//! What cameras are to run: an order, as the broker holds it.
//!
//! In: a JSON text, or model files. Out: an [`Order`] whose fields were checked.
//! `docs/schema/mqtt.json` describes each field. Memory: the order. Cost: negligible; making
//! one reads its models.

use std::collections::BTreeSet;
use std::fmt::Write;

use anyhow::{Context, Result, ensure};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::super::models::MOST;
use crate::output::check_name;

/// Maximum size of a model, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Maximum number of characters of a version.
const LONGEST_VERSION: usize = 100;
/// Characters of a file name that stand in a URL as they are.
const KEPT: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.');

/// The models that cameras are to run, all of them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Order {
    /// The name of this order, which cameras report.
    pub version: String,
    /// The models.
    pub models: Vec<Part>,
}

/// A model of an order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// The name for people.
    pub name: String,
    /// The address of the file, `http://` or `https://`.
    pub url: String,
    /// The SHA-256 of the file, 64 hexadecimal digits.
    pub sha256: String,
    /// The size of the file, bytes.
    pub bytes: u64,
}

impl Order {
    /// Reads an order. Fields that are not known are left out.
    ///
    /// # Errors
    /// When it is no order, or a field is not what it should be.
    pub fn parse(text: &[u8]) -> Result<Self> {
        let mut order: Self = serde_json::from_slice(text).context("this is no order of models")?;
        let version = order.version.chars();
        ensure!(
            (1..=LONGEST_VERSION).contains(&version.clone().count()) && !version.clone().any(char::is_control),
            "a version has 1 to {LONGEST_VERSION} characters, none of them control characters"
        );
        ensure!(order.models.len() <= MOST, "{} models are ordered; a camera runs up to {MOST}", order.models.len());
        let mut hashes = BTreeSet::new();
        for part in &mut order.models {
            check_name(&part.name)?;
            let name = &part.name;
            part.sha256.make_ascii_lowercase();
            let is_hash = part.sha256.len() == 64 && part.sha256.bytes().all(|b| b.is_ascii_hexdigit());
            ensure!(is_hash, "{name}: sha256 has 64 hexadecimal digits");
            ensure!(hashes.insert(part.sha256.clone()), "{name}: the same file is ordered twice");
            let is_web = ["http://", "https://"].iter().any(|scheme| part.url.starts_with(scheme));
            ensure!(is_web, "{name}: url begins with http:// or https://");
            ensure!((1..=MOST_BYTES).contains(&part.bytes), "{name}: bytes lies between 1 and {MOST_BYTES}");
        }
        Ok(order)
    }

    /// The order of files `(file name, bytes)` that lie under `base`, a URL. Without a version, one
    /// is made of the hashes.
    ///
    /// # Errors
    /// As [`Self::parse`].
    pub fn of_files(base: &str, version: Option<String>, files: &[(String, Vec<u8>)]) -> Result<Self> {
        let base = base.trim_end_matches('/');
        let part = |(file, bytes): &(String, Vec<u8>)| Part {
            name: file.strip_suffix(".kgm").unwrap_or(file).into(),
            url: format!("{base}/{}", utf8_percent_encode(file, KEPT)),
            sha256: sha256(bytes),
            bytes: bytes.len() as u64,
        };
        let models: Vec<_> = files.iter().map(part).collect();
        let version = version.unwrap_or_else(|| {
            let all = models.iter().map(|part| format!("{} {}\n", part.sha256, part.name)).collect::<String>();
            sha256(all.as_bytes()).chars().take(12).collect()
        });
        Self::parse(&serde_json::to_vec(&Self { version, models })?)
    }
}

impl Part {
    /// The URL without what may be secret: user, password and query.
    #[must_use]
    pub fn place(&self) -> String {
        let (scheme, rest) = self.url.split_once("://").unwrap_or(("", &self.url));
        let rest = rest.split(['?', '#']).next().unwrap_or_default();
        let (host, path) = rest.split_once('/').unwrap_or((rest, ""));
        let host = host.rsplit('@').next().unwrap_or_default();
        format!("{scheme}://{host}/{path}")
    }
}

/// The SHA-256 of bytes, as 64 hexadecimal digits.
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Bytes as hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn part() -> Value {
        json!({"name": "book", "url": "https://a/book.kgm", "sha256": "AB".repeat(32), "bytes": 7})
    }

    fn parse(version: &str, models: &Value) -> Result<Order> {
        Order::parse(json!({"version": version, "models": models, "further": 1}).to_string().as_bytes())
    }

    #[test]
    fn orders_are_checked() {
        let order = parse("v1", &json!([part()])).expect("is right");
        assert_eq!(order.models[0].sha256, "ab".repeat(32), "as this program writes it");
        assert_eq!(parse("v1", &json!([])).expect("no models are an order, too").models, []);
        for (field, value, word) in [
            ("name", json!(""), "name"),
            ("name", json!("a\nb"), "control"),
            ("url", json!("ftp://a/b"), "http://"),
            ("url", json!("/etc/passwd"), "http://"),
            ("sha256", json!("ab"), "64"),
            ("sha256", json!("zz".repeat(32)), "64"),
            ("sha256", json!("../".repeat(32)), "64"),
            ("bytes", json!(0), "between"),
            ("bytes", json!(-1), "order"),
            ("bytes", json!(1_u64 << 40), "between"),
        ] {
            let mut wrong = part();
            wrong[field] = value;
            let error = format!("{:#}", parse("v1", &json!([wrong])).expect_err(field));
            assert!(error.contains(word), "{wrong}: {error}");
        }
        assert!(parse("", &json!([])).is_err() && parse(&"v".repeat(101), &json!([])).is_err());
        let twice = parse("v1", &json!([part(), part()])).expect_err("twice").to_string();
        assert!(twice.contains("twice"), "{twice}");
        assert!(Order::parse(b"online").is_err() && Order::parse(b"{}").is_err());
    }

    #[test]
    fn what_may_be_secret_is_not_told() {
        let mut part: Part = serde_json::from_value(part()).expect("is one");
        part.url = "https://me:secret@host:81/a/b.kgm?token=secret".into();
        assert_eq!(part.place(), "https://host:81/a/b.kgm");
        part.url = "http://host".into();
        assert_eq!(part.place(), "http://host/");
    }

    #[test]
    fn an_order_of_files() {
        let files = [("my book.kgm".to_string(), b"abc".to_vec())];
        let order = Order::of_files("http://a/models/", None, &files).expect("is right");
        // The hash of `abc` is an example of FIPS 180-4.
        assert_eq!(order.models[0].sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(order.models[0].url, "http://a/models/my%20book.kgm");
        assert_eq!((order.models[0].name.as_str(), order.version.len()), ("my book", 12));
        let other = Order::of_files("http://a/models/", None, &[("other".into(), b"abd".to_vec())]);
        assert_ne!(order.version, other.expect("is right").version);
    }
}
