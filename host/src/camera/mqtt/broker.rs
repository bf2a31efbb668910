//! The address of a broker, and what to publish there.
//!
//! In: arguments of the command line. Out: [`Broker`]. Memory and cost: none.

use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};

use super::super::arguments::Publishing;
use super::tls::{self, Encryption};
use super::topics::{Topics, check_prefix, level};

/// A broker, and what to publish there.
#[derive(Clone, Debug)]
pub struct Broker {
    /// Name or address of the host.
    pub host: String,
    /// The port.
    pub port: u16,
    /// User and password.
    pub login: Option<(String, String)>,
    /// How to encrypt; `None`: not at all.
    pub tls: Option<Encryption>,
    /// The names of the topics.
    pub topics: Topics,
    /// The topic under which models are ordered.
    pub orders: Option<String>,
    /// Minimum time between two lines.
    pub period: Duration,
}

/// The parts of a broker's URL.
#[derive(Debug, PartialEq, Eq)]
struct Address {
    is_encrypted: bool,
    host: String,
    port: u16,
    login: Option<(String, String)>,
    prefix: String,
}

impl Broker {
    /// The broker that the arguments name; `None` when they name none.
    ///
    /// # Errors
    /// When the URL has another form, a prefix has characters that topics cannot have, files
    /// of TLS are given for a connection without, or they cannot be used.
    pub fn from_arguments(given: &Publishing) -> Result<Option<Self>> {
        let Some(url) = &given.mqtt else { return Ok(None) };
        let Address { is_encrypted, host, port, login, prefix } = Address::parse(url)?;
        // Models may come from a server with TLS whatever the broker has.
        let has_files = given.mqtt_cert.is_some() || given.mqtt_ca.is_some() && given.mqtt_models.is_none();
        ensure!(is_encrypted || !has_files, "certificates are for TLS: give the broker as mqtts://");
        let own = given.mqtt_cert.as_deref().zip(given.mqtt_key.as_deref());
        let tls = is_encrypted.then(|| tls::configuration(given.mqtt_ca.as_deref(), own)).transpose()?;
        let discovery = given.mqtt_discovery.as_deref().map(|p| p.trim_matches('/').to_string());
        if let Some(discovery) = &discovery {
            check_prefix(discovery)?;
            ensure!(!discovery.is_empty(), "the prefix of Home Assistant is empty: leave it out for homeassistant");
        }
        let period = Duration::from_secs_f64(1.0 / given.mqtt_rate);
        let topics = Topics::new(prefix, discovery);
        let orders = given.mqtt_models.clone();
        orders.as_deref().map(|topic| topics.check_other(topic)).transpose()?;
        Ok(Some(Self { host, port, login, tls, topics, orders, period }))
    }

    /// Host and port, for the log.
    #[must_use]
    pub fn place(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }
}

impl Address {
    /// Parses `mqtt[s]://[USER:PASSWORD@]HOST[:PORT][/PREFIX]`.
    fn parse(url: &str) -> Result<Self> {
        const FORM: &str = "a broker is given as mqtt://[USER:PASSWORD@]HOST[:PORT][/PREFIX], or mqtts:// for TLS";
        let (is_encrypted, rest) = match url.split_once("://") {
            Some(("mqtt", rest)) => (false, rest),
            Some(("mqtts", rest)) => (true, rest),
            _ => bail!(FORM),
        };
        let (place, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let (login, place) = match place.rsplit_once('@') {
            Some((login, place)) => (Some(login.split_once(':').unwrap_or((login, ""))), place),
            None => (None, place),
        };
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) if !port.contains(']') => (host, port.parse().ok().context(FORM)?),
            _ => (place, if is_encrypted { 8883 } else { 1883 }),
        };
        ensure!(!host.is_empty(), FORM);
        let prefix = prefix.trim_matches('/');
        check_prefix(prefix)?;
        let prefix = if prefix.is_empty() { format!("keygraph/{}", level(&host_name())) } else { prefix.into() };
        let login = login.map(|(user, password)| (unescape(user), unescape(password)));
        Ok(Self { is_encrypted, host: host.trim_matches(['[', ']']).into(), port, login, prefix })
    }
}

/// Replaces escapes such as `%40` by their characters.
fn unescape(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        let code = (*first == b'%').then(|| tail.get(..2)).flatten().and_then(|h| std::str::from_utf8(h).ok());
        match code.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The name of this machine.
#[must_use]
pub fn host_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").or_else(|_| std::env::var("HOSTNAME"));
    name.map_or_else(|_| "camera".into(), |n| n.trim().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_brokers() {
        let address = Address::parse("mqtt://me:p%40ss@broker.lan:1884/plant/door/").expect("parses");
        let expected = Address {
            is_encrypted: false,
            host: "broker.lan".into(),
            port: 1884,
            login: Some(("me".into(), "p@ss".into())),
            prefix: "plant/door".into(),
        };
        assert_eq!(address, expected);
        let plain = Address::parse("mqtt://[::1]").expect("parses");
        assert_eq!((plain.host.as_str(), plain.port, plain.login), ("::1", 1883, None));
        assert!(plain.prefix.starts_with("keygraph/"), "{}", plain.prefix);
        let encrypted = Address::parse("mqtts://a").expect("parses");
        assert_eq!((encrypted.is_encrypted, encrypted.port), (true, 8883));
        for (wrong, word) in [
            ("broker.lan", "mqtt://"),
            ("http://broker.lan", "mqtts://"),
            ("mqtt://", "mqtt://"),
            ("mqtt://a:b", "mqtt://"),
            ("mqtt://a/x/#", "no #"),
            ("mqtt://a/x\ny", "control"),
        ] {
            let error = Address::parse(wrong).expect_err(wrong).to_string();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }
}
