//! What is shown while a robot drives: speeds asked and measured, time left, what limits hold back, how far it is from where it should
//! be, and how much of the space of commands has been visited.

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use wheelwright_core::channel::Channel;
use wheelwright_core::drive::DriveProgress;
use wheelwright_core::excitation::Excitation;

use super::console::Console;
use crate::report::track::metres;

/// Cells of the picture of commands, across and up.
const CELLS: (usize, usize) = (24, 8);
/// Time between two pictures.
const REFRESH: Duration = Duration::from_millis(100);
/// Width of the bar of time.
const BAR: usize = 30;
/// Shades of a cell, from never visited to visited often.
const SHADES: [char; 4] = ['·', '░', '▒', '█'];

/// The space of the first two commands: which of the cells that the excitation plans to visit were visited.
#[derive(Debug, Clone)]
pub(super) struct Coverage {
    /// Most of each command, either way.
    reach: [f64; 2],
    planned: Vec<bool>,
    visits: Vec<u32>,
}

impl Coverage {
    /// The cells an excitation will visit.
    pub(super) fn plan(excitation: &dyn Excitation, duration: f64, period: f64, inputs: &[Channel]) -> Self {
        let rows = ((duration / period).ceil()).clamp(1.0, 1e6) as usize;
        let mut command = vec![0.0; inputs.len()];
        let planned: Vec<[f64; 2]> = (0..rows)
            .map(|k| {
                excitation.command(k as f64 * period, inputs, &mut command);
                pair(&command)
            })
            .collect();
        let most = |i: usize| planned.iter().map(|c| c[i].abs()).filter(|x| x.is_finite()).fold(0.0, f64::max);
        let cells = CELLS.0 * CELLS.1;
        let mut coverage = Self { reach: [most(0), most(1)], planned: vec![false; cells], visits: vec![0; cells] };
        for command in planned {
            let cell = coverage.cell(command);
            coverage.planned[cell] = true;
        }
        coverage
    }

    pub(super) fn visit(&mut self, command: &[f64]) {
        let cell = self.cell(pair(command));
        self.visits[cell] += 1;
    }

    /// Share of the planned cells that were visited.
    pub(super) fn share(&self) -> f64 {
        let both = self.planned.iter().zip(&self.visits).filter(|(p, v)| **p && **v > 0).count();
        both as f64 / self.planned.iter().filter(|p| **p).count().max(1) as f64
    }

    fn cell(&self, command: [f64; 2]) -> usize {
        let along = |value: f64, reach: f64, cells: usize| {
            let share = if reach > 0.0 { 0.5 + 0.5 * value / reach } else { 0.5 };
            // A value that is no number goes to the first cell.
            ((share * cells as f64) as usize).min(cells - 1)
        };
        along(command[1], self.reach[1], CELLS.1) * CELLS.0 + along(command[0], self.reach[0], CELLS.0)
    }

    fn picture(&self, text: &mut String) {
        for up in (0..CELLS.1).rev() {
            let row = up * CELLS.0..(up + 1) * CELLS.0;
            let shade = |i: usize| match (self.planned[i], self.visits[i]) {
                (false, 0) => ' ',
                (_, n) => SHADES[(n as usize).min(SHADES.len() - 1)],
            };
            let _ = write!(text, "\n  |{}|", row.map(shade).collect::<String>());
        }
    }
}

fn pair(command: &[f64]) -> [f64; 2] {
    [command.first().copied().unwrap_or(0.0), command.get(1).copied().unwrap_or(0.0)]
}

/// Paints on a thread of its own: a terminal that does not take its text, as after ctrl-S, must not hold up a command.
struct Painter {
    pictures: Option<SyncSender<String>>,
    thread: Option<JoinHandle<()>>,
}

impl Painter {
    fn start() -> Self {
        let (pictures, received) = sync_channel(1);
        Self { pictures: Some(pictures), thread: Some(std::thread::spawn(move || paint(&received))) }
    }

    /// Shows a picture unless the one before is still being painted.
    fn show(&self, text: String) {
        if let Some(pictures) = &self.pictures {
            let _ = pictures.try_send(text);
        }
    }
}

impl Drop for Painter {
    fn drop(&mut self) {
        self.pictures = None;
        if let Some(thread) = self.thread.take() {
            // A painter that panicked has nothing left to show.
            let _ = thread.join();
        }
    }
}

/// Each picture over the one before; the last is wiped.
fn paint(pictures: &Receiver<String>) {
    let mut up = String::new();
    for text in pictures {
        let _ = write!(std::io::stderr().lock(), "{up}\r\x1b[J{text}");
        let lines = text.matches('\n').count();
        up = if lines > 0 { format!("\x1b[{lines}A") } else { String::new() };
    }
    let _ = write!(std::io::stderr().lock(), "{up}\r\x1b[J");
}

/// The view of a running drive.
pub(super) struct View {
    painter: Option<Painter>,
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    coverage: Option<Coverage>,
    /// Largest distance from where the robot should have been \[m\].
    farthest: f64,
    held: bool,
    drawn: Option<Instant>,
}

impl View {
    pub(super) fn new(console: &Console, inputs: &[Channel], outputs: &[Channel], coverage: Option<Coverage>, held: bool) -> Self {
        let painter = console.is_live().then(Painter::start);
        Self { painter, inputs: inputs.to_vec(), outputs: outputs.to_vec(), coverage, farthest: 0.0, held, drawn: None }
    }

    /// Share of the planned commands that were visited, if any were planned.
    pub(super) fn visited(&self) -> Option<f64> {
        self.coverage.as_ref().map(Coverage::share)
    }

    /// Takes a row and, now and then, shows it.
    pub(super) fn update(&mut self, progress: &DriveProgress<'_>) {
        if let Some(coverage) = &mut self.coverage {
            coverage.visit(progress.command);
        }
        self.farthest = self.farthest.max(progress.distance.unwrap_or(0.0));
        let Some(painter) = self.painter.as_ref().filter(|_| self.drawn.is_none_or(|drawn| drawn.elapsed() >= REFRESH)) else { return };
        painter.show(self.text(progress));
        self.drawn = Some(Instant::now());
    }

    fn text(&self, progress: &DriveProgress<'_>) -> String {
        let share = (progress.t / progress.duration).clamp(0.0, 1.0);
        let full = (share * BAR as f64) as usize;
        let bar = "#".repeat(full) + &".".repeat(BAR - full);
        let left = (progress.duration - progress.t).max(0.0);
        let stop = if self.held { "let the key go to stop" } else { "ctrl-C stops" };
        let mut text = format!("{:7.1} s [{bar}] {left:.1} s left, {stop}", progress.t);
        // Writing to a String cannot fail.
        for (channel, value) in self.inputs.iter().zip(progress.command) {
            let measured = channel.name.strip_suffix("_ref").and_then(|name| self.outputs.iter().position(|c| c.name == name));
            let answer = measured.map_or(String::new(), |i| format!("   measured {:9.4}", progress.measured[i]));
            let _ = write!(text, "\n  {:<12} {value:9.4} {}{answer}", channel.name, channel.unit);
        }
        let held_back = progress.bites.iter().map(|b| format!("{} ({})", b.limit, b.commands)).collect::<Vec<_>>().join(", ");
        let _ = write!(text, "\n  held back: {}", if held_back.is_empty() { "nothing" } else { &held_back });
        if let Some(distance) = progress.distance {
            let _ = write!(text, "\n  distance error: {} now, {} at most", metres(distance), metres(self.farthest));
        }
        if let Some(coverage) = &self.coverage {
            let names = self.inputs.iter().take(2).map(|c| c.name.as_ref()).collect::<Vec<_>>().join(" across, ");
            let _ = write!(text, "\n  commands visited: {:.0} % of the plan ({names} up)", 100.0 * coverage.share());
            coverage.picture(&mut text);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wheelwright_core::channel::{OMEGA_REF, V, V_REF};
    use wheelwright_core::excitation::thesis::ThesisPioneer;

    #[test]
    fn a_drive_that_follows_its_plan_covers_it() {
        let inputs = [V_REF, OMEGA_REF];
        let plan = ThesisPioneer::default();
        let mut coverage = Coverage::plan(&plan, 150.0, 0.1, &inputs);
        assert_eq!(coverage.share(), 0.0);
        let mut command = [0.0; 2];
        let mut half = 0.0;
        for k in 0..1500 {
            plan.command(0.1 * f64::from(k), &inputs, &mut command);
            coverage.visit(&command);
            half = if k == 400 { coverage.share() } else { half };
        }
        assert!(half > 0.1 && half < 0.95, "{half}");
        assert_eq!(coverage.share(), 1.0);
    }

    #[test]
    fn a_robot_on_a_trajectory_shows_how_far_it_is_off() {
        let mut view = View::new(&Console::new(false, true), &[V_REF], &[V], None, false);
        let at = |t: f64, distance: f64| DriveProgress {
            t,
            duration: 20.0,
            command: &[0.3],
            measured: &[0.29],
            bites: &[],
            distance: Some(distance),
        };
        view.update(&at(4.0, 0.0482));
        view.update(&at(5.0, 0.0123));
        // A number and its unit are joined by a narrow space.
        let text = view.text(&at(5.0, 0.0123)).replace(crate::report::number::THIN, " ");
        assert!(text.contains("distance error: 12.3 mm now, 48.2 mm at most"), "{text}");
        assert!(text.contains("15.0 s left, ctrl-C stops") && text.contains("measured    0.2900"), "{text}");
        assert_eq!(view.visited(), None);
    }

    #[test]
    fn a_plan_that_stands_still_has_one_cell() {
        let still = wheelwright_core::excitation::signals::Signals { duration: 1.0, signals: Vec::new() };
        let mut coverage = Coverage::plan(&still, 1.0, 0.1, &[V_REF]);
        coverage.visit(&[0.0]);
        assert_eq!(coverage.share(), 1.0);
    }
}
