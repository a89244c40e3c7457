//! The loop over samples, pieces and steps.
//!
//! It is written once for any number of outputs `N` and as many inputs, with 0 for numbers that are only known when it runs: two
//! outputs whose linear part is diagonal, which nearly every robot on two wheels has, are then a handful of instructions a step.

use super::linear::Linear;
use super::pace::{Measure, Steps};
use super::slots::Slots;
use super::tangents::Along;
use super::{BEND, EffectSimulator, OVERFLOW};
use crate::dataset::Stretch;
use crate::effect::{Frame, Instant, Scene};
use crate::model::{ModelError, RegressorModel};
use crate::simulation::{Readout, row, square_row};

/// Share of a step before its end that is the end, but for what switches there.
const JUST: f64 = 1e-6;
/// How many times as long as the longest step a piece may be that is one.
const SAME: f64 = 1.0 + 1e-6;

/// Outputs and inputs of the step in progress.
#[derive(Debug)]
pub(super) struct Body {
    pub(super) x: Vec<f64>,
    kept: Kept,
    /// Whether `n0` is that of the step to come, and `n1` of the one after it.
    known: bool,
    mid: Vec<f64>,
    n0: Vec<f64>,
    nm: Vec<f64>,
    n1: Vec<f64>,
    next: Vec<f64>,
    u: Vec<f64>,
    /// Commands of which the line through a step's start and its middle is the nearest to what arrives; where it is held, the one before.
    start: Vec<f64>,
    middle: Vec<f64>,
    travelled: Vec<f64>,
    /// One over the root mean square of each output.
    fineness: Vec<f64>,
    work: Work,
}

/// What a step changes, as it was before.
#[derive(Debug)]
struct Kept {
    u: Vec<f64>,
    travelled: Vec<f64>,
    trace: usize,
}

/// Inputs on their way to accelerations.
#[derive(Debug)]
pub(super) struct Work {
    /// What is left of the command.
    pub(super) net: Vec<f64>,
    load: Vec<f64>,
    drive: Vec<f64>,
    /// The drive before the drive effects.
    given: Vec<f64>,
    /// What the ground has to give besides.
    held: Vec<f64>,
}

impl Body {
    pub(super) fn new(outputs: usize, inputs: usize, scene: &Scene) -> Self {
        let (buffer, input) = (|| vec![0.0; outputs], || vec![0.0; inputs]);
        Self {
            x: buffer(),
            kept: Kept { u: input(), travelled: buffer(), trace: 0 },
            known: false,
            mid: buffer(),
            n0: buffer(),
            nm: buffer(),
            n1: buffer(),
            next: buffer(),
            u: input(),
            start: input(),
            middle: input(),
            travelled: buffer(),
            fineness: scene.scales.outputs.iter().map(|s| 1.0 / s).collect(),
            work: Work { net: input(), load: input(), drive: input(), given: input(), held: input() },
        }
    }

    /// How many outputs there are.
    #[inline(always)]
    fn outputs<const N: usize>(&self) -> usize {
        if N == 0 { self.x.len() } else { N }
    }

    /// Whether the run has left the range in which numbers can be squared and multiplied.
    #[inline(always)]
    fn lost(&self) -> bool {
        let within = |x: &[f64]| x.iter().fold(true, |all, x| all & (x.abs() < OVERFLOW));
        !(within(&self.x) & within(&self.mid) & within(&self.next))
    }
}

impl EffectSimulator<'_> {
    /// Runs over rows of stretch number `s` from `initial`.
    pub(super) fn run_rows(
        &mut self,
        s: usize,
        stretch: &Stretch,
        rows: std::ops::Range<usize>,
        initial: &[f64],
        simulated: &mut [Vec<f64>],
    ) -> Result<(), ModelError> {
        let (scene, readout) = (self.scene, self.readout);
        let first = Instant::of_sample(stretch, rows.start, &scene.tracks[s], scene, readout);
        for (i, out) in simulated.iter_mut().enumerate() {
            out.clear();
            out.reserve(rows.len());
            out.push(initial[i]);
        }
        self.stretch = s;
        self.measure = self.measure();
        if !self.follows {
            self.paces.resize_with(self.paces.len().max(s + 1), Steps::default);
            self.paces[s].clear();
        }
        self.body.known = false;
        self.body.x.copy_from_slice(initial);
        self.trace.truncate(0, 0);
        self.added.clear();
        self.slots.begin(&first, initial, &mut self.state, &mut self.body.u);
        if self.slots.sensed {
            // A sensor sees the first sample too.
            self.trace.push(first.time, &self.body.x, None);
            self.body.next.copy_from_slice(initial);
            self.sense(&first);
            simulated.iter_mut().zip(&self.body.next).for_each(|(out, seen)| out[0] = *seen);
        }
        let rows = rows.start + 1..rows.end;
        let two = self.body.x.len() == 2 && self.body.u.len() == 2;
        match (if two { 2 } else { 0 }, self.linear.diagonal) {
            (2, true) => self.proceed::<2, true>(&first, rows, simulated),
            (2, false) => self.proceed::<2, false>(&first, rows, simulated),
            (_, true) => self.proceed::<0, true>(&first, rows, simulated),
            (_, false) => self.proceed::<0, false>(&first, rows, simulated),
        }
    }

    /// Goes on from the row before `rows`.
    fn proceed<const N: usize, const DIAGONAL: bool>(
        &mut self,
        first: &Instant<'_>,
        rows: std::ops::Range<usize>,
        simulated: &mut [Vec<f64>],
    ) -> Result<(), ModelError> {
        let time = &first.stretch.time;
        for k in rows {
            let before = Instant { time: time[k - 1], row: k - 1, ..*first };
            let stepped = self.interval::<N, DIAGONAL>(&before, time[k]);
            // A model that runs away overflows, and then its accelerations are undetermined as well.
            if self.body.lost() {
                return Err(ModelError::Diverged { model: self.model.name().to_owned(), time: time[k] });
            }
            stepped?;
            let n = self.body.outputs::<N>();
            let Body { x, next, travelled, .. } = &mut self.body;
            let (x, next, travelled) = (&x[..n], &mut next[..n], &travelled[..n]);
            if self.readout == Readout::IntervalMean {
                let interval = time[k] - time[k - 1];
                next.iter_mut().zip(travelled).for_each(|(s, d)| *s = d / interval);
            } else {
                next.copy_from_slice(x);
            }
            if self.slots.sensed {
                let at = Instant { time: time[k], row: k, ..*first };
                self.trace.push(at.time, &self.body.x, None);
                self.sense(&at);
            }
            simulated.iter_mut().zip(&self.body.next).for_each(|(out, seen)| out.push(*seen));
            if let Some(tangents) = &mut self.tangents {
                tangents.sample((self.readout == Readout::IntervalMean).then(|| time[k] - time[k - 1]));
            }
        }
        Ok(())
    }

    /// Lets the sensors change what is recorded now, and when it is looked at.
    fn sense(&mut self, at: &Instant<'_>) {
        let Self { slots, trace, added, state, body: Body { next, .. }, .. } = self;
        if slots.reread {
            // Means over an interval are of its middle.
            let middle = if at.readout == Readout::IntervalMean { 0.5 * at.interval() } else { 0.0 };
            added.begin(at.time - middle, next);
        }
        slots.sense(at, &|time, out| trace.at(time, out), state, next);
        if slots.reread {
            added.end(next);
        }
        let seen = |time: f64, out: &mut [f64]| {
            trace.at(time, out);
            if slots.reread {
                added.add(time, out);
            }
        };
        slots.read(at, &seen, state, next);
    }

    /// The command that goes on from an instant; the accelerations at the end of the last step are those of the next one only if it is the same.
    #[inline(always)]
    fn command(&mut self, at: &Instant<'_>, same: bool) {
        let Body { x, u, start, known, .. } = &mut self.body;
        *known &= same && self.slots.lasting;
        if *known {
            start.copy_from_slice(u);
        }
        self.slots.command(at, x, &mut self.state, u);
        *known = *known && start == u;
    }

    /// Advances over the interval that begins at a sample.
    #[inline(always)]
    fn interval<const N: usize, const DIAGONAL: bool>(&mut self, first: &Instant<'_>, end: f64) -> Result<(), ModelError> {
        let (start, substeps) = (first.time, self.substeps);
        let longest = (end - start) / substeps as f64;
        // What is left after a switch this close to a sample is no step.
        let tolerance = 1e-9 * (end - start);
        let n = self.body.outputs::<N>();
        self.body.travelled[..n].fill(0.0);
        if !self.follows {
            self.paces[self.stretch].begin(first.row);
        }
        let (mut time, mut parts) = (start, 0);
        while end - time > tolerance {
            let at = Instant { time, ..*first };
            // What switches by itself may be something else from now on.
            self.command(&at, time == start);
            let switch = self.slots.next_switch(&at, &self.state, time + tolerance, end);
            let until = if end - switch > tolerance { switch } else { end };
            let whole = time == start && until == end;
            let (h, count) = if whole { (longest, substeps) } else { cut(until - time, longest, substeps) };
            parts = self.piece::<N, DIAGONAL>(&at, h, parts, count)?;
            time = until;
        }
        Ok(())
    }

    /// So many steps of one length: one that may miss too much is halved, and its halves again, and what comes after is as long again as fits. `from` is
    /// where the interval's parts have been counted to before; returns where to after.
    #[inline(always)]
    fn piece<const N: usize, const DIAGONAL: bool>(
        &mut self,
        first: &Instant<'_>,
        longest: f64,
        from: usize,
        count: usize,
    ) -> Result<usize, ModelError> {
        let Measure { allowed, deepest, finest } = self.measure;
        let shortest = longest * finest;
        let mut place = 0;
        let mut depth = self.depth(first.row, from, place, deepest);
        while place < count << deepest {
            let at = Instant { time: first.time + f64::from(place as u32) * shortest, ..*first };
            let h = shortest * f64::from(1_u32 << (deepest - depth));
            self.keep();
            self.linear.prepare(h);
            self.steps += 1;
            let missed = self.step::<N, DIAGONAL>(&at, h, allowed)?;
            if missed > allowed && depth < deepest {
                self.restore();
                self.halved = true;
                depth += 1;
                continue;
            }
            if self.tangents.is_some() {
                self.carry::<N, DIAGONAL>(&at, h)?;
            }
            std::mem::swap(&mut self.body.x, &mut self.body.next);
            std::mem::swap(&mut self.body.n0, &mut self.body.n1);
            place += 1 << (deepest - depth);
            if !self.follows {
                self.paces[self.stretch].push(from + place);
            }
            depth = depth.min(deepest - place.trailing_zeros().min(deepest)).max(self.depth(first.row, from, place, deepest));
        }
        Ok(from + place)
    }

    /// Carries tangents along the step that was just taken.
    fn carry<const N: usize, const DIAGONAL: bool>(&mut self, at: &Instant<'_>, h: f64) -> Result<(), ModelError> {
        let Self { model, theta, slots, state, linear, body: b, tangents, .. } = self;
        let Some(tangents) = tangents else { return Ok(()) };
        self.steps += tangents.effort;
        let n = b.outputs::<N>();
        let middle = Instant { time: at.time + 0.5 * h, span: 0.0, step: h, ..*at };
        let along = Along {
            at: &middle,
            outputs: [&b.x[..n], &b.mid[..n], &b.next[..n]],
            u: if slots.ahead { &b.middle } else { &b.u },
            state,
            fineness: &b.fineness,
        };
        let right = RightSide { model: *model, theta, slots, linear };
        tangents.carry::<N, DIAGONAL>(&right, &along, &mut b.work, h)
    }

    /// How often the longest step has to be halved, so that one that begins at a place is no longer than in the run that is followed.
    #[inline(always)]
    fn depth(&self, row: usize, from: usize, place: usize, deepest: u32) -> u32 {
        let kept = self.paces.get(self.stretch).filter(|_| self.follows);
        kept.and_then(|steps| steps.end(row, from + place))
            .map_or(0, |end| deepest.saturating_sub((end - from - place).ilog2()).min(deepest))
    }

    /// Keeps what a step changes besides the outputs.
    #[inline(always)]
    fn keep(&mut self) {
        let Body { u, travelled, kept, .. } = &mut self.body;
        if self.slots.steers() {
            kept.u.copy_from_slice(u);
        }
        if self.readout == Readout::IntervalMean {
            kept.travelled.copy_from_slice(travelled);
        }
        if !self.state.is_empty() {
            self.before.copy_from_slice(&self.state);
        }
        kept.trace = self.trace.len();
    }

    /// Takes it back.
    #[cold]
    fn restore(&mut self) {
        let Body { x, u, travelled, kept, .. } = &mut self.body;
        if self.slots.steers() {
            u.copy_from_slice(&kept.u);
        }
        if self.readout == Readout::IntervalMean {
            travelled.copy_from_slice(&kept.travelled);
        }
        self.trace.truncate(kept.trace, x.len());
        self.state.copy_from_slice(&self.before);
    }

    /// One step from `at`, to the next outputs; returns what it may miss, if that may be more than is allowed.
    #[inline(always)]
    fn step<const N: usize, const DIAGONAL: bool>(&mut self, at: &Instant<'_>, h: f64, allowed: f64) -> Result<f64, ModelError> {
        let Self { model, theta, slots, state, linear, body: b, trace, readout, .. } = self;
        let n = b.outputs::<N>();
        let size = if DIAGONAL { n } else { n * n };
        let ([half, half_forcing, full, start, middle], part) = (linear.weights(size), &linear.part[..size]);
        let (x, mid, next) = (&b.x[..n], &mut b.mid[..n], &mut b.next[..n]);
        let (n0, nm) = (&mut b.n0[..n], &mut b.nm[..n]);
        let at = &Instant { step: h, ..*at };
        let middle_at = Instant { time: at.time + 0.5 * h, span: 0.5 * h, ..*at };
        let end = Instant { time: at.time + h, span: 0.5 * h, ..*at };
        if slots.ahead {
            // What filters and ramps make of a command hangs on no output, and the whole step of it is known before any of it is taken.
            let m = if N == 0 { b.u.len() } else { N };
            let (starts, middles, u) = (&mut b.start[..m], &mut b.middle[..m], &mut b.u[..m]);
            starts.copy_from_slice(u);
            slots.command(&middle_at, x, state, u);
            middles.copy_from_slice(u);
            // Before what switches there.
            slots.command(&Instant { time: end.time - JUST * h, ..end }, x, state, u);
            straighten(starts, middles, u);
        }
        let right = RightSide { model: *model, theta, slots, linear };
        // Under a command that is held a step begins as the one before it has ended, or as the longer one has begun that it is a half of.
        if !(slots.lasting && b.known) {
            right.accelerations::<N>(at, x, if slots.ahead { &b.start } else { &b.u }, state, &mut b.work, n0)?;
            if slots.sensed {
                trace.push(at.time, x, Some(n0));
            }
            for (i, n0) in n0.iter_mut().enumerate() {
                *n0 -= row::<DIAGONAL>(part, i, x);
            }
        }
        for (i, mid) in mid.iter_mut().enumerate() {
            *mid = row::<DIAGONAL>(half, i, x) + row::<DIAGONAL>(half_forcing, i, n0);
        }
        if slots.looped {
            slots.command(&middle_at, mid, state, &mut b.u);
        }
        let u = if slots.ahead { &b.middle } else { &b.u };
        if slots.advancing {
            slots.advance(&middle_at, &linear.motion(u, mid, &b.work.held), &b.work.given, state);
        }
        right.accelerations::<N>(&middle_at, mid, u, state, &mut b.work, nm)?;
        let (mut bend, mut bowed, mut moved, mut held) = (0.0_f64, 0.0, 0.0, 0.0);
        for i in 0..n {
            nm[i] -= row::<DIAGONAL>(part, i, mid);
            let (bent, by) = ((nm[i] - n0[i]) * b.fineness[i], (mid[i] - x[i]) * b.fineness[i]);
            bend = bend.max(bent.abs());
            bowed += bent * bent;
            moved += by * by;
            held -= bent * by;
        }
        // Where commands or numbers of effects change within a step, what changes is not the outputs' doing alone.
        let firm = if slots.steers() || slots.advancing { 0.0 } else { h * held };
        let share = if firm > moved { implicit(firm / moved, h * bend) } else { 1.0 };
        if share < 1.0 {
            nm.iter_mut().zip(n0.iter()).for_each(|(nm, n0)| *nm = n0 + share * (*nm - n0));
        }
        for (i, next) in next.iter_mut().enumerate() {
            *next = row::<DIAGONAL>(full, i, x) + row::<DIAGONAL>(start, i, n0) + row::<DIAGONAL>(middle, i, nm);
        }
        if *readout == Readout::IntervalMean {
            for (i, travelled) in b.travelled[..n].iter_mut().enumerate() {
                *travelled += h / 6.0 * (x[i] + 4.0 * mid[i] + next[i]);
            }
        }
        if slots.looped {
            slots.command(&end, next, state, &mut b.u);
        }
        if slots.advancing {
            slots.advance(&end, &linear.motion(&b.u, next, &b.work.held), &b.work.given, state);
        }
        // The middle was reached by what acted at the start: where the right side hangs on the outputs it is another at the true one, by
        // hanging = reach √(bowed/moved).
        let reach = 0.25 * h * bend;
        let even = h * bend <= allowed && (h * reach).powi(2) * bowed <= allowed.powi(2) * moved;
        if even && !slots.abrupt && !(slots.rubs() && nears_rest(&at.scene.frame, x, next)) {
            b.known = false;
            return Ok(0.0);
        }
        let hanging = if moved > 0.0 { reach * (bowed / moved).sqrt() } else { 0.0 };
        // The step is exact for a right side that changes evenly. A third look tells a bend from a slope, and sees what only the second half meets, a wheel
        // that comes to rest: of a parabola a sixth of what the ends differ from twice the middle is missed.
        let n1 = &mut b.n1[..n];
        right.accelerations::<N>(&end, next, &b.u, state, &mut b.work, n1)?;
        let mut curved: f64 = 0.0;
        for i in 0..n {
            n1[i] -= row::<DIAGONAL>(part, i, next);
            let looked_at = n0[i] + (nm[i] - n0[i]) / share;
            curved = curved.max((n0[i] - 2.0 * looked_at + n1[i]).abs() * b.fineness[i]);
        }
        b.known = true;
        Ok(h * (curved / 6.0).max(hanging))
    }
}

/// The longest step of a part of an interval, and how many of them there are.
#[inline(always)]
fn cut(part: f64, longest: f64, substeps: usize) -> (f64, usize) {
    let needed = if part <= SAME * longest { 1 } else { (part / longest + 1.0 - SAME).ceil() as usize };
    // Where effects switch often they change fast: short pieces are refined as well when all are.
    let count = needed.max(substeps.div_ceil(2));
    (part / count as f64, count)
}

/// Puts the line through a step's start and its middle in the place of a command's values there, that which is the nearest to the parabola through them
/// and the last one: it has the parabola's mean, (u0 + 4 um + u1)/6, and rises by u1 − u0.
#[inline(always)]
fn straighten(starts: &mut [f64], middles: &mut [f64], last: &[f64]) {
    for ((start, middle), last) in starts.iter_mut().zip(middles).zip(last) {
        let rise = last - *start;
        *middle = (*start + 4.0 * *middle + last) / 6.0;
        *start = *middle - 0.5 * rise;
    }
}

/// Whether a speed, of the robot or of a wheel, changes by more than is left of it at either end of a step.
#[inline(always)]
fn nears_rest(frame: &Frame, from: &[f64], to: &[f64]) -> bool {
    let near = |from: f64, to: f64| from.abs().min(to.abs()) <= (to - from).abs();
    let wheels = match (from, to) {
        (&[.., _, _], &[.., _, _]) if frame.has_wheels() => {
            let (from, to) = (frame.wheels(from), frame.wheels(to));
            near(from[0], to[0]) | near(from[1], to[1])
        }
        _ => false,
    };
    from.iter().zip(to).fold(wheels, |any, (from, to)| any | near(*from, *to))
}

/// The share of a change of the right side within a step that counts where a force holds the outputs more firmly than the step is long, with z > 1 its
/// slope times the step. It would be overshot, to and fro over the kink of a friction, by no more than that is wide: x' = x + h N/(1 + z), as the
/// implicit rule has it, never does. What changes more than a little is looked at more closely instead, by a rule of second order.
#[inline(always)]
fn implicit(z: f64, bend: f64) -> f64 {
    let seen = (4.0 * bend / BEND - 3.0).clamp(0.0, 1.0);
    seen + (1.0 - seen) * 2.0 / (1.0 + z)
}

/// The accelerations of a model with loads and drive effects.
pub(super) struct RightSide<'s, 'a> {
    pub(super) model: &'s dyn RegressorModel,
    pub(super) theta: &'s [f64],
    pub(super) slots: &'s Slots<'a>,
    pub(super) linear: &'s Linear,
}

impl RightSide<'_, '_> {
    /// What the loads leave of a command, as `work.net`.
    #[inline(always)]
    pub(super) fn left<const N: usize>(&self, at: &Instant<'_>, x: &[f64], u: &[f64], state: &[f64], work: &mut Work) {
        let m = if N == 0 { u.len() } else { N };
        let (net, load) = (&mut work.net[..m], &mut work.load[..m]);
        net.copy_from_slice(&u[..m]);
        if self.slots.bears() {
            self.slots.bear(at, x, state, load);
            net.iter_mut().zip(load.iter()).for_each(|(n, l)| *n -= l);
        }
        if self.slots.driven() {
            work.held[..m].copy_from_slice(net);
        }
        if self.slots.loads() {
            self.slots.load(at, x, state, load);
            net.iter_mut().zip(load.iter()).for_each(|(n, l)| *n -= l);
        }
    }

    #[inline(always)]
    pub(super) fn accelerations<const N: usize>(
        &self,
        at: &Instant<'_>,
        x: &[f64],
        u: &[f64],
        state: &[f64],
        work: &mut Work,
        out: &mut [f64],
    ) -> Result<(), ModelError> {
        let m = if N == 0 { u.len() } else { N };
        if self.slots.rubs() || self.slots.driven() {
            self.left::<N>(at, x, u, state, work);
            self.model.accelerations(self.theta, &work.net[..m], x, out)?;
        } else {
            self.model.accelerations(self.theta, &u[..m], x, out)?;
        }
        if self.slots.driven() {
            let Linear { inertia, mobility, drag, .. } = self.linear;
            let Work { drive, given, held, .. } = work;
            let (given, drive) = (&mut given[..m], &mut drive[..m]);
            for (i, given) in given.iter_mut().enumerate() {
                *given = square_row(inertia, i, out);
                held[i] -= square_row(drag, i, x) + *given;
            }
            drive.copy_from_slice(given);
            self.slots.drive(at, &self.linear.motion(u, x, held), state, drive);
            for (i, out) in out.iter_mut().enumerate() {
                *out = square_row(mobility, i, drive);
            }
        }
        Ok(())
    }
}
