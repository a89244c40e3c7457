//! The proof: free runs over data that no estimate saw, each stretch from its measured first sample.

use wheelwright_core::effect::{Effect, EffectSimulator, Scene};
use wheelwright_core::model::RegressorModel;
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, Stretch};

use crate::adequacy::Jitter;
use crate::decide::LEFT_OVER;
use crate::fit::layout::unsettled;
use crate::noise::{HUBER, Noise};
use crate::residuals::Series;

/// A model as it is simulated on other data.
#[derive(Debug, Clone)]
pub(crate) struct Explanation<'a> {
    pub(crate) effects: Vec<&'a dyn Effect>,
    pub(crate) theta: Vec<f64>,
    pub(crate) values: Vec<f64>,
}

/// Data to simulate on.
pub(crate) struct Ground<'a> {
    pub(crate) model: &'a dyn RegressorModel,
    pub(crate) data: &'a Dataset,
    pub(crate) scene: &'a Scene,
    pub(crate) readout: Readout,
}

/// A free run, and its squared errors.
#[derive(Debug, Clone)]
pub(crate) struct Proof {
    pub(crate) simulated: Series,
    /// Fit of each output in percent; not a number where an output never changes or the run diverged.
    pub(crate) fit: Vec<f64>,
    /// Mean squared error of each output; infinite where the run diverged.
    pub(crate) error: Vec<f64>,
}

impl Ground<'_> {
    /// Simulates every stretch from its measured first sample. What goes round, or was left somewhere, stands where these data say that it stood
    /// at their start.
    pub(crate) fn prove(&self, explanation: &Explanation<'_>) -> Proof {
        let given = self.run(explanation);
        let (explanation, given) = self.left_at(explanation.clone(), given);
        let explanation = &explanation;
        let parts = explanation.parts(self.scene);
        if parts.is_empty() {
            return given;
        }
        let scene = self.scene.followed(self.data, &given.simulated);
        let ground = Ground { scene: &scene, ..*self };
        let given = ground.run(explanation);
        match ground.begun(explanation, &parts, &given) {
            Some(begun) => ground.run(&begun),
            None => given,
        }
    }

    /// The same with everything as it stood where the explanation was fitted.
    pub(crate) fn run(&self, explanation: &Explanation<'_>) -> Proof {
        let n = self.data.outputs.len();
        let Explanation { effects, theta, values } = explanation;
        let mut simulated: Series = Vec::with_capacity(self.data.stretches.len());
        let mut whole = true;
        match EffectSimulator::new(self.model, theta, effects, self.scene) {
            Ok(simulator) => {
                let mut simulator = simulator.with_readout(self.readout);
                whole &= simulator.set(theta, values).is_ok() && simulator.choose_substeps(&self.data.stretches).is_ok();
                for (s, stretch) in self.data.stretches.iter().enumerate() {
                    let initial: Vec<f64> = stretch.outputs.iter().map(|c| c[0]).collect();
                    let mut run = vec![Vec::new(); n];
                    whole &= simulator.run(s, stretch, &initial, &mut run).is_ok();
                    // A run that diverged stands still from there on, so that pictures have all rows.
                    for series in &mut run {
                        let last = series.iter().rev().copied().find(|x| x.is_finite()).unwrap_or(0.0);
                        series.iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = last);
                        series.resize(stretch.len(), last);
                    }
                    simulated.push(run);
                }
            }
            Err(_) => {
                whole = false;
                simulated.extend(self.data.stretches.iter().map(|s| s.outputs.iter().map(|c| vec![c[0]; s.len()]).collect::<Vec<_>>()));
            }
        }
        let error: Vec<f64> = (0..n).map(|c| if whole { mean_square(self.data, &simulated, c) } else { f64::INFINITY }).collect();
        let fit = error.iter().enumerate().map(|(c, e)| percent(*e, variance(self.data, c))).collect();
        Proof { simulated, fit, error }
    }

    /// The fit that noise of this deviation leaves to any model.
    pub(crate) fn ceiling(&self, output: usize, deviation: f64) -> f64 {
        percent(deviation * deviation, variance(self.data, output))
    }
}

/// Fit of a free run in percent, output by output.
pub(crate) fn fits(data: &Dataset, simulated: &Series) -> Vec<f64> {
    (0..data.outputs.len()).map(|c| percent(mean_square(data, simulated, c), variance(data, c))).collect()
}

fn percent(error: f64, variance: f64) -> f64 {
    if variance > 0.0 && error.is_finite() { 100.0 * (1.0 - (error / variance).sqrt()) } else { f64::NAN }
}

fn mean_square(data: &Dataset, simulated: &Series, c: usize) -> f64 {
    let stretch = |s: &Stretch, y: &Vec<Vec<f64>>| s.outputs[c].iter().zip(&y[c]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    data.stretches.iter().zip(simulated).map(|(s, y)| stretch(s, y)).sum::<f64>() / data.samples().max(1) as f64
}

fn variance(data: &Dataset, c: usize) -> f64 {
    let all = || data.stretches.iter().flat_map(|s| s.outputs[c].iter());
    let n = data.samples().max(1) as f64;
    let mean = all().sum::<f64>() / n;
    all().map(|y| (y - mean).powi(2)).sum::<f64>() / n
}

/// What held-out data say of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transfer {
    /// It is as good there, or nothing there needs explaining.
    Holds,
    /// It would be with other parameters, between which the data it was fitted to do not tell.
    Open,
    /// It does not bring the error down there as it does on the data it was fitted to.
    Fails,
}

/// How much louder the noise of the same sensors is on another recording at most, as a square: half as loud again. What has more is motion.
const LOUDEST: f64 = 1.5 * 1.5;
/// Ratio of an error to that on the training data, as a square, up to which nothing needs explaining: the fifteen percent in amplitude
/// that the errors of parameters and of the first sample make.
const NEAR: f64 = 1.15 * 1.15;
/// Ratio of losses beyond which held-out data show motion that training data lack, where errors of parameters make up to a half more.
const FOREIGN: f64 = 3.0;
/// Ratio of losses after and before up to which an explanation of which there is nothing to see has done no harm.
pub(crate) const UNHURT: f64 = 1.02;
/// What an effect has to change on held-out data, as a sum of squares in units of the noise, for them to say anything of it.
const VISIBLE: f64 = 10.0;
/// Standard errors that make sure.
const SURE: f64 = 3.0;

/// Mean loss of a free run's errors over an output, in units of what a right model's scatter by: the noise, which stamps that jitter make louder
/// where an output changes, and other driving changes more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Loss {
    /// With errors that are far out counted by their size: a few of them are not motion.
    pub(crate) robust: f64,
    /// With all of them counted by their squares: how much motion is missed, and not how often.
    pub(crate) square: f64,
}

impl Loss {
    fn of(scaled: &[f64]) -> Self {
        let huber = |x: f64| if x <= HUBER { x * x } else { HUBER * (2.0 * x - HUBER) };
        let (robust, square) = scaled.iter().fold((0.0, 0.0), |(r, s), x| (r + huber(x.abs()), s + x * x));
        let count = scaled.len().max(1) as f64;
        Self { robust: robust / count, square: square / count }
    }

    fn times(self, factor: f64) -> Self {
        Self { robust: factor * self.robust, square: factor * self.square }
    }
}

/// A free run over data. What moves before a stretch has settled hangs on what nobody recorded, and is not counted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run<'a> {
    pub(crate) data: &'a Dataset,
    pub(crate) scene: &'a Scene,
    pub(crate) simulated: &'a Series,
}

impl Run<'_> {
    /// The mean of the outputs' robust losses.
    pub(crate) fn loss(&self, noise: &[f64], jitter: Option<Jitter>) -> f64 {
        mean(&self.losses(noise, jitter))
    }

    /// The loss of each output.
    pub(crate) fn losses(&self, noise: &[f64], jitter: Option<Jitter>) -> Vec<Loss> {
        self.each_output(noise, jitter, |scaled| scaled)
    }

    /// The same of what errors change by from sample to sample, as of independent ones.
    fn quick(&self, noise: &[f64], jitter: Option<Jitter>) -> Vec<Loss> {
        let changes = |scaled: Vec<f64>| scaled.windows(2).map(|w| (w[1] - w[0]) * std::f64::consts::FRAC_1_SQRT_2).collect();
        self.each_output(noise, jitter, changes)
    }

    fn each_output(&self, noise: &[f64], jitter: Option<Jitter>, of: impl Fn(Vec<f64>) -> Vec<f64>) -> Vec<Loss> {
        let first: Vec<usize> = self.data.stretches.iter().map(|stretch| unsettled(self.scene, stretch)).collect();
        let output = |(c, noise): (usize, &f64)| {
            let stretch = |((stretch, run), first): ((&Stretch, &Vec<Vec<f64>>), &usize)| {
                let errors = stretch.outputs[c].iter().zip(&run[c]).map(|(y, s)| (y - s) / noise);
                of(match jitter {
                    Some(jitter) => {
                        let scatter = jitter.slope(&stretch.time, &run[c]).into_iter().map(|d| jitter.scatter(d, *noise));
                        errors.zip(scatter).skip(*first).map(|(x, by)| x / by).collect()
                    }
                    None => errors.skip(*first).collect(),
                })
            };
            Loss::of(&self.data.stretches.iter().zip(self.simulated).zip(&first).flat_map(stretch).collect::<Vec<_>>())
        };
        noise.iter().enumerate().map(output).collect()
    }
}

/// The mean of robust losses.
pub(crate) fn mean(losses: &[Loss]) -> f64 {
    losses.iter().map(|loss| loss.robust).sum::<f64>() / losses.len().max(1) as f64
}

/// An explanation's free runs over the data it was fitted to and over others, with what it takes for noise.
pub(crate) struct Runs<'a> {
    pub(crate) training: Run<'a>,
    pub(crate) held_out: Run<'a>,
    pub(crate) noise: &'a Noise,
    pub(crate) jitter: Option<Jitter>,
}

impl Runs<'_> {
    /// The loss that noise alone leaves of each output of the other data: as on the training data, or by as much more as errors change more from
    /// sample to sample there. Motion that is missed goes on for longer; noise with heavy tails, and jitter at steps, are not as loud on every
    /// recording. Up to a bound: quick motion that is missed changes from sample to sample as well.
    pub(crate) fn floor(&self) -> Vec<Floor> {
        let deviation = &self.noise.deviation;
        let of = |run: Run<'_>| run.quick(deviation, self.jitter);
        let louder = of(self.held_out).into_iter().zip(of(self.training)).map(|(there, here)| there.robust / here.robust);
        let trained = self.training.losses(deviation, self.jitter);
        let rows = [self.training.data.samples(), self.held_out.data.samples()];
        let floor = |(c, (loss, louder)): (usize, (&Loss, f64))| Floor {
            loss: loss.times(if louder.is_finite() { louder.clamp(1.0, LOUDEST) } else { 1.0 }),
            chance: rows.map(|rows| self.noise.scatter(c, rows)).into_iter().fold(0.0, f64::hypot),
        };
        trained.iter().zip(louder).enumerate().map(floor).collect()
    }
}

/// Weighs the outputs' losses on held-out data before and after against what noise alone leaves there. Of no output's excess may more stay than an
/// explanation may leave over of the data it was fitted to, unless what stays is nothing that needs explaining. Shares are of squares, as a
/// signal's energy is: by their size, of a misfit of ten deviations a hundredth of its energy is a tenth.
pub(crate) fn transfer(before: &[Loss], after: &[Loss], floor: &[Floor]) -> Transfer {
    let unhurt = mean(after) <= mean(before) * UNHURT;
    let output = |((before, after), floor): ((&Loss, &Loss), &Floor)| {
        let taken = || after.square - floor.loss.square <= LEFT_OVER * (before.square - floor.loss.square);
        after.robust <= floor.near() || (after.robust < before.robust && taken())
    };
    if unhurt && before.iter().zip(after).zip(floor).all(output) { Transfer::Holds } else { Transfer::Fails }
}

/// Whether held-out data are so far off that something moves there which the training data do not show.
pub(crate) fn foreign(held_out: &[Loss], floor: &[Floor]) -> bool {
    mean(held_out) > FOREIGN * level(floor)
}

/// What noise alone leaves of an output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Floor {
    pub(crate) loss: Loss,
    /// By how much of it that scatters by chance, as a standard deviation: slow noise is not as loud on every recording.
    chance: f64,
}

impl Floor {
    /// The loss up to which nothing needs explaining.
    fn near(&self) -> f64 {
        self.loss.robust * (1.0 + (NEAR - 1.0).hypot(SURE * self.chance))
    }
}

/// The mean of the robust losses that noise alone leaves.
pub(crate) fn level(floor: &[Floor]) -> f64 {
    mean(&floor.iter().map(|floor| floor.loss).collect::<Vec<_>>())
}

/// How much of what an effect changes on held-out data, in which it had no part, is found there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BorneOut {
    /// 1 if all of it is there, 0 if the data know nothing of it, less if they know the contrary.
    share: f64,
    /// Its standard error.
    error: f64,
    /// Sum of squares of what the effect changes, in units of the noise: what the data could show.
    shown: f64,
}

impl BorneOut {
    /// By regression of the errors without the effect on what it changes, both whitened. `gain` is twice the log-likelihood that the effect has
    /// gained on the data it was fitted to: so far its size is known.
    pub(crate) fn new(noise: &Noise, with: Run<'_>, without: &Series, gain: f64) -> Self {
        let (mut shown, mut found, mut left, mut values) = (0.0, 0.0, 0.0, 0.0);
        for ((stretch, simulated), without) in with.data.stretches.iter().zip(with.simulated).zip(without) {
            let first = unsettled(with.scene, stretch);
            for (c, measured) in stretch.outputs.iter().enumerate() {
                let white = |a: &[f64]| {
                    let mut difference: Vec<f64> = a.iter().zip(&without[c]).map(|(a, b)| a - b).collect();
                    noise.whiten_output(c, &mut difference);
                    difference
                };
                for (change, error) in white(&simulated[c]).into_iter().zip(white(measured)).skip(first) {
                    shown += change * change;
                    found += change * error;
                    left += (error - change).powi(2);
                    values += 1.0;
                }
            }
        }
        let share = found / shown;
        let error = ((left / values).max(1.0) / shown + 1.0 / gain.max(f64::MIN_POSITIVE)).sqrt();
        Self { share, error, shown }
    }

    /// Whether the data could show the effect, and surely know of less than half of it.
    pub(crate) fn refuted(self) -> bool {
        self.shown > VISIBLE && self.share + SURE * self.error < 0.5
    }
}

/// Held-out data on a clock of their own: the same stretches with their times moved.
pub(crate) fn shifted(data: &Dataset, by: f64) -> Dataset {
    let mut moved = data.clone();
    moved.stretches.iter_mut().flat_map(|s| &mut s.time).for_each(|t| *t += by);
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adequacy::Scatter;
    use crate::fit::layout::Layout;
    use crate::fixture::{Case, NOISE, normal};

    #[test]
    fn an_explanation_transfers_if_it_takes_the_excess_away_or_there_is_none() {
        let both = |losses: [f64; 2]| losses.map(|loss| Loss { robust: loss, square: loss });
        let quiet = both([1.0, 1.0]).map(|loss| Floor { loss, chance: 0.0 });
        let weighed = |before: [f64; 2], after: [f64; 2]| transfer(&both(before), &both(after), &quiet);
        let of = |before: f64, after: f64| weighed([before, 1.0], [after, 1.0]);
        assert_eq!(of(4.0, 1.1), Transfer::Holds, "the excess is gone");
        assert_eq!(of(4.0, 2.0), Transfer::Fails, "a third of it is still there");
        assert_eq!(of(40.0, 3.5), Transfer::Holds, "the form of a law is never exact");
        assert_eq!(of(40.0, 6.0), Transfer::Fails, "what is still there is more than that");
        assert_eq!(of(1.05, 1.04), Transfer::Holds, "there was none");
        assert_eq!(of(1.1, 1.6), Transfer::Fails, "it has made one");
        assert_eq!(of(0.7, 0.9), Transfer::Fails, "it has made one where it was quiet");
        assert_eq!(of(4.0, f64::INFINITY), Transfer::Fails, "it diverges");
        assert_eq!(weighed([40.0, 2.5], [1.0, 2.5]), Transfer::Fails, "one output is not explained");
        let far = |held_out: [f64; 2]| foreign(&both(held_out), &quiet);
        assert!(far([6.0, 1.0]) && !far([1.5, 1.0]));
        // A strong misfit counts by its energy: of ten deviations three, a tenth of it, are too much, and two, a thirtieth, are not.
        let energy = |after: f64| {
            let loss = |size: f64| Loss::of(&[1.0 + size, 1.0 - size]);
            transfer(&[loss(10.0)], &[loss(after)], &[Floor { loss: loss(0.0), chance: 0.0 }])
        };
        assert_eq!((energy(2.0), energy(3.0)), (Transfer::Holds, Transfer::Fails));
        // Slow noise is twice as loud by chance.
        let slow = quiet.map(|floor| Floor { chance: 0.4, ..floor });
        assert_eq!([1.9, 2.5].map(|after| transfer(&both([2.0; 2]), &both([after; 2]), &slow)), [Transfer::Holds, Transfer::Fails]);
    }

    /// The true motion of a case.
    fn over(case: &Case) -> Run<'_> {
        Run { data: &case.data, scene: &case.scene, simulated: &case.truth }
    }

    /// Held-out data asked about an effect that changes them by `size` standard deviations of their noise, and of which a share is there.
    fn asked(share: f64, size: f64, gain: f64) -> BorneOut {
        let change = |t: f64, output: usize| size * NOISE[output] * t.sin();
        let case = Case::new(3, |t, i, y, _, random| y + share * change(t, i) + NOISE[i] * normal(random));
        let mut with = case.truth.clone();
        for (run, stretch) in with.iter_mut().zip(&case.data.stretches) {
            for (i, column) in run.iter_mut().enumerate() {
                column.iter_mut().zip(&stretch.time).for_each(|(y, t)| *y += change(*t, i));
            }
        }
        let noise = Noise::white(&NOISE, &Layout::of(&case.data, &case.scene));
        BorneOut::new(&noise, Run { simulated: &with, ..over(&case) }, &case.truth, gain)
    }

    #[test]
    fn an_effect_of_which_held_out_data_know_nothing_is_refuted() {
        let known = 1e3;
        let [absent, present] = [0.0, 1.0].map(|share| asked(share, 1.0, known));
        assert!(absent.refuted() && !present.refuted(), "{absent:?} {present:?}");
        assert!(absent.share.abs() < 3.0 * absent.error && (present.share - 1.0).abs() < 3.0 * present.error, "{absent:?} {present:?}");
        assert!(asked(-0.5, 0.3, known).refuted(), "they know the contrary");
        assert!(!asked(0.8, 1.0, known).refuted(), "the form of a law is never exact");
        assert!(!asked(0.0, 0.05, known).refuted(), "the data could not show it");
        assert!(!asked(0.0, 1.0, 20.0).refuted(), "its size is hardly known");
    }

    #[test]
    fn noise_that_is_louder_on_other_data_is_no_motion_that_is_missed() {
        let trained = Case::clean(11);
        let noise = Noise::white(&NOISE, &Layout::of(&trained.data, &trained.scene));
        let floor = |held: &Case| {
            let runs = Runs { training: over(&trained), held_out: over(held), noise: &noise, jitter: None };
            level(&runs.floor()) / over(&trained).loss(&NOISE, None)
        };
        let louder = Case::new(12, |_, i, y, _, random| y + 1.5 * NOISE[i] * normal(random));
        let expected = over(&louder).loss(&NOISE, None) / over(&trained).loss(&NOISE, None);
        assert!((floor(&louder) / expected - 1.0).abs() < 0.1, "{} for {expected}", floor(&louder));
        let shaken = Case::new(15, |_, i, y, _, random| y + 4.0 * NOISE[i] * normal(random));
        assert!((floor(&shaken) / LOUDEST - 1.0).abs() < 1e-9, "{}", floor(&shaken));
        let missed = Case::new(13, |t, i, y, _, random| y + NOISE[i] * (normal(random) + 2.0 * (2.0 * t).sin()));
        assert!(floor(&missed) < 1.2 && over(&missed).loss(&NOISE, None) > 2.0, "{}", floor(&missed));
        let quieter = Case::new(14, |_, i, y, _, random| y + 0.5 * NOISE[i] * normal(random));
        assert!(floor(&quieter) <= 1.0 + 1e-12, "{}", floor(&quieter));
    }

    #[test]
    fn what_moves_before_a_stretch_has_settled_is_not_counted() {
        // In motion from the start: what came before it is still at work.
        let mut case = Case::clean(8);
        let rows = 30..case.truth[0][0].len();
        for (stretch, run) in case.data.stretches.iter_mut().zip(&mut case.truth) {
            *stretch = stretch.slice(rows.clone());
            run.iter_mut().for_each(|series| *series = series[rows.clone()].to_vec());
        }
        case.scene = case.scene.like(&case.data, None);
        let first: Vec<usize> = case.data.stretches.iter().map(|stretch| unsettled(&case.scene, stretch)).collect();
        assert!(first.iter().any(|first| *first > 0), "{first:?}");
        let usual = over(&case).loss(&NOISE, None);
        let mut off = case.truth.clone();
        for (run, first) in off.iter_mut().zip(&first) {
            run.iter_mut().for_each(|series| series[..*first].iter_mut().for_each(|y| *y += 0.3));
        }
        assert_eq!(Run { simulated: &off, ..over(&case) }.loss(&NOISE, None), usual);
        off.iter_mut().flatten().for_each(|series| series.iter_mut().for_each(|y| *y += 0.02));
        assert!(Run { simulated: &off, ..over(&case) }.loss(&NOISE, None) > 2.0 * usual);
    }

    #[test]
    fn stamps_that_jitter_scatter_more_where_more_changes() {
        let jitter = Jitter { of: Scatter::Stamps, deviation: 0.03, error: 0.0, z: 0.0, still: 1.0 };
        let case = Case::jittering(7, jitter.deviation);
        let of = |jitter| over(&case).loss(&NOISE, jitter);
        let calm = Case::clean(7);
        let usual = over(&calm).loss(&NOISE, None);
        assert!(of(None) > 1.5 * usual, "{} for {usual}", of(None));
        assert!((of(Some(jitter)) / usual - 1.0).abs() < 0.1, "{} for {usual}", of(Some(jitter)));
    }
}
