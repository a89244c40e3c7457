//! The `wheelwright` program: exit codes and nothing else.

fn main() {
    // A plugin's call that never returned must not keep the program from ending.
    wheelwright_plugin::exit(i32::from(wheelwright::cli::main()));
}
