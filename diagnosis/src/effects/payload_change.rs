//! Something is loaded or unloaded: from t0 on the robot accelerates as with another mass and another moment of inertia.
//!
//! θ1 → θ1 (1 + d1), θ2 → θ2 (1 + d2), and where the load moves the centre of mass along the robot, θ5 → θ5 + d5 and
//! θ3 → θ3 + h² d5 (of one cause, m b). In channels without wheels each has a change of its own. One that is `undone` is as before from t0 + T on. One
//! that is `gradual`, as what is filled in, comes evenly within T from t0 on.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::moments::{self, SHARES};
use super::words::{quantity, scaled};

/// How a load changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LoadLaw {
    /// At once and for good.
    #[default]
    Lasting,
    /// At once, and what was put on is taken off again, or the reverse.
    Undone,
    /// Evenly over some time, and for good.
    Gradual,
}

/// A change of payload.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PayloadChange {
    /// How. Default `lasting`.
    #[serde(default)]
    pub law: LoadLaw,
}

/// Least share of the recording that a load stays on: what jerks the robot for a moment is none.
const STAYS: f64 = 0.1;
/// Times between which a change is tried that is undone, of those of one that is not: what is undone is then the difference of two changes that are not, and
/// nothing new to take out of the noise.
const WHILES: [(usize, usize); 12] =
    [(0, 4), (0, 7), (0, 12), (3, 5), (3, 8), (3, 12), (5, 8), (5, 12), (7, 10), (7, 14), (10, 12), (10, 14)];
/// Times in which a gradual change comes that are tried, as shares of the recording.
const TAKES: [f64; 3] = [0.04, 0.12, 0.36];
/// Half of the robot may have been load; a robot that carries six times itself is another one.
const CHANGE: (f64, f64) = (-0.5, 6.0);

impl PayloadChange {
    /// How many of its parameters are times.
    fn times(&self) -> usize {
        if self.law == LoadLaw::Lasting { 1 } else { 2 }
    }

    /// When it begins and ends to change, or is undone.
    fn switches(&self, times: &[f64]) -> [f64; 2] {
        match self.law {
            LoadLaw::Lasting => [times[0], f64::INFINITY],
            _ => [times[0], times[0] + times[1]],
        }
    }

    /// What share of the change there is.
    fn share(&self, times: &[f64], at: &Instant<'_>) -> f64 {
        let [from, to] = self.switches(times);
        match (self.law, moments::passed(from, at), moments::passed(to, at)) {
            (_, false, _) | (LoadLaw::Undone, _, true) => 0.0,
            (LoadLaw::Gradual, _, false) => ((at.time - from) / (to - from)).clamp(0.0, 1.0),
            _ => 1.0,
        }
    }
}

#[typetag::serde(name = "payload_change")]
impl Effect for PayloadChange {
    fn name(&self) -> &str {
        "payload_change"
    }

    fn about(&self) -> String {
        let how = match self.law {
            LoadLaw::Lasting => "at some time",
            LoadLaw::Undone => "at some time and change back",
            LoadLaw::Gradual => "over some time",
        };
        format!("mass and moment of inertia change {how}")
    }

    fn stage(&self) -> Stage {
        Stage::Inertia
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_commands(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let change = |name: &str| EffectParameter::new(name, "1", CHANGE, 0.1).neutral(0.0);
        let time = moments::parameter(scene);
        let (whole, scale) = (moments::duration(scene), time.scale);
        let mut all = vec![time];
        match self.law {
            LoadLaw::Lasting => {}
            LoadLaw::Undone => all.push(EffectParameter::new("lasts_s", "s", (STAYS * whole, whole), scale)),
            LoadLaw::Gradual => all.push(EffectParameter::new("takes_s", "s", (0.0, whole), scale).neutral(0.0)),
        }
        if let Frame::Channels = scene.frame {
            all.extend(scene.outputs.iter().map(|y| change("inertia_change").of("output", &y.name)));
        } else {
            let typical = force::command(scene, 0) / scene.scales.speed.powi(2);
            let unit = if matches!(scene.frame, Frame::Sides { .. }) { "V s2/m2" } else { "s/m" };
            all.extend([
                change("mass_change"),
                change("inertia_change"),
                EffectParameter::new("coupling_change", unit, (-typical, typical), 0.05 * typical).neutral(0.0),
            ]);
        }
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let times = self.times();
        let changes: Vec<f64> = self.parameters(scene)[times..].iter().map(|p| p.scale).collect();
        let columns: Vec<Vec<usize>> = (times..times + changes.len()).map(|i| vec![i]).collect();
        let start = |when: &[f64]| Start { values: [when, &changes[..]].concat(), columns: columns.clone(), linear: true };
        let at = |share: f64| moments::at(share, scene);
        match self.law {
            LoadLaw::Lasting => SHARES.map(|share| start(&[at(share)])).into(),
            LoadLaw::Undone => {
                WHILES.map(|(from, to)| (at(SHARES[from]), at(SHARES[to]))).map(|(from, to)| start(&[from, to - from])).into()
            }
            LoadLaw::Gradual => {
                let takes = |takes: f64| SHARES.map(|share| start(&[at(share), takes * moments::duration(scene)]));
                TAKES.into_iter().flat_map(takes).collect()
            }
        }
    }

    /// The same change at other times nearby: while the robot does not accelerate, the time of change does not show, so that the
    /// likelihood has a maximum for every acceleration.
    fn detours(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        let parameters = self.parameters(scene);
        // The whole, its end, and its beginning alone.
        let ways: &[[f64; 2]] = match self.law {
            LoadLaw::Lasting => &[[1.0, 0.0]],
            _ => &[[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]],
        };
        let shifted = |(way, off): (&[f64; 2], f64)| {
            let mut values = values.to_vec();
            values[..self.times()].iter_mut().zip(way).for_each(|(t, way)| *t += way * off);
            values
        };
        let within = |values: &Vec<f64>| parameters.iter().zip(values).all(|(p, v)| (p.bounds.0..=p.bounds.1).contains(v));
        let nearby = moments::nearby(scene);
        ways.iter().flat_map(|way| nearby.clone().map(move |off| (way, off))).map(shifted).filter(within).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let change = |e: Estimate| {
            let word = if e.value < 0.0 { "smaller" } else { "greater" };
            format!("{} {word}", quantity(scaled(e, |x| 100.0 * x * e.value.signum()), "%"))
        };
        let changes = &values[self.times()..];
        let what = match scene.frame {
            Frame::Channels => format!("as if the inertia of `{}` were {}", scene.outputs[0].name, change(changes[0])),
            _ => format!("as if its mass were {} and its moment of inertia {}", change(changes[0]), change(changes[1])),
        };
        let (changed, from_then) = match self.law {
            LoadLaw::Lasting => ("changed at", "from then on".to_owned()),
            LoadLaw::Undone => ("changed at", format!("from then on for {}", quantity(values[1], "s"))),
            LoadLaw::Gradual => ("began to change at", format!("after it had done so for {}", quantity(values[1], "s"))),
        };
        let (when, into) = (moments::when(values[0]), moments::into(values[0], scene));
        format!(
            "the load {changed} {when}, {into} into the recording: {from_then} the robot accelerates {what}; the model's stayed the same"
        )
    }

    fn excitation(&self) -> &'static str {
        "speeding up and slowing down, forwards and in turns, before and after the change"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "battery_sag",
                because: "a drive that weakens with time accelerates less as well; a sag also lowers the steady speed, a load does not",
            },
            Confusion {
                with: "theta1",
                because: "a change near either end leaves too little on one side, and the model's own inertia takes it up",
            },
        ]
    }

    fn stands_in(&self) -> bool {
        self.law == LoadLaw::Gradual
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        let (times, changes) = p.split_at(self.times());
        let next = self.switches(times).into_iter().filter(|time| *time > at.time).fold(f64::INFINITY, f64::min);
        if changes.iter().any(|change| *change != 0.0) { next } else { f64::INFINITY }
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let (times, change) = p.split_at(self.times());
        let share = self.share(times, at);
        if share == 0.0 {
            return;
        }
        let frame = &at.scene.frame;
        if frame.has_wheels() {
            let [mass, inertia, coupling] = [0, 1, 2].map(|i| share * change[i]);
            let ([v, w], h) = (frame.body(motion.outputs), frame.half_track());
            let [forward, turn] = frame.body(drive);
            let changed = [(forward + coupling * h * h * w * w) / (1.0 + mass), (turn - coupling * v * w) / (1.0 + inertia)];
            drive.copy_from_slice(&frame.from_body(changed));
        } else {
            drive.iter_mut().zip(change).for_each(|(drive, change)| *drive /= 1.0 + share * change);
        }
    }
}
