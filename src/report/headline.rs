//! The first screen: what was found, how well it does on data it never saw, and what to be careful about.

use std::fmt::Write;

use wheelwright_core::RegressorModel;
use wheelwright_core::identification::Identification;
use wheelwright_core::solver::Status;
use wheelwright_core::validation::Validation;

use crate::report::page::{enumerate, escape, notes, prose};
use crate::report::{Outcome, ReportInput, fit, number};

pub(super) fn html(input: &ReportInput<'_>) -> String {
    let warnings = notes("warnings", "Worth knowing", &warnings(input));
    match input.outcome {
        Outcome::Failed { error, .. } => format!(
            "<div class=\"headline failed\"><p class=\"verdict\">No parameters were identified.</p><p class=\"error\">{}</p>\
             <p>Below is the data as measured, to see what it does and does not hold.</p></div>\n{warnings}",
            prose(error)
        ),
        Outcome::Identified(found) => {
            let about = format!("Model {}: {}. Solver {}.", found.model, input.model_about.trim_end_matches('.'), found.solver);
            format!(
                "<div class=\"headline\"><p class=\"verdict\">{}</p><p>{}</p><div class=\"tiles\">{}</div></div>\n{warnings}",
                escape(&sentence(input.model, found)),
                prose(&about),
                tiles(input.model, found)
            )
        }
    }
}

/// One sentence in words and numbers.
fn sentence(model: &dyn RegressorModel, found: &Identification) -> String {
    let (proof, data) = match &found.held_out {
        Some(held_out) => (held_out, "data it never saw"),
        None => (&found.train, "the data it was fitted to (none was held out)"),
    };
    if proof.failure.is_some() {
        return format!("The identified model cannot follow {data}: its simulation diverges.");
    }
    let fits: Vec<(String, f64)> = model.outputs().iter().zip(&proof.fit).filter_map(|(c, f)| f.map(|f| (c.name.to_string(), f))).collect();
    let Some(worst) = fits.iter().map(|f| f.1).reduce(f64::min) else {
        return format!("No output changes in {data}, so there is no fit to state.");
    };
    let list = |of: &[&(String, f64)], text: fn(&str, String) -> String| {
        enumerate(&of.iter().map(|(name, fit)| text(name, number::percent(*fit))).collect::<Vec<_>>())
    };
    let (good, bad): (Vec<_>, Vec<_>) = fits.iter().partition(|f| f.1 >= 0.0);
    let follows = list(&good, |name, fit| format!("{fit} of {name}"));
    let worse = list(&bad, |name, fit| format!("{name} ({fit})"));
    match worst {
        w if w >= 95.0 => format!("A close fit: in free run the model reproduces {follows} on {data}."),
        w if w >= 85.0 => format!("A good fit: in free run the model reproduces {follows} on {data}."),
        w if w >= 60.0 => format!("A rough fit: in free run the model reproduces {follows} on {data}."),
        w if w >= 0.0 => format!("A poor fit: in free run the model reproduces only {follows} on {data}."),
        _ if good.is_empty() => format!("No fit: in free run on {data} the model does worse than a constant on {worse}."),
        _ => format!("A poor fit: in free run on {data} the model reproduces {follows} and does worse than a constant on {worse}."),
    }
}

/// A tile an output: its fit large, the rest small.
fn tiles(model: &dyn RegressorModel, found: &Identification) -> String {
    let mut html = String::new();
    for (i, channel) in model.outputs().iter().enumerate() {
        let (kind, proof) = found.held_out.as_ref().map_or(("training", &found.train), |v| ("held out", v));
        let mut small = fit::rms(proof, i)
            .map(|e| format!("error {}{}{} rms", number::significant(e, 2), number::THIN, channel.unit))
            .into_iter()
            .collect::<Vec<_>>();
        if found.held_out.is_some() {
            small.push(format!("training {}", percent_or_none(&found.train, i)));
        }
        // Writing to a String cannot fail.
        let _ = write!(
            html,
            "<div class=\"tile\"><span class=\"what\">{}, {kind}</span><span class=\"big\">{}</span><span class=\"small\">{}</span></div>",
            escape(&channel.name),
            percent_or_none(proof, i),
            escape(&small.join(" · "))
        );
    }
    html.push_str("<p class=\"scale\">Fit: 100&nbsp;% is a perfect copy of the measurement, 0&nbsp;% no better than its mean.</p>");
    html
}

fn percent_or_none(validation: &Validation, output: usize) -> String {
    validation.fit.get(output).copied().flatten().map_or_else(|| number::NONE.to_owned(), number::percent)
}

/// Everything anybody warned of, the gravest first, each once.
fn warnings(input: &ReportInput<'_>) -> Vec<String> {
    let mut all = Vec::new();
    if let Outcome::Identified(found) = input.outcome {
        let failures = [("held-out", found.held_out.as_ref()), ("training", Some(&found.train))];
        for (data, failure) in failures.iter().filter_map(|(data, v)| Some((data, v.as_ref()?.failure.as_ref()?))) {
            all.push(format!("Free run on {data} data: {failure}."));
        }
        if found.solution.status == Status::IterationLimit {
            all.push("The solver stopped at its iteration limit: the parameters are the best it met, not an optimum.".to_owned());
        }
        all.extend(found.solution.warnings.iter().cloned());
    }
    all.extend(input.warnings.iter().cloned());
    for recording in input.recordings {
        all.extend(recording.warnings.iter().map(|w| format!("{}: {w}", recording.path)));
    }
    let mut unique: Vec<String> = Vec::with_capacity(all.len());
    for warning in all {
        if !unique.contains(&warning) {
            unique.push(warning);
        }
    }
    unique
}
