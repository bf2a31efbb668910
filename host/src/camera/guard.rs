//! Which requests are answered.
//!
//! In: the headers of a request. Out: whether it is answered. Without a token, only
//! requests from this machine are answered (the page listens on loopback), and only under
//! a name of this machine: no web page elsewhere can point its own name here and read the
//! camera (DNS rebinding). With a token, every request that has the token is answered. In
//! both cases a browser may change something only for the page that this program serves:
//! the `Origin` that it sends must be the host that it asks, or the public address of the
//! page behind a proxy.
//!
//! Memory: the token. Cost: negligible.

use std::borrow::Cow;
use std::hint::black_box;

use anyhow::{Context, Result, ensure};
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderName, Uri};
use percent_encoding::percent_decode_str;

/// Minimum length of a token that is given, characters.
const SHORTEST: usize = 16;

/// The check of requests.
#[derive(Clone)]
pub struct Guard {
    token: Option<String>,
    public: Option<String>,
}

impl std::fmt::Debug for Guard {
    /// Leaves the token out.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Guard").field("public", &self.public).finish_non_exhaustive()
    }
}

/// The reason why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The token is missing: send it as `Authorization: Bearer TOKEN`.
    Token,
    /// The token is wrong.
    Wrong,
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
                "a token is needed: open the address that the program printed, or send the token as `Authorization: Bearer TOKEN`"
            }
            Self::Wrong => {
                "the token is wrong: open the address that the program printed. A random token is another one after each start"
            }
            Self::Host => "this page is only served as localhost: give --token to reach it under another name",
            Self::Origin => "only the page itself may change something",
        }
    }
}

impl Guard {
    /// A check by token; `None` answers this machine alone. `public` is the address of the
    /// page behind a proxy, see [`parse_public`].
    #[must_use]
    pub const fn new(token: Option<String>, public: Option<String>) -> Self {
        Self { token, public }
    }

    /// Whether requests need a token.
    #[must_use]
    pub const fn has_token(&self) -> bool {
        self.token.is_some()
    }

    /// Whether requests come through a proxy.
    #[must_use]
    pub const fn is_behind_proxy(&self) -> bool {
        self.public.is_some()
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
                let given = bearer.or(token).ok_or(Refusal::Token)?;
                if !same(given, secret) {
                    return Err(Refusal::Wrong);
                }
            }
            None if !is_this_machine(host) => return Err(Refusal::Host),
            None => {}
        }
        if action == Action::Change && headers.contains_key(ORIGIN) {
            let origin = header(ORIGIN).unwrap_or_default();
            let is_public = self.public.as_deref() == Some(origin);
            if !is_public && origin.split_once("://").is_none_or(|(_, from)| from != host) {
                return Err(Refusal::Origin);
            }
        }
        Ok(())
    }
}

/// Whether two strings are equal. The time does not depend on where they differ.
fn same(a: &str, b: &str) -> bool {
    // The compiler does not see that nothing can change any more.
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, (a, b)| black_box(all | (a ^ b))) == 0
}

/// The token in the query of a request.
#[must_use]
pub fn token_in(uri: &Uri) -> Option<Cow<'_, str>> {
    let token = uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))?;
    Some(percent_decode_str(token).decode_utf8_lossy())
}

/// Checks a token that is given. The message does not tell it.
///
/// # Errors
/// When the token is short enough to be guessed.
pub fn check_token(token: &str) -> Result<()> {
    ensure!(
        token.chars().count() >= SHORTEST && token.bytes().all(|b| (b'!'..=b'~').contains(&b)),
        "the token (--token or KEYGRAPH_TOKEN) must have {SHORTEST} characters or more, plain ones without blanks: \
         leave it out for a random one, or make one with `openssl rand -hex 16`"
    );
    Ok(())
}

/// Reads the public address of the page, such as `https://cam.example.org`, in the form in
/// which browsers send it.
///
/// # Errors
/// When the text is more or less than a scheme and a host.
pub fn parse_public(text: &str) -> Result<String, String> {
    let origin = text.trim_end_matches('/').to_ascii_lowercase();
    match origin.split_once("://") {
        Some(("http" | "https", host)) if !host.is_empty() && !host.contains(['/', '?', '#', '@', ' ']) => Ok(origin),
        _ => Err("give scheme and host of the page, such as https://cam.example.org".into()),
    }
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
        let guard = Guard::new(None, None);
        for host in ["127.0.0.1:8080", "localhost:8080", "localhost", "[::1]:8080", "127.3.2.1"] {
            assert_eq!(guard.check(&headers(&[(HOST, host)]), None, Action::Change), Ok(()), "{host}");
        }
        for host in ["evil.example:8080", "192.168.1.4:8080", "127.0.0.1.evil.example", ""] {
            assert_eq!(guard.check(&headers(&[(HOST, host)]), None, Action::Look), Err(Refusal::Host), "{host}");
        }
    }

    #[test]
    fn a_token_opens_for_any_host() {
        let guard = Guard::new(Some("secret".into()), None);
        let host = (HOST, "camera.local");
        assert_eq!(
            guard.check(&headers(&[host.clone(), (AUTHORIZATION, "Bearer secret")]), None, Action::Change),
            Ok(())
        );
        assert_eq!(guard.check(&headers(std::slice::from_ref(&host)), Some("secret"), Action::Look), Ok(()));
        for wrong in ["", "secre", "secret1", "Secret"] {
            assert_eq!(
                guard.check(&headers(std::slice::from_ref(&host)), Some(wrong), Action::Look),
                Err(Refusal::Wrong),
                "{wrong}"
            );
        }
        assert_eq!(guard.check(&headers(&[host]), None, Action::Look), Err(Refusal::Token));
    }

    #[test]
    fn only_the_page_itself_may_change_something() {
        let guard = Guard::new(None, None);
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
    fn the_public_address_may_change_something_too() {
        let guard = Guard::new(Some("secret".into()), Some(parse_public("https://Cam.example.org/").expect("parses")));
        let from = |origin: &str| {
            let list = [(HOST, "127.0.0.1:8080"), (ORIGIN, origin), (AUTHORIZATION, "Bearer secret")];
            guard.check(&headers(&list), None, Action::Change)
        };
        assert_eq!(from("https://cam.example.org"), Ok(()));
        for origin in ["http://cam.example.org", "https://cam.example.org:444", "https://cam.example.org.evil.example"]
        {
            assert_eq!(from(origin), Err(Refusal::Origin), "{origin}");
        }
        for wrong in ["cam.example.org", "https://", "https://a/b", "ftp://a", "https://me@a", "https:// a"] {
            assert!(parse_public(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn short_tokens_are_refused_and_not_told() {
        for wrong in ["", "hunter2", "fifteen letters", "sixteen letters!", "sixteenlettersäö"] {
            let told = check_token(wrong).expect_err(wrong).to_string();
            assert!(told.contains("16 characters") && (wrong.is_empty() || !told.contains(wrong)), "{told}");
        }
        check_token("sixteen-letters!").expect("long enough");
        let guard = Guard::new(Some("sixteen-letters!".into()), None);
        assert!(!format!("{guard:?}").contains("letters"), "{guard:?}");
    }

    #[test]
    fn a_token_in_the_query_is_decoded() {
        let uri: Uri = "/status?a=b&token=a%2Fb%3D+c".parse().expect("parses");
        assert_eq!(token_in(&uri).as_deref(), Some("a/b=+c"));
        assert_eq!(token_in(&"/status?tokens=1".parse().expect("parses")), None);
    }

    #[test]
    fn tokens_differ() {
        let [a, b] = [(); 2].map(|()| random_token().expect("randomness"));
        assert!(a.len() == 32 && a != b);
    }
}
