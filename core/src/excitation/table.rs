//! `table`: commands written out row by row and held from each row to the next, as a designed experiment or another
//! recording gives them.
//!
//! ```toml
//! [excitation]
//! type = "table"
//! time = [0.0, 1.0, 3.0]
//! commands = { v_ref = [0.0, 0.3, 0.0], omega_ref = [0.0, 0.0, 0.5] }
//! duration = 5.0                  # the last row lasts this long; as long as the row before it if absent
//! ```
//!
//! The program reads `file = "commands.csv"` in place of `time` and `commands`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Excitation, ExcitationError, check_channel, check_duration};
use crate::channel::Channel;

/// Commands row by row.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandTable {
    /// Time of each row \[s\], from zero, increasing; at least two rows.
    pub time: Vec<f64>,
    /// One column a channel, in its unit, as long as `time`.
    pub commands: BTreeMap<String, Vec<f64>>,
    /// Length \[s\]; the last row is held as long as the one before it if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duration: Option<f64>,
}

#[typetag::serde(name = "table")]
impl Excitation for CommandTable {
    fn about(&self) -> String {
        "commands row by row, each held until the next".to_owned()
    }

    fn duration(&self) -> f64 {
        let held = match self.time.as_slice() {
            [.., before, last] => 2.0 * last - before,
            _ => 0.0,
        };
        self.duration.unwrap_or(held)
    }

    fn check(&self, inputs: &[Channel]) -> Result<(), ExcitationError> {
        if self.time.len() < 2 || self.commands.is_empty() {
            let reason =
                format!("has {} rows of {} channels: at least two rows of one channel are needed", self.time.len(), self.commands.len());
            return Err(ExcitationError::config("time", reason));
        }
        if self.time[0] != 0.0 {
            return Err(ExcitationError::config("time", format!("starts at {} s: the first row is at 0", self.time[0])));
        }
        if let Some(k) = (1..self.time.len()).find(|&k| !(self.time[k].is_finite() && self.time[k] > self.time[k - 1])) {
            let reason = format!("row {} is at {} s, not after {} s: times must increase", k + 1, self.time[k], self.time[k - 1]);
            return Err(ExcitationError::config("time", reason));
        }
        for (channel, values) in &self.commands {
            check_channel(channel, inputs)?;
            let key = || format!("commands.{channel}");
            if values.len() != self.time.len() {
                return Err(ExcitationError::config(key(), format!("has {} values for {} rows", values.len(), self.time.len())));
            }
            if let Some(k) = values.iter().position(|v| !v.is_finite()) {
                return Err(ExcitationError::config(key(), format!("row {} is {}, not a finite number", k + 1, values[k])));
            }
        }
        check_duration(self.duration())
    }

    fn command(&self, t: f64, inputs: &[Channel], command: &mut [f64]) {
        let row = self.time.partition_point(|start| *start <= t).max(1) - 1;
        for (channel, value) in inputs.iter().zip(command) {
            *value = self.commands.get(channel.name.as_ref()).and_then(|column| column.get(row)).copied().unwrap_or(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::{OMEGA_REF, V_REF};

    fn table() -> CommandTable {
        let commands = [("v_ref".to_owned(), vec![0.1, 0.3, -0.2])];
        CommandTable { time: vec![0.0, 1.0, 3.0], commands: commands.into(), duration: None }
    }

    #[test]
    fn a_row_is_held_until_the_next_and_the_last_as_long_as_the_one_before() {
        let table = table();
        table.check(&[V_REF, OMEGA_REF]).unwrap();
        assert_eq!(table.duration(), 5.0);
        for (t, v) in [(0.0, 0.1), (0.999, 0.1), (1.0, 0.3), (2.9, 0.3), (3.0, -0.2), (9.0, -0.2)] {
            let mut command = [7.0, 7.0];
            table.command(t, &[V_REF, OMEGA_REF], &mut command);
            assert_eq!(command, [v, 0.0], "at {t} s");
        }
    }

    #[test]
    fn impossible_tables_name_their_key_and_row() {
        let refused = |change: &dyn Fn(&mut CommandTable)| {
            let mut table = table();
            change(&mut table);
            table.check(&[V_REF, OMEGA_REF]).unwrap_err().to_string()
        };
        assert!(refused(&|t| t.time[2] = 1.0).contains("`time`: row 3 is at 1 s, not after 1 s"));
        assert!(refused(&|t| t.time[0] = 0.5).contains("starts at 0.5 s"));
        assert!(refused(&|t| t.time.truncate(1)).contains("1 rows of 1 channels"));
        assert!(refused(&|t| drop(t.commands.insert("u".to_owned(), Vec::new()))).contains("no command `u`"));
        assert!(
            refused(&|t| drop(t.commands.insert("v_ref".to_owned(), vec![0.0, f64::NAN, 0.0]))).contains("`commands.v_ref`: row 2 is NaN")
        );
        assert!(refused(&|t| drop(t.commands.insert("v_ref".to_owned(), vec![0.0]))).contains("1 values for 3 rows"));
        assert!(refused(&|t| t.duration = Some(0.0)).contains("`duration`"));
    }
}
