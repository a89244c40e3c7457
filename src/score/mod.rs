//! The score of a blind trial: answers against the key of those who hid the physics.
//!
//! Each case ends in exactly one [`Outcome`]; rates are of outcomes, with Wilson's intervals, over all cases of a class and
//! by excitation, noise, strength and detectability, so that what could not be seen is neither credited nor blamed.

mod judge;
mod key;
mod wilson;

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

pub use judge::{Class, Counts, Judged, Outcome, Terms, judge};
pub use key::{Answer, HEADER, Header, Key, KeyCase, Kind, read_answers, read_key};
pub use wilson::Rate;

/// A question asked of each case; `None` where it does not apply.
type Ask = fn(&Judged<'_>) -> Option<bool>;

/// The rates that are stated, by name, with what they mean.
pub const RATES: [(&str, &str, Ask); 10] = [
    ("exact", "exactly the effects hidden", |j| j.class.nameable().then_some(j.outcome == Outcome::Exact)),
    ("exact_or_equivalent", "the same, or a set declared to be the same mathematics", |j| {
        j.class.nameable().then_some(matches!(j.outcome, Outcome::Exact | Outcome::Equivalent))
    }),
    ("family", "the same, or of the right families", |j| {
        j.class.nameable().then_some(matches!(j.outcome, Outcome::Exact | Outcome::Equivalent | Outcome::Family))
    }),
    ("in_set", "the truth, or an equivalent, among the effects and alternatives reported", |j| j.in_set),
    ("missed", "something hidden, nothing found", |j| hidden(j).then_some(j.outcome == Outcome::Missed)),
    ("abstained", "something hidden, said to be unexplained", |j| hidden(j).then_some(j.outcome == Outcome::Abstained)),
    ("ambiguous", "the verdict is ambiguous", |j| hidden(j).then_some(j.verdict == "ambiguous")),
    ("confidently_wrong", "something hidden, explained by none of it nor of its families", |j| {
        hidden(j).then_some(j.outcome == Outcome::Wrong)
    }),
    ("failed", "no answer, or one that failed", |j| Some(j.outcome == Outcome::Failed)),
    ("false_alarm", "nothing hidden, something found, or no answer", |j| {
        (j.class == Class::None).then_some(matches!(j.outcome, Outcome::FalseAlarm | Outcome::Failed))
    }),
];

fn hidden(judged: &Judged<'_>) -> bool {
    judged.class != Class::None
}

/// The score of a folder of answers.
#[derive(Debug)]
pub struct Score<'a> {
    /// Every case of the key, judged, in the key's order.
    pub cases: Vec<Judged<'a>>,
    /// Answers to cases that the key does not have.
    pub strays: Vec<String>,
}

/// Rates and figures of some of the cases.
#[derive(Debug, Clone)]
pub struct Summary {
    /// What the cases have in common.
    pub name: String,
    /// How many there are.
    pub cases: usize,
    /// One rate each of [`RATES`].
    pub rates: Vec<Rate>,
    /// Mean number of effects and alternatives reported.
    pub set_size: Option<f64>,
    /// Median share of the gap to the ceiling that was closed, and the quarters.
    pub gap_closed: Option<[f64; 3]>,
    /// Localisation in time.
    pub times: Counts,
    /// Localisation in regions.
    pub regions: Counts,
    /// Median absolute error of the time of a payload \[s\], and the rate within 1 s.
    pub payload: Option<(f64, Rate)>,
    /// Largest and median time a case took \[s\].
    pub seconds: Option<(f64, f64)>,
}

impl<'a> Score<'a> {
    /// Judges every case of a key.
    pub fn new(key: &'a Key, answers: &[Answer], without: &[String]) -> Self {
        let whole = |family: &str| family.split('/').next().unwrap_or(family).to_owned();
        let families = wheelwright_diagnosis::effects::library().iter().map(|e| (e.name().to_owned(), whole(e.family()))).collect();
        let quantities = key.cases.iter().flat_map(|c| c.regions.iter().flatten()).map(|r| r.of.as_str()).collect();
        let terms = Terms { without, families, quantities };
        let by_name: BTreeMap<&str, &Answer> = answers.iter().map(|a| (a.case.as_str(), a)).collect();
        let known: BTreeSet<&str> = key.cases.iter().map(|c| c.case.as_str()).collect();
        let cases = key.cases.iter().map(|case| judge(case, by_name.get(case.case.as_str()).copied(), &terms));
        let strays = by_name.keys().filter(|name| !known.contains(*name)).map(|name| (*name).to_owned());
        Self { cases: cases.collect(), strays: strays.collect() }
    }

    /// Over all cases of each class that has any.
    pub fn by_class(&self) -> Vec<Summary> {
        let of = |class: Class| self.summary(class.name(), &|j| j.class == class);
        Class::ALL.into_iter().map(of).filter(|s| s.cases > 0).collect()
    }

    /// Tables by something the key tells, with the nameable cases of each value.
    pub fn by(&self) -> Vec<(&'static str, Vec<Summary>)> {
        let text = |pick: fn(&KeyCase) -> &Option<String>| -> Vec<Summary> {
            let values: BTreeSet<String> = self.cases.iter().filter_map(|j| pick(j.case).clone()).collect();
            values.iter().map(|v| self.summary(v, &|j| pick(j.case).as_ref() == Some(v))).collect()
        };
        let bands = |edges: &[f64], pick: &dyn Fn(&KeyCase) -> Option<f64>| -> Vec<Summary> {
            let all = [&[f64::NEG_INFINITY], edges, &[f64::INFINITY]].concat();
            let band = |pair: &[f64]| {
                let (from, to) = (pair[0], pair[1]);
                let name = match (from.is_finite(), to.is_finite()) {
                    (false, _) => format!("below {to}"),
                    (_, false) => format!("{from} and more"),
                    _ => format!("{from} to {to}"),
                };
                self.summary(&name, &|j| pick(j.case).is_some_and(|x| x >= from && x < to))
            };
            all.windows(2).map(band).collect()
        };
        let effects: BTreeSet<&str> = self.cases.iter().filter(|j| j.class.nameable()).map(|j| j.truth.as_str()).collect();
        let mut tables = vec![
            ("excitation", text(|c| &c.excitation)),
            ("noise", text(|c| &c.noise)),
            ("robot", text(|c| &c.robot)),
            ("strength", bands(&[0.2, 0.4, 0.6, 0.8], &|c| c.strength)),
            ("detectability", bands(&[10.0, 30.0, 100.0, 1000.0], &KeyCase::hardest)),
            ("rate_hz", bands(&[15.0, 25.0, 50.0], &|c| c.rate_hz)),
            ("effect", effects.iter().map(|e| self.summary(e, &|j| j.class.nameable() && j.truth == *e)).collect()),
        ];
        for (_, rows) in &mut tables {
            rows.retain(|s| s.cases > 0);
        }
        tables.retain(|(_, rows)| !rows.is_empty());
        tables
    }

    /// How often each thing said followed each thing hidden.
    pub fn confusion(&self) -> BTreeMap<&str, BTreeMap<&str, usize>> {
        let mut matrix: BTreeMap<&str, BTreeMap<&str, usize>> = BTreeMap::new();
        for judged in &self.cases {
            let truth = if judged.class == Class::Removed { "(removed)" } else { judged.truth.as_str() };
            *matrix.entry(truth).or_default().entry(&judged.said).or_default() += 1;
        }
        matrix
    }

    /// Rates and figures of the cases that `belongs` picks.
    pub fn summary(&self, name: &str, belongs: &dyn Fn(&Judged<'_>) -> bool) -> Summary {
        let cases: Vec<&Judged<'_>> = self.cases.iter().filter(|j| belongs(j)).collect();
        let sizes: Vec<f64> = cases.iter().filter_map(|j| j.set_size).map(|n| n as f64).collect();
        let errors: Vec<f64> = cases.iter().filter_map(|j| j.time_error).map(f64::abs).collect();
        let seconds: Vec<f64> = cases.iter().filter_map(|j| j.seconds).collect();
        let sum = |pick: fn(&Judged<'_>) -> Option<Counts>| cases.iter().filter_map(|j| pick(j)).fold(Counts::default(), Counts::plus);
        Summary {
            name: name.to_owned(),
            cases: cases.len(),
            rates: RATES.iter().map(|(_, _, ask)| Rate::of(cases.iter().map(|j| ask(j)))).collect(),
            set_size: (!sizes.is_empty()).then(|| sizes.iter().sum::<f64>() / sizes.len() as f64),
            gap_closed: quarters(cases.iter().filter_map(|j| j.gap_closed).collect()),
            times: sum(|j| j.times),
            regions: sum(|j| j.regions),
            payload: quarters(errors.clone()).map(|[_, median, _]| (median, Rate::of(errors.iter().map(|e| Some(*e <= 1.0))))),
            seconds: quarters(seconds.clone()).map(|[_, median, _]| (seconds.iter().copied().fold(0.0, f64::max), median)),
        }
    }

    /// `wheelwright.score/1`.
    pub fn document(&self, header: Option<&Header>, seal: Option<bool>) -> Value {
        let tables = |rows: &[Summary]| rows.iter().map(|s| (s.name.clone(), s.document())).collect::<Map<_, _>>();
        let by: Map<String, Value> = self.by().iter().map(|(name, rows)| ((*name).to_owned(), Value::Object(tables(rows)))).collect();
        let case = |j: &Judged<'_>| {
            json!({
                "case": j.case.case, "class": j.class, "truth": j.truth, "said": j.said, "verdict": j.verdict, "outcome": j.outcome,
                "in_set": j.in_set, "gap_closed": j.gap_closed, "times_f1": j.times.and_then(Counts::f1),
                "regions_f1": j.regions.and_then(Counts::f1), "payload_time_error_s": j.time_error,
                "detectability": j.case.hardest(), "strength": j.case.strength,
                "excitation": j.case.excitation, "noise": j.case.noise,
            })
        };
        json!({
            "schema": "wheelwright.score/1",
            "version": header.and_then(|h| h.version.clone()),
            "without": header.map(|h| h.without.clone()).unwrap_or_default(),
            "sealed": seal,
            "all": self.summary("all", &|_| true).document(),
            "classes": tables(&self.by_class()),
            "by": by,
            "confusion": self.confusion(),
            "cases": self.cases.iter().map(case).collect::<Vec<_>>(),
            "strays": self.strays,
        })
    }
}

impl Summary {
    /// The rate of a name in [`RATES`].
    pub fn rate(&self, name: &str) -> Rate {
        RATES.iter().position(|(n, _, _)| *n == name).and_then(|i| self.rates.get(i)).copied().unwrap_or_default()
    }

    fn document(&self) -> Value {
        let mut document = json!({
            "cases": self.cases,
            "set_size": self.set_size,
            "gap_closed": self.gap_closed.map(|[low, median, high]| json!({ "median": median, "quarters": [low, high] })),
            "times_f1": self.times.f1(),
            "regions_f1": self.regions.f1(),
            "payload_time_error_s": self.payload.map(|(median, _)| median),
            "payload_within_1_s": self.payload.map(|(_, rate)| rate.document()),
            "seconds": self.seconds.map(|(most, median)| json!({ "median": median, "most": most })),
        });
        for ((name, _, _), rate) in RATES.iter().zip(&self.rates).filter(|(_, r)| r.of > 0) {
            document[name] = rate.document();
        }
        document
    }
}

/// Lower quarter, median, upper quarter; `None` without values.
fn quarters(mut values: Vec<f64>) -> Option<[f64; 3]> {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let place = share * (values.len() - 1) as f64;
        let (low, rest) = (place.floor() as usize, place.fract());
        values[low] + rest * (values[(low + 1).min(values.len() - 1)] - values[low])
    };
    (!values.is_empty()).then(|| [at(0.25), at(0.5), at(0.75)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> Key {
        let case = |name: &str, kind: &str, truth: &[&str], more: Value| {
            let mut case = json!({ "case": name, "kind": kind, "truth": truth.iter().map(|t| json!({ "effect": t })).collect::<Vec<_>>() });
            if let (Value::Object(all), Value::Object(more)) = (&mut case, more) {
                all.extend(more);
            }
            case
        };
        serde_json::from_value(json!({ "schema": "wheelwright.key/1", "cases": [
            case("a", "single", &["command_delay"], json!({ "excitation": "rich", "strength": 0.3, "detectability": 50.0 })),
            case("b", "single", &["command_delay"], json!({ "excitation": "thesis", "strength": 0.7, "detectability": [500.0, null] })),
            case("c", "pair", &["command_delay", "dead_zone"], json!({ "excitation": "rich", "detectability": 3000.0, "detectability_each": [2000.0, 40.0] })),
            case("d", "none", &[], json!({ "noise": "white" })),
            case("e", "outside", &[], json!({ "outside": "a push" })),
        ]}))
        .unwrap()
    }

    fn answers() -> Vec<Answer> {
        let answer = |case: &str, verdict: &str, names: &[&str]| {
            let effects: Vec<Value> = names.iter().map(|n| json!({ "name": n, "alternatives": [] })).collect();
            serde_json::from_value(json!({ "case": case, "verdict": verdict, "effects": effects, "seconds": 1.0 })).unwrap()
        };
        vec![
            answer("a", "explained", &["command_delay"]),
            answer("b", "explained", &["actuator_lag"]),
            answer("c", "explained", &["dead_zone", "command_delay"]),
            answer("d", "no_mismatch", &[]),
            answer("z", "no_mismatch", &[]),
        ]
    }

    #[test]
    fn rates_are_of_the_cases_of_their_class_and_band() {
        let key = key();
        let score = Score::new(&key, &answers(), &[]);
        let document = score.document(None, None);
        let rate = |path: &str| {
            let rate = crate::documents::lookup(&document, path).unwrap_or_else(|| panic!("{path}"));
            (rate["hits"].as_u64().unwrap(), rate["of"].as_u64().unwrap())
        };
        assert_eq!(rate("classes.single.exact"), (1, 2));
        assert_eq!(rate("classes.single.family"), (2, 2), "a lag for a delay is of the family");
        assert_eq!(rate("classes.pair.exact"), (1, 1));
        assert_eq!(rate("classes.none.false_alarm"), (0, 1));
        assert_eq!(rate("classes.outside.confidently_wrong"), (0, 1), "no answer is no confident one");
        assert_eq!(rate("by.excitation.rich.exact"), (2, 2));
        assert_eq!(rate("by.excitation.thesis.exact"), (0, 1));
        assert_eq!(document["by"]["strength"]["0.2 to 0.4"]["exact"]["hits"], 1);
        assert_eq!(document["by"]["detectability"]["100 to 1000"]["exact"]["hits"], 0);
        assert_eq!(document["by"]["detectability"]["30 to 100"]["cases"], 2, "a pair by what of it is hardest to see");
        assert_eq!(document["by"]["effect"]["command_delay + dead_zone"]["cases"], 1);
        assert_eq!(document["confusion"]["outside"]["no answer"], 1);
        assert_eq!(document["strays"], json!(["z"]));
        let removed = Score::new(&key, &answers(), &["command_delay".to_owned()]).document(None, None);
        assert_eq!(removed["classes"]["removed"]["cases"], 3);
    }

    #[test]
    fn quarters_interpolate() {
        // numpy.percentile([1, 2, 4, 8], [25, 50, 75])
        assert_eq!(quarters(vec![8.0, 1.0, 4.0, 2.0]), Some([1.75, 3.0, 5.0]));
        assert_eq!(quarters(Vec::new()), None);
    }

    #[test]
    fn the_page_of_a_score_has_its_rates_and_its_confusions() {
        let key = key();
        let score = Score::new(&key, &answers(), &[]);
        let page = crate::report::score::html(&score, "Score of a", &Header::default(), Some(true), "wheelwright score a --key k.json");
        for part in ["the key was sealed", "By excitation", "actuator_lag", "confidently wrong", "wheelwright score a"] {
            assert!(page.contains(part), "{part}");
        }
    }
}
