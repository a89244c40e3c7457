//! What named columns of a file become: the one meaning of column names, shared by every reader of tables.

use std::path::Path;

use wheelwright_core::channel;
use wheelwright_core::recording::{Column, ColumnMap, ReadError, ReadOptions, Recording, RecordingError, Segment, Source, Stream, list};

use crate::assemble::{Rows, absent_hint};

/// Columns read as segment labels, the first that is there.
const SEGMENT_NAMES: [&str; 3] = ["segment", "test", "run"];

/// What a column of the file is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Numbers that must all be there and finite: time, the contract's names, mapped columns.
    Number,
    /// Segment labels.
    Label,
    /// A column the contract does not name: kept if it holds nothing but finite numbers.
    Extra,
    /// Not read.
    Ignored,
}

/// One column of the recording: `value = scale × file value + offset`.
#[derive(Debug, Clone)]
struct Output {
    name: String,
    source: usize,
    scale: f64,
    offset: f64,
}

/// The roles of a file's columns, decided from their names and the options before any value is read.
#[derive(Debug)]
pub(crate) struct Plan {
    names: Vec<String>,
    roles: Vec<Role>,
    time: Output,
    outputs: Vec<Output>,
    warnings: Vec<String>,
}

/// The values of one column of the file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Values {
    /// One number a row, or nothing for labels and ignored columns.
    pub(crate) numbers: Vec<f64>,
    /// What the file calls the type, such as `number` or `INT64`.
    pub(crate) kind: String,
    /// SI unit of a column that the contract does not name; empty for the contract's or none.
    pub(crate) unit: String,
    /// Why an extra column is left out, once it is.
    pub(crate) left_out: Option<LeftOut>,
}

/// Why an extra column is not in the recording.
#[derive(Debug, Clone)]
pub(crate) enum LeftOut {
    /// It holds text: no surprise.
    Text,
    /// Place and reason, worth a warning.
    Broken(String),
}

impl Plan {
    /// Decides what each column is for.
    ///
    /// # Errors
    /// [`ReadError`] for a mapping that cannot be meant, two columns of one needed name, or no time column.
    pub(crate) fn new(names: Vec<String>, options: &ReadOptions) -> Result<Self, ReadError> {
        let mut plan =
            Self { roles: vec![Role::Extra; names.len()], names, time: identity("t", 0), outputs: Vec::new(), warnings: Vec::new() };
        plan.check_unique(options)?;
        let mapped = plan.map_columns(&options.columns)?;
        plan.find_segments(&mapped);
        plan.keep_the_rest(&mapped);
        plan.find_time()?;
        Ok(plan)
    }

    /// The role of each column, in the file's order.
    pub(crate) fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The column names, in the file's order.
    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    fn check_unique(&mut self, options: &ReadOptions) -> Result<(), ReadError> {
        for (i, name) in self.names.iter().enumerate() {
            let again = self.names[..i].contains(name);
            let needed = is_contract_name(name) || options.columns.iter().any(|m| m.from == *name);
            if again && needed {
                let reason = "two columns have this name; rename or remove one".to_owned();
                return Err(ReadError::Malformed { position: format!("header, column `{name}`"), reason });
            }
            if again || name.is_empty() {
                self.roles[i] = Role::Ignored;
            }
            if again && !name.is_empty() {
                self.warnings.push(format!("column `{name}` appears more than once: only the first is kept"));
            }
        }
        Ok(())
    }

    /// Adds mapped outputs; returns the names they give, which file columns of the same names yield to.
    fn map_columns(&mut self, maps: &[ColumnMap]) -> Result<Vec<String>, ReadError> {
        let mut targets = Vec::new();
        for map in maps {
            check_map(map, &targets)?;
            let source = self.names.iter().position(|n| *n == map.from).ok_or_else(|| ReadError::Malformed {
                position: position_of(map),
                reason: format!("no column `{}`; {}", map.from, absent_hint(&map.from, self.present())),
            })?;
            let role = if map.name == "segment" { Role::Label } else { Role::Number };
            if !matches!(self.roles[source], Role::Extra) && self.roles[source] != role {
                let reason = format!("`{}` cannot give both labels and numbers", map.from);
                return Err(ReadError::Malformed { position: position_of(map), reason });
            }
            self.roles[source] = role;
            if map.name != "segment" {
                self.outputs.push(Output { name: map.name.clone(), source, scale: map.scale, offset: map.offset });
            }
            targets.push(map.name.clone());
        }
        Ok(targets)
    }

    fn find_segments(&mut self, mapped: &[String]) {
        if mapped.iter().any(|n| n == "segment") {
            return;
        }
        let label = SEGMENT_NAMES.iter().find_map(|name| self.names.iter().position(|n| n == name));
        if let Some(source) = label.filter(|&i| self.roles[i] == Role::Extra) {
            self.roles[source] = Role::Label;
        }
    }

    fn keep_the_rest(&mut self, mapped: &[String]) {
        for (source, name) in self.names.iter().enumerate() {
            if self.roles[source] != Role::Extra {
                continue;
            }
            if mapped.contains(name) {
                self.roles[source] = Role::Ignored;
                self.warnings.push(format!("column `{name}` gives way to the mapping to `{name}`"));
                continue;
            }
            if is_contract_name(name) {
                self.roles[source] = Role::Number;
            }
            self.outputs.push(identity(name, source));
        }
    }

    fn find_time(&mut self) -> Result<(), ReadError> {
        let Some(index) = self.outputs.iter().position(|o| o.name == "t") else {
            return Err(RecordingError::MissingColumn { name: "t".to_owned(), available: list(self.present()) }.into());
        };
        self.time = self.outputs.remove(index);
        Ok(())
    }

    fn present(&self) -> impl Iterator<Item = &str> + Clone {
        self.names.iter().map(String::as_str).filter(|n| !n.is_empty())
    }

    /// Builds the recording from the values of every column. `segments` is empty where the file has no labels.
    ///
    /// # Errors
    /// [`ReadError`] as of [`Rows::into_recording`].
    pub(crate) fn assemble(
        mut self,
        mut values: Vec<Values>,
        segments: Vec<Segment>,
        path: &Path,
        format: &str,
        locate: &dyn Fn(usize) -> String,
    ) -> Result<Recording, ReadError> {
        let mut uses = vec![0usize; values.len()];
        for output in self.outputs.iter().chain([&self.time]) {
            uses[output.source] += 1;
        }
        let time = take(&mut values, &mut uses, &self.time);
        let rows = time.len();
        let streams = streams(&self, &values, rows);
        let outputs = std::mem::take(&mut self.outputs);
        let kept = outputs.into_iter().filter(|o| values[o.source].left_out.is_none()).collect::<Vec<_>>();
        let columns = kept.iter().map(|o| column(&mut values, &mut uses, o)).collect();
        let segments = if segments.is_empty() { vec![Segment { label: "0".to_owned(), rows: 0..rows }] } else { segments };
        let source = Source { path: path.to_owned(), format: format.to_owned() };
        let mut recording = Rows { time, columns, segments }.into_recording(source, locate)?;
        recording.streams = streams;
        let broken = values.iter().filter_map(|v| match &v.left_out {
            Some(LeftOut::Broken(why)) => Some(format!("{why}: the column is left out")),
            _ => None,
        });
        recording.warnings.extend(self.warnings.into_iter().chain(broken));
        Ok(recording)
    }
}

fn column(values: &mut [Values], uses: &mut [usize], output: &Output) -> Column {
    let mut column = Column::new(output.name.clone(), take(values, uses, output));
    if column.unit.is_empty() {
        column.unit.clone_from(&values[output.source].unit);
    }
    column
}

/// The scaled values of an output; the last use of a file column takes its values without a copy.
fn take(values: &mut [Values], uses: &mut [usize], output: &Output) -> Vec<f64> {
    let source = output.source;
    uses[source] -= 1;
    let mut numbers = if uses[source] == 0 { std::mem::take(&mut values[source].numbers) } else { values[source].numbers.clone() };
    if output.scale != 1.0 || output.offset != 0.0 {
        numbers.iter_mut().for_each(|v| *v = output.scale * *v + output.offset);
    }
    numbers
}

fn streams(plan: &Plan, values: &[Values], rows: usize) -> Vec<Stream> {
    let described = plan.names.iter().zip(&plan.roles).zip(values);
    described
        .map(|((name, role), values)| Stream {
            name: name.clone(),
            kind: values.kind.clone(),
            count: rows as u64,
            used: *role != Role::Ignored && values.left_out.is_none(),
        })
        .collect()
}

fn identity(name: &str, source: usize) -> Output {
    Output { name: name.to_owned(), source, scale: 1.0, offset: 0.0 }
}

fn is_contract_name(name: &str) -> bool {
    !channel::unit_of(name).is_empty()
}

fn position_of(map: &ColumnMap) -> String {
    format!("mapping {}={}", map.name, map.from)
}

/// Refuses a mapping that cannot be meant, whatever the file.
pub(crate) fn check_map(map: &ColumnMap, targets: &[String]) -> Result<(), ReadError> {
    let reason = if !map.scale.is_finite() || map.scale == 0.0 {
        format!("scale = {} would leave nothing; give a finite factor other than zero", map.scale)
    } else if !map.offset.is_finite() {
        format!("offset = {} is not a finite number", map.offset)
    } else if map.name.is_empty() {
        "the name to map to is empty; write NAME=COLUMN".to_owned()
    } else if targets.contains(&map.name) {
        format!("`{}` is mapped twice; keep one", map.name)
    } else {
        return Ok(());
    };
    Err(ReadError::Malformed { position: position_of(map), reason })
}
