//! The program `lightsheaf`: parses the command line, runs the command, prints an error once, sets the exit
//! code.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
