//! What a recording cannot speak of: effects whose response, at any plausible size, would not reach the evidence that is asked.

use crate::finding::Untestable;
use crate::screen::{Candidate, Response};
use crate::select::{Search, State};

/// Multiple of the size at which an effect is first tried up to which it is plausible.
const PLAUSIBLE: f64 = 20.0;

/// Effects that would not have been seen.
pub(crate) fn list(search: &Search<'_>, screened: &[Vec<Candidate>], responses: &[Response], named: &State) -> Vec<Untestable> {
    let mut all = Vec::new();
    for candidates in screened.iter().filter(|c| !named.effects.contains(&c[0].effect)) {
        let effect = search.effect(candidates[0].effect);
        let bound = candidates.iter().filter_map(|c| smallest(search, c, &responses[c.response])).fold(f64::INFINITY, f64::min);
        let name = effect.name().to_owned();
        if bound <= PLAUSIBLE || all.iter().any(|u: &Untestable| u.name == name) {
            continue;
        }
        let because = if bound.is_finite() {
            format!(
                "{} would be seen only at {bound:.0} times the size at which it is first tried; missing is {}",
                name,
                effect.excitation()
            )
        } else {
            format!("nothing in this recording shows {}; missing is {}", name, effect.excitation())
        };
        all.push(Untestable { name, because });
    }
    for effect in search.library.iter() {
        if let Some(reason) = effect.inapplicable(search.setting.scene) {
            all.push(Untestable { name: effect.name().to_owned(), because: reason });
        }
    }
    all
}

/// The smallest multiple of a start's size that would gain more than its penalty; for a start that counts as it is, one or none.
fn smallest(search: &Search<'_>, candidate: &Candidate, response: &Response) -> Option<f64> {
    let needed = search.penalty(response.start.columns.len() as f64);
    if candidate.information.is_nan() || candidate.information <= 0.0 {
        return None;
    }
    let multiple = (needed / candidate.information).sqrt();
    match response.start.linear {
        true => Some(multiple),
        false => (multiple <= 1.0).then_some(1.0),
    }
}
