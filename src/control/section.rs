//! `[track]`, `[simulation]`, `[source]` and `[migrate]` of a configuration.

use serde::Deserialize;
use toml::Table;
use wheelwright_controllers::migration::GainRule;

/// `[track]`: how the trajectory is laid, for how long, and what ends it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackSection {
    /// Length \[s\]; the trajectory's own, one round of a closed one, if absent.
    pub duration: Option<f64>,
    /// Where the trajectory begins.
    pub start: Start,
    /// Factor on the trajectory's lengths.
    pub size: f64,
    /// Factor on its pace, or `"limits"`: slowed, if need be, until it fills no more than `fill` of any limit.
    pub pace: Pace,
    /// Share of the robot's limits that `pace = "limits"` may fill.
    pub fill: f64,
    /// Distance error at which the robot is stopped \[m\]; it is never, if absent.
    pub off_course: Option<f64>,
    /// Standard deviations of measured v \[m/s\] and omega \[rad/s\], for foretelling drift.
    pub noise: Option<[f64; 2]>,
    /// The robot's own parameters, where the controller starts from others: its stability depends on both.
    pub own_theta: Option<Vec<f64>>,
    /// Drives although something dangerous was foreseen.
    pub force: bool,
}

impl Default for TrackSection {
    fn default() -> Self {
        Self {
            duration: None,
            start: Start::Robot,
            size: 1.0,
            pace: Pace::Factor(1.0),
            fill: 0.9,
            off_course: None,
            noise: None,
            own_theta: None,
            force: false,
        }
    }
}

/// Where a trajectory begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// At the robot: it is turned and moved to begin at the pose measured first.
    Robot,
    /// Where its own coordinates say.
    World,
}

/// How fast a trajectory is run.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Pace {
    /// A factor on time's pace.
    Factor(f64),
    /// As the robot's limits allow.
    Limits(WithinLimits),
}

/// The word `limits`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WithinLimits {
    /// Within the limits.
    Limits,
}

/// `[simulation]`: model and controller integrated together, in place of a robot; nothing is sampled, noisy or limited.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulationSection {
    /// The simulated robot's own parameters.
    pub theta: Vec<f64>,
    /// Runge-Kutta step \[s\].
    #[serde(default = "step")]
    pub step: f64,
    /// Start with the trajectory's velocities; from rest without.
    #[serde(default = "yes")]
    pub moving: bool,
    /// First position and heading off the trajectory's: ahead \[m\], to the left \[m\], turned \[rad\].
    #[serde(default)]
    pub offset: [f64; 3],
}

fn step() -> f64 {
    0.02
}

fn yes() -> bool {
    true
}

/// `[source]`: the robot that the controller was tuned on.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceSection {
    /// Its model: `file`, or `type` and `theta`.
    pub model: Table,
    /// Its control period \[s\].
    pub period: f64,
    /// Its controller, `inverse-dynamics` or `adaptive`.
    pub controller: Table,
}

/// `[migrate]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MigrateSection {
    /// What becomes of the gains.
    pub gains: GainRule,
    /// Identify the target even if its parameters are given. Without parameters it is always identified.
    pub identify: bool,
    /// Settings of the adaptation in the run that adapts: keys of `adaptive` beside the gains.
    pub adaptation: Option<Table>,
    /// Parameters of a controller identified natively on the target, to compare with. If absent, and the target is a
    /// simulation, a second identification with other noise stands for it.
    pub native_theta: Option<Vec<f64>>,
    /// Drives the comparisons too: unmigrated, all ones, native. On a robot in real time only those that are stable.
    pub compare: bool,
}

impl Default for MigrateSection {
    fn default() -> Self {
        Self { gains: GainRule::default(), identify: false, adaptation: None, native_theta: None, compare: true }
    }
}
