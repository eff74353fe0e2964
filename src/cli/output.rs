//! Output of commands. Files are checked before the work begins, and are written completely or not at all.

use std::io::{self, Write as _};
use std::path::Path;

use crate::film;
use anyhow::{Context as _, Result, bail};

/// Returns the command line, quoted for a shell.
pub fn command_line() -> String {
    let words: Vec<String> = std::env::args().collect();
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_else(|_| words.join(" "))
}

/// Prints to stdout. A closed pipe is not an error.
pub fn print(text: &str) -> Result<()> {
    match writeln!(io::stdout(), "{text}") {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => Err(e).context("stdout cannot be written"),
        _ => Ok(()),
    }
}

/// Checks that a file with one of the extensions can be written. An existing file is left unchanged.
pub fn check(path: &Path, extensions: &[&str]) -> Result<()> {
    let shown = path.display();
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if !extensions.contains(&extension.as_str()) {
        let endings: Vec<_> = extensions.iter().map(|e| format!(".{e}")).collect();
        bail!("{shown}: unknown file format; the name has to end in {}", endings.join(" or "));
    }
    if path.is_dir() {
        bail!("{shown}: is a folder; give the name of a file");
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        bail!("{shown}: the folder {} does not exist; create it first", folder.display());
    }
    let part = film::part_of(path);
    std::fs::write(&part, []).with_context(|| format!("{shown}: the folder {} cannot be written", folder.display()))?;
    std::fs::remove_file(&part).with_context(|| format!("{} cannot be removed", part.display()))
}

/// Writes a text file, which is never incomplete.
pub fn write(path: &Path, text: &str) -> Result<()> {
    Ok(film::write(path, text.as_bytes())?)
}
