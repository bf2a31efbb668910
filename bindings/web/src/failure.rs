//! Errors, with a kind that programs can read.
//!
//! In: errors of the host, the core and the JSON parser. Out: an answer with `error`, a sentence, and `kind`:
//! `training` (the picture cannot be trained on), `model` (the bytes are no model), `value` (an option or
//! a size is wrong) or `state` (the call came too early). Memory: the sentence. Cost: none.

use keygraph_core::{FrameError, ModelError, TrainError};
use serde_json::json;

use crate::message::Answer;

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    kind: &'static str,
    text: String,
}

/// Sentences of the command line, and what a page calls the same.
const WORDS: [(&str, &str); 6] = [
    ("train with --crop ", "train with the outline of the part x,y,width,height "),
    ("make one with `keygraph train`", "make one with Keygraph.train"),
    ("--profile hd", "profile: \"hd\""),
    ("--min-visible", "minVisible"),
    ("--profile", "profile"),
    ("--roi", "roi"),
];

/// A sentence of the command line, as a page says it.
pub fn in_page(text: &str) -> String {
    WORDS.iter().fold(text.to_string(), |text, (ours, page)| text.replace(ours, page))
}

impl Failure {
    /// An option or a size that is wrong.
    pub fn value(text: impl Into<String>) -> Self {
        Self { kind: "value", text: text.into() }
    }

    /// A call that came too early.
    pub fn state(text: impl Into<String>) -> Self {
        Self { kind: "state", text: text.into() }
    }

    /// The answer that tells it.
    pub fn answer(&self) -> Answer {
        Answer::of(&json!({"error": in_page(&self.text), "kind": self.kind}))
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        let kind = if error.is::<TrainError>() {
            "training"
        } else if error.is::<ModelError>() {
            "model"
        } else {
            "value"
        };
        Self { kind, text: format!("{error:#}") }
    }
}

impl From<ModelError> for Failure {
    fn from(error: ModelError) -> Self {
        anyhow::Error::from(error).into()
    }
}

impl From<FrameError> for Failure {
    fn from(error: FrameError) -> Self {
        Self::value(error.to_string())
    }
}

impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        // Where in the head it is says nothing to the caller, who has not written the head.
        let text = error.to_string();
        Self::value(text.split(" at line ").next().unwrap_or_default())
    }
}
