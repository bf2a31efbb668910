//! Files from a web server.
//!
//! In: a [`Part`] of an order. Out: the bytes of its file, of the size and the hash that were
//! ordered, or an error. A server that says nothing for `SILENCE` is given up.
//!
//! Memory: `PIECE` bytes. Cost: a request.

use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};
use ureq::Agent;

use super::order::{Part, hex};
use super::tls;

/// Maximum time for which a server may say nothing.
const SILENCE: Duration = Duration::from_secs(30);
/// Number of bytes read at a time.
const PIECE: usize = 1 << 16;

/// Fetches files.
#[derive(Clone, Debug)]
pub struct Fetcher(Agent);

impl Fetcher {
    /// A fetcher that trusts the authorities in the file `ca`, by default those of the system.
    ///
    /// # Errors
    /// When the file cannot be read, or has no authority.
    pub fn new(ca: Option<&Path>) -> Result<Self> {
        let settings = Agent::config_builder()
            .timeout_connect(Some(SILENCE))
            .timeout_per_read(Some(SILENCE))
            .timeout_recv_response(Some(SILENCE))
            .user_agent(concat!("keygraph/", env!("CARGO_PKG_VERSION")));
        Ok(Self(tls::trust(settings, ca)?.build().into()))
    }

    /// Writes the file of `part` to `out`, as long as `goes_on` holds.
    ///
    /// # Errors
    /// When the server does not give the file, or gives another one; when `out` cannot be
    /// written; when `goes_on` does not hold any more.
    pub fn fetch(&self, part: &Part, out: &mut impl Write, goes_on: &dyn Fn() -> bool) -> Result<()> {
        let place = part.place();
        ensure!(
            cfg!(feature = "tls") || part.url.starts_with("http://"),
            "{place}: this program was built without TLS: build it with the feature keygraph/tls, or use http://"
        );
        let mut answer = self.0.get(&part.url).call().with_context(|| format!("cannot fetch {place}"))?;
        let mut body = answer.body_mut().as_reader();
        let (mut piece, mut length, mut hash) = (vec![0; PIECE], 0, Sha256::new());
        loop {
            let count = body.read(&mut piece).with_context(|| format!("cannot fetch {place}"))?;
            if count == 0 {
                break;
            }
            if !goes_on() {
                bail!("{place} is not wanted any more");
            }
            length += count as u64;
            ensure!(length <= part.bytes, "{place} has more than the {} bytes that were ordered", part.bytes);
            hash.update(&piece[..count]);
            out.write_all(&piece[..count]).with_context(|| format!("cannot keep {place}"))?;
        }
        ensure!(length == part.bytes, "{place} has {length} bytes, not {} as ordered", part.bytes);
        let hash = hex(&hash.finalize());
        ensure!(hash == part.sha256, "{place} is another file than was ordered: its SHA-256 is {hash}");
        Ok(())
    }
}
