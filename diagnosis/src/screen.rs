//! Screening: what each effect would change, linearised, and how much of the misfit that explains.
//!
//! Every effect is simulated at its starts beside the current model. The difference of the two runs is a secant response. Whitened and
//! projected on the complement of what the current model's parameters can do, it is held against the residual: with a free
//! amplitude where the response is proportional to it, as it is where a kink makes its shape depend on its size.

use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use wheelwright_core::effect::{Effect, EffectParameter, Start};
use wheelwright_core::least_squares::{Limits, constrained_step};

use crate::fit::algebra::{Directions, add, clear, dot, factor, gram};
use crate::fit::search::{Fit, likelihood, parts};
use crate::fit::setting::{Point, Runner, Setting};
use crate::fit::span::Span;
use crate::fit::whitening::Whitening;

/// A column that keeps less than this share of its length beside the model's own columns is theirs.
const OWN: f64 = 1e-6;

/// Shares of a step to a start of which the largest is made that can be looked at.
const SHARES: [f64; 8] = [1.0, 0.97, 0.94, 0.88, 0.75, 0.5, 0.25, 0.12];

/// A column that several starts share.
type Shared = Arc<Vec<f64>>;

/// Raw secant responses of one effect at one start.
#[derive(Debug, Clone)]
pub(crate) struct Response {
    /// Index in the library.
    pub(crate) effect: usize,
    pub(crate) start: Start,
    pub(crate) parameters: Vec<EffectParameter>,
    /// One a column of the start; zero where it could not be simulated. Starts of one effect whose column has the same values share it.
    pub(crate) columns: Vec<Shared>,
}

/// A start for refinement with its linearised gain.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub(crate) effect: usize,
    /// Index among the responses.
    pub(crate) response: usize,
    /// Multiple of each column of the start.
    amplitude: Vec<f64>,
    /// The effect's values with these amplitudes.
    values: Vec<f64>,
    /// Gain of twice the log-likelihood.
    pub(crate) gain: f64,
    /// The same of a start that is a place by itself, with its values as they are.
    pub(crate) as_it_is: f64,
    /// Columns that count.
    pub(crate) freedom: usize,
    /// Sum of squares of the columns, whitened and projected: the information on a change as large as the start.
    pub(crate) information: f64,
}

/// The model that effects are added to.
pub(crate) struct Current<'s, 'a> {
    setting: &'s Setting<'a>,
    effects: &'s [&'s dyn Effect],
    fit: &'s Fit,
    /// Its free runs by the number of steps between samples: what is compared is stepped alike.
    runs: RefCell<Vec<(usize, Shared)>>,
}

impl<'s, 'a> Current<'s, 'a> {
    pub(crate) fn new(setting: &'s Setting<'a>, effects: &'s [&'s dyn Effect], fit: &'s Fit) -> Self {
        Self { setting, effects, fit, runs: RefCell::new(Vec::new()) }
    }

    /// The free run with so many steps between samples.
    fn run(&self, substeps: usize) -> Option<Shared> {
        if let Some((_, run)) = self.runs.borrow().iter().find(|(s, _)| *s == substeps) {
            return Some(Arc::clone(run));
        }
        let point = &self.fit.point;
        let mut runner = Runner::with_substeps(self.setting, self.effects, point, substeps).ok()?;
        let mut run = vec![0.0; self.setting.layout.len()];
        if !runner.run(&point.x, &point.starts, &mut run) {
            return None;
        }
        let run = Arc::new(run);
        self.runs.borrow_mut().push((substeps, Arc::clone(&run)));
        Some(run)
    }
}

/// Responses of library effects at all their starts.
pub(crate) fn responses(current: &Current<'_, '_>, library: &[(usize, &dyn Effect)]) -> Vec<Response> {
    library.iter().flat_map(|(index, effect)| responses_at(current, *index, *effect, effect.starts(current.setting.scene))).collect()
}

/// Responses of one effect at some of its starts.
pub(crate) fn responses_at(current: &Current<'_, '_>, index: usize, effect: &dyn Effect, starts: Vec<Start>) -> Vec<Response> {
    let parameters = effect.parameters(current.setting.scene);
    let mut known = Known::default();
    starts.into_iter().filter_map(|start| respond(current, index, effect, &parameters, start, &mut known)).collect()
}

/// What the first starts of an effect have found: the step for all, and columns by the values that made them.
#[derive(Default)]
struct Known {
    substeps: Option<usize>,
    columns: Vec<(Vec<f64>, Shared)>,
}

/// The responses of one start.
fn respond(
    current: &Current<'_, '_>,
    index: usize,
    effect: &dyn Effect,
    parameters: &[EffectParameter],
    start: Start,
    known: &mut Known,
) -> Option<Response> {
    let Current { setting, effects, fit, .. } = *current;
    let joined: Vec<&dyn Effect> = effects.iter().copied().chain(std::iter::once(effect)).collect();
    let mut columns = Vec::with_capacity(start.columns.len());
    let at = |values: &[f64]| Point { x: fit.point.x.iter().chain(values).copied().collect(), starts: fit.point.starts.clone() };
    let mut runner = match known.substeps {
        Some(substeps) => Runner::with_substeps(setting, &joined, &at(&start.values), substeps),
        None => Runner::coarse(setting, &joined, &at(&start.values)),
    }
    .ok()?;
    known.substeps = Some(runner.substeps());
    let without = current.run(runner.substeps())?;
    for c in 0..start.columns.len() {
        let values = values_of(parameters, &start, &|other| if other == c { 1.0 } else { 0.0 });
        if let Some((_, same)) = known.columns.iter().find(|(v, _)| *v == values) {
            columns.push(Arc::clone(same));
            continue;
        }
        let mut column = vec![0.0; setting.layout.len()];
        let x: Vec<f64> = fit.point.x.iter().chain(&values).copied().collect();
        if runner.run(&x, &fit.point.starts, &mut column) {
            column.iter_mut().zip(&*without).for_each(|(c, s)| *c -= s);
        } else {
            column.fill(0.0);
        }
        let column = Arc::new(column);
        known.columns.push((values, Arc::clone(&column)));
        columns.push(column);
    }
    Some(Response { effect: index, start, parameters: parameters.to_vec(), columns })
}

/// The start's values with each column's distance from neutral multiplied by its amplitude, kept within bounds.
fn values_of(parameters: &[EffectParameter], start: &Start, amplitude: &dyn Fn(usize) -> f64) -> Vec<f64> {
    let mut values = start.values.clone();
    for (c, members) in start.columns.iter().enumerate() {
        for &j in members {
            let p = &parameters[j];
            if let Some(neutral) = p.neutral {
                let amplitude = amplitude(c);
                // A limit that is neutral at infinity is there or not.
                let value = match (neutral.is_finite(), amplitude == 0.0) {
                    (true, _) => neutral + amplitude * (start.values[j] - neutral),
                    (false, true) => neutral,
                    (false, false) => start.values[j],
                };
                values[j] = value.max(p.bounds.0).min(p.bounds.1);
            }
        }
    }
    values
}

/// Projected columns of one effect by their raw ones: many starts share them.
#[derive(Default)]
pub(crate) struct Projected(Vec<(Shared, Option<Shared>)>);

impl Projected {
    fn of(&mut self, raw: &Shared, projection: &Projection<'_, '_>) -> Option<Shared> {
        if let Some((_, own)) = self.0.iter().find(|(r, _)| Arc::ptr_eq(r, raw)) {
            return own.clone();
        }
        let own = projection.own(raw).map(Arc::new);
        self.0.push((Arc::clone(raw), own.clone()));
        own
    }
}

/// Products of an effect's columns with each other and with the residual, which stands last, output by output: all that the gain of an amplitude
/// hangs on.
struct Products(Vec<DMatrix<f64>>);

impl Products {
    fn of<'c>(columns: impl Iterator<Item = &'c [f64]>, residual: &'c [f64], outputs: &[Range<usize>]) -> Self {
        let all: Vec<&[f64]> = columns.chain(std::iter::once(residual)).collect();
        Self(outputs.iter().map(|output| gram(&all, std::slice::from_ref(output), &[1.0])).collect())
    }

    fn columns(&self) -> usize {
        self.0.first().map_or(0, |products| products.nrows() - 1)
    }

    /// The same over all outputs.
    fn sum(&self) -> DMatrix<f64> {
        let size = self.columns() + 1;
        self.0.iter().fold(DMatrix::zeros(size, size), |sum, output| sum + output)
    }

    /// Sum of squares of all columns.
    fn information(&self) -> f64 {
        let columns = self.columns();
        self.0.iter().flat_map(|output| (0..columns).map(|i| output[(i, i)])).sum()
    }

    /// Sum of squares of each output where columns with amplitudes are taken off the residual.
    fn left(&self, amplitude: &[f64]) -> Vec<f64> {
        let weights = DVector::from_iterator(amplitude.len() + 1, amplitude.iter().map(|a| -a).chain(std::iter::once(1.0)));
        self.0.iter().map(|output| weights.dot(&(output * &weights))).collect()
    }
}

/// Residual and orthonormal columns of the current model, outputs weighted: what responses are projected with.
pub(crate) struct Projection<'s, 'a> {
    setting: &'s Setting<'a>,
    whitening: &'s Whitening,
    fit: &'s Fit,
    limits: Limits,
    roots: Vec<f64>,
    basis: Vec<Vec<f64>>,
    residual: Vec<f64>,
}

impl<'s, 'a> Projection<'s, 'a> {
    /// `parameters` are those of the effects that the model has already.
    pub(crate) fn new(setting: &'s Setting<'a>, whitening: &'s Whitening, fit: &'s Fit, parameters: &[EffectParameter]) -> Self {
        let roots: Vec<f64> = fit.weights(setting).iter().map(|w| w.sqrt()).collect();
        let mut made = Self { setting, whitening, fit, limits: setting.limits(parameters), roots, basis: Vec::new(), residual: Vec::new() };
        let mut residual = fit.residual.clone();
        made.weigh(&mut residual);
        let stopped = made.stopped();
        for (unknown, column) in fit.columns.iter().enumerate() {
            let mut column = column.clone();
            made.weigh(&mut column);
            // What it would do beyond its bound, where the data would have it, the model cannot do.
            if stopped.iter().any(|(j, on)| *j == unknown && on * dot(&column, &residual) < 0.0) {
                continue;
            }
            let size = dot(&column, &column).sqrt();
            made.project(&mut column);
            made.project(&mut column);
            let rest = dot(&column, &column).sqrt();
            if rest > 1e-4 * size {
                column.iter_mut().for_each(|x| *x /= rest);
                made.basis.push(column);
            }
        }
        made.project(&mut residual);
        made.residual = residual;
        made
    }

    /// Unknowns that stand at a bound of their own, each with the direction in which it may still go.
    fn stopped(&self) -> Vec<(usize, f64)> {
        let Limits { g, .. } = &self.limits;
        let own = |row: usize| {
            let mut bounded = (0..g.ncols()).map(|j| (j, g[(row, j)])).filter(|(_, on)| *on != 0.0);
            bounded.next().filter(|_| bounded.next().is_none())
        };
        self.limits.active(&DVector::from_column_slice(&self.fit.point.x)).into_iter().filter_map(own).collect()
    }

    fn weigh(&self, values: &mut [f64]) {
        for (c, root) in self.roots.iter().enumerate() {
            values[self.setting.layout.output(c)].iter_mut().for_each(|x| *x *= root);
        }
    }

    fn project(&self, values: &mut [f64]) {
        self.basis.iter().for_each(|q| clear(values, q));
    }

    /// A raw response, whitened, weighted and projected; nothing if the model can do the same.
    fn own(&self, raw: &[f64]) -> Option<Vec<f64>> {
        if raw.iter().all(|x| *x == 0.0) {
            return None;
        }
        let mut column = raw.to_vec();
        self.whitening.apply(&mut column);
        self.weigh(&mut column);
        let size = dot(&column, &column);
        self.project(&mut column);
        let rest = dot(&column, &column);
        (rest.is_finite() && rest > OWN * OWN * size && rest > 0.0).then_some(column)
    }

    /// What a raw response with an amplitude of its own promises to gain.
    pub(crate) fn promised(&self, raw: &[f64]) -> f64 {
        self.own(raw).map_or(0.0, |own| dot(&own, &self.residual).powi(2) / dot(&own, &own))
    }

    /// Twice the log-likelihood of what amplitudes leave, against that of the model.
    fn gain(&self, products: &Products, amplitude: &[f64]) -> f64 {
        let rows = self.setting.layout.counted();
        let of = |amplitude: &[f64]| -> f64 {
            let left = products.left(amplitude);
            likelihood(&left.iter().zip(&self.roots).map(|(left, root)| left / (root * root)).collect::<Vec<f64>>(), rows)
        };
        of(amplitude) - of(&vec![0.0; amplitude.len()])
    }

    /// The best candidate that a response makes. `known` are the columns of the same effect that were projected already.
    pub(crate) fn candidate(&self, index: usize, response: &Response, known: &mut Projected) -> Candidate {
        let columns: Vec<Option<Shared>> = response.columns.iter().map(|c| known.of(c, self)).collect();
        let shown: Vec<usize> = (0..columns.len()).filter(|c| columns[*c].is_some()).collect();
        let products = Products::of(columns.iter().flatten().map(|c| &c[..]), &self.residual, &parts(self.setting));
        let one_sided: Vec<bool> = shown.iter().map(|c| one_sided(response, *c)).collect();
        let mut best = self.amplitudes(&products, &one_sided);
        let mut as_it_is = best.1;
        if !response.start.linear {
            let mut whole = self.whole(&products);
            as_it_is = whole.1;
            // A grid point counts as it is; a free amplitude says that a smaller or larger one would fit.
            whole.1 = whole.1.max(best.1);
            best = whole;
        }
        let (found, gain) = best;
        let mut amplitude = vec![0.0; columns.len()];
        shown.iter().zip(found).for_each(|(c, a)| amplitude[*c] = a);
        let freedom = amplitude.iter().filter(|a| **a != 0.0).count().max(1);
        let values = values_of(&response.parameters, &response.start, &|c| amplitude[c]);
        Candidate {
            effect: response.effect,
            response: index,
            amplitude,
            values,
            gain,
            as_it_is,
            freedom,
            information: products.information(),
        }
    }

    /// Amplitudes by least squares, columns left out whose amplitude would lie beyond a bound.
    fn amplitudes(&self, products: &Products, one_sided: &[bool]) -> (Vec<f64>, f64) {
        let all = products.sum();
        let mut amplitude = vec![0.0; one_sided.len()];
        let mut shown: Vec<usize> = (0..one_sided.len()).collect();
        while !shown.is_empty() {
            let inverse = Directions::of(&all.select_rows(&shown).select_columns(&shown)).inverse();
            let right = DVector::from_iterator(shown.len(), shown.iter().map(|i| all[(*i, one_sided.len())]));
            let found = inverse * right;
            let against = (0..shown.len()).filter(|i| found[*i] < 0.0 && one_sided[shown[*i]]);
            let Some(worst) = against.min_by(|a, b| found[*a].total_cmp(&found[*b])) else {
                shown.iter().zip(found.iter()).for_each(|(i, a)| amplitude[*i] = *a);
                break;
            };
            shown.remove(worst);
        }
        let gain = self.gain(products, &amplitude);
        (amplitude, gain)
    }

    /// Each column as it is or not at all, whichever leaves less.
    fn whole(&self, products: &Products) -> (Vec<f64>, f64) {
        let mut amplitude = vec![0.0; products.columns()];
        let mut best = f64::NEG_INFINITY;
        let mut open: Vec<usize> = (0..amplitude.len()).collect();
        loop {
            let with = |i: usize| {
                let mut trial = amplitude.clone();
                trial[i] = 1.0;
                self.gain(products, &trial)
            };
            let tried = open.iter().map(|i| (*i, with(*i)));
            let Some((i, gain)) = tried.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, gain)| *gain > best) else { break };
            best = gain;
            amplitude[i] = 1.0;
            open.retain(|o| *o != i);
        }
        (amplitude, if best.is_finite() { best } else { 0.0 })
    }

    /// Unknowns of the joint fit to start from: those of the model, moved to make room for the effect, then the effect's values.
    pub(crate) fn start(&self, response: &Response, candidate: &Candidate) -> Vec<f64> {
        let Candidate { amplitude, values, .. } = candidate;
        let x = &self.fit.point.x;
        let mut left = self.fit.residual.clone();
        for (raw, a) in response.columns.iter().zip(amplitude).filter(|(_, a)| **a != 0.0) {
            let mut column = raw.to_vec();
            self.whitening.apply(&mut column);
            add(&mut left, -a, &column);
        }
        left.iter_mut().for_each(|x| *x = -*x);
        let columns: Vec<&[f64]> = self.fit.columns.iter().map(Vec::as_slice).chain(std::iter::once(left.as_slice())).collect();
        let mut moved = x.clone();
        if !x.is_empty() {
            let factor = factor(&gram(&columns, &parts(self.setting), &self.fit.weights(self.setting)));
            let held = DVector::from_fn(x.len(), |j, _| 1e-3 * factor.r.column(j).norm());
            if let Ok(step) = constrained_step(&factor, Some(&held), &DVector::from_column_slice(x), &self.limits) {
                // What is linear may ask for a robot that follows at once: as far towards it as can be looked at.
                let by = |share: f64| x.iter().zip(step.iter()).map(|(x, s)| x + share * s).collect::<Vec<f64>>();
                let fastest = self.setting.fastest(x);
                moved = SHARES.into_iter().map(by).find(|there| self.setting.rate(there) <= fastest).unwrap_or(moved);
            }
        }
        moved.extend_from_slice(values);
        moved
    }
}

/// Whether a column's parameters cannot go to the other side of neutral.
fn one_sided(response: &Response, column: usize) -> bool {
    response.start.columns[column].iter().any(|&j| {
        let p = &response.parameters[j];
        p.neutral.is_none_or(|neutral| {
            let side = response.start.values[j] - neutral;
            let room = if side > 0.0 { neutral - p.bounds.0 } else { p.bounds.1 - neutral };
            // Beyond a limit that is neutral at infinity there is nothing.
            room.is_nan() || room <= 0.0
        })
    })
}

/// What is left of the residual when everything that any response or parameter can do is taken out of it: the saturated residual, flat,
/// in the whitening's units, and the degrees of freedom taken, at most one of fifteen.
pub(crate) fn saturate(setting: &Setting<'_>, whitening: &Whitening, fit: &Fit, responses: &[Response]) -> (Vec<f64>, usize) {
    let weights = fit.weights(setting);
    let weigh = |values: &mut [f64], power: f64| {
        for (c, w) in weights.iter().enumerate() {
            let factor = w.powf(power);
            values[setting.layout.output(c)].iter_mut().for_each(|x| *x *= factor);
        }
    };
    let unit = |mut column: Vec<f64>| {
        weigh(&mut column, 0.5);
        let size = dot(&column, &column).sqrt();
        column.iter_mut().for_each(|x| *x /= size);
        (size.is_finite() && size > 0.0).then_some(column)
    };
    let whitened = |raw: &Shared| {
        let mut column = raw.to_vec();
        whitening.apply(&mut column);
        unit(column)
    };
    let mut raw: Vec<&Shared> = Vec::new();
    for column in responses.iter().flat_map(|r| &r.columns) {
        if !raw.iter().any(|r| Arc::ptr_eq(r, column)) {
            raw.push(column);
        }
    }
    let columns = fit.columns.iter().cloned().filter_map(unit).chain(raw.into_iter().filter_map(whitened)).collect();
    let span = Span::of(columns, (setting.layout.counted() / 15).max(1));
    let mut residual = fit.residual.clone();
    weigh(&mut residual, 0.5);
    span.take_out_of(&mut residual);
    weigh(&mut residual, -0.5);
    (residual, span.size())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;
    use crate::fit::search::linearise;
    use crate::fixture::{Case, with_selected};

    #[test]
    fn what_an_unknown_would_do_beyond_its_bound_the_model_cannot_do() {
        with_selected(&Case::clean(5), &[], 0, |search, selected| {
            let mut setting = search.setting.clone();
            let x = selected.base.point.x[0];
            setting.bounds[0] = (0.0, x);
            let mut fit = selected.base.clone();
            let mut runner = Runner::new(&setting, &[], &fit.point).unwrap();
            let raw = runner.columns(&fit.point, 0..1).remove(0);
            linearise(&mut runner, &selected.whitening, &mut fit, 0..6);
            // The data would have it beyond the bound, or back.
            for (side, can) in [(1.0, false), (-1.0, true)] {
                let mut pushed = fit.clone();
                let column = fit.columns[0].clone();
                add(&mut pushed.residual, side * x, &column);
                let projection = Projection::new(&setting, &selected.whitening, &pushed, &[]);
                assert_eq!(projection.own(&raw).is_none(), can, "{side}");
            }
        });
    }

    #[test]
    fn a_limit_that_is_neutral_at_infinity_is_tried_at_its_starts() {
        let limit = EffectParameter::new("limit", "m/s", (0.04, f64::INFINITY), 0.1).neutral(f64::INFINITY);
        let size = EffectParameter::new("size", "m/s", (0.0, 1.0), 0.1).neutral(0.0);
        let start = Start { values: vec![0.7, 0.2], columns: vec![vec![0], vec![1]], linear: false };
        let parameters = [limit, size];
        assert_eq!(values_of(&parameters, &start, &|c| [1.0, 0.0][c]), [0.7, 0.0]);
        assert_eq!(values_of(&parameters, &start, &|c| [0.0, 2.0][c]), [f64::INFINITY, 0.4]);
        let response = Response { effect: 0, start, parameters: parameters.to_vec(), columns: Vec::new() };
        assert!(one_sided(&response, 0) && one_sided(&response, 1));
    }
}
