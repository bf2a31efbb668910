//! In place of encrypted connections, in a program that was built without them.
//!
//! In: what `tls` takes. Out: an error that says what to do. Memory and cost: none.

use std::path::Path;

use anyhow::{Result, bail};
use rumqttc::{ConnectionError, MqttOptions};
use ureq::config::ConfigBuilder;
use ureq::typestate::AgentScope;

/// How to encrypt connections: there is no value.
#[derive(Clone, Copy, Debug)]
pub enum Encryption {}

impl Encryption {
    /// Makes a client encrypt its connections.
    pub const fn apply_to(self, _: &mut MqttOptions) {
        match self {}
    }
}

/// Refuses to encrypt.
///
/// # Errors
/// Always.
pub fn configuration(_: Option<&Path>, _: Option<(&Path, &Path)>) -> Result<Encryption> {
    bail!("this program was built without TLS: build it with the feature keygraph/tls, or use mqtt://")
}

/// Leaves a web client as it is.
///
/// # Errors
/// When there is a file of authorities to trust.
pub fn trust(client: ConfigBuilder<AgentScope>, ca: Option<&Path>) -> Result<ConfigBuilder<AgentScope>> {
    ca.map(|_| configuration(ca, None)).transpose()?;
    Ok(client)
}

/// What is wrong with an encrypted connection: there are none.
#[must_use]
pub const fn advice(_: &ConnectionError) -> Option<&'static str> {
    None
}
