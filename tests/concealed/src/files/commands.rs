//! Reads a file of commands: CSV with the columns `t,v_ref,omega_ref`, others are ignored.

use crate::error::Error;
use crate::firmware::Command;
use std::path::Path;

/// Reads commands; times must rise.
pub fn read(path: &Path) -> Result<Vec<Command>, Error> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::File { what: "read", path: path.into(), source })?;
    let fault = |row: usize, reason: String| Error::Commands { path: path.into(), row, reason };
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let header: Vec<&str> = lines.next().map(|(_, line)| line.split(',').map(str::trim).collect()).unwrap_or_default();
    let column = |name: &str| {
        header.iter().position(|h| *h == name).ok_or_else(|| fault(1, format!("no column \"{name}\": wanted are t, v_ref and omega_ref")))
    };
    let (t, v, omega) = (column("t")?, column("v_ref")?, column("omega_ref")?);
    let mut commands: Vec<Command> = Vec::new();
    for (k, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |at: usize| {
            let cell = cells.get(at).copied().unwrap_or("");
            cell.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| fault(k + 1, format!("\"{cell}\" is not a finite number")))
        };
        let command = Command { t: number(t)?, v: number(v)?, omega: number(omega)? };
        if commands.last().is_some_and(|last| last.t >= command.t) {
            return Err(fault(k + 1, format!("time {} does not rise", command.t)));
        }
        commands.push(command);
    }
    if commands.len() < 2 {
        return Err(fault(1, format!("{} rows: a drive needs at least two", commands.len())));
    }
    Ok(commands)
}
