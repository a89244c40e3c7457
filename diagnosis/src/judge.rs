//! Held-out driving as the judge between explanations that the training data cannot tell apart.
//!
//! Where no wheel reverses, friction, an offset and a dead zone are one; another kind of driving tells them apart without any parameter
//! being fitted to it. Only rivals that the evidence leaves within reach are judged, as near as laws are exact, and only a decisive
//! difference counts, one that remains when either has its parameters where the held-out data would have them, as far as the training data
//! let them go (`leeway.rs`).
//!
//! What the training data show to be too little beside what was explained to be more than the imperfect form of that, joins if the held-out data want
//! it as decisively and, once all is fitted to the end beside it, it is more after all: another kind of driving shows how a law is imperfect elsewhere, and that is
//! no cause.
//!
//! So does the wider law of two, friction by direction and plain friction, that the training data hardly tell apart.
//!
//! An effect beside others goes if they do decisively better on the held-out data without it, or if these know nothing of what it changes
//! there, whatever its evidence on the training data: it stood in for the imperfect form of the others there. So does one against which they say more
//! than the training data say for it: what both say together is its evidence.

use std::cell::LazyCell;

use wheelwright_core::Dataset;
use wheelwright_core::effect::Scene;

use crate::adequacy::Jitter;
use crate::answer::{MENTIONED, always, clocks, like_a_threshold, mentioned, proven};
use crate::holdout::{Run, Runs, UNHURT, level, shifted};
use crate::leeway::{Court, Leeway, Moved};
use crate::noise::Noise;
use crate::question::Question;
use crate::residuals::Series;
use crate::screen::Response;
use crate::select::{FINAL, Newest, Rival, SHARE, Search, Selected, State};

/// Share of a rival's held-out excess that a better explanation may leave: the same half by which an explanation has to close it.
const CLOSED: f64 = 0.5;

/// The selection as the held-out data leave it: without members that they reject, with each of the others exchanged for the rival that they
/// prefer decisively, and without the rivals that they rule out.
pub(crate) fn judged(question: &Question<'_>, search: &Search<'_>, mut selected: Selected, first: &[Response]) -> Selected {
    let Some(bench) = Bench::new(question, search, &selected) else { return selected };
    while let Some(fewer) = bench.fewer(search, &selected) {
        selected = fewer;
        search.exchange(&mut selected, first, Newest::Open);
    }
    selected = exchanged(&bench, search, selected);
    let contested = |mut fewer: Selected| {
        search.exchange(&mut fewer, first, Newest::Open);
        exchanged(&bench, search, fewer)
    };
    while let Some(fewer) = bench.borne_out(search, &selected) {
        selected = contested(fewer);
    }
    while let Some(fewer) = bench.supported(search, &selected) {
        selected = contested(fewer);
    }
    while let Some(more) = bench.further(search, &selected, first) {
        selected = exchanged(&bench, search, more);
    }
    selected
}

/// The selection with a law in a member's place that contains it, where the held-out data decisively ask for one: what it explains beyond the
/// narrow one on the training data was too little to be more than the imperfect form of that.
pub(crate) fn widened(question: &Question<'_>, search: &Search<'_>, selected: &Selected) -> Option<Selected> {
    let bench = Bench::new(question, search, selected)?;
    let own = bench.missed(search, selected)?;
    bench.widened(search, selected, own).map(|wide| exchanged(&bench, search, wide))
}

/// Each member exchanged for the rival that the held-out data prefer decisively.
fn exchanged(bench: &Bench<'_>, search: &Search<'_>, mut selected: Selected) -> Selected {
    // The form of a law is never exact: rivals differ by as much for no other reason.
    let explained = selected.gained(&search.setting, &selected.state.fit);
    let farthest = MENTIONED.max(SHARE * explained);
    if !selected.rivals.iter().flatten().any(|r| r.gap - r.cost.max(0.0) < farthest) {
        return selected;
    }
    let base = selected.plain();
    let plain = LazyCell::new(|| bench.loss(search, &base));
    let mut known = None;
    let mut member = 0;
    for _ in 0..selected.state.effects.len() {
        let Some(rivals) = selected.rivals.get_mut(member).map(std::mem::take) else { break };
        let found = search.effect(selected.state.effects[member]);
        let near_enough = |r: &Rival| mentioned(found, search.effect(r.effect), r, explained);
        // The same mathematics under every drive differs by what nobody recorded before the first sample.
        let (same, rivals): (Vec<_>, Vec<_>) = rivals.into_iter().partition(|r| always(found, search.effect(r.effect)).is_some());
        // What the training data hold for worse has to be better on other data as it stands.
        let better = |r: &Rival| r.gap < farthest && bench.better(search, &r.state, &selected.state);
        let rivals: Vec<Rival> = rivals.into_iter().filter(|r| near_enough(r) || better(r)).collect();
        let near = bench.contenders(search, &selected, rivals);
        if near.is_empty() {
            selected.rivals[member] = same;
            member += 1;
            continue;
        }
        let own = *known.get_or_insert_with(|| bench.with_leeway(search, &selected.state));
        // Of a threshold and a friction that look alike neither is exact near standstill: what differs by no more decides nothing between them.
        let (alike, mut others): (Vec<_>, Vec<_>) =
            near.into_iter().partition(|(loss, r)| like_a_threshold(found, search.effect(r.effect)) && inexact(*plain, own, *loss));
        let Some((loss, best)) = bench.preferred(&others, own).map(|i| others.remove(i)) else {
            let open = others.into_iter().filter(|(loss, _)| !bench.decisive(own, *loss)).chain(alike).map(|(_, r)| r);
            selected.rivals[member] = open.filter(near_enough).chain(same).collect();
            member += 1;
            continue;
        };
        others.extend(alike);
        // The one that came in stands last.
        selected.rivals.remove(member);
        selected.rivals.push(bench.beside(search, (loss, &best), others, explained));
        known = Some(loss);
        selected.state = best.state;
        member = 0;
    }
    selected
}

/// Held-out data and what an explanation leaves where it was fitted.
pub(crate) struct Bench<'q> {
    question: &'q Question<'q>,
    held: &'q Dataset,
    noise: Noise,
    jitter: Option<Jitter>,
    /// Loss that noise alone leaves on the held-out data.
    floor: f64,
    /// Independent values of the held-out data: those that the noise's own past does not foretell.
    values: f64,
}

impl<'q> Bench<'q> {
    pub(crate) fn new(question: &'q Question<'q>, search: &Search<'_>, selected: &Selected) -> Option<Self> {
        let held = question.held_out.filter(|h| !h.stretches.is_empty())?;
        let noise = &selected.whitening.noise;
        let share = (0..noise.deviation.len()).map(|c| noise.independent(c)).sum::<f64>();
        let jitter = search.jitter(selected);
        let trained = search.setting.layout.series(&selected.state.fit.simulated);
        let mut bench = Self { question, held, noise: noise.clone(), jitter, floor: 0.0, values: share * held.samples() as f64 };
        let floor = |data: &Dataset, scene: &Scene| {
            let run = proven(search, &selected.state, data, scene).simulated;
            let training = Run { data: search.setting.data, scene: search.setting.scene, simulated: &trained };
            level(&Runs { training, held_out: Run { data, scene, simulated: &run }, noise, jitter }.floor())
        };
        bench.floor = bench.likeliest(search, floor);
        Some(bench)
    }

    /// Mean loss on the held-out data, on the likeliest clock.
    pub(crate) fn loss(&self, search: &Search<'_>, state: &State) -> f64 {
        self.likeliest(search, |data, scene| self.of(data, scene, &proven(search, state, data, scene).simulated))
    }

    /// Mean loss of a free run.
    fn of(&self, data: &Dataset, scene: &Scene, simulated: &Series) -> f64 {
        Run { data, scene, simulated }.loss(&self.noise.deviation, self.jitter)
    }

    /// The same with the leeway that the training data leave, and what it costs there.
    fn with_leeway(&self, search: &Search<'_>, state: &State) -> f64 {
        let leeway = Leeway::new(search, state, &self.noise);
        let moved = self.likeliest(search, |data, scene| match leeway.moved(data, scene) {
            Some(Moved { simulated, cost, .. }) => self.with_cost(self.of(data, scene, &simulated), cost),
            None => f64::INFINITY,
        });
        moved.min(self.loss(search, state))
    }

    /// A loss with what it costs on the training data, in twice the log-likelihood.
    pub(crate) fn with_cost(&self, loss: f64, cost: f64) -> f64 {
        loss * (cost / self.values).exp()
    }

    /// Rivals fitted to the end, as small as they can be, each with the loss that it leaves. They were only fitted well enough to be ranked: what is left to
    /// the end counts on other data as much as a cause does.
    fn contenders(&self, search: &Search<'_>, selected: &Selected, rivals: Vec<Rival>) -> Vec<(f64, Rival)> {
        let to_the_end = |mut rival: Rival| {
            if let Some((whitening, fit)) = search.under(&rival.state.effects, &rival.state.fit, &selected.whitening.noise, FINAL) {
                let state = State { effects: rival.state.effects.clone(), fit };
                rival.state = search.modest(state, &whitening, &selected.base);
            }
            (self.with_leeway(search, &rival.state), rival)
        };
        rivals.into_iter().map(to_the_end).collect()
    }

    /// Which of some rivals these data decisively prefer to what leaves a loss. Among those that they hold for equal the library's order decides, as
    /// it does on the training data.
    fn preferred(&self, rivals: &[(f64, Rival)], own: f64) -> Option<usize> {
        let losses: Vec<f64> = rivals.iter().map(|(loss, _)| *loss).collect();
        let best = self.equals(&losses).min_by_key(|i| rivals[*i].1.effect)?;
        self.decisive(least(&losses), own).then_some(best)
    }

    /// What stays open of some rivals beside the one that took the member's place and leaves a loss, in a whole that explains so much.
    fn beside(&self, search: &Search<'_>, (loss, best): (f64, &Rival), rivals: Vec<(f64, Rival)>, explained: f64) -> Vec<Rival> {
        let found = search.effect(best.effect);
        // What is the same under every drive stays beside it whatever these data say.
        let same = |r: &Rival| always(found, search.effect(r.effect)).is_some();
        let open = rivals.into_iter().filter(|(other, r)| same(r) || !self.decisive(loss, *other));
        let moved = open.map(|(_, r)| Rival { gap: r.gap - best.gap, cost: r.cost - best.cost, ..r });
        moved.filter(|r| mentioned(found, search.effect(r.effect), r, explained)).collect()
    }

    /// Which of some losses are the least, but for chance.
    fn equals(&self, losses: &[f64]) -> impl Iterator<Item = usize> {
        let least = least(losses);
        (0..losses.len()).filter(move |i| !self.decisive(least, losses[*i]))
    }

    /// The least of a loss on every clock that the held-out data may have.
    fn likeliest(&self, search: &Search<'_>, loss: impl Fn(&Dataset, &Scene) -> f64) -> f64 {
        self.clocks(search).map(|(data, scene)| loss(&data, &scene)).fold(f64::INFINITY, f64::min)
    }

    /// The held-out data and their scene on every clock that they may have.
    fn clocks(&self, search: &Search<'_>) -> impl Iterator<Item = (Dataset, Scene)> {
        let headings = self.question.held_out_headings.as_deref();
        clocks(self.question.training, self.held).into_iter().map(move |by| {
            let moved = shifted(self.held, by);
            let scene = search.setting.scene.like(&moved, headings);
            (moved, scene)
        })
    }

    /// The selection without the member that the held-out data reject most, if they reject any.
    fn fewer(&self, search: &Search<'_>, selected: &Selected) -> Option<Selected> {
        let (_, rest) = self.rests(search, selected).into_iter().next()?;
        self.better(search, &rest, &selected.state).then(|| search.only(selected, &rest)).flatten()
    }

    /// The selection with a wider law, or else with a further effect that is small beside its members on the training data, where it is missed on the
    /// held-out data.
    fn further(&self, search: &Search<'_>, selected: &Selected, first: &[Response]) -> Option<Selected> {
        if selected.state.effects.len() == search.fixed(selected) {
            return None;
        }
        let own = self.missed(search, selected)?;
        let joined = || {
            search
                .joined_by_little(selected, first)
                .filter(|more| more_than_form(search, more) && self.better(search, &more.state, &selected.state))
        };
        // A wider law is one cause, a further effect another: a castor that rolls as heavily as the driven wheels do is no castor that drags.
        self.widened(search, selected, own).or_else(|| if search.full(selected) { None } else { joined() })
    }

    /// The selection with a law in a member's place that contains it, where these data miss what that has more; `own` is what it leaves itself.
    fn widened(&self, search: &Search<'_>, selected: &Selected, own: f64) -> Option<Selected> {
        let wider = (search.fixed(selected)..selected.state.effects.len()).flat_map(|member| search.wider(selected, member));
        // As it was fitted a wider law says nothing where what it has beyond the narrow one is what the training data do not show.
        let wider = wider.map(|wide| (self.with_leeway(search, &wide.state), wide)).filter(|(loss, _)| self.decisive(*loss, own));
        let (losses, mut wider): (Vec<f64>, Vec<Selected>) = wider.unzip();
        // Another form of what was found is no other cause.
        let renamed = |i: usize| search.names(&wider[i].state) != search.names(&selected.state);
        let best = self.equals(&losses).min_by(|a, b| renamed(*a).cmp(&renamed(*b)).then(losses[*a].total_cmp(&losses[*b])));
        best.map(|i| wider.swap_remove(i))
    }

    /// The held-out error if it is decisively above that of the training data: something is imperfect there.
    pub(crate) fn missed(&self, search: &Search<'_>, selected: &Selected) -> Option<f64> {
        Some(self.with_leeway(search, &selected.state)).filter(|loss| self.decisive(self.floor, *loss))
    }

    /// The selection without the member of which the held-out data know nothing and miss least, if there is such.
    fn borne_out(&self, search: &Search<'_>, selected: &Selected) -> Option<Selected> {
        let rests = self.rests(search, selected);
        if rests.is_empty() {
            return None;
        }
        let with = |(data, scene)| (proven(search, &selected.state, &data, &scene).simulated, data, scene);
        let clocks: Vec<(Series, Dataset, Scene)> = self.clocks(search).map(with).collect();
        let leeway = Leeway::new(search, &selected.state, &self.noise);
        let courts: Vec<Court<'_, '_>> = clocks.iter().map(|(with, data, scene)| Court::new(&leeway, with, data, scene)).collect();
        // Whether they know nothing, on whatever clock, of what the selection has beyond a rest.
        let unknown = |rest: &State| courts.iter().all(|c| c.refutes(rest, &proven(search, rest, c.data, c.scene).simulated));
        let (_, rest) = rests.iter().find(|(_, rest)| unknown(rest))?;
        search.only(selected, rest)
    }

    /// The selection without the member against which the held-out data say most, if that is more than the training data say for it, and not even with
    /// leeway they ask for it. One that stands alone stays where it hurts so much there that the verdict says that it does not transfer.
    fn supported(&self, search: &Search<'_>, selected: &Selected) -> Option<Selected> {
        let members = search.fixed(selected)..selected.state.effects.len();
        let (own, alone) = (self.loss(search, &selected.state), members.len() == 1);
        let against = |member: usize| {
            let rest = search.without(selected, member)?;
            let worth = search.worth(selected, &rest);
            let without = self.loss(search, &rest);
            let told = worth + self.values * (without / own).ln();
            (told < 0.0 && !(alone && own > UNHURT * without)).then_some((told, rest))
        };
        let (_, rest) = members.filter_map(against).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let asked_for = self.decisive(self.with_leeway(search, &selected.state), self.with_leeway(search, &rest));
        if asked_for { None } else { search.only(selected, &rest) }
    }

    /// The selection without each of its members, and the loss on the held-out data that this leaves; least first. One that stands alone has
    /// no others to stand in for, unless stamps jitter, which makes evidence for whatever acts while the robot accelerates: that it does not transfer is
    /// the verdict's business.
    fn rests(&self, search: &Search<'_>, selected: &Selected) -> Vec<(f64, State)> {
        let members = search.fixed(selected)..selected.state.effects.len();
        if selected.state.effects.len() + usize::from(self.jitter.is_some()) < 2 {
            return Vec::new();
        }
        let rests = members.filter_map(|member| search.without(selected, member)).map(|rest| (self.loss(search, &rest), rest));
        let mut rests: Vec<(f64, State)> = rests.collect();
        rests.sort_by(|a, b| a.0.total_cmp(&b.0));
        rests
    }

    /// Whether a state does decisively better than another, as they were fitted and with leeway.
    fn better(&self, search: &Search<'_>, less: &State, more: &State) -> bool {
        self.prefers((search, less), (search, more))
    }

    /// The same of states that read the data each in its own way.
    pub(crate) fn prefers(&self, less: (&Search<'_>, &State), more: (&Search<'_>, &State)) -> bool {
        self.decisive(self.loss(less.0, less.1), self.loss(more.0, more.1))
            && self.decisive(self.with_leeway(less.0, less.1), self.with_leeway(more.0, more.1))
    }

    /// Whether a loss is so much less than another that it is no chance.
    pub(crate) fn decisive(&self, less: f64, more: f64) -> bool {
        let excess = |loss: f64| (loss - self.floor).max(0.0);
        self.values * (more / less).ln() > MENTIONED && excess(less) <= CLOSED * excess(more)
    }
}

/// Whether the last member of a selection, once all is fitted to the end beside it, is more than the imperfect form of what the others explain.
fn more_than_form(search: &Search<'_>, selected: &Selected) -> bool {
    let last = selected.state.effects.len() - 1;
    let rest = search.without(selected, last);
    rest.is_some_and(|rest| search.worth(selected, &rest) >= SHARE * selected.gained(&search.setting, &rest.fit))
}

/// Whether two losses differ by no more than the form of a law is inexact, beside what the better one takes off that of the base model.
fn inexact(plain: f64, a: f64, b: f64) -> bool {
    (a / b).ln().abs() < SHARE * (plain / a.min(b)).ln()
}

fn least(losses: &[f64]) -> f64 {
    losses.iter().copied().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use wheelwright_core::ModelConfig;
    use wheelwright_core::effect::Effect;
    use wheelwright_models::VwPdConfig;

    use super::*;
    use crate::effects::{CoulombFriction, QuadraticDrag};
    use crate::fixture::{Case, NOISE, hiding, normal, with_selected};

    #[test]
    fn what_hardly_anything_spoke_for_goes_where_other_data_speak_against_it() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(QuadraticDrag::default())];
        let with =
            |seed: u64, drag: f64| Case::new(seed, move |_, i, y, _, random| y - [drag, 0.0][i] * y * y.abs() + NOISE[i] * normal(random));
        let mut seen = 0;
        for k in 0..24 {
            let drag = 0.002 * f64::from(k);
            let training = with(5, drag);
            with_selected(&training, &library, 1, |search, selected| {
                let worth = search.rests(&selected)[0].as_ref().map_or(f64::NAN, |rest| search.worth(&selected, rest));
                if !(0.0..MENTIONED).contains(&worth) {
                    return;
                }
                seen += 1;
                let model = VwPdConfig::default().build().unwrap();
                let held = with(6, drag);
                let question = Question { held_out: Some(&held.data), ..Question::new(&*model, &training.data, &library) };
                let goes = |off: f64| {
                    let mut told = selected.clone();
                    told.state.fit.point.x[search.setting.free()] += off;
                    Bench::new(&question, search, &told).unwrap().supported(search, &told).is_some()
                };
                // Of a size that the other data do not know, of the right one, and of one that fails there altogether.
                assert_eq!([-0.009, 0.0, 0.5].map(goes), [true, false, false], "{drag}: {worth}");
            });
        }
        assert!(seen > 0);
    }

    #[test]
    fn a_trace_beside_a_large_effect_is_its_form() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default()), Box::new(QuadraticDrag::default())];
        let more = |drag: f64| {
            let mut more = None;
            let case = hiding(5, &library, &[0, 1], &[0.1, 1.0, drag, 0.0, 2.0]);
            with_selected(&case, &library, 2, |search, selected| {
                let rest = search.without(&selected, 1).unwrap();
                more = Some((super::more_than_form(search, &selected), search.worth(&selected, &rest) > MENTIONED));
            });
            more.unwrap()
        };
        // The evidence of the one is 32 of 3800, that of the other 240.
        assert_eq!([more(0.4), more(2.0)], [(false, true), (true, true)]);
    }

    #[test]
    fn what_forms_are_inexact_by_goes_by_what_is_explained() {
        assert!(inexact(9.0, 1.0, 1.04) && inexact(9.0, 1.04, 1.0) && !inexact(9.0, 1.0, 1.05));
        assert!(!inexact(1.3, 1.0, 1.04) && !inexact(0.9, 1.0, 1.0));
    }

    #[test]
    fn one_that_stands_alone_may_go_where_stamps_jitter() {
        let library: Vec<Box<dyn Effect>> = vec![Box::new(CoulombFriction::default())];
        for deviation in [0.0, 0.03] {
            let case = |seed: u64| Case::jittering(seed, deviation);
            let (training, held) = (case(3), case(4));
            with_selected(&training, &library, 1, |search, selected| {
                let model = VwPdConfig::default().build().unwrap();
                let question = Question { held_out: Some(&held.data), ..Question::new(&*model, &training.data, &library) };
                let bench = Bench::new(&question, search, &selected).unwrap();
                assert_eq!(bench.jitter.is_some(), deviation > 0.0);
                assert_eq!(bench.rests(search, &selected).len(), usize::from(deviation > 0.0));
            });
        }
    }
}
