//! A robot built by a recipe, and its drives.
//!
//! One clock runs through a case: the first recording begins at zero, the second begins [`PAUSE`] seconds after the first has ended, a further
//! drive as much later again. What changes with time (a load put on, a battery) goes on across them. Each drive begins at rest on the same mark.

use super::recipe::{Recipe, Sort};
use crate::draw::robot::Machine;
use crate::draw::stream;
use crate::firmware::Command;
use crate::firmware::control::Style;
use crate::hidden::forms::FORMS;
use crate::hidden::outside::{Known, OUTSIDE};
use crate::hidden::{Demands, Parameters, Subject, demands, effect};
use crate::referee::lumped::Lumped;
use crate::sensors::trace::Trace;
use rand::Rng;
use rand::rngs::StdRng;
use std::f64::consts::PI;

/// Time between two drives of a case \[s\].
pub const PAUSE: f64 = 20.0;

/// Longest further drive foreseen for what happens at times \[s\].
const FURTHER: f64 = 300.0;

/// A robot with what is hidden in it.
#[derive(Clone, Debug)]
pub struct Built {
    /// The robot without anything hidden.
    pub plain: Machine,
    /// The robot.
    pub machine: Machine,
    /// Parameters of each effect.
    pub parameters: Vec<Parameters>,
    /// What is known of an outside cause.
    pub known: Known,
    /// Commands of the two recordings.
    pub commands: [Vec<Command>; 2],
    /// Commands as they are written: the same, unless they are another drive's.
    pub written: [Vec<Command>; 2],
    /// Heading of the mark on which each drive begins \[rad\].
    pub heading: f64,
}

/// Moments of the rows of a recording.
fn stamps<R: Rng>(start: f64, length: f64, rate: f64, lost: f64, rng: &mut R) -> Vec<f64> {
    let rows = (length * rate).round() as usize + 1;
    let kept = |k: usize, rng: &mut R| k == 0 || rng.random::<f64>() >= lost;
    (0..rows).filter(|&k| kept(k, rng)).map(|k| ((start + k as f64 / rate) * 1e6).round() / 1e6).collect()
}

impl Built {
    /// Builds a recipe's robot and draws its commands; `leave` names an effect (by its number in the recipe) that is left out.
    pub fn new(recipe: &Recipe, leave: Option<usize>) -> Built {
        let plain = Machine::draw(recipe.kind, recipe.style, &mut recipe.chance(2));
        let starts = [0.0, recipe.length[0] + PAUSE];
        let draw =
            |rows: &[f64], k: usize, rng: &mut StdRng| recipe.manner[k].commands(rows, plain.typical, plain.firmware.half_track, rng);
        let commands = [0, 1].map(|k| {
            let rng = &mut recipe.chance(3 + k as u64);
            let rows = stamps(starts[k], recipe.length[k], recipe.rate, recipe.lost, rng);
            draw(&rows, k, rng)
        });
        let written = if recipe.sort == Sort::Stranger {
            [0, 1].map(|k| {
                let rows: Vec<f64> = commands[k].iter().map(|c| c.t).collect();
                draw(&rows, k, &mut recipe.chance(40 + k as u64))
            })
        } else {
            commands.clone()
        };
        let mut machine = plain.clone();
        let asked = demands(&plain, &commands[0]);
        let mut parameters = Vec::new();
        let mut known = Known::default();
        for (k, ingredient) in recipe.effects.iter().enumerate() {
            let mut subject = subject(recipe, &mut machine, ingredient.strength, asked);
            let mut scratch;
            if leave == Some(k) {
                // Draws the same numbers and changes nothing.
                scratch = plain.clone();
                subject = Subject { machine: &mut scratch, ..subject };
            }
            let rng = &mut recipe.chance(20 + k as u64);
            let hide = ingredient.form.map_or_else(|| effect(ingredient.name).map(|e| e.hide), |form| Some(FORMS[form].hide));
            parameters.push(hide.map(|hide| hide(&mut subject, rng)).unwrap_or_default());
        }
        if let Some((which, strength)) = recipe.outside {
            known = (OUTSIDE[which].hide)(&mut subject(recipe, &mut machine, strength, asked), &mut recipe.chance(30));
        }
        let heading = recipe.chance(5).random_range(-PI..PI);
        Built { plain, machine, parameters, known, commands, written, heading }
    }

    /// Drives the robot through commands; `purpose` chooses the luck of its messages.
    pub fn drive(&self, recipe: &Recipe, commands: &[Command], purpose: u64) -> Trace {
        let end = commands.last().map_or(0.0, |c| c.t) + 0.5;
        let mut luck = recipe.chance(purpose);
        Trace::drive(&self.machine.rig, &self.machine.firmware, commands, end, self.heading, || luck.random())
    }

    /// When the second recording ends \[s\].
    pub fn end(&self) -> f64 {
        self.commands[1].last().map_or(0.0, |c| c.t)
    }

    /// The robot without anything hidden in lumped numbers.
    pub fn lumped(&self) -> Lumped {
        let m = &self.plain;
        let moment = m.rig.body.mass * m.rig.body.forward;
        let feedback = if m.firmware.control.style == Style::Open { 0.0 } else { 1.0 };
        let [forward, turning] = m.times();
        [
            forward,
            turning,
            moment / m.servo[0],
            feedback + m.drag[0] / m.servo[0],
            moment / m.servo[1],
            feedback + m.drag[1] / m.servo[1],
            1.0,
            1.0,
        ]
    }

    /// A generator apart from all of the case's own, for noise of further drives.
    pub fn further_chance(recipe: &Recipe, words: u64) -> StdRng {
        stream(recipe.origin.seed, &[recipe.origin.index as u64, 0xd41e, words])
    }
}

fn subject<'a>(recipe: &Recipe, machine: &'a mut Machine, strength: f64, asked: Demands) -> Subject<'a> {
    Subject {
        machine,
        strength,
        span: (0.0, recipe.length[0]),
        until: recipe.length[0] + recipe.length[1] + 2.0 * PAUSE + FURTHER,
        row: 1.0 / recipe.rate,
        asked,
    }
}
