//! A constant is added to the commands: u' = u + b.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force::Wheel;
use super::parts::Axis;
use super::words::quantity;

/// A trim that is off: a joystick's centre, an amplifier's or a sensor's zero.
///
/// The name is not among the contract's. The effect is needed as a rival: while no wheel reverses it is friction, exactly, and a
/// friction that differs with the direction is friction plus an offset, always. Without it a robot whose trim is off would be
/// said to have odd friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandOffset {}

/// What an input is called, and how it is labelled.
fn names(scene: &Scene, i: usize) -> (String, (&'static str, String)) {
    match scene.frame {
        Frame::Body { .. } => {
            let axis = [Axis::V, Axis::Omega][i];
            (format!("the {} command", axis.word()), ("axis", axis.name().to_owned()))
        }
        Frame::Sides { .. } => {
            let wheel = [Wheel::Left, Wheel::Right][i];
            (format!("the {} side's command", wheel.word()), ("wheel", wheel.word().to_owned()))
        }
        Frame::Channels => (format!("`{}`", scene.inputs[i].name), ("input", scene.inputs[i].name.to_string())),
    }
}

#[typetag::serde(name = "command_offset")]
impl Effect for CommandOffset {
    fn name(&self) -> &str {
        "command_offset"
    }

    fn about(&self) -> String {
        "a constant is added to the commands".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Gain
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let of = |(i, channel): (usize, &wheelwright_core::Channel)| {
            let (typical, (kind, which)) = (scene.scales.inputs[i], names(scene, i).1);
            EffectParameter::new("offset", &channel.unit, (-typical, typical), 0.03 * typical).neutral(0.0).of(kind, &which)
        };
        scene.inputs.iter().enumerate().map(of).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let n = scene.inputs.len();
        let values = scene.scales.inputs.iter().map(|typical| 0.03 * typical).collect();
        vec![Start { values, columns: (0..n).map(|i| vec![i]).collect(), linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let said = values
            .iter()
            .zip(&scene.inputs)
            .enumerate()
            .map(|(i, (b, c))| format!("{} is off by {}", names(scene, i).0, quantity(*b, &c.unit)));
        format!("{}, always; the model had no offset", said.collect::<Vec<_>>().join(", "))
    }

    fn excitation(&self) -> &'static str {
        "standing still, and the same driving forwards and backwards, to the left and to the right"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "coulomb_friction", because: "while no wheel reverses, friction takes a constant off the command" },
            Confusion {
                with: "coulomb_friction_one_wheel",
                because: "while no wheel reverses, friction at one wheel is a constant forward and a constant turning command",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "friction that differs with the direction is friction plus an offset, always",
            },
            Confusion { with: "slope", because: "while the heading stays the same, a slope pulls with a constant force" },
            Confusion { with: "gain_asymmetry", because: "at one forward speed a veer in proportion to it is a constant turning command" },
        ]
    }

    fn holds(&self) -> bool {
        true
    }

    fn command(&self, p: &[f64], _at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        u.iter_mut().zip(p).for_each(|(u, b)| *u += b);
    }
}
