//! The program `lightsheaf`: runs the command line and sets the exit code.

fn main() -> std::process::ExitCode {
    lightsheaf::cli::run()
}
