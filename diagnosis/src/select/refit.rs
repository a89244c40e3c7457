//! The model again: with fewer effects, from elsewhere, or under another noise.

use super::{COMPARING, FINAL, Search, Selected, State, TOLD, Unbent, quieter};
use crate::fit::Fitted;
use crate::fit::algebra::Directions;
use crate::fit::base::renew;
use crate::fit::profile::Known;
use crate::fit::search::{Effort, Fit, evaluate, left, maximise, settled};
use crate::fit::setting::Point;
use crate::fit::whitening::Whitening;
use crate::noise::Noise;

/// How often a fit is made again at most under the markedly quieter noise that it leaves.
const RENEWALS: usize = 4;

impl<'a> Search<'a> {
    /// A fit under the noise that it leaves itself. A candidate was simulated from the initial outputs of the model that it joins, which what that
    /// misses may have drawn far off: its noise is what it leaves from its own likeliest ones.
    pub(crate) fn under_its_own(&self, indices: &[usize], fit: &Fit, whitening: &Whitening, effort: Effort) -> Option<(Whitening, Fit)> {
        let mut runner = self.runner(indices, &fit.point)?;
        let mut there = evaluate(&self.setting, &mut runner, whitening, &fit.point)?;
        there.columns.clone_from(&fit.columns);
        let fit = settled(&self.setting, &mut runner, whitening, there);
        let (whitening, fit) = renew(&self.setting, &mut runner, self.left_noise(&fit, whitening), &fit, effort)?;
        Some(self.quieted(indices, whitening, fit, effort))
    }

    /// The noise that a fit leaves.
    fn left_noise(&self, fit: &Fit, whitening: &Whitening) -> Noise {
        let taken = fit.rank(&self.setting) as f64 + whitening.taken();
        self.setting.noise(&left(&self.setting, &fit.simulated), taken)
    }

    /// A fit under the noise that it leaves itself, as long as it leaves markedly less than it was fitted under: what a threshold or a limit in the wrong
    /// place misses passes for loud and slow noise until it is in the right one.
    pub(super) fn quieted(&self, indices: &[usize], mut whitening: Whitening, mut fit: Fit, effort: Effort) -> (Whitening, Fit) {
        for _ in 0..RENEWALS {
            let noise = self.left_noise(&fit, &whitening);
            if !quieter(&noise, &whitening.noise) {
                break;
            }
            let renewed = self.runner(indices, &fit.point).and_then(|mut runner| renew(&self.setting, &mut runner, noise, &fit, effort));
            let Some(renewed) = renewed else { break };
            (whitening, fit) = renewed;
        }
        (whitening, fit)
    }

    /// The free run of a model at a point, flat; `None` where it cannot be simulated.
    pub(crate) fn run_of(&self, indices: &[usize], point: &Point) -> Option<Vec<f64>> {
        let mut run = vec![0.0; self.setting.layout.len()];
        self.runner(indices, point)?.run(&point.x, &point.starts, &mut run).then_some(run)
    }

    /// The fit from a point under a noise model.
    pub(crate) fn at(&self, indices: &[usize], point: Point, noise: &Noise) -> Option<(Whitening, Fit)> {
        let mut runner = self.runner(indices, &point)?;
        let mut simulated = vec![0.0; self.setting.layout.len()];
        if !runner.run(&point.x, &point.starts, &mut simulated) {
            return None;
        }
        let whitening = Whitening::new(noise.clone(), &self.setting.layout, &mut runner, &point);
        let fit = evaluate(&self.setting, &mut runner, &whitening, &point)?;
        let fit = maximise(&self.setting, &mut runner, &whitening, fit, COMPARING, false);
        Some((whitening, fit))
    }

    /// What the data know of the parameters of a model that was fitted under a noise: by the likelihood if there are effects, and time to find it out.
    pub(crate) fn known_of(&self, state: &State, noise: &Noise) -> Known {
        let State { effects, fit } = state;
        let worthwhile = !effects.is_empty() && !self.setting.exhausted();
        let runner = if worthwhile { self.runner(effects, &fit.point) } else { None };
        let by_likelihood = runner.and_then(|mut runner| {
            let whitening = Whitening::new(noise.clone(), &self.setting.layout, &mut runner, &fit.point);
            Known::of(&self.setting, &mut runner, &whitening, fit)
        });
        by_likelihood.unwrap_or_else(|| Known::by_derivatives(&self.setting, fit))
    }

    /// The fit from a point under a noise that is whitened as it was; its columns are exact if `exact`.
    pub(crate) fn fitted_from(&self, indices: &[usize], point: &Point, whitening: &Whitening, effort: Effort, exact: bool) -> Option<Fit> {
        self.fitted_with(Vec::new(), indices, point, whitening, effort, exact)
    }

    /// The fit from another one that is near, in another scene or at another place: its columns are those until a step disappoints.
    pub(crate) fn fitted_near(&self, indices: &[usize], near: &Fit, whitening: &Whitening, effort: Effort) -> Option<Fit> {
        self.fitted_with(near.columns.clone(), indices, &near.point, whitening, effort, false)
    }

    /// The fit from a point whose columns may be those of somewhere near, or none.
    fn fitted_with(
        &self,
        columns: Vec<Vec<f64>>,
        indices: &[usize],
        point: &Point,
        whitening: &Whitening,
        effort: Effort,
        exact: bool,
    ) -> Option<Fit> {
        let mut runner = self.runner(indices, point)?;
        let mut there = evaluate(&self.setting, &mut runner, whitening, point)?;
        there.columns = columns;
        Some(maximise(&self.setting, &mut runner, whitening, there, effort, exact))
    }

    /// A fit under another noise model.
    pub(crate) fn under(&self, indices: &[usize], fit: &Fit, noise: &Noise, effort: Effort) -> Option<(Whitening, Fit)> {
        let mut runner = self.runner(indices, &fit.point)?;
        renew(&self.setting, &mut runner, noise.clone(), fit, effort)
    }

    /// The model without each of its members.
    pub(crate) fn rests(&self, selected: &Selected) -> Vec<Option<State>> {
        (0..selected.state.effects.len()).map(|member| self.without(selected, member)).collect()
    }

    /// The selection with fewer members, fitted to the end under the same noise.
    pub(crate) fn only(&self, selected: &Selected, rest: &State) -> Option<Selected> {
        let (whitening, fit) = self.under(&rest.effects, &rest.fit, &selected.whitening.noise, FINAL)?;
        let state = State { effects: rest.effects.clone(), fit };
        Some(Selected { state, whitening, base: selected.base.clone(), rivals: Vec::new(), ranking: selected.ranking.clone() })
    }

    /// The model without one of its effects, refitted under the same noise.
    pub(crate) fn without(&self, selected: &Selected, member: usize) -> Option<State> {
        self.keeping(selected, &|i| i != member)
    }

    /// The model with some of its effects, refitted under the same noise.
    pub(crate) fn keeping(&self, selected: &Selected, keep: &dyn Fn(usize) -> bool) -> Option<State> {
        self.reduced(&selected.state, selected, keep)
    }

    /// A model with some of its effects, refitted under the noise of a selection.
    pub(super) fn reduced(&self, state: &State, selected: &Selected, keep: &dyn Fn(usize) -> bool) -> Option<State> {
        let kept: Vec<usize> = (0..state.effects.len()).filter(|i| keep(*i)).collect();
        let effects: Vec<usize> = kept.iter().map(|i| state.effects[*i]).collect();
        if effects.is_empty() {
            return Some(State { effects, fit: selected.base.clone() });
        }
        if effects.len() == state.effects.len() {
            return Some(state.clone());
        }
        let Unbent { x, columns } = self.part(state, keep);
        let point = Point { x, starts: state.fit.point.starts.clone() };
        let fit = self.fitted_with(columns, &effects, &point, &selected.whitening, COMPARING, true)?;
        Some(State { effects, fit })
    }

    /// The model's unknowns as they are beside one of its effects.
    pub(super) fn unbent(&self, state: &State, member: usize) -> Unbent {
        self.part(state, &|i| i != member)
    }

    /// The model's unknowns as they are, of those that stay if some of its effects do.
    pub(super) fn part(&self, state: &State, keep: &dyn Fn(usize) -> bool) -> Unbent {
        let (x, columns) = self.unknowns(state, keep).map(|j| (state.fit.point.x[j], state.fit.column(j))).unzip();
        Unbent { x, columns }
    }

    /// Indices of the unknowns of a model that stay if some of its effects do.
    pub(crate) fn unknowns(&self, state: &State, keep: &dyn Fn(usize) -> bool) -> impl Iterator<Item = usize> + use<> {
        let free = self.setting.free();
        let mut all: Vec<usize> = (0..free).collect();
        let mut at = free;
        for (i, index) in state.effects.iter().enumerate() {
            let n = self.effect(*index).parameters(self.setting.scene).len();
            if keep(i) {
                all.extend(at..at + n);
            }
            at += n;
        }
        all.into_iter()
    }

    /// The values of each effect's parameters.
    pub(crate) fn values(&self, state: &State) -> Vec<Vec<f64>> {
        let mut at = self.setting.free();
        let of = |effect: &usize| {
            let n = self.effect(*effect).parameters(self.setting.scene).len();
            at += n;
            state.fit.point.x[at - n..at].to_vec()
        };
        state.effects.iter().map(of).collect()
    }

    /// A state in the form that others work with.
    pub(crate) fn fitted(&self, state: &State) -> Fitted<'a> {
        let free = &state.fit.point.x[..self.setting.free()];
        let information = state.fit.information(&self.setting);
        let directions = Directions::of(&information);
        let (mut covariance, told) = (directions.inverse(), directions.visibility());
        (0..told.len()).filter(|j| told[*j] < TOLD).for_each(|j| covariance[(j, j)] = f64::INFINITY);
        Fitted {
            values: self.values(state),
            effects: self.effects(&state.effects),
            free: free.to_vec(),
            theta: self.setting.map.theta(free),
            initial: state.fit.point.starts.clone(),
            simulated: self.setting.layout.series(&state.fit.simulated),
            likelihood: state.fit.likelihood(&self.setting),
            rank: directions.rank(),
            information,
            covariance,
        }
    }

    /// Penalised gain of a member on top of the others.
    pub(crate) fn worth(&self, selected: &Selected, rest: &State) -> f64 {
        self.beyond(&selected.state.effects, &selected.state.fit, rest).1
    }

    /// What a fit gains on another model under the same noise, in twice the log-likelihood.
    pub(crate) fn gain(&self, fit: &Fit, rest: &State) -> f64 {
        fit.likelihood(&self.setting) - rest.fit.likelihood(&self.setting)
    }

    /// Degrees of freedom that a model has beyond another, and its penalised gain.
    pub(crate) fn beyond(&self, effects: &[usize], fit: &Fit, rest: &State) -> (f64, f64) {
        let freedom = self.freedom(effects, fit) - self.freedom(&rest.effects, &rest.fit);
        (freedom, self.gain(fit, rest) - self.penalty(freedom))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use super::*;
    use crate::effects::QuadraticDrag;
    use crate::fixture::{Case, with_selected};

    #[test]
    fn initial_outputs_that_another_model_drew_aside_are_no_noise() {
        let library: Vec<Box<dyn wheelwright_core::Effect>> = vec![Box::new(QuadraticDrag::default())];
        with_selected(&Case::clean(5), &library, 1, |search, selected| {
            let State { effects, fit } = &selected.state;
            let own = |fit: &Fit| search.under_its_own(effects, fit, &selected.whitening, COMPARING).unwrap();
            let mut drawn = fit.clone();
            drawn.point.starts.iter_mut().flatten().for_each(|start| *start += 0.3);
            let [(first, fit), (other, moved)] = [own(fit), own(&drawn)];
            for (a, b) in first.noise.deviation.iter().zip(&other.noise.deviation) {
                assert!((a / b - 1.0).abs() < 1e-3, "{a} {b}");
            }
            let apart = fit.point.starts.iter().flatten().zip(moved.point.starts.iter().flatten()).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) < 1e-3);
        });
    }
}
