//! Effects: physics that a model leaves out, as an object that changes a simulation at one of three places.
//!
//! A model with effects is again something that can be simulated, from command to recording:
//!
//! command → *command effects* → u → **model** with *loads* taken off u and *drive effects* on what is left to accelerate →
//! outputs → *sensor effects* → recording
//!
//! Every model here is an equation whose right side is its input, so a force that a model leaves out is the part of the
//! input that it uses up: friction in m/s of command or in volts, whatever the model commands. One law therefore serves
//! all models. [`Frame`] tells an effect how a model's channels are forward and angular velocity, and left and right wheel.

mod course;
mod frame;
mod scene;
mod simulation;

use std::fmt::Debug;

use serde::Serialize;

pub use frame::Frame;
pub use scene::{Instant, Scales, Scene, Track};
pub use simulation::{Direction, EffectSimulator};

/// Where an effect acts. Effects of one simulation act in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Command: transport in time (delay).
    Transport,
    /// Command: limit of its rate of change.
    Ramp,
    /// Command: threshold below which nothing arrives.
    Threshold,
    /// Command: limit of its size.
    Limit,
    /// Command: gains of wheels and of the supply.
    Gain,
    /// Command: filters behind the rest.
    Filter,
    /// Command: added by an outer loop that compares with the outputs.
    Loop,
    /// Dynamics: input used up at the wheels, by their bearings and motors, before anything reaches the ground.
    Bearing,
    /// Dynamics: input used up by a force on the robot that the model lacks.
    Load,
    /// Dynamics: what the motors have left to accelerate.
    Drive,
    /// Dynamics: what the ground carries of it.
    Contact,
    /// Dynamics: what it accelerates.
    Inertia,
    /// Measurement: what sensors make of the outputs.
    Sensor,
    /// Measurement: when that is looked at.
    Reading,
}

/// The three places of which a person speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// Between what was sent and what drives.
    Command,
    /// In the robot's motion.
    Dynamics,
    /// Between what happened and what was recorded.
    Measurement,
}

impl Stage {
    /// The place this stage belongs to.
    pub fn place(self) -> Place {
        match self {
            Self::Bearing | Self::Load | Self::Drive | Self::Contact | Self::Inertia => Place::Dynamics,
            Self::Reading | Self::Sensor => Place::Measurement,
            _ => Place::Command,
        }
    }
}

/// Distance from a bound that rounding leaves, as a share of a parameter's scale.
const ROUNDING: f64 = 1e-6;

/// One parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// Name, such as `delay`; with a side or an axis, `label` tells which.
    pub name: String,
    /// SI unit; `1` for a pure number.
    pub unit: String,
    /// Physical bounds: a friction is not negative.
    pub bounds: (f64, f64),
    /// Plausible size in this scene: difference steps and starts are measured in it.
    pub scale: f64,
    /// The value at which the effect (or this part of it) does nothing; `None` for a shape that has no such value. That of a limit is
    /// infinite, also where its bounds are not.
    pub neutral: Option<f64>,
    /// Side or axis: `("wheel", "left")`, `("axis", "omega")`.
    pub label: Option<(&'static str, String)>,
    /// The value it has on most robots, and how far it usually is from it; `None` where any value within its bounds is as likely. It speaks
    /// where the data do not: a shape that was never excited would otherwise be whatever the noise makes of it.
    pub usual: Option<(f64, f64)>,
    /// Whether it says how something stood when a recording began: a matter of that recording and not of the robot, fitted anew to every one.
    pub initial: bool,
}

impl EffectParameter {
    /// A parameter without a neutral value or a label.
    pub fn new(name: &str, unit: &str, bounds: (f64, f64), scale: f64) -> Self {
        Self { name: name.to_owned(), unit: unit.to_owned(), bounds, scale, neutral: None, label: None, usual: None, initial: false }
    }

    /// The same with the value at which it does nothing.
    #[must_use]
    pub fn neutral(mut self, value: f64) -> Self {
        self.neutral = Some(value);
        self
    }

    /// The same with the value it usually has, and how far it is from it.
    #[must_use]
    pub fn usually(mut self, value: f64, spread: f64) -> Self {
        self.usual = Some((value, spread));
        self
    }

    /// The same as what differs from recording to recording.
    #[must_use]
    pub fn initially(mut self) -> Self {
        self.initial = true;
        self
    }

    /// Whether a value is neutral but for what rounding leaves of a bound.
    pub fn is_neutral(&self, value: f64) -> bool {
        self.neutral.is_some_and(|neutral| (value - neutral).abs() <= ROUNDING * self.scale.abs())
    }

    /// The bound that a size has come to, if it has: not that at which it does nothing, and not that of a shape with a usual value, which is at its bounds
    /// where the data do not tell.
    pub fn extreme(&self, value: f64) -> Option<f64> {
        let sized = self.neutral.is_some() && self.usual.is_none() && !self.is_neutral(value);
        let (low, high) = self.bounds;
        [low, high].into_iter().find(|bound| sized && (value - bound).abs() <= ROUNDING * self.scale.abs())
    }

    /// The same with a side or an axis.
    #[must_use]
    pub fn of(mut self, kind: &'static str, which: &str) -> Self {
        self.label = Some((kind, which.to_owned()));
        self
    }
}

/// A point of parameter space from which an effect is tried, and the columns by which it is screened there.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Value of each parameter.
    pub values: Vec<f64>,
    /// One column of the linearised problem each: the parameters that take their value while those of the other columns
    /// are neutral. Parameters in no column keep their value throughout.
    pub columns: Vec<Vec<usize>>,
    /// Whether the response is proportional to the columns' parameters, so that their amplitude is free; otherwise a
    /// column is the response of exactly these values and counts as it is.
    pub linear: bool,
}

/// An estimated value with its interval, for sentences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// 95 % interval, if there is an honest one.
    pub ci95: Option<(f64, f64)>,
}

impl Estimate {
    /// Values without intervals.
    pub fn bare(values: &[f64]) -> Vec<Self> {
        values.iter().map(|value| Self { value: *value, ci95: None }).collect()
    }
}

/// Another effect that looks alike, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Confusion {
    /// Name of the other effect, or of a model parameter.
    pub with: &'static str,
    /// When and why, in one sentence.
    pub because: &'static str,
}

/// What a drive effect sees of the motion. Without drive effects nobody asks for `inertia`, `drag` and `held`: they are zero then.
#[derive(Debug, Clone, Copy)]
pub struct Motion<'a> {
    /// The command behind the command effects.
    pub u: &'a [f64],
    /// Outputs.
    pub outputs: &'a [f64],
    /// Inputs that one unit of acceleration of each output needs, row-major, inputs × outputs.
    pub inertia: &'a [f64],
    /// Inputs that one unit of each output takes to be held, by the linear part of the model, row-major, inputs × outputs.
    pub drag: &'a [f64],
    /// Inputs that the ground has to give besides those that accelerate the robot: the part of the model that is not linear, and the loads on
    /// the robot itself.
    pub held: &'a [f64],
}

/// Physics that a model leaves out. Plain data with its settings, picked by `type = "NAME"`, as a solver is.
///
/// An effect implements the hooks of its [`stage`](Self::stage) and no other, unless it [`senses`](Self::senses) too. `p` are
/// the values of its parameters in the order of [`parameters`](Self::parameters), `state` its own numbers, which start at
/// [`begin`](Self::begin). A hook allocates nothing and returns finite numbers for finite arguments within bounds.
#[typetag::serde]
pub trait Effect: Debug + Send + Sync {
    /// Name under which configurations and results know it (contract, section 5).
    fn name(&self) -> &str;

    /// One line on what it is, for `wheelwright plugins`.
    fn about(&self) -> String;

    /// Where it acts.
    fn stage(&self) -> Stage;

    /// Effects of one family are variants of one cause (frictions; delay and lag): two of them are never put into one
    /// explanation side by side. Parts of a cause that may stand together, a side or an axis each, are written below it:
    /// `slew_limit/v` beside `slew_limit/omega`, neither beside `slew_limit`. By default an effect is a family of its own.
    fn family(&self) -> &str {
        self.name()
    }

    /// Whether it can act on this frame and scene: an effect on wheels needs to know them, a slope needs headings.
    /// The reason why not, for a person, or `None` if it applies.
    fn inapplicable(&self, _scene: &Scene) -> Option<String> {
        None
    }

    /// Its parameters, scaled to a scene.
    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter>;

    /// Points from which it is tried, in the order of the search; none where no run finds it.
    fn starts(&self, scene: &Scene) -> Vec<Start>;

    /// Other values worth a look from fitted ones, where the likelihood has many maxima side by side: a time of change shows only
    /// while something changes.
    fn detours(&self, _values: &[f64], _scene: &Scene) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// Whether its values are the time constants \[s\] of lags in series with the model's own, one for each input: linear motion does not tell
    /// which of the two is which.
    fn in_series(&self) -> bool {
        false
    }

    /// Other values worth a look once everything else has been found: of a part that is too rare to be looked for while something else is missing,
    /// which it would stand in for.
    fn afterthoughts(&self, _values: &[f64], _scene: &Scene) -> Vec<Vec<f64>> {
        Vec::new()
    }

    /// The same values where a part of the effect that goes round stood by `angle` \[rad\] further when the recording began: that is a matter
    /// of a recording, not of the robot, and is fitted anew to every one. Parts are counted from 0; `None` if there is no such part.
    fn turned(&self, _values: &[f64], _part: usize, _angle: f64) -> Option<Vec<f64>> {
        None
    }

    /// The same values where the robot headed elsewhere by `angle` \[rad\] when the recording began. Where no heading is measured that is a matter of a
    /// recording as well. `None` where the heading is nothing to it.
    fn heading_elsewhere(&self, _values: &[f64], _angle: f64) -> Option<Vec<f64>> {
        None
    }

    /// The multiple of a wheel's turning at which it leaves a line. An effect that has one is tried only where such a line stands out of what
    /// everything else leaves over: it is too rare to be tried on every recording. By default there is none.
    fn line(&self) -> Option<f64> {
        None
    }

    /// Whether it is tried only in the place of another effect of its name or family that was found: what looks like that one and is too rare to be
    /// sought on every recording.
    fn stands_in(&self) -> bool {
        false
    }

    /// Whether its likelihood has many maxima, since what it does hangs on moments, such as when teeth meet: it is looked for by a walk over its values.
    fn rugged(&self) -> bool {
        false
    }

    /// Families of two effects that it is at once: it is tried in the place of both where they were found beside one another.
    fn at_once(&self) -> Option<[&'static str; 2]> {
        None
    }

    /// One plain sentence with magnitudes and units: "the left wheel's motor needs 0.31 V before it moves; the model had none".
    /// It names an interval where there is one.
    fn statement(&self, values: &[Estimate], scene: &Scene) -> String;

    /// What fitted values say that is more than this effect: a filter that rings has something elastic in it. In a sentence; `None` if nothing.
    fn beyond(&self, _values: &[Estimate]) -> Option<String> {
        None
    }

    /// The name of the effect that this one is with these values, where a part of it does nothing: friction at one of two wheels.
    fn narrower(&self, _values: &[f64], _scene: &Scene) -> Option<&'static str> {
        None
    }

    /// The name under which a person is told of these values, if that is not its own: of an effect in the library with the same parameters and the same
    /// motion, which needs no [`starts`](Self::starts). Dry friction of nearly one size at both wheels is not that of one wheel.
    fn told_as(&self, _values: &[f64]) -> Option<&'static str> {
        None
    }

    /// Names of the effects that this one is with some of its values: friction by direction is dry friction where both directions have the
    /// same. It takes their place only if it explains markedly more than they do.
    fn contains(&self) -> &'static [&'static str] {
        &[]
    }

    /// Whether it is tried only where the noise goes on from sample to sample, as it may be no noise: what has too many starts to be tried on every
    /// recording, such as whatever changes with the place.
    fn last_resort(&self) -> bool {
        false
    }

    /// What a step with it costs, in terms of one with friction: a search has so much to spend.
    fn effort(&self) -> u64 {
        1
    }

    /// The motion that shows it: "slow driving in both directions, through standstill".
    fn excitation(&self) -> &'static str;

    /// What it is confused with, and why.
    fn confusions(&self) -> &'static [Confusion] {
        &[]
    }

    /// Numbers of state it needs.
    fn states(&self, _scene: &Scene) -> usize {
        0
    }

    /// Sets the state at the start of a stretch, from the command [before](Instant::before) it and the initial outputs.
    fn begin(&self, _p: &[f64], _at: &Instant<'_>, _inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state.fill(0.0);
    }

    /// The next time after `time` at which the effect switches by itself, so that no step spans it. Infinite if never. The
    /// state is the one after the command has arrived.
    fn next_switch(&self, _p: &[f64], _at: &Instant<'_>, _state: &[f64]) -> f64 {
        f64::INFINITY
    }

    /// Command effects: lets `at.span` seconds pass up to `at.time` and changes `u` from what arrived to what goes on. `u` is
    /// the arriving command at `at.time`, `outputs` for a [loop](Stage::Loop) the outputs then; all others are asked before a step is taken, and
    /// get those at its start. A span of zero follows each switch of the command.
    fn command(&self, _p: &[f64], _at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], _u: &mut [f64]) {}

    /// Command effects: whether the command that goes on stays as it is while the arriving one does, unless the effect
    /// [switches](Self::next_switch): then it is asked once where either happens and not at every step between. Not so where it
    /// depends on the time, the outputs or a state.
    fn holds(&self) -> bool {
        false
    }

    /// Loads: adds the input that is used up at this instant to `load`, in the model's input channels.
    fn load(&self, _p: &[f64], _at: &Instant<'_>, _outputs: &[f64], _state: &[f64], _load: &mut [f64]) {}

    /// Drive effects: changes `drive`, the input that is left for acceleration: inertia × acceleration in the model's
    /// input channels.
    fn drive(&self, _p: &[f64], _at: &Instant<'_>, _motion: &Motion<'_>, _state: &[f64], _drive: &mut [f64]) {}

    /// Loads and drive effects with state: lets `at.span` seconds pass up to `at.time`, in a motion and at the drive before any
    /// drive effect. Called twice a step with equal spans: up to its middle with the drive of its start, and up to its end with the
    /// drive of its middle.
    fn advance(&self, _p: &[f64], _at: &Instant<'_>, _motion: &Motion<'_>, _drive: &[f64], _state: &mut [f64]) {}

    /// Drive effects: changes `outputs` to what [loops](Stage::Loop) take for them, by encoders that err.
    fn perceived(&self, _p: &[f64], _at: &Instant<'_>, _outputs: &mut [f64]) {}

    /// Drive effects: whether loops take something else for the outputs, by [`perceived`](Self::perceived).
    fn deceives(&self) -> bool {
        false
    }

    /// Loads and drive effects: whether they change what is recorded as well, by the hook of the sensors. Encoders at the motor
    /// count what happens before the wheel.
    fn senses(&self) -> bool {
        false
    }

    /// Sensor effects, and others that [sense](Self::senses): changes the outputs that are recorded at a sample, once a sample in their
    /// order, the first included.
    /// `past(t, out)` writes the true outputs at an earlier time of the stretch; before it, its first. To what acts at [`Stage::Reading`] it
    /// writes what all other sensors made of them.
    fn measure(&self, _p: &[f64], _at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], _outputs: &mut [f64]) {}
}
