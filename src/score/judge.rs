//! One answer against one case of the key.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::key::{Answer, KeyCase, Kind, Range};

/// A gap to the ceiling smaller than this many points of fit is no gap to close.
const SMALLEST_GAP: f64 = 0.5;

/// What a case is for the score: its kind, or that its effect was left out of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Nothing hidden.
    None,
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// Another physical form.
    OtherForm,
    /// In no library.
    Outside,
    /// In the library, but left out of it for this run.
    Removed,
}

impl Class {
    /// All of them, in the order of reports.
    pub const ALL: [Self; 6] = [Self::None, Self::Single, Self::Pair, Self::OtherForm, Self::Outside, Self::Removed];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Single => "single",
            Self::Pair => "pair",
            Self::OtherForm => "other_form",
            Self::Outside => "outside",
            Self::Removed => "removed",
        }
    }

    /// Whether the right answer is a name.
    pub fn nameable(self) -> bool {
        matches!(self, Self::Single | Self::Pair | Self::OtherForm)
    }
}

/// What came of a case. Exactly one of these holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Nothing hidden, nothing found.
    Clean,
    /// Nothing hidden, something found.
    FalseAlarm,
    /// Exactly the effects hidden.
    Exact,
    /// A set declared to be the same mathematics.
    Equivalent,
    /// As many effects, of the right families.
    Family,
    /// All effects hidden (or an equivalent set), and more.
    Extra,
    /// Some of the effects hidden.
    Part,
    /// Not named, but among the alternatives of an ambiguous answer.
    Offered,
    /// An ambiguous answer without the truth among its alternatives.
    Ambiguous,
    /// Said to be unexplained.
    Abstained,
    /// Something hidden, nothing found.
    Missed,
    /// Said to be explained, by none of the effects hidden nor of their families.
    Wrong,
    /// No answer, or one that failed.
    Failed,
}

/// Counts of a localisation: true positives, false positives, false negatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// In both.
    pub both: usize,
    /// In the answer only.
    pub answer: usize,
    /// In the key only.
    pub key: usize,
}

impl Counts {
    /// F1 = 2 TP / (2 TP + FP + FN); `None` if there is nothing in either.
    pub fn f1(self) -> Option<f64> {
        let all = 2 * self.both + self.answer + self.key;
        (all > 0).then(|| 2.0 * self.both as f64 / all as f64)
    }

    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        Self { both: self.both + other.both, answer: self.answer + other.answer, key: self.key + other.key }
    }
}

/// A case with its answer, judged.
#[derive(Debug, Clone)]
pub struct Judged<'a> {
    /// The case.
    pub case: &'a KeyCase,
    /// Its class.
    pub class: Class,
    /// What came of it.
    pub outcome: Outcome,
    /// Whether the truth (or an equivalent set) is within the effects named and their alternatives.
    pub in_set: Option<bool>,
    /// Effects and alternatives reported.
    pub set_size: Option<usize>,
    /// Share of the gap to the ceiling that was closed on held-out data.
    pub gap_closed: Option<f64>,
    /// Localisation in blocks of 1 s.
    pub times: Option<Counts>,
    /// Localisation in regions.
    pub regions: Option<Counts>,
    /// Error of the time of a change of payload \[s\].
    pub time_error: Option<f64>,
    /// What was hidden, for the confusion matrix.
    pub truth: String,
    /// What was said.
    pub said: String,
    /// Verdict.
    pub verdict: String,
    /// Seconds it took.
    pub seconds: Option<f64>,
}

/// What all answers of a trial are judged by.
#[derive(Debug, Default)]
pub struct Terms<'a> {
    /// Effects left out of the library.
    pub without: &'a [String],
    /// Families of the effects known.
    pub families: BTreeMap<String, String>,
    /// Quantities whose regions the key tells in any case. Of others it cannot say where they should be.
    pub quantities: BTreeSet<&'a str>,
}

/// Judges an answer.
pub fn judge<'a>(case: &'a KeyCase, answer: Option<&Answer>, terms: &Terms<'_>) -> Judged<'a> {
    let Terms { without, families, quantities } = terms;
    let truth: BTreeSet<&str> = case.truth.iter().map(|t| t.effect.as_str()).collect();
    let removed = truth.iter().any(|t| without.iter().any(|w| w == t));
    let class = match case.kind {
        Kind::None => Class::None,
        _ if removed => Class::Removed,
        Kind::Single => Class::Single,
        Kind::Pair => Class::Pair,
        Kind::OtherForm => Class::OtherForm,
        Kind::Outside => Class::Outside,
    };
    let hidden = match (case.kind, truth.is_empty()) {
        (Kind::None, _) => "nothing".to_owned(),
        (_, true) => "outside".to_owned(),
        _ => truth.iter().copied().collect::<Vec<_>>().join(" + "),
    };
    let Some(answer) = answer.filter(|a| !a.failed) else {
        let nothing = (class != Class::None).then_some(false).filter(|_| class.nameable());
        return Judged {
            case,
            class,
            outcome: Outcome::Failed,
            in_set: nothing,
            set_size: None,
            gap_closed: None,
            times: None,
            regions: None,
            time_error: None,
            truth: hidden,
            said: "no answer".to_owned(),
            verdict: "failed".to_owned(),
            seconds: None,
        };
    };
    let named: BTreeSet<&str> = answer.effects.iter().map(|e| e.name.as_str()).collect();
    let reported: BTreeSet<&str> =
        answer.effects.iter().flat_map(|e| std::iter::once(e.name.as_str()).chain(e.alternatives.iter().map(String::as_str))).collect();
    let sets = accepted(case, &truth);
    let outcome = outcome(class, answer, &named, &reported, &truth, &sets, families);
    Judged {
        case,
        class,
        outcome,
        in_set: class.nameable().then(|| sets.iter().any(|set| set.is_subset(&reported))),
        set_size: (class.nameable() && !reported.is_empty()).then_some(reported.len()),
        gap_closed: (class.nameable()).then(|| gap_closed(case, answer)).flatten(),
        times: case.times.as_ref().map(|times| blocks(&answer.place.times, times)),
        regions: case.regions.as_ref().map(|regions| matched(&answer.place.regions, regions, quantities)),
        time_error: time_error(case, answer),
        truth: hidden,
        said: said(answer, &named),
        verdict: answer.verdict.clone(),
        seconds: answer.seconds,
    }
}

/// The truth and the sets declared equivalent to it, none of them empty.
fn accepted<'a>(case: &'a KeyCase, truth: &BTreeSet<&'a str>) -> Vec<BTreeSet<&'a str>> {
    let declared = case.acceptable.iter().flatten().map(|set| set.iter().map(String::as_str).collect());
    std::iter::once(truth.clone()).chain(declared).filter(|set: &BTreeSet<&str>| !set.is_empty()).collect()
}

fn outcome(
    class: Class,
    answer: &Answer,
    named: &BTreeSet<&str>,
    reported: &BTreeSet<&str>,
    truth: &BTreeSet<&str>,
    sets: &[BTreeSet<&str>],
    families: &BTreeMap<String, String>,
) -> Outcome {
    let clean = answer.verdict == "no_mismatch";
    if class == Class::None {
        return if clean { Outcome::Clean } else { Outcome::FalseAlarm };
    }
    if clean {
        return Outcome::Missed;
    }
    if !truth.is_empty() && named == truth {
        return Outcome::Exact;
    }
    if sets.iter().any(|set| set == named) {
        return Outcome::Equivalent;
    }
    let family = |names: &BTreeSet<&str>| -> Vec<String> {
        let mut all: Vec<String> = names.iter().map(|n| families.get(*n).cloned().unwrap_or_else(|| (*n).to_owned())).collect();
        all.sort();
        all
    };
    if sets.iter().any(|set| set.len() == named.len() && family(set) == family(named)) {
        return Outcome::Family;
    }
    if sets.iter().any(|set| set.is_subset(named)) {
        return Outcome::Extra;
    }
    if answer.verdict == "ambiguous" && sets.iter().any(|set| set.is_subset(reported)) {
        return Outcome::Offered;
    }
    let families_of_truth: BTreeSet<String> = sets.iter().flat_map(&family).collect();
    if family(named).iter().any(|f| families_of_truth.contains(f)) {
        return Outcome::Part;
    }
    match answer.verdict.as_str() {
        "ambiguous" => Outcome::Ambiguous,
        "unexplained" => Outcome::Abstained,
        _ => Outcome::Wrong,
    }
}

/// What an answer said, in a word or two.
fn said(answer: &Answer, named: &BTreeSet<&str>) -> String {
    if named.is_empty() {
        return answer.verdict.clone();
    }
    let names = named.iter().copied().collect::<Vec<_>>().join(" + ");
    if answer.verdict == "ambiguous" { format!("{names}?") } else { names }
}

/// Σ (after − before) / Σ (ceiling − before) over the outputs, the key's ceiling before the answer's own; `None` where
/// there is no gap to speak of.
fn gap_closed(case: &KeyCase, answer: &Answer) -> Option<f64> {
    let own = |name: &String| answer.fit.noise_ceiling.as_ref().and_then(|c| c.get(name).copied().flatten());
    let (mut closed, mut gap) = (0.0, 0.0);
    for (name, before) in &answer.fit.before {
        let ceiling = case.noise_ceiling.as_ref().and_then(|c| c.get(name).copied()).or_else(|| own(name));
        let (before, after, ceiling) = ((*before)?, answer.fit.after.get(name).copied().flatten()?, ceiling?);
        closed += after - before;
        gap += ceiling - before;
    }
    (gap >= SMALLEST_GAP).then(|| closed / gap)
}

/// Blocks of 1 s that are covered by at least half, in the answer and in the key.
fn blocks(answer: &[(f64, f64)], key: &[(f64, f64)]) -> Counts {
    let covered = |spans: &[(f64, f64)]| -> BTreeSet<i64> {
        let mut time: BTreeMap<i64, f64> = BTreeMap::new();
        for (from, to) in spans.iter().filter(|(a, b)| a.is_finite() && b.is_finite() && b > a) {
            // A span of days is no span of a recording.
            for second in from.floor() as i64..(to.ceil() as i64).min(from.floor() as i64 + 1_000_000) {
                let overlap = to.min(second as f64 + 1.0) - from.max(second as f64);
                *time.entry(second).or_default() += overlap;
            }
        }
        time.into_iter().filter(|(_, covered)| *covered >= 0.5).map(|(second, _)| second).collect()
    };
    let (answer, key) = (covered(answer), covered(key));
    let both = answer.intersection(&key).count();
    Counts { both, answer: answer.len() - both, key: key.len() - both }
}

/// Regions of the same quantity that share at least half of the shorter one; only of `quantities` does the key say all of them.
fn matched(answer: &[Range], key: &[Range], quantities: &BTreeSet<&str>) -> Counts {
    let ends = |r: &Range| (r.from.unwrap_or(-1e9), r.to.unwrap_or(1e9));
    let meets = |a: &Range, b: &Range| {
        let ((a0, a1), (b0, b1)) = (ends(a), ends(b));
        a.of == b.of && a1.min(b1) - a0.max(b0) >= 0.5 * (a1 - a0).min(b1 - b0)
    };
    let both = key.iter().filter(|k| answer.iter().any(|a| meets(a, k))).count();
    let judged = answer.iter().filter(|a| quantities.contains(a.of.as_str()));
    let stray = judged.filter(|a| !key.iter().any(|k| meets(a, k))).count();
    Counts { both, answer: stray, key: key.len() - both }
}

/// Error of the time at which the payload changed, where key and answer both tell it.
fn time_error(case: &KeyCase, answer: &Answer) -> Option<f64> {
    const EFFECT: &str = "payload_change";
    const NAMES: [&str; 3] = ["time_s", "time", "t0"];
    let hidden = case.truth.iter().find(|t| t.effect == EFFECT)?;
    let named = answer.effects.iter().find(|e| e.name == EFFECT)?;
    let truth = NAMES.iter().find_map(|n| hidden.parameters.get(*n)).and_then(serde_json::Value::as_f64)?;
    let found = named.parameters.iter().find(|p| NAMES.contains(&p.name.as_str())).and_then(|p| p.value)?;
    Some(found - truth)
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
