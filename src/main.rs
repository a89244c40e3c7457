//! The `wheelwright` program: exit codes and nothing else.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(wheelwright::cli::main())
}
