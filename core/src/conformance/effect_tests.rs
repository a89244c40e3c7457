use serde::{Deserialize, Serialize};

use super::*;
use crate::effect::{Stage, Start};

/// A gain of all commands, with one promise broken at will.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
struct Weak {
    broken: String,
    #[serde(skip)]
    forgotten: f64,
}

impl Weak {
    fn is(&self, broken: &str) -> bool {
        self.broken == broken
    }
}

#[typetag::serde(name = "weak-command-of-a-test")]
impl Effect for Weak {
    fn name(&self) -> &str {
        if self.is("name") { "another" } else { "weak-command-of-a-test" }
    }
    fn about(&self) -> String {
        if self.is("about") { String::new() } else { "commands lose a share".to_owned() }
    }
    fn stage(&self) -> Stage {
        Stage::Gain
    }
    fn inapplicable(&self, _scene: &Scene) -> Option<String> {
        self.is("nowhere").then(|| "never".to_owned())
    }
    fn parameters(&self, _scene: &Scene) -> Vec<EffectParameter> {
        let bounds = if self.is("bounds") { (1.0, 0.0) } else { (0.0, if self.is("endless") { f64::INFINITY } else { 1.0 }) };
        let scale = if self.is("scale") { 0.0 } else { 0.05 };
        let share = EffectParameter::new("share", "1", bounds, scale);
        vec![if self.is("never neutral") { share } else { share.neutral(if self.is("neutral bound") { -1.0 } else { 0.0 }) }]
    }
    fn starts(&self, _scene: &Scene) -> Vec<Start> {
        let values = match &*self.broken {
            "start" => vec![2.0],
            "start length" => vec![0.1, 0.1],
            "trace" => vec![0.0],
            _ => vec![0.1],
        };
        vec![Start { values, columns: vec![vec![usize::from(self.is("column"))]], linear: true }]
    }
    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let Estimate { value, ci95 } = values[0];
        match &*self.broken {
            "mute" => "commands are weak".to_owned(),
            "interval" => format!("commands lose {value}"),
            _ => format!("commands lose {value} {ci95:?}"),
        }
    }
    fn excitation(&self) -> &'static str {
        "any"
    }
    fn holds(&self) -> bool {
        !self.is("aging")
    }
    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        if self.is("aging") || self.is("restless") {
            u.iter_mut().for_each(|u| *u -= p[0] * at.time * *u);
        }
        let lost = if self.is("neutral") { p[0] + 1e-6 } else { p[0] };
        let lost = if self.is("infinite") { 1.0 - 1.0 / (1.0 - lost) } else { lost };
        u.iter_mut().for_each(|u| *u *= 1.0 - lost);
    }
}

#[test]
fn an_effect_that_keeps_its_promises_passes() {
    assert_eq!(check_effect(&Weak::default()), Ok(()));
    assert_eq!(check_effect(&Weak { broken: "aging".to_owned(), ..Weak::default() }), Ok(()));
    assert_eq!(check_effect(&Weak { broken: "endless".to_owned(), ..Weak::default() }), Ok(()));
}

#[test]
fn each_broken_promise_is_found() {
    for (broken, said) in [
        ("name", "it is written as `weak-command-of-a-test` and calls itself `another`"),
        ("about", "what it is is empty"),
        ("nowhere", "it applies nowhere"),
        ("restless", "it says that it holds, and its command changes within the interval"),
        ("bounds", "the bounds of `share` are 1 and 0"),
        ("scale", "the scale of `share` is 0"),
        ("never neutral", "it cannot be turned off"),
        ("neutral bound", "the neutral value of `share` lies outside its bounds"),
        ("start", "start 0: `share` = 2 is not within its bounds"),
        ("start length", "start 0 has 2 values for 1 parameters"),
        ("column", "start 0: column [1] names no parameter"),
        ("trace", "it leaves no trace"),
        ("mute", "does not tell its magnitude"),
        ("interval", "leaves the interval out"),
        ("neutral", "neutral values [0.0] change a run by"),
        ("infinite", "command gives a value that is not finite at [1.0]"),
    ] {
        let violations = check_effect(&Weak { broken: broken.to_owned(), ..Weak::default() }).unwrap_err();
        let text = violations.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
        assert!(text.contains(said), "{broken}: {text}");
    }
    let violations = check_effect(&Weak { forgotten: 1.0, ..Weak::default() }).unwrap_err();
    assert!(violations[0].to_string().contains("when read again"), "{violations:?}");
}
