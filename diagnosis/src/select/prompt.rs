//! Lateness that every drive has is no effect.
//!
//! A model of first order leaves out the loops of the firmware, which hold their output for a period, the motors' windings, and tyres, which creep:
//! each makes a robot late by some milliseconds, which enough data show, and which nobody would look for.

use super::settle::others;
use super::{Search, Selected, State};
use crate::comparison::rates;
use crate::effects::LATENESS;
use crate::fit::setting::Setting;

/// By how much a loop is late that runs at 100 Hz, as slow as those of a robot's firmware usually are, and holds its output for a period: by half
/// of it \[s\].
const HELD: f64 = 0.005;
/// By how much a loop is late that runs as often as is usual at the most, at ten times the rate ω of what it controls (ω h from 0.1 to 0.6: Åström and
/// Wittenmark, Computer-Controlled Systems): by h/2, as a share of the time constant.
const PROMPT: f64 = 0.05;

impl Search<'_> {
    /// A selection that has a member which makes the model late by no more than any drive is, without it; and by how much \[s\].
    pub(crate) fn prompt(&self, selected: &Selected) -> Option<(Selected, f64)> {
        let usual =
            |member: usize| self.lateness(&selected.state, member).filter(|late| *late < HELD.min(PROMPT * self.slowest(&selected.state)));
        let (member, late) = (self.fixed(selected)..selected.state.effects.len()).find_map(|member| Some((member, usual(member)?)))?;
        let fewer = self.only(selected, &self.without(selected, member)?)?;
        let (_, rivals) = others(selected, member);
        Some((Selected { rivals, ..fewer }, late))
    }

    /// By how much a member makes the model late at the most \[s\], if that is what it does.
    fn lateness(&self, state: &State, member: usize) -> Option<f64> {
        let effect = self.effect(state.effects[member]);
        let (parameters, values) = (effect.parameters(self.setting.scene), self.values(state).swap_remove(member));
        let times = parameters.iter().zip(&values).filter(|(p, _)| p.unit == "s").map(|(_, value)| *value);
        (effect.family() == LATENESS).then(|| times.fold(0.0, f64::max))
    }

    /// The longest time constant of the model's outputs \[s\]; none where it has none.
    fn slowest(&self, state: &State) -> f64 {
        let Setting { model, map, .. } = &self.setting;
        let rates = rates(*model, &map.theta(&state.fit.point.x[..self.setting.free()])).unwrap_or_default();
        rates.into_iter().filter(|rate| *rate > 0.0).map(f64::recip).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::effect::Effect;

    use crate::effects::{CommandDelay, QuadraticDrag};
    use crate::fixture::{Case, with_selected};

    #[test]
    fn a_lateness_that_any_drive_has_is_no_effect_and_a_longer_one_is() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(QuadraticDrag::default()), Box::new(CommandDelay::default())];
        with_selected(&Case::clean(5), &library, 2, |search, mut selected| {
            let delay = selected.state.fit.point.x.len() - 1;
            // Time constants of 0.22 and 0.17 s.
            let mut told = |late: f64| {
                selected.state.fit.point.x[delay] = late;
                search.prompt(&selected).map(|(fewer, late)| (fewer.state.effects, late))
            };
            assert_eq!(told(0.004), Some((vec![0], 0.004)));
            assert_eq!(told(0.006), None);
        });
        // A robot of a tenth of these time constants is late by 2 ms with less reason.
        with_selected(&Case::clean(5), &library[1..], 1, |search, mut selected| {
            selected.state.fit.point.x[..2].iter_mut().for_each(|theta| *theta *= 0.1);
            *selected.state.fit.point.x.last_mut().unwrap() = 0.002;
            assert!(search.prompt(&selected).is_none());
        });
    }
}
