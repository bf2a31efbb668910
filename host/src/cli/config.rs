//! Options of `keygraph camera` from a file (`--config FILE`).
//!
//! In: a command line, and the file that it names, in TOML: `threshold = 0.7`. Out: the command line with the options of
//! the file before those that were given, for clap, whose checks hold for all of them. An option of the file is left out
//! if the command line or the environment gives it, or gives one that it does not go with. A relative path is one from
//! the folder of the file. Memory and cost: the file.

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command, CommandFactory, Error, Parser, ValueHint};
use keygraph::file::read_whole;
use keygraph::input::{is_stdin, is_url};
use keygraph::output::plain;
use toml::de::{DeTable, DeValue};

use super::Cli;

/// The command whose options may stand in a file.
const COMMAND: &str = "camera";
/// Options that are no settings.
const NO_SETTINGS: [&str; 3] = ["config", "help", "version"];
/// Permission of everybody to read a file.
const READ_BY_ALL: u32 = 0o004;

/// An option in a file.
#[derive(Debug)]
struct Setting {
    /// The option, without its dashes.
    name: String,
    line: usize,
    arguments: Vec<OsString>,
}

/// Reads the command line of the program, with the options of the file that it names. Returns warnings too. Ends the
/// program with status 2 when options are wrong.
///
/// # Errors
/// When the file cannot be read.
pub fn parse() -> Result<(Cli, Vec<String>)> {
    complete(&env::args_os().collect::<Vec<_>>()).map_err(|error| match error.downcast::<Error>() {
        Ok(wrong) => wrong.exit(),
        Err(unreadable) => unreadable,
    })
}

/// Reads a command line `given`, with the options of the file that it names. Returns warnings too.
///
/// # Errors
/// A [`clap::Error`] when options are wrong; another one when the file cannot be read.
fn complete(given: &[OsString]) -> Result<(Cli, Vec<String>)> {
    // What is wrong or missing is found below, once all options are there.
    let loose = Cli::command().ignore_errors(true).try_get_matches_from(given);
    let matches = loose.ok().and_then(|all| all.subcommand_matches(COMMAND).cloned());
    let path = matches.as_ref().and_then(|m| m.get_one::<PathBuf>("config"));
    let (Some(matches), Some(path)) = (&matches, path) else {
        return Ok((Cli::try_parse_from(given)?, Vec::new()));
    };
    let file = plain(&path.display().to_string()).into_owned();
    let bytes = read_whole(path).with_context(|| format!("cannot read the options in {file}"))?;
    let text = String::from_utf8(bytes).map_err(|_| wrong(format!("{file} is no text in UTF-8")))?;
    let mut root = Cli::command();
    root.build();
    let command = root.find_subcommand(COMMAND).context("there is no such command")?;
    let mut settings = settings(&text, command, path.parent().unwrap_or(Path::new("")))
        .map_err(|(line, told)| wrong(format!("{file}, line {line}: {}", plain(&told))))?;
    let mut warnings: Vec<_> = readable_secret(path, &settings, &file).into_iter().collect();
    settings.retain(|setting| {
        let Some(arg) = option(command, &setting.name).filter(|arg| !is_given(matches, arg)) else { return false };
        let rival = command.get_arguments().find(|other| is_typed(matches, other) && conflict(command, arg, other));
        if let Some(rival) = rival.and_then(Arg::get_long) {
            let (line, name) = (setting.line, &setting.name);
            warnings.push(format!("{file}, line {line}: {name} is left out, since it does not go with --{rival}"));
        }
        rival.is_none()
    });
    let at = given.iter().position(|argument| argument == COMMAND).map_or(given.len(), |at| at + 1);
    let (before, after) = given.split_at(at);
    let ours = settings.iter().flat_map(|setting| &setting.arguments);
    let cli = Cli::try_parse_from(before.iter().chain(ours).chain(after));
    Ok((cli.map_err(|error| with_place(error, &file, &settings))?, warnings))
}

/// The error of a wrong command line.
fn wrong(message: String) -> Error {
    Cli::command().error(ErrorKind::ValueValidation, message)
}

/// The option of this name.
fn option<'a>(command: &'a Command, name: &str) -> Option<&'a Arg> {
    command.get_arguments().find(|arg| arg.get_long() == Some(name) && !NO_SETTINGS.contains(&name))
}

/// Whether the command line has the option.
fn is_typed(matches: &ArgMatches, arg: &Arg) -> bool {
    matches.value_source(arg.get_id().as_str()) == Some(ValueSource::CommandLine)
}

/// Whether the command line or the environment has the option.
fn is_given(matches: &ArgMatches, arg: &Arg) -> bool {
    is_typed(matches, arg) || matches.value_source(arg.get_id().as_str()) == Some(ValueSource::EnvVariable)
}

/// Whether two options do not go together.
fn conflict(command: &Command, a: &Arg, b: &Arg) -> bool {
    let excludes =
        |a: &Arg, b: &Arg| command.get_arg_conflicts_with(a).iter().any(|other| other.get_id() == b.get_id());
    excludes(a, b) || excludes(b, a)
}

/// The options in the text of a file that lies in `folder`, or the line of the first that is wrong, and why.
fn settings(text: &str, command: &Command, folder: &Path) -> Result<Vec<Setting>, (usize, String)> {
    let line = |at: usize| 1 + text.bytes().take(at).filter(|&b| b == b'\n').count();
    let table = DeTable::parse(text).map_err(|error| {
        let end = text.trim_end().len();
        (line(error.span().map_or(end, |span| span.start.min(end))), error.message().to_string())
    })?;
    let entries = table.get_ref().iter();
    let mut entries: Vec<_> =
        entries.map(|(key, value)| (line(key.span().start), &**key.get_ref(), value.get_ref())).collect();
    entries.sort_by_key(|entry| entry.0);
    let mut settings = Vec::new();
    for (line, name, value) in entries {
        let arguments = match (option(command, name), value) {
            (_, DeValue::Table(_)) => {
                Err(format!("{name} is a section, and there are none: write options alone, such as mqtt-rate = 5"))
            }
            (Some(arg), _) => arguments(arg, value, folder),
            (None, _) => Err(unknown(name)),
        };
        settings.push(Setting { name: name.into(), line, arguments: arguments.map_err(|told| (line, told))? });
    }
    Ok(settings)
}

/// The message for a name that no option has.
fn unknown(name: &str) -> String {
    if name == "config" {
        return "a file of options names no other".into();
    }
    let refused = Cli::command().try_get_matches_from(["keygraph", COMMAND, &format!("--{name}")]);
    let like = refused.err().and_then(|error| match error.get(ContextKind::SuggestedArg) {
        Some(ContextValue::String(like)) => Some(format!("did you mean {:?}?", like.trim_start_matches('-'))),
        _ => None,
    });
    let advice = like.unwrap_or_else(|| format!("`keygraph help {COMMAND}` lists all"));
    format!("there is no option {name:?}; {advice}")
}

/// An option with its value, as a command line gives it.
fn arguments(arg: &Arg, value: &DeValue<'_>, folder: &Path) -> Result<Vec<OsString>, String> {
    let name = arg.get_long().unwrap_or_default();
    let is_flag = !arg.get_action().takes_values();
    let may_be_alone = arg.get_num_args().is_some_and(|count| count.min_values() == 0);
    let with = |value: OsString| {
        let mut argument = OsString::from(format!("--{name}="));
        argument.push(value);
        Ok(vec![argument])
    };
    match value {
        DeValue::Boolean(true) if is_flag || may_be_alone => Ok(vec![format!("--{name}").into()]),
        DeValue::Boolean(false) if is_flag || may_be_alone => Ok(Vec::new()),
        _ if is_flag => Err(format!("{name} is true or false")),
        DeValue::Array(values) if matches!(arg.get_action(), ArgAction::Append) => {
            let each = values.iter().map(|value| match value.get_ref() {
                DeValue::Array(_) => Err(format!("{name} is a list of values, not of lists")),
                value => arguments(arg, value, folder),
            });
            Ok(each.collect::<Result<Vec<_>, _>>()?.concat())
        }
        DeValue::Array(_) => Err(format!("{name} takes one value, not a list")),
        DeValue::String(text) => with(if is_path(arg, text) { folder.join(&**text).into() } else { (&**text).into() }),
        DeValue::Integer(number) => with(number.to_string().into()),
        DeValue::Float(number) => with(number.to_string().into()),
        DeValue::Boolean(_) => Err(format!("{name} takes a value, not true or false")),
        DeValue::Table(_) | DeValue::Datetime(_) => Err(format!("{name} takes a value: write it as \"...\"")),
    }
}

/// Whether a value is the path of a file: not an address, nor standard input.
fn is_path(arg: &Arg, value: &str) -> bool {
    arg.get_value_hint() == ValueHint::AnyPath
        && !value.is_empty()
        && !is_stdin(value.as_ref())
        && !is_url(value.as_ref())
}

/// The error of clap with the places in the file that it speaks of.
fn with_place(error: Error, file: &str, settings: &[Setting]) -> Error {
    let rendered = error.render().to_string();
    let text = rendered.split("\n\nUsage:").next().unwrap_or_default();
    let text = text.split("\n\nFor more information").next().unwrap_or_default();
    let text = text.strip_prefix("error: ").unwrap_or(text);
    let lines: Vec<_> = settings
        .iter()
        .filter(|setting| mentions(text, &setting.name) || lacks_as(&error, setting))
        .map(|setting| setting.line.to_string())
        .collect();
    let place = match lines.as_slice() {
        [] => return error,
        [line] => format!("line {line}"),
        several => format!("lines {}", several.join(" and ")),
    };
    Cli::command().error(error.kind(), format!("{file}, {place}: {text}"))
}

/// Whether a message names an option.
fn mentions(text: &str, name: &str) -> bool {
    let option = format!("--{name}");
    let goes_on = |c: char| c.is_alphanumeric() || c == '-';
    text.match_indices(&option).any(|(at, _)| !text[at + option.len()..].starts_with(goes_on))
}

/// Whether an option needs what `error` says is missing.
fn lacks_as(error: &Error, setting: &Setting) -> bool {
    let missing = |error: &Error| match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::MissingRequiredArgument, Some(ContextValue::Strings(all))) => all.clone(),
        _ => Vec::new(),
    };
    let lacking = missing(error);
    let start = ["keygraph", COMMAND].map(OsString::from);
    let alone = Cli::command().try_get_matches_from(start.iter().chain(&setting.arguments));
    !lacking.is_empty() && alone.is_err_and(|alone| missing(&alone).iter().any(|need| lacking.contains(need)))
}

/// A warning if the file has a secret and everybody may read it.
fn readable_secret(path: &Path, settings: &[Setting], file: &str) -> Option<String> {
    let is_secret = |setting: &&Setting| {
        let has_password = |argument: &OsString| {
            argument.to_string_lossy().split_once("://").is_some_and(|(_, rest)| rest.contains('@'))
        };
        setting.name == "token" || setting.arguments.iter().any(has_password)
    };
    let secret = settings.iter().find(is_secret)?;
    let mode = mode_of(path)?;
    let (line, name) = (secret.line, &secret.name);
    (mode & READ_BY_ALL != 0)
        .then(|| format!("{file}, line {line}: everybody may read {name}, which is secret: chmod 600 {file}"))
}

/// Who may read and write a file, where the system has such a number.
#[cfg(unix)]
fn mode_of(path: &Path) -> Option<u32> {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;
    Some(fs::metadata(path).ok()?.permissions().mode())
}

/// Who may read and write a file, where the system has such a number.
#[cfg(not(unix))]
fn mode_of(_: &Path) -> Option<u32> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    /// A file of options in a folder of its own.
    struct File(PathBuf);

    impl File {
        fn new(test: &str, text: &str) -> Self {
            let folder = env::temp_dir().join(format!("keygraph-config-{}-{test}", std::process::id()));
            fs::create_dir_all(&folder).expect("makes");
            let file = Self(folder.join("k.toml"));
            fs::write(&file.0, text).expect("writes");
            file
        }

        /// The arguments of `camera` with this file and `more`, and the warnings.
        fn with(&self, more: &[&str]) -> Result<(String, Vec<String>)> {
            let start = [OsString::from("keygraph"), COMMAND.into(), "--config".into(), self.0.clone().into()];
            let given: Vec<_> = start.into_iter().chain(more.iter().map(OsString::from)).collect();
            let (cli, warnings) = complete(&given)?;
            Ok((format!("{:?}", cli.command).replace(&*self.folder(), "FOLDER"), warnings))
        }

        fn folder(&self) -> String {
            self.0.parent().expect("there").display().to_string()
        }
    }

    impl Drop for File {
        fn drop(&mut self) {
            let _ = self.0.parent().map(fs::remove_dir_all);
        }
    }

    /// Asserts that a file with `text` is refused with all of `words`.
    #[track_caller]
    fn refused(test: &str, text: &str, words: &[&str]) {
        let error = File::new(test, text).with(&[]).map(|(arguments, _)| arguments).expect_err(text);
        let error = error.downcast::<Error>().expect("clap says so").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{words:?} are not all in:\n{error}");
        assert!(!error.contains("secret"), "{error}");
    }

    #[test]
    fn options_of_all_kinds() {
        let text = "# comment\nmodel = [\"a.kgm\", \"/b.kgm\"]\nmodels = \"shelf\"\nweb = true\njson = true\nmirror = false\n\
                    threshold = 0.75\nbudget-ms = 40\nroi = \"25%,0,50%,100%\"\nreplay = \"rtsp://camera.lan/a\"\n\
                    mqtt = \"mqtt://broker\"\nmqtt-models = \"orders\"\nmqtt-discovery = true\n";
        let (arguments, warnings) = File::new("kinds", text).with(&[]).expect("is right");
        for part in [
            "models: [\"FOLDER/a.kgm\", \"/b.kgm\"]",
            "folder: Some(\"FOLDER/shelf\")",
            "web: Some(127.0.0.1:8080)",
            "json: true",
            "mirror: false",
            "threshold: 0.75",
            "budget_ms: Some(40ms)",
            "replay: Some(\"rtsp://camera.lan/a\")",
            "mqtt_models: Some(\"orders\")",
            "mqtt_discovery: Some(\"homeassistant\")",
        ] {
            assert!(arguments.contains(part), "{part} is not in {arguments}");
        }
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn the_command_line_wins() {
        let file = File::new("wins", "model = [\"a.kgm\", \"b.kgm\"]\ndevice = 2\nfps = 5\nthreshold = 0.5\n");
        let (arguments, warnings) = file.with(&["-m", "c.kgm", "--fps=9"]).expect("is right");
        for part in ["models: [\"c.kgm\"]", "fps: Some(9.0)", "device: Some(\"2\")", "threshold: 0.5"] {
            assert!(arguments.contains(part), "{part} is not in {arguments}");
        }
        assert!(warnings.is_empty(), "{warnings:?}");
        // What does not go with what is given is left out, too.
        let (arguments, warnings) = file.with(&["--replay", "clip.mp4"]).expect("is right");
        assert!(arguments.contains("device: None") && arguments.contains("replay: Some(\"clip.mp4\")"), "{arguments}");
        assert!(warnings.len() == 1 && warnings[0].contains("line 2: device is left out"), "{warnings:?}");
        // One that is given may be what another one of the file needs.
        let file = File::new("needs", "public-url = \"https://cam.example.org\"\n");
        assert!(file.with(&["--web"]).is_ok());
        let wrong = file.with(&["--web", "--thresold", "3"]).expect_err("no such option").to_string();
        assert!(wrong.contains("--thresold") && !wrong.contains("k.toml"), "{wrong}");
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        refused(
            "name",
            "fps = 3\n\nthresold = 0.5\n",
            &["k.toml, line 3: ", "no option \"thresold\"", "\"threshold\"?"],
        );
        refused("nothing", "x = 1", &["line 1: there is no option \"x\"", "`keygraph help camera`"]);
        refused("value", "json = true\nthreshold = 7\n", &["k.toml, line 2: ", "'7'", "--threshold"]);
        refused("choice", "profile = \"8k\"\n", &["line 1: ", "8k", "vga"]);
        refused("flag", "json = 1\n", &["line 1: json is true or false"]);
        refused("list", "fps = [1, 2]\n", &["line 1: fps takes one value, not a list"]);
        refused("lists", "model = [[\"a\"]]\n", &["line 1: model is a list of values"]);
        refused("bool", "fps = true\n", &["line 1: fps takes a value, not true or false"]);
        refused("date", "fps = 2026-11-29\n", &["line 1: fps takes a value: write it as"]);
        refused("section", "json = true\n[mqtt]\nrate = 3\n", &["line 2: mqtt is a section"]);
        refused("other", "config = \"k.toml\"\n", &["line 1: a file of options names no other"]);
        refused("quotes", "json = true\ndevice = /dev/video0\n", &["k.toml, line 2: ", "quoted"]);
        refused("open", "json = true\ntoken = \"secret", &["k.toml, line 2: "]);
        refused("twice", "fps = 3\nfps = 4\n", &["k.toml, line 2: duplicate key"]);
        refused("rivals", "device = 0\n\nreplay = \"a\"\n", &["k.toml, lines 1 and 3: ", "cannot be used with"]);
        refused("need", "fps = 2\nmqtt = \"mqtt://b\"\nmqtt-cert = \"c.pem\"\n", &["k.toml, line 3: ", "--mqtt-key"]);
        refused("needs", "token = \"secret\"\n", &["k.toml, line 1: ", "--web"]);
        let missing = File::new("missing", "");
        fs::remove_file(&missing.0).expect("removes");
        let error = missing.with(&[]).map(|(arguments, _)| arguments).expect_err("missing");
        assert!(format!("{error:#}").contains("cannot read the options in "), "{error:#}");
    }

    #[test]
    fn a_secret_that_everybody_may_read_is_told() {
        let all = "token = \"0123456789abcdef\"\nweb = 8080\n";
        for (test, text, line) in [
            ("token", all, "line 1: everybody may read token"),
            ("broker", "json = true\nmqtt = \"mqtt://me:secret@broker\"\n", "line 2: everybody may read mqtt"),
            ("stream", "replay = \"rtsp://me:secret@camera\"\n", "line 1: everybody may read replay"),
        ] {
            let file = File::new(test, text);
            let warnings_at = |mode: u32| {
                fs::set_permissions(&file.0, fs::Permissions::from_mode(mode)).expect("sets");
                file.with(&[]).expect("is right").1
            };
            let warnings = warnings_at(0o644);
            assert!(warnings.len() == 1 && warnings[0].contains(line) && !warnings[0].contains("me:"), "{warnings:?}");
            assert!(warnings_at(0o640).is_empty());
        }
    }

    /// The file of the package, and each option that it offers in a comment.
    #[test]
    fn the_example_is_right() {
        let text = include_str!("../../../docs/keygraph.toml");
        let (arguments, _) = File::new("example", text).with(&[]).expect("is right");
        assert!(arguments.contains("folder: Some(\"/var/lib/keygraph\")"), "{arguments}");
        let offered: Vec<_> =
            text.lines().filter_map(|line| line.strip_prefix('#')).filter(|l| !l.starts_with(' ')).collect();
        assert!(offered.len() > 10, "{offered:?}");
        for line in offered.iter().filter(|line| !line.is_empty()) {
            let name = line.split(' ').next().unwrap_or_default();
            let others = text.lines().filter(|line| !line.starts_with('#') && !line.starts_with(&format!("{name} ")));
            // What an option needs stands above it.
            let needed = if line.starts_with("mqtt-") { "mqtt = \"mqtt://broker\"\n" } else { "" };
            let all = others.collect::<Vec<_>>().join("\n") + "\n" + needed + line;
            File::new("offered", &all).with(&[]).unwrap_or_else(|error| unreachable!("{all}\n{error:#}"));
        }
    }
}
