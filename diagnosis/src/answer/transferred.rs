//! Whether an explanation holds on held-out data: as it was fitted, or with parameters as these have them.

use statrs::distribution::{ChiSquared, ContinuousCDF};
use wheelwright_core::Dataset;
use wheelwright_core::effect::Scene;

use crate::adequacy::Jitter;
use crate::holdout::{Floor, Loss, Run, Transfer, foreign, transfer};
use crate::leeway::{Court, Leeway};
use crate::residuals::Series;
use crate::select::{SHARE, Search, Selected, State};

use super::MENTIONED;
use super::unseen::unseen;

/// Chance with which the true parameters cost more on the training data, in twice the log-likelihood, than they may to be where held-out data have them.
const UNLUCKY: f64 = 1e-3;

/// Held-out data, and what an explanation may leave of them.
pub(super) struct There<'t, 'a> {
    pub(super) search: &'t Search<'a>,
    pub(super) selected: &'t Selected,
    pub(super) data: &'t Dataset,
    pub(super) scene: &'t Scene,
    pub(super) jitter: Option<Jitter>,
    /// What the model leaves that the explanation is compared with.
    pub(super) before: Vec<Loss>,
    /// What noise alone leaves.
    pub(super) floor: Vec<Floor>,
}

/// What they say of an explanation.
pub(super) struct Transferred {
    pub(super) transfer: Transfer,
    /// Whether they show motion that the training data lack.
    pub(super) foreign: bool,
    /// Another part of a cause that was found, which only they show, if that is what the explanation lacks there.
    pub(super) unseen: Option<String>,
}

impl There<'_, '_> {
    /// Weighs the free run of an explanation, beside those of what is left of it without each of its members.
    pub(super) fn weigh(&self, after: &Series, rests: &[(&State, &Series)]) -> Transferred {
        let leeway = Leeway::new(self.search, &self.selected.state, &self.selected.whitening.noise);
        let court = Court::new(&leeway, after, self.data, self.scene);
        let refuted = rests.iter().any(|(rest, without)| court.refutes(rest, without));
        let after = self.losses(after);
        let mut unseen = None;
        let transfer = if refuted {
            Transfer::Fails
        } else if self.holds(&after) {
            Transfer::Holds
        } else if self.saved(&leeway) {
            Transfer::Open
        } else {
            unseen = self.unseen();
            if unseen.is_some() { Transfer::Open } else { Transfer::Fails }
        };
        Transferred { transfer, foreign: transfer != Transfer::Open && foreign(&after, &self.floor), unseen }
    }

    fn losses(&self, run: &Series) -> Vec<Loss> {
        Run { data: self.data, scene: self.scene, simulated: run }.losses(&self.selected.whitening.noise.deviation, self.jitter)
    }

    fn holds(&self, after: &[Loss]) -> bool {
        transfer(&self.before, after, &self.floor) == Transfer::Holds
    }

    /// Whether the explanation holds with leeway. Leeway that saves the base model as well speaks for nothing that was added to it, unless that
    /// has to go decisively farther.
    fn saved(&self, leeway: &Leeway<'_, '_>) -> bool {
        let Self { search, selected, .. } = self;
        let base = selected.plain();
        let base_cost = || {
            let alone = selected.state.effects.is_empty();
            if alone { None } else { self.cost(&Leeway::new(search, &base, &selected.whitening.noise)) }
        };
        self.cost(leeway).is_some_and(|own| base_cost().is_none_or(|farther| farther > own + MENTIONED))
    }

    /// What the leeway costs with which an explanation holds, as far as it is affordable.
    fn cost(&self, leeway: &Leeway<'_, '_>) -> Option<f64> {
        let Self { search, selected, .. } = self;
        // What parameters cost at their true values, and what the imperfect form of a law makes of them.
        let most = affordable(selected.state.fit.rank(&search.setting)) + SHARE * selected.gained(&search.setting, &selected.state.fit);
        let there = leeway.moved_within(most, self.data, self.scene)?;
        self.holds(&self.losses(&there.simulated)).then_some(there.cost)
    }

    /// The other part of a cause with which the explanation holds, in a sentence.
    fn unseen(&self) -> Option<String> {
        let there = unseen(self.search, self.selected, self.data, self.scene, |run| self.losses(run))?;
        self.holds(&there.losses).then_some(there.statement)
    }
}

/// What so many parameters cost at their true values, but for bad luck: chi-squared.
fn affordable(freedom: usize) -> f64 {
    ChiSquared::new(freedom.max(1) as f64).map_or(0.0, |cost| cost.inverse_cdf(1.0 - UNLUCKY))
}
