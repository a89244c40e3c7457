use serde_json::{Value, json};

use super::*;

fn case(kind: &str, truth: &[&str], acceptable: Value) -> KeyCase {
    let truth: Vec<Value> = truth.iter().map(|t| json!({ "effect": t, "parameters": {} })).collect();
    serde_json::from_value(json!({ "case": "c", "kind": kind, "truth": truth, "acceptable": acceptable })).unwrap()
}

fn answer(verdict: &str, named: &[(&str, &[&str])]) -> Answer {
    let effects: Vec<Value> = named.iter().map(|(name, others)| json!({ "name": name, "alternatives": others })).collect();
    serde_json::from_value(json!({ "case": "c", "verdict": verdict, "effects": effects })).unwrap()
}

fn terms(without: &[String]) -> Terms<'_> {
    let families = [("command_delay", "lateness"), ("actuator_lag", "lateness")].map(|(a, b)| (a.to_owned(), b.to_owned())).into();
    Terms { without, families, quantities: BTreeSet::new() }
}

fn outcome_of(case: &KeyCase, answer: &Answer, without: &[&str]) -> (Outcome, Option<bool>) {
    let without: Vec<String> = without.iter().map(|w| (*w).to_owned()).collect();
    let judged = judge(case, Some(answer), &terms(&without));
    (judged.outcome, judged.in_set)
}

#[test]
fn every_outcome_has_its_case() {
    let nothing = case("none", &[], Value::Null);
    assert_eq!(outcome_of(&nothing, &answer("no_mismatch", &[]), &[]), (Outcome::Clean, None));
    assert_eq!(outcome_of(&nothing, &answer("unexplained", &[]), &[]).0, Outcome::FalseAlarm);
    let delay = case("single", &["command_delay"], json!([["resonance"]]));
    for (answer, expected) in [
        (answer("explained", &[("command_delay", &[])]), (Outcome::Exact, Some(true))),
        (answer("explained", &[("resonance", &[])]), (Outcome::Equivalent, Some(true))),
        (answer("explained", &[("actuator_lag", &[])]), (Outcome::Family, Some(false))),
        (answer("ambiguous", &[("actuator_lag", &["command_delay"])]), (Outcome::Family, Some(true))),
        (answer("explained", &[("command_delay", &[]), ("slope", &[])]), (Outcome::Extra, Some(true))),
        (answer("ambiguous", &[("slope", &["command_delay"])]), (Outcome::Offered, Some(true))),
        (answer("explained", &[("slope", &[]), ("actuator_lag", &[])]), (Outcome::Part, Some(false))),
        (answer("ambiguous", &[("slope", &["backlash"])]), (Outcome::Ambiguous, Some(false))),
        (answer("unexplained", &[]), (Outcome::Abstained, Some(false))),
        (answer("no_mismatch", &[]), (Outcome::Missed, Some(false))),
        (answer("explained", &[("slope", &[])]), (Outcome::Wrong, Some(false))),
    ] {
        assert_eq!(outcome_of(&delay, &answer, &[]), expected, "{answer:?}");
    }
    let judged = judge(&delay, None, &terms(&[]));
    assert_eq!((judged.outcome, judged.in_set), (Outcome::Failed, Some(false)));
}

#[test]
fn pairs_want_both_and_outside_wants_no_name() {
    let pair = case("pair", &["command_delay", "slope"], Value::Null);
    assert_eq!(outcome_of(&pair, &answer("explained", &[("slope", &[]), ("command_delay", &[])]), &[]), (Outcome::Exact, Some(true)));
    assert_eq!(outcome_of(&pair, &answer("explained", &[("slope", &[])]), &[]), (Outcome::Part, Some(false)));
    let outside = case("outside", &[], Value::Null);
    assert_eq!(outcome_of(&outside, &answer("unexplained", &[]), &[]), (Outcome::Abstained, None));
    assert_eq!(outcome_of(&outside, &answer("explained", &[("slope", &[])]), &[]), (Outcome::Wrong, None));
    let known = case("outside", &[], json!([["slope"]]));
    assert_eq!(outcome_of(&known, &answer("explained", &[("slope", &[])]), &[]).0, Outcome::Equivalent);
}

#[test]
fn an_effect_left_out_of_the_library_makes_a_case_of_its_own() {
    let delay = case("single", &["command_delay"], Value::Null);
    let judged = judge(&delay, Some(&answer("explained", &[("slope", &[])])), &terms(&["command_delay".to_owned()]));
    assert_eq!((judged.class, judged.outcome, judged.in_set), (Class::Removed, Outcome::Wrong, None));
}

#[test]
fn localisation_counts_blocks_of_a_second_and_regions_that_overlap() {
    let counts = blocks(&[(10.0, 13.0), (20.4, 20.8)], &[(11.2, 15.0)]);
    // Covered by half or more: 10, 11, 12 against 11, 12, 13, 14.
    assert_eq!(counts, Counts { both: 2, answer: 1, key: 2 });
    assert!((counts.f1().unwrap() - 4.0 / 7.0).abs() < 1e-12);
    assert_eq!(Counts::default().f1(), None);
    let range = |of: &str, from, to| Range { of: of.to_owned(), from, to };
    let key = [range("v", Some(-0.05), Some(0.05)), range("v", None, Some(-0.05))];
    let said = [range("v", Some(-0.1), Some(0.02)), range("omega", Some(0.0), Some(1.0)), range("phi", Some(0.0), Some(1.0))];
    // Of the 0.12 that are said, 0.07 lie in the first and 0.05 in the second. Of headings the key tells nothing in any case.
    assert_eq!(matched(&said, &key, &["v", "omega"].into()), Counts { both: 1, answer: 1, key: 1 });
}

#[test]
fn the_gap_is_closed_as_far_as_the_keys_ceiling() {
    let mut case = case("single", &["slope"], Value::Null);
    case.noise_ceiling = Some([("v".to_owned(), 98.0), ("omega".to_owned(), 99.0)].into());
    let mut said = answer("explained", &[("slope", &[])]);
    let fits = |v, omega| [("v".to_owned(), Some(v)), ("omega".to_owned(), Some(omega))].into();
    said.fit.before = fits(90.0, 97.0);
    said.fit.after = fits(97.0, 99.0);
    assert!((gap_closed(&case, &said).unwrap() - 0.9).abs() < 1e-12);
    said.fit.before = fits(97.9, 98.9);
    assert_eq!(gap_closed(&case, &said), None, "a gap within rounding is none");
}

#[test]
fn the_time_of_a_payload_is_compared_where_both_tell_it() {
    let mut case = case("single", &["payload_change"], Value::Null);
    case.truth[0].parameters.insert("time_s".to_owned(), json!(61.5));
    let mut said = answer("explained", &[("payload_change", &[])]);
    assert_eq!(time_error(&case, &said), None);
    said.effects[0].parameters = vec![serde_json::from_value(json!({ "name": "time_s", "value": 62.0 })).unwrap()];
    assert_eq!(time_error(&case, &said), Some(0.5));
}
