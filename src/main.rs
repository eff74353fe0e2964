//! `lightsheaf`: global illumination by rasterization alone. Parses, runs, prints an error once, sets the exit code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
