//! Small commands do nothing: U' = U where |U| ≥ d and 0 below, or U' = sgn U · max(|U| − d, 0), on each wheel or on an axis.
//!
//! With `holding` a command that has passed goes on passing until it is below a share r of the threshold, as a comparator with hysteresis has it.
//!
//! With `servo` it is a wheel's motor that does nothing, and not its command: of what its speed loop asks for, e = U − β s, s the wheel's speed
//! and β its feedback, 1 or somewhat less, sgn e · min(|e|, d) is lost; where the loops are closed on forward and angular velocity, e is what both ask
//! of the wheel (`force::asked`).

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::parts::{Axis, Parts, shares};
use super::words::{KINK, each, passage, percent, quantity};

/// A threshold in the command path: a drive that does not turn below some command, a joystick's or a controller's dead band.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeadZone {
    /// Whether what passes is smaller by the threshold, so that nothing jumps.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub subtracting: bool,
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
    /// On the forward or the turning command in place of the wheels'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// In the loops' answer, not in their command.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub servo: bool,
    /// Whether a command that has passed goes on passing below the threshold.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub holding: bool,
}

/// Shares of the threshold down to which a command that has passed is tried to go on.
const RELEASES: [f64; 2] = [0.7, 0.4];
/// The threshold that is tried with them, as a share of a typical command: where one was found already it starts from that.
const HOLDING: f64 = 0.25;

impl DeadZone {
    fn parts(&self, scene: &Scene) -> Parts {
        Parts::of(scene.frame, self.wheel, self.axis)
    }
}

#[typetag::serde(name = "dead_zone")]
impl Effect for DeadZone {
    fn name(&self) -> &str {
        "dead_zone"
    }

    fn about(&self) -> String {
        let what = match (self.servo, self.holding) {
            (true, _) => "motors do nothing below a threshold",
            (_, true) => "commands below a threshold do nothing, until they have been above it",
            _ => "commands below a threshold do nothing",
        };
        what.to_owned()
    }

    fn stage(&self) -> Stage {
        if self.servo { Stage::Drive } else { Stage::Threshold }
    }

    /// What holds on one axis says nothing about the other.
    fn family(&self) -> &str {
        match self.axis {
            Some(Axis::V) => "dead_zone/v",
            Some(Axis::Omega) => "dead_zone/omega",
            None => "dead_zone",
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.holding && (self.servo || self.subtracting) {
            return Some("it is set to two kinds of thresholds: it is one of them".to_owned());
        }
        let looped = if self.servo { force::needs_loops(scene) } else { None };
        looped.or_else(|| Parts::refuse(scene.frame, self.wheel, self.axis))
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let of = |p: super::parts::Part| p.parameter("threshold", &p.unit, (0.0, p.largest), 0.03 * p.typical).neutral(0.0);
        let loops = self.servo.then(|| force::loops(scene)).into_iter().flatten();
        let release = self.holding.then(|| EffectParameter::new("release", "1", (0.0, 1.0), 0.1).neutral(1.0));
        self.parts(scene).list(scene).into_iter().map(of).chain(loops).chain(release).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.parts(scene).list(scene).iter().map(|p| p.typical).collect();
        if self.holding {
            let with = |mut start: Start, release: f64| {
                start.values.push(release);
                start
            };
            return shares(&sizes, &[HOLDING]).into_iter().flat_map(|start| RELEASES.map(|release| with(start.clone(), release))).collect();
        }
        let mut all = shares(&sizes, &[0.02, 0.03, 0.045, 0.065, 0.09, 0.13, 0.18, 0.25, 0.35, 0.5, 0.6, 0.7, 0.82, 0.95, 1.1]);
        all.iter_mut().filter(|_| self.servo).for_each(|start| start.values.extend([1.0, 1.0]));
        all
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parts = self.parts(scene).list(scene);
        let released = values.last().filter(|_| self.holding);
        let rest = match released {
            Some(share) => format!(", and once it moves for those below {} of that", percent(share.value)),
            None => if self.subtracting { ", and larger ones lose as much" } else { "" }.to_owned(),
        };
        if self.servo {
            let size = quantity(values[0], &parts[0].unit);
            return format!("a wheel's motor does not push before its speed is {size} off what it is told; the model's did at once");
        }
        match (self.wheel, self.axis, &*parts) {
            (Some(w), _, [part]) => {
                format!(
                    "the {} wheel does not move for commands below {}{rest}; the model had no dead zone",
                    w.word(),
                    quantity(values[0], &part.unit)
                )
            }
            (None, None, [part]) => {
                format!("a wheel does not move for commands below {}{rest}; the model had no dead zone", quantity(values[0], &part.unit))
            }
            _ => {
                let said = each(&parts, values, |p, v| format!("{} command does nothing below {}", p.whose, quantity(v, &p.unit)));
                format!("{said}{rest}; the model had no dead zone")
            }
        }
    }

    /// What goes on passing looks like a threshold wherever commands come from far above it or from nothing.
    fn stands_in(&self) -> bool {
        self.holding
    }

    fn excitation(&self) -> &'static str {
        "slow commands from standstill, some below and some above the threshold, in both directions"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "a dead zone that subtracts is friction but for its phase at reversals: it acts by the sign of the command, friction by that of the motion",
            },
            Confusion {
                with: "stribeck_friction",
                because: "a wheel that sticks until its command exceeds a threshold and a command that is withheld until then start alike",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "while no wheel reverses, friction and a dead zone that subtracts take a constant off the command",
            },
            Confusion {
                with: "command_offset",
                because: "while no command changes its sign, a dead zone that subtracts takes a constant off",
            },
        ]
    }

    fn holds(&self) -> bool {
        !self.holding
    }

    /// Of each part whether it passes.
    fn states(&self, scene: &Scene) -> usize {
        if self.holding { Parts::count(scene) } else { 0 }
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        let parts = self.parts(at.scene);
        state.fill(0.0);
        parts.look(inputs, |(part, command)| {
            if let (Some(state), Some(i)) = (state.get_mut(part), parts.parameter_of(part)) {
                *state = f64::from(u8::from(command.abs() > p[i]));
            }
        });
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        if self.servo {
            return;
        }
        let typical = at.scene.scales.command;
        self.parts(at.scene).change(u, |part, i, command| {
            let size = command.abs();
            let threshold = match (state.get_mut(part), p.last()) {
                (Some(passes), Some(release)) => {
                    let held_up_to = |passes: bool| if passes { release * p[i] } else { p[i] };
                    *passes = f64::from(u8::from(size > held_up_to(*passes > 0.0)));
                    held_up_to(*passes > 0.0)
                }
                _ => p[i],
            };
            if threshold <= 0.0 {
                command
            } else if self.subtracting {
                command.signum() * (size - threshold).max(0.0)
            } else {
                // A steep passage in place of a jump: narrow against any command that matters, and there is a slope to climb.
                let width = (KINK * typical).min(0.25 * threshold);
                command * passage((size - threshold) / width)
            }
        });
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        if !self.servo {
            return;
        }
        let frame = &at.scene.frame;
        let lost = force::asked(frame, motion, p[1], p[2]).map(|e| -e.clamp(-p[0].abs(), p[0].abs()));
        frame.add_at_wheels(lost, p[2], drive);
    }
}
