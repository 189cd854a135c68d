//! Manual pages and shell completions, made of the command lines themselves.

use super::{CommandLine, DaemonArguments};
use clap::{Command, CommandFactory as _};
use clap_complete::{Generator, Shell};
use std::io;

/// A file of the manual or of a shell: where it goes under the prefix, and its contents.
pub(super) type Page = (String, Vec<u8>);

/// All of them.
///
/// # Errors
/// What the generators say; they write into memory.
pub(super) fn pages() -> io::Result<Vec<Page>> {
    let programs = [
        (CommandLine::command(), "1"),
        (DaemonArguments::command(), "8"),
    ];
    let mut pages = Vec::new();
    for (program, section) in programs {
        let mut program = program.disable_help_subcommand(true);
        program.build();
        manual(&program, section, &mut pages)?;
        let name = program.get_name().to_owned();
        let mut add = |shell: Shell, folder: &str| {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut program.clone(), &name, &mut script);
            let file = match shell {
                // The name that bash-completion looks for.
                Shell::Bash => name.clone(),
                _ => shell.file_name(&name),
            };
            pages.push((format!("share/{folder}/{file}"), script));
        };
        add(Shell::Bash, "bash-completion/completions");
        add(Shell::Zsh, "zsh/site-functions");
        add(Shell::Fish, "fish/vendor_completions.d");
    }
    Ok(pages)
}

/// The page of a command and of each below it.
fn manual(command: &Command, section: &str, pages: &mut Vec<Page>) -> io::Result<()> {
    let name = command.get_display_name().unwrap_or(command.get_name());
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone())
        .section(section)
        .render(&mut text)?;
    pages.push((format!("share/man/man{section}/{name}.{section}"), text));
    for below in command.get_subcommands() {
        manual(below, section, pages)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_and_every_shell_its_completions() {
        let pages = pages().unwrap();
        let text = |name: &str| {
            let found = pages.iter().find(|(path, _)| path.ends_with(name));
            let (_, bytes) = found.unwrap_or_else(|| panic!("no {name}"));
            String::from_utf8_lossy(bytes).into_owned()
        };
        for command in CommandLine::command().get_subcommands() {
            let page = text(&format!("man1/capturectl-{}.1", command.get_name()));
            assert!(page.contains(".TH"), "{page}");
        }
        assert!(text("man8/captured.8").contains("viewer"));
        assert!(text("completions/capturectl").contains("fsck"));
        assert!(text("site-functions/_capturectl").contains("#compdef"));
        assert!(text("vendor_completions.d/capturectl.fish").contains("relight"));
    }
}
