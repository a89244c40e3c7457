//! What a whole explanation is worth.

use super::{COMPARING, Search, Selected, State};
use crate::fit::search::Fit;
use crate::fit::whitening::Whitening;

impl Search<'_> {
    /// Twice the log-likelihood of the whole less what its effects cost. Comparable between readings of the same data: the scale of
    /// each reading's own noise counts with it.
    pub(crate) fn evidence(&self, state: &State, whitening: &Whitening, base: &Fit) -> f64 {
        let scale = whitening.noise.scale(self.setting.layout.counted());
        let effects = state.effects.len() as f64;
        let freedom = (self.freedom(&state.effects, &state.fit) - self.freedom(&[], base)).max(effects);
        let cost = freedom * self.log_values() + effects * (self.penalty(1.0) - self.log_values());
        state.fit.likelihood(&self.setting) - scale - cost
    }

    /// The same under the noise that a selection leaves itself, where that is better: where nothing was added the noise is that of all that
    /// effects could do.
    pub(crate) fn own_evidence(&self, selected: &Selected) -> f64 {
        let Selected { state: State { effects, fit }, whitening, base, .. } = selected;
        let given = self.evidence(&selected.state, whitening, base);
        let Some((whitening, fit)) = self.under_its_own(effects, fit, whitening, COMPARING) else { return given };
        let own = self.evidence(&State { effects: effects.clone(), fit }, &whitening, base);
        own.max(given)
    }
}
