//! A walk over the values of an effect whose likelihood has many maxima: what it does hangs on moments, and a step by its slope leads to the
//! nearest of them. Each value by itself is made greater or smaller, in strides that become shorter, as long as that leads uphill.

use std::ops::Range;

use wheelwright_core::effect::EffectParameter;

use crate::fit::search::{Fit, evaluate};
use crate::fit::setting::Runner;
use crate::fit::whitening::Whitening;
use crate::select::Search;

/// Factors of a value's strides, one after the other. Moments are met within a tenth of what leads to them.
const STRIDES: [f64; 3] = [1.6, 1.25, 1.1];
/// Most looks of a walk.
const LOOKS: usize = 90;
/// Twice the log-likelihood by which a look has to be better.
const UPHILL: f64 = 0.5;

impl Search<'_> {
    /// The best that a walk over the values of a model's last effect comes by; the other unknowns stay.
    pub(crate) fn walked(&self, last: usize, runner: &mut Runner<'_, '_>, whitening: &Whitening, fit: Fit) -> Fit {
        let parameters = self.effect(last).parameters(self.setting.scene);
        let own = fit.point.x.len() - parameters.len()..fit.point.x.len();
        let (mut best, mut looks) = (fit, 0);
        for stride in STRIDES {
            let moves: Vec<(usize, f64)> = (0..own.len()).flat_map(|i| [(i, stride), (i, 1.0 / stride)]).collect();
            // Moves since the last one that led uphill: one that does is made again.
            let (mut at, mut since) = (0, 0);
            while since < moves.len() && looks < LOOKS {
                let (i, factor) = moves[at % moves.len()];
                looks += 1;
                match self.uphill(&parameters[i], &own, (i, factor), runner, whitening, &best) {
                    Some(better) => (best, since) = (better, 0),
                    None => (at, since) = (at + 1, since + 1),
                }
            }
        }
        best
    }

    /// A fit with one value another one, if it is better.
    fn uphill(
        &self,
        parameter: &EffectParameter,
        own: &Range<usize>,
        (i, factor): (usize, f64),
        runner: &mut Runner<'_, '_>,
        whitening: &Whitening,
        fit: &Fit,
    ) -> Option<Fit> {
        let mut point = fit.point.clone();
        let value = &mut point.x[own.start + i];
        let (low, high) = parameter.bounds;
        // From nothing a factor leads nowhere.
        let to = if value.abs() < parameter.scale { *value + (factor - 1.0).signum() * parameter.scale } else { *value * factor };
        let to = to.clamp(low, high);
        if to == *value {
            return None;
        }
        *value = to;
        let there = evaluate(&self.setting, runner, whitening, &point)?;
        (there.likelihood(&self.setting) > fit.likelihood(&self.setting) + UPHILL).then_some(there)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::Effect;

    use crate::effects::Backlash;
    use crate::fit::search::{Effort, evaluate, join, maximise};
    use crate::fixture::{hiding, point, with_selected};

    const GAP: f64 = 0.008;

    #[test]
    fn a_walk_leads_where_slopes_do_not() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(Backlash { at_motor: true, ..Backlash::default() })];
        let values = |gap: f64, spin_up: f64| [gap, spin_up, 0.05, 0.05, 1.0];
        let case = hiding(3, &library, &[0], &values(GAP, 0.04));
        with_selected(&case, &library, 0, |search, selected| {
            let whitening = &selected.whitening;
            let point = point(&selected.base, search.setting.free(), &values(1.7 * GAP, 0.02));
            let mut runner = search.runner(&[0], &point).unwrap();
            let mut fit = evaluate(&search.setting, &mut runner, whitening, &point).unwrap();
            let likelihood = |fit: &crate::fit::search::Fit| fit.likelihood(&search.setting);
            let walked = search.walked(0, &mut runner, whitening, fit.clone());
            join(&mut runner, whitening, &mut fit, &selected.base.columns);
            let effort = Effort { trials: 30, worthwhile: 0.5, target: f64::NEG_INFINITY };
            let slid = maximise(&search.setting, &mut runner, whitening, fit, effort, false);
            assert!(likelihood(&walked) > likelihood(&slid) + 100.0, "{} and {}", likelihood(&walked), likelihood(&slid));
        });
    }
}
