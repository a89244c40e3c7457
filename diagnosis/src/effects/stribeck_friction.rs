//! Dry friction that is greater near standstill: f = sgn s (c + b exp(−(s/v_s)²)) at each wheel (Stribeck; the form of Armstrong-
//! Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1994).
//!
//! b is what breaking away needs beyond the running friction c, v_s the speed at which it is gone. A `presliding` one comes up with the
//! way since the last reversal, as bristles bend.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::words::{KINK, quantity};
use super::{bristles, force};

/// Least speed over which friction falls, in widths of the smoothed sign: a narrower rise is the form of the kink.
const NARROWEST: f64 = 5.0;

/// Running friction and what breaking away needs beyond it, as shares of a typical command, where they are so large that wheels stick and jump.
const STICKING: (f64, f64) = (0.1, 0.2);

/// Share by which a speed may differ from its least and is that.
const LEAST: f64 = 1e-3;

/// Stribeck friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StribeckFriction {
    /// Whether it comes up with the way since the last reversal. Default `false`: it is whole as soon as a wheel turns.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub presliding: bool,
}

/// Friction at a speed.
fn holds(p: &[f64], speed: f64) -> f64 {
    p[0] + p[1] * (-(speed / p[2]).powi(2)).exp()
}

/// The same as a share of that near standstill.
fn reach(p: &[f64], speed: f64) -> f64 {
    let most = p[0] + p[1];
    if most > 0.0 { holds(p, speed) / most } else { 1.0 }
}

#[typetag::serde(name = "stribeck_friction")]
impl Effect for StribeckFriction {
    fn name(&self) -> &str {
        "stribeck_friction"
    }

    fn about(&self) -> String {
        "dry friction at both wheels that is greater near standstill".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let typical = scene.scales.speed;
        let mut all = force::sizes(scene, "friction");
        all.extend(force::sizes(scene, "breakaway"));
        all.push(EffectParameter::new("stribeck_speed", "m/s", (NARROWEST * KINK * typical, typical), 0.1 * typical));
        all.extend(self.presliding.then(|| bristles::length(scene)));
        all.extend(force::turning_ratio(scene));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let command = force::command(scene, 0);
        let length = self.presliding.then(|| bristles::length(scene).scale);
        let values = |kinetic: f64, rise: f64, share: f64| -> Vec<f64> {
            [kinetic * command, rise * command, share * scene.scales.speed].into_iter().chain(length).collect()
        };
        let from = |share: f64| force::starts(scene, &values(0.05, 0.05, share), &[vec![0], vec![1]]);
        // From a small friction no step leads to wheels that stick.
        let sticking = |share: f64| {
            let values = force::with_ratio(scene, &values(STICKING.0, STICKING.1, share));
            Start { values, columns: vec![vec![0], vec![1]], linear: false }
        };
        [0.06, 0.12, 0.22, 0.4].into_iter().flat_map(from).chain([0.1, 0.2, 0.4].map(sticking)).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        format!(
            "dry friction at each wheel uses up {}, while it rolls and {} more near standstill, gone above {}{}; the model had none",
            force::in_words(values[0], scene),
            quantity(values[1], force::unit(scene)),
            quantity(values[2], "m/s"),
            if self.presliding { bristles::comes_up(values[3]) } else { String::new() },
        )
    }

    fn narrower(&self, values: &[f64], scene: &Scene) -> Option<&'static str> {
        let all = self.parameters(scene);
        let of = |name: &'static str| all.iter().zip(values).filter(move |(p, _)| p.name == name);
        let no_rise = of("breakaway").all(|(p, x)| p.is_neutral(*x));
        // At its least speed a rise is the form of the kink, which no two models of dry friction share.
        let kink = of("stribeck_speed").all(|(p, x)| *x <= p.bounds.0 * (1.0 + LEAST));
        (no_rise || kink).then_some("coulomb_friction")
    }

    fn contains(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }

    fn excitation(&self) -> &'static str {
        "creeping and starting from rest, many times, in both directions"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "coulomb_friction", because: "without slow motion only its running value is seen" },
            Confusion {
                with: "dead_zone",
                because: "a robot that needs a large command to break away hardly moves below it, as in a dead zone",
            },
            Confusion { with: "theta4", because: "friction that falls with speed looks like less viscous friction" },
        ]
    }

    fn stands_in(&self) -> bool {
        self.presliding
    }

    fn states(&self, _scene: &Scene) -> usize {
        if self.presliding { bristles::STATES } else { 0 }
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, _inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.presliding {
            bristles::begin(at, outputs, state, |speed| reach(p, speed));
        }
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if self.presliding {
            bristles::advance(p[3], at, motion, state, |speed| reach(p, speed));
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        if self.presliding {
            bristles::load(p[0] + p[1], at, state, p.get(4), load);
            return;
        }
        force::at_contacts(at, outputs, p.get(3), None, load, |_, speed, sign| sign * holds(p, speed));
    }
}
