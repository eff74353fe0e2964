//! The command line: `render`, `view`, `compare`, `bench`, `plan`, `stress`, `scenes`.
//!
//! Exit codes: 0 done; 1 a threshold of `compare` is exceeded, or a case of `stress` is wrong; 2 an error, printed once on stderr as
//! `error: ...`; 130 `render` was interrupted.
//! Results go to stdout or to the files asked for; warnings, progress and the closing line go to stderr.

mod bench;
mod compare;
mod interrupt;
mod output;
mod render;
mod stress;
mod view;
mod window;

use std::fmt::Display;
use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use serde::Serialize;

use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::path_plan::PathPlan;
use lightsheaf::plan::FramePlan;
use lightsheaf::scene::{self, Geometry, SceneStats};
use lightsheaf::settings::{Method, Settings};
use lightsheaf::stress::messages::Listener;

use view::{View, ViewArgs};

/// Global illumination by rasterization alone
///
/// Raster bidirectional path tracing on any GPU, with or without ray tracing, and a CPU path tracer that judges it.
#[derive(Parser)]
#[command(version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 a threshold is exceeded or a case of stress is wrong, 2 an error, 130 render was \
                          interrupted (Ctrl-C or SIGTERM) and has written what it had; a second signal ends it at once.";

#[derive(Subcommand)]
enum Command {
    /// Render a scene to an image
    Render(Box<render::RenderArgs>),
    /// Look at a scene in a window while it is rendered
    View(Box<window::WindowArgs>),
    /// Say how far an image is from a reference, on linear RGB
    Compare(compare::CompareArgs),
    /// Take error against run time, and write a report
    Bench(Box<bench::BenchArgs>),
    /// Print what a render would do, pass by pass with the reason, without rendering
    Plan(Box<PlanArgs>),
    /// Render odd scenes, sizes and values, and say which come out wrong on this device
    Stress(stress::StressArgs),
    /// List the scenes that need no file, and the kinds of files that are read
    Scenes,
}

#[derive(clap::Args)]
struct PlanArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Parses the arguments and runs the command.
pub fn run() -> ExitCode {
    // Errors are printed here and once; RUST_LOG shows what the libraries say beside them.
    let logger = env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("off")).build();
    // Validation layers speak in warnings and errors, which `stress` listens to.
    let level = logger.filter().max(log::LevelFilter::Warn);
    if log::set_boxed_logger(Box::new(Listener(logger))).is_ok() {
        log::set_max_level(level);
    }
    let parsed = Cli::command().try_get_matches().and_then(|matches| Ok((Cli::from_arg_matches(&matches)?, matches)));
    let (cli, matches) = match parsed {
        Ok(parsed) => parsed,
        Err(e) => {
            // Nothing is left to do where the terminal is gone.
            let _ = e.print();
            return ExitCode::from(u8::try_from(e.exit_code()).unwrap_or(2));
        }
    };
    let done = match cli.command {
        Command::Render(mut args) => {
            end_by_default(&mut args.view.settings, &matches);
            render::run(&args)
        }
        Command::View(args) => window::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Compare(args) => compare::run(&args),
        Command::Bench(args) => bench::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Plan(mut args) => {
            end_by_default(&mut args.view.settings, &matches);
            plan(&args).map(|()| ExitCode::SUCCESS)
        }
        Command::Stress(args) => stress::run(&args),
        Command::Scenes => scenes().map(|()| ExitCode::SUCCESS),
    };
    done.unwrap_or_else(|e| {
        eprintln!("error: {e:#}");
        ExitCode::from(2)
    })
}

/// Ends a render by its error and by time where the command line names no end.
fn end_by_default(settings: &mut Settings, matches: &ArgMatches) {
    let of_command = matches.subcommand().map(|(_, matches)| matches);
    let samples = of_command.and_then(|matches| matches.value_source("samples")) == Some(ValueSource::CommandLine);
    if !samples && settings.budget.is_none() && settings.target_error.is_none() {
        settings.end_by_default();
    }
}

/// A device with what a method needs.
fn open(method: Method) -> Result<Gpu, GpuError> {
    if method.traces_rays() { Gpu::with_ray_queries() } else { Gpu::new() }
}

fn plan(args: &PlanArgs) -> Result<()> {
    let method = args.view.settings.method;
    if method == Method::Reference {
        bail!("--method {method}: it does the same for every scene, and has no plan");
    }
    let View { scene, settings, animations } = args.view.load()?;
    let gpu = open(method)?;
    let stats = SceneStats::new(&scene, &Geometry::new(&scene));
    if !method.shares_subpaths() {
        return args.print(&PathPlan::new(&scene, &stats, &settings, &gpu.capabilities), &animations);
    }
    args.print(&FramePlan::new(&stats, &settings, &gpu.capabilities), &animations)
}

impl PlanArgs {
    fn print(&self, plan: &(impl Display + Serialize), animations: &[String]) -> Result<()> {
        if self.json {
            return output::print(&serde_json::to_string_pretty(plan)?);
        }
        let all = if animations.is_empty() { "none".to_owned() } else { animations.join(", ") };
        output::print(&format!("{plan}\nanimations     {all}"))
    }
}

fn scenes() -> Result<()> {
    let mut lines: Vec<_> =
        scene::builtin::names().map(|(name, about)| format!("{:<28}{about}", format!("builtin:{name}"))).collect();
    lines.push(format!("{:<28}{}", "PATH.gltf, PATH.glb", "glTF 2.0, data embedded or in files beside it"));
    lines.push(format!("{:<28}{}", "PATH.xml", "Mitsuba 0.5, 0.6, 2 and 3"));
    output::print(&lines.join("\n"))
}
