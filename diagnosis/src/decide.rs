//! The verdict: what the evidence, the tests without a library and the held-out data say together.

use wheelwright_core::effect::{Effect, Estimate, Scene};

use crate::answer::COUNTED;
use crate::effects::{LATENESS, digits};
use crate::finding::{Alternative, Finding, FoundParameter, Verdict, settings};
use crate::holdout::Transfer;
use crate::residuals::Flag;

/// Share of the misfit that may be left over by a test without a library before an explanation is only a part of one.
pub(crate) const LEFT_OVER: f64 = 0.08;

/// How far what counts are late by may be from half an interval, as a share of that: other laws take some of it up.
const HALF: f64 = 0.2;

/// What is said where only held-out data show a mismatch.
const FOREIGN: &str = "the held-out recording shows motion that the model misses and the training recording does not show; diagnose that \
                       recording, or one driven as it was";

/// What is said where an explanation fails on held-out data.
const UNTRANSFERRED: &str = "what explains the training data does not bring the held-out error down: it fits here and does not transfer";

/// What is said where only parameters that the training data do not show are in the way.
const OPEN: &str = "the held-out error comes down with other values of parameters that the training data hardly show: the fit on held-out data is given \
                    with the values found; drive as in the held-out recording to know them";

/// Effects by which the wheels' rates tell another motion than the robot's.
const SLIDES: [&str; 2] = ["turning_scrub", "wheel_slip"];

/// Everything that weighs.
pub(crate) struct Weighed<'a> {
    pub(crate) findings: Vec<Finding>,
    /// A wrong track that channels beside the model's tell.
    pub(crate) track: Option<Finding>,
    pub(crate) flags: Vec<Flag>,
    pub(crate) transfer: Transfer,
    /// What more of a cause that was found held-out data show, if that is what they lack.
    pub(crate) unseen: Option<String>,
    /// Whether held-out data show motion that the training data lack.
    pub(crate) foreign: bool,
    pub(crate) warnings: Vec<String>,
    pub(crate) effects: &'a [Box<dyn Effect>],
    pub(crate) scene: &'a Scene,
}

/// What comes of it.
pub(crate) struct Decided {
    pub(crate) verdict: Verdict,
    pub(crate) headline: String,
    pub(crate) effects: Vec<Finding>,
    pub(crate) partial: Vec<Finding>,
    pub(crate) warnings: Vec<String>,
}

pub(crate) fn decide(weighed: Weighed<'_>) -> Decided {
    let Weighed { mut findings, track, flags, transfer, unseen, foreign, mut warnings, effects, scene } = weighed;
    // What acts on the noise alone shows in the tests and not in the likelihood.
    let left: Vec<&Flag> = flags.iter().filter(|f| f.left_over.is_some_and(|share| share > LEFT_OVER)).collect();
    // What acts on the noise alone moves nothing that could transfer.
    let elsewhere = if findings.is_empty() { foreign } else { transfer == Transfer::Fails };
    let moved = !findings.is_empty();
    for flag in flags.iter().filter(|f| f.left_over.is_none()) {
        let Some((name, values)) = &flag.effect else { continue };
        if !findings.iter().any(|f| f.name == *name) {
            findings.extend(of_noise(name, values, flag, effects, scene));
        }
    }
    of_counts(&mut findings, &flags, effects, scene);
    // Wheels that slide make a track look wider.
    findings.extend(track.filter(|_| !findings.iter().any(|f| SLIDES.contains(&f.name.as_str()))));
    warnings.extend(left.iter().map(|f| f.statement.clone()));
    let nothing = findings.is_empty();
    let rivals = findings.iter().any(|f| f.alternatives.iter().any(|a| a.open));
    if elsewhere {
        warnings.push(if moved { UNTRANSFERRED } else { FOREIGN }.to_owned());
    }
    if transfer == Transfer::Open {
        let of_another_part =
            |statement| format!("held-out driving shows more of the same cause, where the training data never reach: {statement}");
        warnings.push(unseen.map_or_else(|| OPEN.to_owned(), of_another_part));
    }
    let verdict = match (nothing, left.is_empty()) {
        (true, true) if elsewhere => Verdict::Unexplained,
        (true, true) => Verdict::NoMismatch,
        (_, false) => Verdict::Unexplained,
        // A rival that these data cannot exclude may be what would transfer, with parameters that they do not show.
        (false, true) if rivals => Verdict::Ambiguous,
        (false, true) if elsewhere => Verdict::Unexplained,
        (false, true) => Verdict::Explained,
    };
    let headline = headline(verdict, &findings, &left);
    let (effects, partial) = if verdict == Verdict::Unexplained { (Vec::new(), findings) } else { (findings, Vec::new()) };
    Decided { verdict, headline, effects, partial, warnings }
}

/// Counts that are differenced over the sampling interval are late by half of it. Where the outputs were read at their time, what was found of that is
/// theirs if the counts show; and if they do not, it may be.
fn of_counts(findings: &mut Vec<Finding>, flags: &[Flag], effects: &[Box<dyn Effect>], scene: &Scene) {
    let tested = |test: &str| flags.iter().find(|flag| flag.test == test);
    if tested("means over the interval").is_some() {
        return;
    }
    let half = 0.5 * scene.scales.period;
    let is_late = |f: &Finding| effects.iter().any(|e| e.name() == f.name && e.family() == LATENESS);
    let by_half = |f: &Finding| f.parameters.iter().filter(|p| p.unit == "s").all(|p| (p.value - half).abs() < HALF * half);
    let Some(at) = findings.iter().position(|f| is_late(f) && by_half(f)) else { return };
    let because =
        format!("always, but for what is faster than the samples: differences of counts are late by half an interval, {} s", digits(half));
    let same_as = |name: &str| Alternative { name: name.to_owned(), gap: 0.0, because: because.clone(), always: true, open: false };
    let Some((counts, _)) = tested("counts of the wheels").and_then(|flag| flag.effect.as_ref()) else {
        let counting = effects.iter().find(|e| e.name() == COUNTED && e.inapplicable(scene).is_none());
        findings[at].alternatives.extend(counting.map(|_| same_as(COUNTED)));
        return;
    };
    let late = findings.remove(at);
    let alternative = same_as(&late.name);
    findings.iter_mut().filter(|f| f.name == *counts).for_each(|f| f.alternatives.push(alternative.clone()));
}

/// A finding of an effect that acts on the noise.
fn of_noise(name: &str, values: &[f64], flag: &Flag, effects: &[Box<dyn Effect>], scene: &Scene) -> Option<Finding> {
    let known = |e: &dyn Effect| e.name() == name && e.inapplicable(scene).is_none() && e.parameters(scene).len() == values.len();
    let effect = effects.iter().find(|e| known(&***e))?;
    let parameters = effect.parameters(scene);
    Some(Finding {
        name: effect.name().to_owned(),
        place: effect.stage().place(),
        statement: effect.statement(&Estimate::bare(values), scene),
        parameters: parameters
            .into_iter()
            .zip(values)
            .map(|(p, v)| FoundParameter { name: p.name, value: *v, ci95: None, unit: p.unit, label: p.label })
            .collect(),
        values: values.to_vec(),
        settings: settings(&**effect),
        delta_bic: flag.value - flag.threshold,
        holdout_gain: None,
        alternatives: flag.instead.clone(),
    })
}

fn headline(verdict: Verdict, findings: &[Finding], left: &[&Flag]) -> String {
    let said = || findings.iter().map(|f| f.statement.clone()).collect::<Vec<_>>().join("; and ");
    let names = |f: &Finding| {
        let near = f.alternatives.iter().filter(|a| a.open).map(|a| a.name.as_str());
        std::iter::once(f.name.as_str()).chain(near).collect::<Vec<_>>().join(" or ")
    };
    match verdict {
        Verdict::NoMismatch => "nothing beyond noise: the model explains this recording".to_owned(),
        Verdict::Explained => said(),
        Verdict::Ambiguous => {
            let each: Vec<String> = findings.iter().map(names).collect();
            format!("something is missing: {}; this recording cannot tell them apart", each.join(", and "))
        }
        Verdict::Unexplained => {
            let why = left.first().map_or_else(|| "what fits here does not hold on other data".to_owned(), |f| f.statement.clone());
            match findings.is_empty() {
                true if left.is_empty() => format!("something is missing: {FOREIGN}"),
                true => format!("something is missing that no effect of the library explains: {why}"),
                false => format!("something is missing that the library explains only in part: {why}; the part: {}", said()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use wheelwright_core::ModelConfig;
    use wheelwright_core::effect::Place;
    use wheelwright_models::VwPdConfig;

    use super::*;
    use crate::effects::{ActuatorLag, library};
    use crate::fixture::{Case, TRACK};

    /// The decision where nothing was found, with what else weighs.
    fn decided(foreign: bool, transfer: Transfer, flags: Vec<Flag>) -> Decided {
        with(Vec::new(), foreign, transfer, flags)
    }

    fn with(findings: Vec<Finding>, foreign: bool, transfer: Transfer, flags: Vec<Flag>) -> Decided {
        let model = VwPdConfig::default().build().expect("the model has defaults");
        let case = Case::clean(1);
        let scene = Scene::new(&case.data, &*model, TRACK, None, None);
        decide(Weighed {
            findings,
            track: None,
            flags,
            transfer,
            unseen: None,
            foreign,
            warnings: Vec::new(),
            effects: &library(),
            scene: &scene,
        })
    }

    #[test]
    fn a_held_out_recording_with_motion_of_its_own_is_no_clean_bill() {
        assert_eq!(decided(false, Transfer::Holds, Vec::new()).verdict, Verdict::NoMismatch);
        let foreign = decided(true, Transfer::Fails, Vec::new());
        assert_eq!(foreign.verdict, Verdict::Unexplained);
        assert!(foreign.headline.contains("held-out") && foreign.warnings.len() == 1, "{}", foreign.headline);
    }

    #[test]
    fn what_is_late_by_half_a_sample_is_the_counting_that_was_seen() {
        let counts = |test| Flag {
            test,
            value: 0.5,
            threshold: 0.1,
            left_over: None,
            statement: "the wheels' speeds come in counts".to_owned(),
            effect: Some(("encoder_quantisation".to_owned(), vec![0.001])),
            instead: Vec::new(),
        };
        let late = |time: f64| Finding {
            name: "actuator_lag".to_owned(),
            place: Place::Command,
            statement: String::new(),
            parameters: vec![FoundParameter {
                name: "time_constant".to_owned(),
                value: time,
                ci95: None,
                unit: "s".to_owned(),
                label: None,
            }],
            values: vec![time],
            settings: settings(&ActuatorLag::default()),
            delta_bic: 100.0,
            holdout_gain: None,
            alternatives: Vec::new(),
        };
        // Samples are 50 ms apart.
        let names = |time: f64, tests: &[&'static str]| -> Vec<String> {
            let flags = tests.iter().map(|test| counts(test)).collect();
            with(vec![late(time)], false, Transfer::Holds, flags).effects.into_iter().map(|f| f.name).collect()
        };
        assert_eq!(names(0.027, &["counts of the wheels"]), ["encoder_quantisation"]);
        assert_eq!(names(0.05, &["counts of the wheels"]), ["actuator_lag", "encoder_quantisation"]);
        assert_eq!(names(0.027, &["means over the interval", "counts of the wheels"]), ["actuator_lag", "encoder_quantisation"]);
        // Counts that other noise covers may be what is late all the same.
        let instead = |time: f64| -> Vec<String> {
            let told = with(vec![late(time)], false, Transfer::Holds, Vec::new());
            told.effects[0].alternatives.iter().map(|a| a.name.clone()).collect()
        };
        assert_eq!((instead(0.027), instead(0.05)), (vec!["encoder_quantisation".to_owned()], vec![]));
    }

    #[test]
    fn what_acts_on_the_noise_alone_has_nothing_to_transfer() {
        let jitter = Flag {
            test: "variance against acceleration",
            value: 20.0,
            threshold: 0.0,
            left_over: None,
            statement: "stamps jitter".to_owned(),
            effect: Some(("timestamp_jitter".to_owned(), vec![0.01])),
            instead: Vec::new(),
        };
        let found = decided(false, Transfer::Fails, vec![jitter.clone()]);
        assert_eq!((found.verdict, found.effects.len()), (Verdict::Explained, 1), "{}", found.headline);
        assert_eq!(decided(true, Transfer::Fails, vec![jitter]).verdict, Verdict::Unexplained);
    }
}
