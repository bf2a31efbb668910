//! Which requests are answered.
//!
//! In: the headers of a request. Out: whether it is answered. Without a token, only
//! requests from this machine are answered (the page listens on loopback), and only under
//! a name of this machine: no web page elsewhere can point its own name here and read the
//! camera (DNS rebinding). With a token, every request that has the token is answered. In
//! both cases a browser may change something only for the page that this program serves:
//! the `Origin` that it sends must be the host that it asks.
//!
//! Memory: the token. Cost: negligible.

use anyhow::{Context, Result};
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderName};

/// The check of requests.
#[derive(Clone, Debug)]
pub struct Guard {
    token: Option<String>,
}

/// The reason why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The token is missing or wrong: send it as `Authorization: Bearer TOKEN`.
    Token,
    /// The request names a host that is not this machine.
    Host,
    /// A page from elsewhere made the request.
    Origin,
}

/// What a request asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// To read something.
    Look,
    /// To change something.
    Change,
}

impl Refusal {
    /// The message for the client.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Token => {
                "the token is missing or wrong: send it as `Authorization: Bearer TOKEN`, or open the page with #token=TOKEN"
            }
            Self::Host => "this page is only served as localhost: give --token to reach it under another name",
            Self::Origin => "only the page itself may change something",
        }
    }
}

impl Guard {
    /// A check by token; `None` answers this machine alone.
    #[must_use]
    pub const fn new(token: Option<String>) -> Self {
        Self { token }
    }

    /// Checks a request by its headers, the token in its query, and what it asks for.
    ///
    /// # Errors
    /// The reason to refuse the request.
    pub fn check(&self, headers: &HeaderMap, token: Option<&str>, action: Action) -> Result<(), Refusal> {
        let header = |name: HeaderName| headers.get(name).and_then(|v| v.to_str().ok());
        let host = header(HOST).unwrap_or_default();
        match &self.token {
            Some(secret) => {
                let bearer = header(AUTHORIZATION).and_then(|v| v.strip_prefix("Bearer "));
                if !bearer.or(token).is_some_and(|given| same(given, secret)) {
                    return Err(Refusal::Token);
                }
            }
            None if !is_this_machine(host) => return Err(Refusal::Host),
            None => {}
        }
        if action == Action::Change && headers.contains_key(ORIGIN) {
            let origin = header(ORIGIN).and_then(|o| o.split_once("://"));
            if origin.is_none_or(|(_, from)| from != host) {
                return Err(Refusal::Origin);
            }
        }
        Ok(())
    }
}

/// Whether two strings are equal. The time does not depend on where they differ.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

fn is_this_machine(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    let address = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || address.parse::<std::net::IpAddr>().is_ok_and(|a| a.is_loopback())
}

/// A random token of 128 bits.
///
/// # Errors
/// When the system gives no random numbers.
pub fn random_token() -> Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).context("no random numbers from the system: give --token")?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(HeaderName, &str)]) -> HeaderMap {
        list.iter().map(|(name, value)| (name.clone(), value.parse().expect("a value"))).collect()
    }

    #[test]
    fn without_a_token_only_this_machine_is_served() {
        let guard = Guard::new(None);
        for host in ["127.0.0.1:8080", "localhost:8080", "localhost", "[::1]:8080", "127.3.2.1"] {
            assert_eq!(guard.check(&headers(&[(HOST, host)]), None, Action::Change), Ok(()), "{host}");
        }
        for host in ["evil.example:8080", "192.168.1.4:8080", "127.0.0.1.evil.example", ""] {
            assert_eq!(guard.check(&headers(&[(HOST, host)]), None, Action::Look), Err(Refusal::Host), "{host}");
        }
    }

    #[test]
    fn a_token_opens_for_any_host() {
        let guard = Guard::new(Some("secret".into()));
        let host = (HOST, "camera.local");
        assert_eq!(
            guard.check(&headers(&[host.clone(), (AUTHORIZATION, "Bearer secret")]), None, Action::Change),
            Ok(())
        );
        assert_eq!(guard.check(&headers(std::slice::from_ref(&host)), Some("secret"), Action::Look), Ok(()));
        for wrong in ["", "secre", "secret1", "Secret"] {
            assert_eq!(
                guard.check(&headers(std::slice::from_ref(&host)), Some(wrong), Action::Look),
                Err(Refusal::Token),
                "{wrong}"
            );
        }
        assert_eq!(guard.check(&headers(&[host]), None, Action::Look), Err(Refusal::Token));
    }

    #[test]
    fn only_the_page_itself_may_change_something() {
        let guard = Guard::new(None);
        let from = |origin: &str| headers(&[(HOST, "localhost:8080"), (ORIGIN, origin)]);
        assert_eq!(guard.check(&from("http://localhost:8080"), None, Action::Change), Ok(()));
        for origin in ["http://evil.example", "null", "http://localhost:9090", "http://localhost"] {
            assert_eq!(guard.check(&from(origin), None, Action::Change), Err(Refusal::Origin), "{origin}");
            assert_eq!(
                guard.check(&from(origin), None, Action::Look),
                Ok(()),
                "looking is left to the browser: {origin}"
            );
        }
    }

    #[test]
    fn tokens_differ() {
        let [a, b] = [(); 2].map(|()| random_token().expect("randomness"));
        assert!(a.len() == 32 && a != b);
    }
}
