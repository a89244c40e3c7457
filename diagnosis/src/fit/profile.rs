//! What the training data know of an effect's parameters, as far as these can go.
//!
//! Derivatives tell what a small change does. Some changes do nothing from a size on: a friction that holds a wheel at rest holds it at twice that size
//! as well, and what its derivative shows there is only how the steps of the simulation fall. So each parameter is moved to either side by more
//! than the 95 % interval that derivatives give it, and farther while the likelihood falls less than it would at the end of one. An interval
//! that is wider than e's by w leaves of the information H
//!
//! H' = H − (1 − 1/w²) e eᵀ / C_jj
//!
//! which has 1/w² of what was known of e and all that is known of the others beside it.

use nalgebra::DMatrix;

use super::algebra::Directions;
use super::search::{Fit, evaluate};
use super::setting::{Runner, Setting};
use super::whitening::Whitening;

/// Half of a 95 % interval in standard deviations, and what twice the log-likelihood loses there.
const INTERVAL: f64 = 2.0;
const LOST: f64 = INTERVAL * INTERVAL;
/// Most that an interval is widened.
const WIDEST: f64 = 64.0;

/// What is known of the parameters of a fit.
pub(crate) struct Known {
    /// The information, with what is not known of effects' parameters taken out.
    pub(crate) information: DMatrix<f64>,
    /// Of each effect's parameter the standard deviation to either side.
    pub(crate) deviations: Vec<[f64; 2]>,
}

impl Known {
    /// As derivatives tell it.
    pub(crate) fn by_derivatives(setting: &Setting<'_>, fit: &Fit) -> Self {
        let information = fit.information(setting);
        let covariance = Directions::of(&information).inverse();
        let deviations = (setting.free()..fit.point.x.len()).map(|j| [covariance[(j, j)].max(0.0).sqrt(); 2]).collect();
        Self { information, deviations }
    }

    /// As the likelihood tells it; `None` where the fit cannot be simulated again.
    pub(crate) fn of(setting: &Setting<'_>, runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: &Fit) -> Option<Self> {
        let best = evaluate(setting, runner, whitening, &fit.point)?;
        let mut information = fit.information(setting);
        let mut deviations = Vec::with_capacity(fit.point.x.len() - setting.free());
        for j in setting.free()..fit.point.x.len() {
            let variance = Directions::of(&information).inverse()[(j, j)];
            if variance <= 0.0 {
                deviations.push([0.0; 2]);
                continue;
            }
            let deviation = variance.sqrt();
            let wider = [-1.0, 1.0].map(|side| width(setting, runner, whitening, &best, j, side * INTERVAL * deviation));
            deviations.push(wider.map(|wider| wider * deviation));
            information[(j, j)] -= (1.0 - wider[0].max(wider[1]).powi(-2)) / variance;
        }
        Some(Self { information, deviations })
    }
}

/// How many times its distance a parameter can go before it is known to be wrong.
fn width(setting: &Setting<'_>, runner: &mut Runner<'_, '_>, whitening: &Whitening, best: &Fit, unknown: usize, distance: f64) -> f64 {
    let (lower, upper) = runner.parameters[unknown - setting.free()].bounds;
    let mut width = 1.0;
    while width < WIDEST {
        let mut point = best.point.clone();
        point.x[unknown] += 2.0 * width * distance;
        let there = if (lower..=upper).contains(&point.x[unknown]) { evaluate(setting, runner, whitening, &point) } else { None };
        if there.is_none_or(|there| best.likelihood(setting) - there.likelihood(setting) >= LOST) {
            break;
        }
        width *= 2.0;
    }
    width
}
