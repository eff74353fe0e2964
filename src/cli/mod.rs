//! Command line (feature `cli`): `render`, `view`, `merge`, `denoise`, `compare`, `bench`, `plan`, `stress`, `scenes`.
//!
//! Results and lines of `--json-progress` go to stdout or to the requested files; warnings, notes, progress and
//! the closing line go to stderr.
//!
//! | exit code | meaning |
//! |---|---|
//! | 0 | The command succeeded. |
//! | 1 | A threshold of `compare` is exceeded, or a case of `stress` is wrong. |
//! | 2 | An error occurred. It is printed once on stderr as `error: ...`. |
//! | 130 | `render` was interrupted and has written its picture. |

mod aov;
mod bench;
mod checkpoint;
mod compare;
mod denoise;
pub mod embedded;
mod interrupt;
mod light_groups;
mod merge;
mod output;
mod preview;
mod progress;
mod reference_renderer;
mod render;
mod stress;
mod view;
mod window;

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::scene;
use crate::scene::load::{FORMATS, Format};
use crate::settings::{Method, Settings, Technique, Visibility};
use crate::stress::messages::Listener;

use view::{View, ViewArgs};

/// Global illumination by rasterization alone
///
/// Bidirectional path tracing by rasterization on any GPU, with or without ray tracing hardware. A CPU path
/// tracer serves as the reference.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 success; 1 a threshold of compare is exceeded, or a case of stress is wrong; 2 error; 130 \
                          render was interrupted (Ctrl-C or SIGTERM) and has written its picture. A second signal ends the \
                          program at once.";

#[derive(Subcommand)]
enum Command {
    /// Render a scene to an image file
    Render(Box<render::RenderArgs>),
    /// Show a scene in a window while it is rendered
    View(Box<window::WindowArgs>),
    /// Join pictures of parts of the samples to the picture of all of them
    Merge(merge::MergeArgs),
    /// Denoise a picture by Intel Open Image Denoise
    Denoise(denoise::DenoiseArgs),
    /// Print the error of an image against a reference, in linear RGB
    Compare(compare::CompareArgs),
    /// Measure error against run time, method by method, and write a report
    Bench(Box<bench::BenchArgs>),
    /// Print what a render would do on this device, pass by pass with the reason. Nothing is rendered
    Plan(Box<PlanArgs>),
    /// Render extreme scenes, sizes and values, and print which of them this device renders incorrectly
    Stress(stress::StressArgs),
    /// List the built-in scenes and the file formats that are read
    Scenes,
}

#[derive(clap::Args)]
struct PlanArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Print the plan as JSON
    #[arg(long)]
    json: bool,
}

/// Parses the arguments of the process and runs the command.
#[must_use]
pub fn run() -> ExitCode {
    // Errors are printed once, below. RUST_LOG enables the log messages of the libraries.
    let logger = env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("off")).build();
    // Validation layers log warnings and errors, which `stress` records.
    let level = logger.filter().max(log::LevelFilter::Warn);
    if log::set_boxed_logger(Box::new(Listener(logger))).is_ok() {
        log::set_max_level(level);
    }
    match parse(Cli::command(), std::env::args_os()) {
        Ok(command) => run_command(command).unwrap_or_else(|e| {
            eprintln!("error: {e:#}");
            ExitCode::from(2)
        }),
        Err(e) => {
            // If the terminal is closed, the message is lost and only the exit code remains.
            let _ = e.print();
            ExitCode::from(u8::try_from(e.exit_code()).unwrap_or(2))
        }
    }
}

/// Parses the words of a command line, the first of which is the name of the program, and completes what depends on
/// which options were given.
fn parse(command: clap::Command, words: impl IntoIterator<Item = OsString>) -> Result<Command, clap::Error> {
    let matches = command.try_get_matches_from(words)?;
    let mut cli = Cli::from_arg_matches(&matches)?;
    check_short_names(&matches)?;
    match &mut cli.command {
        Command::Render(args) => {
            args.view.settings.crop = args.crop;
            match args.sample_range {
                Some(range) => args.view.settings.samples = range.count().try_into().unwrap_or(u32::MAX),
                None => end_by_default(&mut args.view.settings, &matches),
            }
        }
        Command::Plan(args) => end_by_default(&mut args.view.settings, &matches),
        _ => {}
    }
    Ok(cli.command)
}

/// Runs a command.
fn run_command(command: Command) -> Result<ExitCode> {
    match command {
        Command::Render(args) => render::run(&args),
        Command::View(args) => window::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Merge(args) => merge::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Denoise(args) => denoise::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Compare(args) => compare::run(&args),
        Command::Bench(args) => bench::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Plan(args) => plan(&args).map(|()| ExitCode::SUCCESS),
        Command::Stress(args) => stress::run(&args),
        Command::Scenes => scenes().map(|()| ExitCode::SUCCESS),
    }
}

/// Rejects short names of methods with ray queries together with another visibility.
fn check_short_names(matches: &ArgMatches) -> Result<(), clap::Error> {
    let Some((_, matches)) = matches.subcommand() else { return Ok(()) };
    let method = matches.try_get_raw("method").ok().flatten().and_then(|mut words| words.next());
    let visibility = matches.try_get_one::<Visibility>("visibility").ok().flatten();
    for (name, technique) in Technique::NAMED.iter().filter(|(_, technique)| technique.needs_ray_queries()) {
        if method.is_some_and(|method| method == *name) && visibility.is_some_and(|v| *v != Visibility::RayQuery) {
            let method = technique.method;
            let text = format!("--method {name} is --method {method} --visibility ray-query; leave one of them out\n");
            return Err(clap::Error::raw(clap::error::ErrorKind::ArgumentConflict, text));
        }
    }
    Ok(())
}

/// Sets the default target error and budget if the command line names no end of the render.
fn end_by_default(settings: &mut Settings, matches: &ArgMatches) {
    let of_command = matches.subcommand().map(|(_, matches)| matches);
    let samples = of_command.and_then(|matches| matches.value_source("samples")) == Some(ValueSource::CommandLine);
    if !samples && settings.budget.is_none() && settings.target_error.is_none() {
        settings.end_by_default();
    }
}

/// Runs `plan`.
fn plan(args: &PlanArgs) -> Result<()> {
    if args.view.settings.method() == Method::Reference {
        bail!("--method reference: the reference has no plan, since it does the same for every scene");
    }
    let View { scene, settings, animations } = args.view.load()?;
    let gpu = crate::render::open_device(settings.technique)?;
    let (text, json) = crate::render::plan(&gpu, &scene, &settings)?;
    if args.json {
        return output::print(&serde_json::to_string_pretty(&json)?);
    }
    let all = if animations.is_empty() { "none".to_owned() } else { animations.join(", ") };
    output::print(&format!("{text}\n{:<21}  {all}", "animations"))
}

/// Runs `scenes`.
fn scenes() -> Result<()> {
    let mut lines: Vec<_> =
        scene::builtin::names().map(|(name, about)| format!("{:<28}{about}", format!("builtin:{name}"))).collect();
    for Format { endings, about, .. } in &FORMATS {
        let paths: Vec<_> = endings.iter().map(|ending| format!("PATH.{ending}")).collect();
        lines.push(format!("{:<28}{about}", paths.join(", ")));
    }
    output::print(&lines.join("\n"))
}
