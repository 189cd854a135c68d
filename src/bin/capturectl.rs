//! Drives `captured`, or does its work in this process: the terminal around [`captured::commands`].
#![forbid(unsafe_code)]

use captured::{
    api::{Fault, FaultKind},
    commands::{CommandLine, outlive_file_size_limit},
};
use clap::Parser;
use miette::{GraphicalReportHandler, MietteDiagnostic, Severity};
use std::{
    io::{self, Write},
    process::ExitCode,
};

fn main() -> ExitCode {
    // Without it a limit on file sizes ends the process where it stands, as it does for most.
    drop(outlive_file_size_limit());
    let command_line = match CommandLine::try_parse() {
        Ok(command_line) => command_line,
        Err(error) => return misunderstood(&error),
    };
    let json = command_line.json;
    match command_line.run() {
        Ok(answer) => {
            if let Some(note) = &answer.note {
                drop(writeln!(io::stderr().lock(), "{note}"));
            }
            for warning in &answer.warnings {
                explain(
                    &Fault {
                        kind: FaultKind::Shot,
                        message: warning.clone(),
                        remedy: None,
                    },
                    Severity::Warning,
                );
            }
            let text = if json {
                pretty(&answer.json)
            } else {
                answer.text
            };
            print(&text, answer.exit_code)
        }
        Err(error) => {
            let fault = error.fault();
            explain(&fault, Severity::Error);
            let code = fault.kind.exit_code();
            if json {
                print(&pretty(&serde_json::json!({ "error": fault })), code)
            } else {
                code.into()
            }
        }
    }
}

/// Help and version, or a command line that makes no sense.
fn misunderstood(error: &clap::Error) -> ExitCode {
    // Whoever reads neither stream does not miss it.
    drop(error.print());
    if !error.use_stderr() {
        return ExitCode::SUCCESS;
    }
    let fault = Fault {
        kind: FaultKind::Request,
        message: error.to_string().trim_end().to_owned(),
        remedy: Some("capturectl --help".to_owned()),
    };
    let code = fault.kind.exit_code();
    if std::env::args_os().any(|argument| argument == "--json") {
        return print(&pretty(&serde_json::json!({ "error": fault })), code);
    }
    code.into()
}

fn pretty(document: &serde_json::Value) -> String {
    format!("{document:#}")
}

/// One document or text on standard output. A reader that has gone away is no failure of ours.
fn print(text: &str, exit_code: u8) -> ExitCode {
    drop(writeln!(io::stdout().lock(), "{text}"));
    exit_code.into()
}

/// A message for people on standard error.
fn explain(fault: &Fault, severity: Severity) {
    let mut diagnostic = MietteDiagnostic::new(&fault.message).with_severity(severity);
    if let Some(remedy) = &fault.remedy {
        diagnostic = diagnostic.with_help(remedy);
    }
    let mut text = String::new();
    // Writing into a string cannot fail.
    let _ = GraphicalReportHandler::new().render_report(&mut text, &diagnostic);
    drop(io::stderr().lock().write_all(text.as_bytes()));
}
