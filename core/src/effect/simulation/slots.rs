//! The effects of a simulation in the order in which they act, sorted by hook once so that no step asks an effect for nothing.

use std::ops::Range;

use crate::effect::{Effect, EffectParameter, Instant, Motion, Place, Scene, Stage};

/// An effect with its parameters and where its numbers are.
#[derive(Debug, Clone)]
pub(super) struct Slot<'a> {
    effect: &'a dyn Effect,
    /// First of its values in the caller's order.
    first: usize,
    values: Vec<f64>,
    states: Range<usize>,
    stage: Stage,
    senses: bool,
}

/// All effects, by hook.
#[derive(Debug, Clone)]
pub(super) struct Slots<'a> {
    slots: Vec<Slot<'a>>,
    /// Where in the order the effects of each hook are.
    commands: Range<usize>,
    bearings: Range<usize>,
    loads: Range<usize>,
    drives: Range<usize>,
    /// Whether the command that goes on hangs on the outputs.
    pub(super) looped: bool,
    /// Whether those loops take something else for the outputs.
    deceived: bool,
    /// Whether anything changes what is recorded.
    pub(super) sensed: bool,
    /// Whether what sensors make of the outputs is looked at at other times.
    pub(super) reread: bool,
    /// Whether a load or a drive effect has numbers that change along the way.
    pub(super) advancing: bool,
    /// Whether the command that goes on changes within a step, and hangs on no output: the whole step of it is known before any of it is taken.
    pub(super) ahead: bool,
    /// Whether the accelerations at the end of a step are those at the start of the next one while the command is the same.
    pub(super) lasting: bool,
    /// Whether nothing but the outputs themselves carries on a change of them, so that tangents are all there is to know.
    pub(super) plain: bool,
    /// Whether something may set in anywhere within a step without its start and its middle telling.
    pub(super) abrupt: bool,
    /// Numbers of all states together.
    pub(super) states: usize,
}

impl<'a> Slots<'a> {
    /// With values that are neutral or, without a neutral value, those of the first start.
    pub(super) fn new(effects: &[&'a dyn Effect], scene: &Scene) -> Self {
        let (mut first, mut states) = (0, 0);
        let mut slots = Vec::with_capacity(effects.len());
        for &effect in effects {
            let parameters = effect.parameters(scene);
            let start = effect.starts(scene).into_iter().next().map(|s| s.values);
            let value =
                |(i, p): (usize, &EffectParameter)| p.neutral.or_else(|| start.as_ref().and_then(|s| s.get(i).copied())).unwrap_or(p.scale);
            let values: Vec<f64> = parameters.iter().enumerate().map(value).collect();
            let range = states..states + effect.states(scene);
            let stage = effect.stage();
            slots.push(Slot {
                effect,
                first,
                values,
                states: range.clone(),
                stage,
                senses: stage.place() == Place::Measurement || effect.senses(),
            });
            first += parameters.len();
            states = range.end;
        }
        slots.sort_by_key(|s| s.stage);
        let before = |end: &dyn Fn(Stage) -> bool| slots.partition_point(|s| end(s.stage));
        let commands = 0..before(&|s| s.place() == Place::Command);
        let bearings = commands.end..before(&|s| s <= Stage::Bearing);
        let loads = bearings.end..before(&|s| s <= Stage::Load);
        let drives = loads.end..before(&|s| s.place() != Place::Measurement);
        // What goes on changes only where a piece of an interval begins.
        let held = slots[commands.clone()].iter().all(|s| s.effect.holds());
        let looped = slots.iter().any(|s| s.stage == Stage::Loop);
        let advancing = slots[bearings.start..drives.end].iter().any(|s| !s.states.is_empty());
        let deceived = looped && slots.iter().any(|s| s.effect.deceives());
        let sensed = slots.iter().any(|s| s.senses);
        let reads = |s: &Slot<'_>| s.stage == Stage::Reading;
        let reread = slots.iter().any(reads) && slots.iter().any(|s| s.senses && !reads(s));
        let ahead = !held && !looped;
        let abrupt = !drives.is_empty() || advancing;
        let plain = !(looped || abrupt || sensed);
        let lasting = held && plain;
        Self {
            slots,
            commands,
            bearings,
            loads,
            drives,
            looped,
            deceived,
            sensed,
            reread,
            advancing,
            ahead,
            lasting,
            plain,
            abrupt,
            states,
        }
    }

    /// Whether the command that goes on changes within a step.
    #[inline(always)]
    pub(super) fn steers(&self) -> bool {
        self.ahead || self.looped
    }

    /// Replaces all values, given in the caller's order.
    pub(super) fn set(&mut self, values: &[f64]) {
        for slot in &mut self.slots {
            let n = slot.values.len();
            slot.values.copy_from_slice(&values[slot.first..slot.first + n]);
        }
    }

    /// The same with other values; none where they are the same.
    pub(super) fn moved(&self, values: &[f64]) -> Option<Self> {
        let same = |slot: &Slot<'_>| slot.values == values[slot.first..slot.first + slot.values.len()];
        (!self.slots.iter().all(same)).then(|| {
            let mut moved = self.clone();
            moved.set(values);
            moved
        })
    }

    /// Whether one of the values, in the caller's order, is that of a force that does not set in at a time of its own.
    pub(super) fn of_force(&self, value: usize, at: &Instant<'_>) -> bool {
        let forces = &self.slots[self.bearings.start..self.loads.end];
        let own = |slot: &&Slot<'_>| (slot.first..slot.first + slot.values.len()).contains(&value);
        forces
            .iter()
            .find(own)
            .is_some_and(|slot| slot.states.is_empty() && slot.effect.next_switch(&slot.values, at, &[]) == f64::INFINITY)
    }

    /// Whether forces act that may set in where something comes to rest.
    #[inline(always)]
    pub(super) fn rubs(&self) -> bool {
        self.bears() || self.loads()
    }

    pub(super) fn bears(&self) -> bool {
        !self.bearings.is_empty()
    }

    pub(super) fn loads(&self) -> bool {
        !self.loads.is_empty()
    }

    pub(super) fn driven(&self) -> bool {
        !self.drives.is_empty()
    }

    /// Sets all states at the start of a stretch; `u` becomes the command that goes on.
    pub(super) fn begin(&self, at: &Instant<'_>, initial: &[f64], state: &mut [f64], u: &mut [f64]) {
        u.iter_mut().enumerate().for_each(|(i, u)| *u = at.before(i));
        let before = Instant { time: at.time - at.scene.scales.period, ..*at };
        for slot in &self.slots {
            let state = &mut state[slot.states.clone()];
            slot.effect.begin(&slot.values, at, u, initial, state);
            if slot.stage.place() == Place::Command {
                self.pass_on(slot, &before, initial, state, u);
            }
        }
        self.command(at, initial, state, u);
    }

    /// The first time after `after` at which an effect switches, or `end`.
    #[inline(always)]
    pub(super) fn next_switch(&self, at: &Instant<'_>, state: &[f64], after: f64, end: f64) -> f64 {
        let switches = self.slots.iter().map(|s| s.effect.next_switch(&s.values, at, &state[s.states.clone()]));
        switches.filter(|t| *t > after).fold(end, f64::min)
    }

    /// The command held now, passed through the command effects, with `at.span` seconds gone by.
    #[inline(always)]
    pub(super) fn command(&self, at: &Instant<'_>, outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        arrive(at, u);
        for slot in &self.slots[self.commands.clone()] {
            self.pass_on(slot, at, outputs, &mut state[slot.states.clone()], u);
        }
    }

    /// The command passed through one of them.
    #[inline(always)]
    fn pass_on(&self, slot: &Slot<'_>, at: &Instant<'_>, outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        match outputs {
            // Wheels, and so encoders that err, are those of a robot with two outputs.
            &[first, second] if self.deceived && slot.stage == Stage::Loop => {
                let mut seen = [first, second];
                self.slots.iter().for_each(|s| s.effect.perceived(&s.values, at, &mut seen));
                slot.effect.command(&slot.values, at, &seen, state, u);
            }
            _ => slot.effect.command(&slot.values, at, outputs, state, u),
        }
    }

    /// What is used up at the wheels.
    #[inline(always)]
    pub(super) fn bear(&self, at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        self.use_up(&self.bearings, at, outputs, state, load);
    }

    /// What is used up by forces on the robot.
    #[inline(always)]
    pub(super) fn load(&self, at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        self.use_up(&self.loads, at, outputs, state, load);
    }

    #[inline(always)]
    fn use_up(&self, by: &Range<usize>, at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        load.fill(0.0);
        for slot in &self.slots[by.clone()] {
            slot.effect.load(&slot.values, at, outputs, &state[slot.states.clone()], load);
        }
    }

    /// What is left to accelerate.
    #[inline(always)]
    pub(super) fn drive(&self, at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        for slot in &self.slots[self.drives.clone()] {
            slot.effect.drive(&slot.values, at, motion, &state[slot.states.clone()], drive);
        }
    }

    /// States of loads and drive effects.
    #[inline(always)]
    pub(super) fn advance(&self, at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        for slot in self.slots[self.bearings.start..self.drives.end].iter().filter(|s| !s.states.is_empty()) {
            slot.effect.advance(&slot.values, at, motion, drive, &mut state[slot.states.clone()]);
        }
    }

    /// What sensors make of the outputs.
    pub(super) fn sense(&self, at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], seen: &mut [f64]) {
        self.measure(|stage| stage != Stage::Reading, at, past, state, seen);
    }

    /// When that is looked at; `past` is what they made of earlier ones.
    pub(super) fn read(&self, at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], seen: &mut [f64]) {
        self.measure(|stage| stage == Stage::Reading, at, past, state, seen);
    }

    fn measure(&self, of: impl Fn(Stage) -> bool, at: &Instant<'_>, past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], seen: &mut [f64]) {
        for slot in self.slots.iter().filter(|s| s.senses && of(s.stage)) {
            slot.effect.measure(&slot.values, at, past, &mut state[slot.states.clone()], seen);
        }
    }
}

/// The command as it was sent.
#[inline(always)]
fn arrive(at: &Instant<'_>, u: &mut [f64]) {
    u.iter_mut().zip(&at.stretch.inputs).for_each(|(u, column)| *u = column[at.row]);
}
