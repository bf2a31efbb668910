//! Values of arguments that several commands take.

use keygraph::run::default_threads;
use keygraph::search::MAX_THREADS;

/// How many threads search.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Threads {
    /// Threads that search [default: one a processor, at most 8]
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=MAX_THREADS as i64))]
    threads: Option<u8>,
}

impl Threads {
    /// The number of threads, that of the processors unless another was given.
    pub fn count(self) -> usize {
        self.threads.map_or_else(default_threads, usize::from)
    }
}

/// Parses the maximum size of a model, bytes.
pub fn model_size(text: &str) -> Result<usize, String> {
    const MOST: usize = 64 << 20;
    match text.parse() {
        Ok(v) if v <= MOST => Ok(v),
        _ => Err(format!("give a number of bytes up to {MOST}")),
    }
}
