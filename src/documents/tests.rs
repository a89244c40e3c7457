//! The shape of the diagnosis' document, key by key.

use serde_json::Value;
use wheelwright_diagnosis::Verdict;

use super::*;
use crate::report::diagnosis::tests::example;

/// Every key with the kind of its value; of a list its first element.
fn shape(value: &Value, path: &str, out: &mut Vec<String>) {
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "bool",
        Value::Number(_) => "number",
        Value::String(_) => "text",
        Value::Array(items) => {
            match items.first() {
                Some(first) => shape(first, &format!("{path}[]"), out),
                None => out.push(format!("{path}[] empty")),
            }
            return;
        }
        Value::Object(fields) => {
            fields.iter().for_each(|(key, value)| shape(value, &format!("{path}.{key}"), out));
            return;
        }
    };
    out.push(format!("{path} {kind}"));
}

fn shape_of(verdict: Verdict) -> String {
    let mut out = Vec::new();
    shape(&answer(&example(verdict), &["a remark".to_owned()]), "", &mut out);
    out.join("\n") + "\n"
}

#[test]
fn the_documents_of_an_ambiguous_and_a_clean_recording_have_their_golden_shape() {
    assert_eq!(shape_of(Verdict::Ambiguous), include_str!("golden/ambiguous.txt"));
    assert_eq!(shape_of(Verdict::NoMismatch), include_str!("golden/no_mismatch.txt"));
}

#[test]
fn a_parameter_carries_its_side_as_a_key() {
    let mut found = example(Verdict::Explained);
    found.effects[0].parameters[0].label = Some(("wheel", "left".to_owned()));
    let document = answer(&found, &[]);
    assert_eq!(document["effects"][0]["parameters"][0]["wheel"], "left");
    assert_eq!(document["verdict"], "explained");
}

#[test]
fn an_effect_found_on_two_axes_stands_once_with_both_parameters() {
    let mut found = example(Verdict::Explained);
    let mut other = found.effects[0].clone();
    other.statement = "the other axis too".to_owned();
    found.effects.insert(1, other);
    let document = answer(&found, &[]);
    let effects = document["effects"].as_array().unwrap();
    let first = &found.effects[0];
    assert_eq!(effects.iter().filter(|e| e["name"] == first.name.as_str()).count(), 1);
    assert_eq!(effects[0]["parameters"].as_array().unwrap().len(), 2 * first.parameters.len());
    assert_eq!(effects[0]["evidence"]["delta_bic"], 2.0 * first.delta_bic);
    assert!(effects[0]["statement"].as_str().unwrap().ends_with("and the other axis too"));
}
