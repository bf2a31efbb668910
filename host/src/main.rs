//! The program `keygraph`.
//!
//! Exit status 0 when all went well; 1 when something could not be read, trained or written
//! (everything else is still done); 2 for a wrong command line.

mod cli;

use std::io;
use std::process::ExitCode;

use keygraph::notice::error;
use keygraph::output::plain_lines;

fn main() -> ExitCode {
    let ended = cli::run();
    // What a thread still writes or reads is given up.
    #[cfg(feature = "live")]
    keygraph::ending::tidy();
    match ended {
        Ok(code) => code,
        // A reader that has seen enough (`| head`) is no failure.
        Err(e) if e.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe) => {
            ExitCode::SUCCESS
        }
        Err(e) => {
            error(&plain_lines(&format!("{e:#}")));
            ExitCode::FAILURE
        }
    }
}
