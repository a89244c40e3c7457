//! Of what is only known to be at least so large, the least.
//!
//! A friction that holds a wheel at rest holds it at twice that size as well, and a search stops at whatever size it came upon. Other driving
//! overcomes what is too large less often than it should. So where half of a parameter explains as much, though its derivative says otherwise, it
//! goes down to where less would show, as far as the form of a law is exact. So does a size of which the data show nothing at all, what a friction takes
//! of a wheel backwards that never rolls backwards: where a search has left it far out, other driving cannot tell it what it should be.

use nalgebra::DMatrix;

use super::{SHARE, Search, State};
use crate::fit::algebra::Directions;
use crate::fit::search::{Effort, Fit, evaluate, maximise};
use crate::fit::setting::Setting;
use crate::fit::whitening::Whitening;

/// Twice the log-likelihood that half of a parameter may lose: that of two standard deviations.
const LOST: f64 = 4.0;
/// The same that its derivative promises for that to say anything: eight standard deviations.
const PROMISED: f64 = 64.0;
/// Most halvings of a parameter, and then of the step back.
const HALVINGS: i32 = 10;
const FINER: usize = 3;
/// How far the other unknowns follow.
const FOLLOWING: Effort = Effort { trials: 8, worthwhile: 0.1, target: f64::NEG_INFINITY };

/// What the derivatives of a fit tell of its unknowns.
struct Told {
    information: DMatrix<f64>,
    covariance: DMatrix<f64>,
}

impl Told {
    fn by(fit: &Fit, setting: &Setting<'_>) -> Self {
        let information = fit.information(setting);
        let covariance = Directions::of(&information).inverse();
        Self { information, covariance }
    }

    /// Whether the data show nothing of an unknown of some size.
    fn hides(&self, unknown: usize, size: f64) -> bool {
        size != 0.0 && size.powi(2) * self.information[(unknown, unknown)] < LOST
    }

    /// Whether half of an unknown's size should show.
    fn promises(&self, unknown: usize, size: f64) -> bool {
        let variance = self.covariance[(unknown, unknown)];
        variance > 0.0 && (0.5 * size).powi(2) >= PROMISED * variance
    }
}

impl Search<'_> {
    /// The state with parameters that can be less at no loss as small as they can be; the base fit is one under the same noise.
    pub(crate) fn modest(&self, mut state: State, whitening: &Whitening, base: &Fit) -> State {
        let told_by = |fit: &Fit| Told::by(fit, &self.setting);
        let mut told = told_by(&state.fit);
        for (k, parameter) in self.parameters(&state.effects).iter().enumerate().filter(|_| !self.setting.exhausted()) {
            // A limit does nothing where it is infinite.
            let Some(neutral) = parameter.neutral.filter(|n| n.is_finite() && parameter.usual.is_none()) else { continue };
            let (unknown, size) = (self.setting.free() + k, state.fit.point.x[self.setting.free() + k] - neutral);
            let hidden = told.hides(unknown, size);
            if !hidden && !told.promises(unknown, size) {
                continue;
            }
            let gained = state.fit.likelihood(&self.setting) - base.likelihood(&self.setting);
            let most = if hidden { LOST } else { LOST.max(SHARE * gained) };
            if let Some(fit) = self.least(&state, whitening, k, neutral, most) {
                told = told_by(&fit);
                state.fit = fit;
            }
        }
        state
    }

    /// The fit with an effects' parameter as near to where it does nothing as it can go for what may be lost at most, if it can go half of the way.
    fn least(&self, state: &State, whitening: &Whitening, parameter: usize, neutral: f64, most: f64) -> Option<Fit> {
        let (fit, unknown) = (&state.fit, self.setting.free() + parameter);
        let size = fit.point.x[unknown] - neutral;
        let at = |share: f64, lost: f64| {
            let mut point = fit.point.clone();
            point.x[unknown] = neutral + share * size;
            let mut runner = self.runner(&state.effects, &point)?;
            // The search would take it back to where it came from.
            runner.parameters[parameter].bounds = (point.x[unknown], point.x[unknown]);
            let there = evaluate(&self.setting, &mut runner, whitening, &point)?;
            let there = maximise(&self.setting, &mut runner, whitening, there, FOLLOWING, true);
            (fit.likelihood(&self.setting) - there.likelihood(&self.setting) < lost).then_some(there)
        };
        let mut found = at(0.5, LOST)?;
        let (mut less, mut share) = (0.25, 0.5);
        for _ in 0..HALVINGS {
            let Some(there) = at(less, most) else { break };
            (found, less, share) = (there, 0.5 * less, less);
        }
        for _ in 0..FINER {
            let middle = 0.5 * (less + share);
            match at(middle, most) {
                Some(there) => (found, share) = (there, middle),
                None => less = middle,
            }
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use serde::{Deserialize, Serialize};
    use wheelwright_core::Effect;
    use wheelwright_core::effect::{EffectParameter, Estimate, Instant, Scene, Stage, Start};

    use super::*;
    use crate::fixture::{Case, NOISE, normal, with_selected};
    use crate::noise::Noise;
    use crate::select::{FINAL, Selected};

    /// What the forward command loses, of which more than this changes nothing.
    const ENOUGH: f64 = 0.05;

    /// A loss that is full from a size on, but for a ripple that no data show: what steps of a simulation leave of a threshold. And one beyond any command.
    #[derive(Debug, Clone, Default, Serialize, Deserialize)]
    struct Full;

    #[typetag::serde(name = "full-of-a-test")]
    impl Effect for Full {
        fn name(&self) -> &str {
            "full"
        }

        fn about(&self) -> String {
            "a loss that is full from a size on".to_owned()
        }

        fn stage(&self) -> Stage {
            Stage::Threshold
        }

        fn parameters(&self, _: &Scene) -> Vec<EffectParameter> {
            ["size", "beyond"].map(|name| EffectParameter::new(name, "m/s", (0.0, 10.0), 0.01).neutral(0.0)).into()
        }

        fn starts(&self, _: &Scene) -> Vec<Start> {
            vec![Start { values: vec![ENOUGH; 2], columns: vec![vec![0]], linear: false }]
        }

        fn statement(&self, _: &[Estimate], _: &Scene) -> String {
            String::new()
        }

        fn excitation(&self) -> &'static str {
            ""
        }

        fn command(&self, p: &[f64], _: &Instant<'_>, _: &[f64], _: &mut [f64], u: &mut [f64]) {
            // Without a command nothing is lost.
            u[0] -= (1e3 * u[0]).clamp(-1.0, 1.0) * p[0].min(ENOUGH) + 5e-5 * (50.0 * p[0]).sin();
            if u[0].abs() > 1e3 {
                u[0] -= p[1];
            }
        }
    }

    /// Hands a test a selection of that loss, at a size that is far too large, from a recording in which forward commands lose just enough.
    fn with_too_much(test: impl FnOnce(&Search<'_>, Selected)) {
        let mut case = Case::new(11, |_, i, y, _, random| y + NOISE[i] * normal(random));
        let forward = case.data.stretches.iter_mut().flat_map(|stretch| &mut stretch.inputs[0]);
        forward.filter(|u| **u != 0.0).for_each(|u| *u += u.signum() * ENOUGH);
        let library: Vec<Box<dyn Effect>> = vec![Box::new(Full)];
        with_selected(&case, &library, 1, |search, mut selected| {
            let noise = Noise::white(&NOISE, &search.setting.layout);
            let (whitening, fit) = search.under(&[0], &selected.state.fit, &noise, FINAL).unwrap();
            (selected.whitening, selected.base) = (whitening, search.under(&[], &selected.base, &noise, FINAL).unwrap().1);
            let mut point = fit.point;
            point.x[search.setting.free()..].fill(160.0 * ENOUGH);
            let there = Effort { trials: 0, ..FOLLOWING };
            selected.state.fit = search.fitted_from(&[0], &point, &selected.whitening, there, true).unwrap();
            test(search, selected);
        });
    }

    #[test]
    fn what_can_be_less_at_no_loss_is_the_least_that_does() {
        with_too_much(|search, selected| {
            let before = selected.state.fit.likelihood(&search.setting);
            let lost = SHARE * selected.gained(&search.setting, &selected.state.fit);
            let modest = search.modest(selected.state, &selected.whitening, &selected.base);
            let [size, beyond] = modest.fit.point.x[search.setting.free()..] else { panic!() };
            assert!((0.8 * ENOUGH..1.1 * ENOUGH).contains(&size), "{size}");
            // Of which nothing shows, hardly anything stays.
            assert!(beyond < 0.1 * ENOUGH, "{beyond}");
            assert!(before - modest.fit.likelihood(&search.setting) < lost);
        });
    }

    #[test]
    fn what_more_of_changes_nothing_is_not_known_by_its_derivative() {
        with_too_much(|search, selected| {
            let known = search.known_of(&selected.state, &selected.whitening.noise);
            let variance =
                |information: &DMatrix<f64>| Directions::of(information).inverse()[(search.setting.free(), search.setting.free())];
            let by_derivatives = variance(&selected.state.fit.information(&search.setting));
            assert!(known.deviations[0][0] >= 8.0 * by_derivatives.sqrt(), "{:?}", known.deviations);
            assert!(variance(&known.information) > 50.0 * by_derivatives);
        });
    }
}
