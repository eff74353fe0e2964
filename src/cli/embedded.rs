//! Commands for other programs, such as the Python package in `python/`: they take the words of a command line and
//! return results and errors, and print only warnings and notes.

use std::ffi::OsString;
use std::sync::Arc;

use anyhow::{Result, bail};
use clap::{ArgAction, CommandFactory as _};

use super::render::RenderArgs;
use super::view::LoadedFile;
use super::{Cli, Command, render};
use crate::film::exr::Picture;
use crate::scene::Scene;

pub use super::interrupt::Interrupt;

/// The file of a scene in memory, from which any number of pictures can be rendered.
#[derive(Clone)]
pub struct Loaded(Arc<LoadedFile>);

impl Loaded {
    /// Returns the scene as its file describes it.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.0.scene
    }
}

/// An option of a command, or an argument without a name.
pub struct OptionHelp {
    /// Its name on the command line without `--`.
    pub name: String,
    /// Its text in `--help`.
    pub help: String,
    /// True if it may be given several times.
    pub repeats: bool,
}

/// Returns the command line, whose `render` may have no output.
fn command() -> clap::Command {
    Cli::command().mut_subcommand("render", |render| render.mut_arg("output", |output| output.required(false)))
}

/// Parses the words after the name of the program.
fn parse(words: &[OsString]) -> Result<Command, clap::Error> {
    super::parse(command(), std::iter::once("lightsheaf".into()).chain(words.iter().cloned()))
}

/// Parses the words of `render`.
fn parse_render(words: &[OsString]) -> Result<Box<RenderArgs>> {
    match parse(words)? {
        Command::Render(args) => Ok(args),
        _ => bail!("only `render` makes a picture"),
    }
}

/// Loads the file of the scene that the words of `render` name.
///
/// # Errors
/// Returns a [`clap::Error`] for wrong words, or the program's message if the file cannot be loaded.
pub fn load(words: &[OsString]) -> Result<Loaded> {
    Ok(Loaded(Arc::new(parse_render(words)?.view.load_file()?)))
}

/// Renders the picture that the words of `render` ask for, and writes its files if they name any. `loaded` saves
/// reading the scene's file, unless the words ask for another variant or environment.
///
/// # Errors
/// Returns a [`clap::Error`] for wrong words, or the program's message.
pub fn picture(words: &[OsString], loaded: Option<Loaded>, interrupt: &Interrupt) -> Result<Picture> {
    let mut args = parse_render(words)?;
    args.view.loaded = loaded.map(|loaded| loaded.0);
    render::picture(&args, interrupt)
}

/// Runs a command that writes files.
///
/// # Errors
/// Returns a [`clap::Error`] for wrong words, or the program's message.
pub fn run(words: &[OsString]) -> Result<()> {
    super::run_command(parse(words)?).map(|_| ())
}

/// Returns the options of a command; none if there is no such command.
#[must_use]
pub fn options(name: &str) -> Vec<OptionHelp> {
    let command = command();
    let arguments = command.find_subcommand(name).into_iter().flat_map(clap::Command::get_arguments);
    let option = |argument: &clap::Arg| OptionHelp {
        name: argument.get_long().unwrap_or(argument.get_id().as_str()).to_owned(),
        help: argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default(),
        repeats: matches!(argument.get_action(), ArgAction::Append),
    };
    arguments.map(option).collect()
}
