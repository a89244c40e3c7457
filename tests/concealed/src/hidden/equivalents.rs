//! Which other names are the same mathematics on a recording, declared before anybody diagnoses it.
//!
//! The rules: while no wheel turns back, friction laws differ by nothing but a constant; rolling resistance is dry friction; an old speed is
//! a late command where nothing else is recorded; under slow driving a lag is a delay; a wheel of another size is a gain where wheel speeds are
//! not recorded; under slow driving viscous drag of one side is a gain; counting encoders average over a row, which is half a row of delay.

use std::collections::BTreeSet;

/// What decides whether two effects can be told apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circumstances {
    /// Whether any wheel turned both ways.
    pub reverses: bool,
    /// Share of the time in which the slower wheel was slower than twice the Stribeck speed (0 without one).
    pub crawls: f64,
    /// Highest angular frequency of the commands \[rad/s\].
    pub bandwidth: f64,
    /// Longer time constant of the servo \[s\].
    pub time: f64,
    /// Delay or lag, where one is hidden \[s\].
    pub late: f64,
    /// Whether wheel speeds are recorded.
    pub wheels: bool,
    /// Step of counted speeds over the noise of forward speed.
    pub coarseness: f64,
}

/// Below this product of bandwidth and time, first-order phase is all that is left of a lag.
const SLOW: f64 = 0.5;

/// Names, or sets of names, that do as well as `name`.
fn alternatives(name: &str, form: Option<&str>, c: &Circumstances) -> Vec<Vec<&'static str>> {
    const FRICTION: [&str; 3] = ["coulomb_friction", "rolling_resistance", "direction_asymmetry"];
    const LATE: [&str; 3] = ["command_delay", "sensor_delay", "actuator_lag"];
    let singles = |names: &[&'static str]| names.iter().filter(|n| **n != name).map(|n| vec![*n]).collect::<Vec<_>>();
    let slow_delay = c.bandwidth * c.late < SLOW;
    match name {
        "coulomb_friction" | "rolling_resistance" | "direction_asymmetry" if !c.reverses => {
            let mut all = singles(&FRICTION);
            all.push(vec!["stribeck_friction"]);
            all
        }
        "stribeck_friction" if !c.reverses && c.crawls < 0.03 => singles(&FRICTION),
        "coulomb_friction" | "rolling_resistance" => singles(&FRICTION[..2]),
        "dead_zone" if form.is_some_and(|f| f.starts_with("dead band")) => vec![vec!["coulomb_friction"]],
        "sensor_delay" if form == Some("one axis only") => Vec::new(),
        "command_delay" | "sensor_delay" => {
            let mut names: Vec<&str> = if c.wheels { Vec::new() } else { LATE[..2].to_vec() };
            if slow_delay {
                names.push("actuator_lag");
            }
            singles(&names)
        }
        "actuator_lag" if slow_delay => {
            if c.wheels {
                vec![vec!["command_delay"]]
            } else {
                singles(&LATE)
            }
        }
        "gain_asymmetry" | "wheel_radius_mismatch" | "viscous_asymmetry" => {
            let mut names: Vec<&str> =
                if c.wheels || name == "viscous_asymmetry" { Vec::new() } else { vec!["gain_asymmetry", "wheel_radius_mismatch"] };
            if c.bandwidth * c.time < SLOW && !(name == "wheel_radius_mismatch" && c.wheels) {
                names.extend(["gain_asymmetry", "viscous_asymmetry"]);
            }
            names.sort_unstable();
            names.dedup();
            singles(&names)
        }
        "encoder_quantisation" => {
            let mut all = vec![vec!["encoder_quantisation", "sensor_delay"], vec!["encoder_quantisation", "command_delay"]];
            if c.coarseness < 1.0 {
                all.extend([vec!["sensor_delay"], vec!["command_delay"]]);
            }
            all
        }
        _ => Vec::new(),
    }
}

/// Sets of names, other than the truth, that are the same mathematics; `truth` are names and forms.
pub fn acceptable(truth: &[(&str, Option<&str>)], circumstances: &Circumstances) -> Vec<Vec<String>> {
    let mut sets: Vec<BTreeSet<String>> = vec![BTreeSet::new()];
    for (name, form) in truth {
        let mut choices: Vec<Vec<&str>> = vec![vec![name]];
        choices.extend(alternatives(name, *form, circumstances));
        sets = sets
            .iter()
            .flat_map(|set| choices.iter().map(move |names| set.iter().cloned().chain(names.iter().map(|n| (*n).to_owned())).collect()))
            .collect();
    }
    let own: BTreeSet<String> = truth.iter().map(|(name, _)| (*name).to_owned()).collect();
    let mut seen = BTreeSet::new();
    sets.retain(|set| *set != own && seen.insert(set.clone()));
    sets.into_iter().map(|set| set.into_iter().collect()).collect()
}
