//! The `concealed` program: makes sets of cases and drives their robots again.

use clap::{Parser, Subcommand};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use wheelwright_concealed::error::Error;
use wheelwright_concealed::files::{commands, folder};
use wheelwright_concealed::make::{case, plan};
use wheelwright_concealed::referee::key::{Entry, Key, SCHEMA};

/// Robots with hidden physics: makes recordings of them, and a sealed key that says what is hidden.
#[derive(Parser)]
#[command(name = "concealed", version)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Makes a set of cases and its key, and prints the key's SHA-256.
    Make {
        /// Folder that gets one folder a case.
        #[arg(long)]
        out: PathBuf,
        /// Key file; it must not lie inside the folder of cases.
        #[arg(long)]
        key: PathBuf,
        /// Seed: the same seed makes the same bytes.
        #[arg(long)]
        seed: u64,
        /// Which set (see `concealed sets`).
        #[arg(long)]
        set: String,
        /// How many cases.
        #[arg(long)]
        count: usize,
    },
    /// Lists the sets.
    Sets,
    /// Drives the very robot of a case through other commands: same hidden physics, new noise.
    Drive {
        /// Key file of the case's set.
        #[arg(long)]
        key: PathBuf,
        /// Name of the case.
        #[arg(long)]
        case: String,
        /// CSV with the columns t, v_ref, omega_ref; each row is held until the next.
        #[arg(long)]
        commands: PathBuf,
        /// CSV to write; its times go on where the case's clock stood.
        #[arg(long)]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    let done = match Arguments::parse().task {
        Task::Make { out, key, seed, set, count } => make(&out, &key, seed, &set, count),
        Task::Sets => {
            sets();
            Ok(())
        }
        Task::Drive { key, case, commands, out } => drive(&key, &case, &commands, &out),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("concealed: {error}");
            ExitCode::from(2)
        }
    }
}

fn sets() {
    for set in plan::SETS {
        println!("{:<8}  {}", set.name, set.words);
    }
}

fn make(out: &Path, key: &Path, seed: u64, set: &str, count: usize) -> Result<(), Error> {
    folder::apart(key, out)?;
    let recipes = plan::recipes(plan::set(set)?, seed, count);
    folder::create(out)?;
    let entry = |(name, recipe): &(String, _)| -> Result<Entry, Error> {
        let made = case::make(name, recipe);
        let home = out.join(name);
        folder::create(&home)?;
        for (file, text) in &made.files {
            folder::write(&home.join(file), text)?;
        }
        Ok(made.entry)
    };
    let cases = recipes.par_iter().map(entry).collect::<Result<Vec<_>, _>>()?;
    let seal = folder::write_key(key, &Key { schema: SCHEMA.to_owned(), cases })?;
    println!("{seal}  {}", key.display());
    Ok(())
}

fn drive(key_path: &Path, name: &str, command_path: &Path, out: &Path) -> Result<(), Error> {
    let key = folder::read_key(key_path)?;
    let found = key.cases.iter().find(|c| c.case == name).ok_or_else(|| Error::UnknownCase {
        key: key_path.into(),
        case: name.to_owned(),
        count: key.cases.len(),
        first: key.cases.first().map_or_else(String::new, |c| c.case.clone()),
    })?;
    let origin = &found.origin;
    let recipe = plan::recipe(plan::set(&origin.set)?, origin.seed, origin.index, origin.count);
    folder::write(out, &case::further(&recipe, &commands::read(command_path)?))
}
