//! Libraries in C for the tests of the program.

use std::path::Path;
use std::process::Command;

/// Compiles a C file of the workspace; false, said plainly, where there is no C compiler.
pub(crate) fn compile(source: &str, defines: &[&str], library: &Path) -> bool {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let mut command = Command::new(&compiler);
    command.args(["-shared", "-fPIC", "-std=gnu11", "-I"]).arg(root.join("plugin/include")).arg(root.join(source));
    command.args(defines.iter().map(|d| format!("-D{d}"))).arg("-o").arg(library).arg("-lm");
    match command.status() {
        Ok(status) => {
            assert!(status.success(), "{source} does not compile");
            true
        }
        Err(error) => {
            println!("skipped: no C compiler ({compiler}: {error})");
            false
        }
    }
}
