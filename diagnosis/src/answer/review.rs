//! What is left over: tests without a library on what the final model leaves, and where the base model is off.

use wheelwright_core::effect::{Effect, Estimate, Scene};

use crate::adequacy;
use crate::effects::digits;
use crate::finding::{Alternative, Finding, Location};
use crate::fit::search::{Fit, left};
use crate::fit::setting::{Runner, Setting};
use crate::noise::Noise;
use crate::question::{DiagnosisError, Question};
use crate::residuals::{Flag, Residuals, Series};

use super::{COUNTED, Means, Story};

/// The parameter of an effect that begins during a recording.
const BEGINS: &str = "time_s";

/// Ratio of a rest's deviation to that of its innovations above which it is no noise: its past tells fifteen sixteenths of its variance.
const SLOW: f64 = 4.0;

/// Tests without a library on what the final model leaves, and where the base model is off.
pub(super) fn review(question: &Question<'_>, story: &Story<'_>, findings: &[Finding]) -> Result<(Vec<Flag>, Location), DiagnosisError> {
    let Story { search, selected, .. } = story;
    let setting = &search.setting;
    let free = setting.free();
    let state = &selected.state;
    let (plain, base) = (Setting { readout: story.compared_readout(), ..setting.clone() }, story.compared());
    let simulate = |setting: &Setting<'_>, effects: &[usize], fit: &Fit, x: &[f64]| -> Result<Vec<f64>, DiagnosisError> {
        let mut runner = Runner::new(setting, &search.effects(effects), &fit.point)?;
        let mut out = fit.simulated.clone();
        if !runner.run(x, &fit.point.starts, &mut out) {
            out.clone_from(&fit.simulated);
        }
        // What nobody recorded the cause of is no misfit.
        for c in 0..setting.layout.outputs() {
            for s in 0..setting.layout.stretches() {
                let rows = setting.layout.before_settled(c, s);
                out[rows.clone()].copy_from_slice(&setting.measured[rows]);
            }
        }
        Ok(out)
    };
    let series = |flat: &[f64]| setting.layout.series(flat);
    let last = simulate(setting, &state.effects, &state.fit, &state.fit.point.x)?;
    let without = series(&simulate(&plain, &[], &state.fit, &state.fit.point.x[..free])?);
    let effects = search.effects(&state.effects);
    let mut runner = Runner::new(setting, &effects, &state.fit.point)?;
    let jacobian = runner.columns(&state.fit.point, 0..state.fit.point.x.len());
    let residuals = Residuals {
        model: setting.model,
        data: setting.data,
        theta_base: setting.map.theta(&base.point.x[..free]),
        theta_final: setting.map.theta(&state.fit.point.x[..free]),
        base: series(&simulate(&plain, &[], base, &base.point.x)?),
        last: series(&last),
        left: series(&left(setting, &last)),
        rounded: setting.rounded.clone(),
        noise: selected.whitening.noise.clone(),
        jacobian: jacobian.iter().map(|column| series(column)).collect(),
        half_track: setting.scene.frame.half_track(),
    };
    // Reading means over the interval is a part of the explanation, and of what it gains.
    let gain = match &story.means {
        Some(_) => gained(setting, &selected.whitening.noise, &residuals),
        None => selected.gained(setting, &state.fit),
    };
    let times = findings.iter().flat_map(|f| &f.parameters).filter(|p| p.name == BEGINS).map(|p| p.value);
    let moments = search.effects(&state.effects).iter().any(|effect| effect.rugged());
    let explained = adequacy::Explained { without: &without, since: times.min_by(f64::total_cmp), late: search.late(state), gain, moments };
    let (flags, location) = adequacy::review(&residuals, setting.scene, &explained, question.seed)?;
    // The pattern of numerical error is nobody's physics.
    Ok((if numerical(setting, &selected.state.fit) { Vec::new() } else { flags }, location))
}

/// What the final model gains of twice the log-likelihood on the base model, however each is read: independent values count by what is left.
fn gained(setting: &Setting<'_>, noise: &Noise, residuals: &Residuals<'_>) -> f64 {
    let left = |run: &Series, c: usize| -> f64 {
        let stretches = setting.data.stretches.iter().zip(run);
        stretches.flat_map(|(s, run)| s.outputs[c].iter().zip(&run[c]).map(|(y, m)| (y - m).powi(2))).sum::<f64>().max(f64::MIN_POSITIVE)
    };
    let independent = |c: usize| noise.independent(c) * setting.layout.counted() as f64;
    (0..setting.layout.outputs()).map(|c| independent(c) * (left(&residuals.base, c) / left(&residuals.last, c)).ln()).sum()
}

/// Whether no output leaves more than the numerical error of a free run.
pub(super) fn numerical(setting: &Setting<'_>, fit: &Fit) -> bool {
    (0..setting.layout.outputs()).all(|c| {
        let left = setting.layout.output(c).map(|k| (setting.measured[k] - fit.simulated[k]).powi(2));
        left.sum::<f64>() <= setting.floor[c].powi(2) * setting.layout.counted() as f64
    })
}

/// A rest that hardly changes from sample to sample: motion, however well an autoregression takes it for noise.
pub(super) fn following(setting: &Setting<'_>, noise: &Noise, base: &Fit) -> Option<Flag> {
    let layout = &setting.layout;
    let of = |c: usize| {
        let before: f64 = layout.output(c).map(|k| (setting.measured[k] - base.simulated[k]).powi(2)).sum::<f64>() / layout.rows() as f64;
        let slow = noise.deviation[c].powi(2) - noise.innovation[c].powi(2);
        (c, noise.deviation[c] / noise.innovation[c], (slow / before).clamp(0.0, 1.0))
    };
    let worst = (0..layout.outputs()).map(of).filter(|(_, ratio, _)| *ratio > SLOW).max_by(|a, b| a.2.total_cmp(&b.2))?;
    let (output, value, share) = worst;
    let statement = format!(
        "what is left of {} hardly changes from sample to sample: motion that these effects do not explain, not noise",
        setting.data.outputs[output].name
    );
    Some(Flag {
        test: "a rest that follows its past",
        value,
        threshold: SLOW,
        left_over: Some(share),
        statement,
        effect: None,
        instead: Vec::new(),
    })
}

/// What a finding's values say that its effect does not explain: all of it is left over.
pub(super) fn beyond(effect: &dyn Effect, finding: &Finding, scene: &Scene) -> Option<Flag> {
    let estimates: Vec<Estimate> = finding.parameters.iter().map(|p| Estimate { value: p.value, ci95: p.ci95 }).collect();
    let statement = effect.beyond(&estimates).or_else(|| impossible(effect, &estimates, scene))?;
    Some(Flag {
        test: "values beyond the effect",
        value: 1.0,
        threshold: 0.0,
        left_over: Some(1.0),
        statement,
        effect: None,
        instead: Vec::new(),
    })
}

/// What says that an effect would have to be larger than it can be, where the data show that it is there at all.
fn impossible(effect: &dyn Effect, estimates: &[Estimate], scene: &Scene) -> Option<String> {
    let parameters = effect.parameters(scene);
    parameters.iter().zip(estimates).find_map(|(p, e)| {
        let bound = p.extreme(e.value)?;
        let (low, high) = e.ci95?;
        let there = p.neutral.is_some_and(|neutral| neutral < low || high < neutral);
        there.then(|| {
            let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
            format!(
                "the `{}` of `{}` would have to be beyond {}{unit}, as far as it can go: something else is behind it",
                p.name,
                effect.name(),
                digits(bound)
            )
        })
    })
}

/// Outputs that are means over the interval are those of an encoder, whether or not its counts show. No drive tells the mean from the delay by
/// half a sample that it would otherwise be: they differ by what is faster than the samples.
pub(super) fn means(means: Means, scene: &Scene) -> Flag {
    let Means { evidence, instead, .. } = means;
    let statement = "speeds are recorded as means over the sampling interval".to_owned();
    let because = &format!(
        "always, but for what is faster than the samples: a mean over an interval is late by half of it, {} s",
        digits(0.5 * scene.scales.period)
    );
    let alternative = |name| Alternative { name, gap: evidence, because: because.clone(), always: true, open: false };
    let instead = instead.into_iter().map(alternative).collect();
    let effect = Some((COUNTED.to_owned(), vec![0.0]));
    Flag { test: "means over the interval", value: evidence, threshold: 0.0, left_over: None, statement, effect, instead }
}

/// Where noise happens to be largest is no place.
pub(super) fn nowhere(location: Location) -> Location {
    Location {
        channels: location.channels.into_iter().map(|(name, _)| (name, 0.0)).collect(),
        statement: "nothing beyond noise, and so nowhere".to_owned(),
        tests: location.tests,
        ..Location::default()
    }
}
