//! Dry friction at one wheel, f = c sgn s there and nothing at the other, or of another size at each.
//!
//! A rubbing tyre or a dry bearing: it slows the robot and turns it. In the body frame it uses up (f_R + f_L)/2 of the forward command and
//! ρ (f_R − f_L)/(2h) of the turning command. Sizes that are nearer to each other than to nothing at one wheel are told as friction of both.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::words::smooth_sign;

/// Coulomb friction of one wheel, or of unequal wheels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFrictionOneWheel {
    /// Which one. Without, each has a size of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
}

/// Share of the greater size from which on the lesser one is nearer to it than to nothing.
const BOTH: f64 = 0.5;

impl CoulombFrictionOneWheel {
    /// The wheels that have friction.
    fn wheels(&self) -> impl Iterator<Item = Wheel> + use<> {
        let only = self.wheel;
        [Wheel::Left, Wheel::Right].into_iter().filter(move |w| only.is_none_or(|only| only == *w))
    }
}

#[typetag::serde(name = "coulomb_friction_one_wheel")]
impl Effect for CoulombFrictionOneWheel {
    fn name(&self) -> &str {
        "coulomb_friction_one_wheel"
    }

    fn about(&self) -> String {
        match self.wheel {
            Some(wheel) => format!("dry friction of constant size at the {wheel} wheel alone"),
            None => "dry friction of another constant size at each wheel".to_owned(),
        }
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
        let size = |wheel: Wheel| force::sizes(scene, "friction").into_iter().map(move |p| p.of("wheel", wheel.word()));
        self.wheels().flat_map(size).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.wheels().map(|_| 0.05 * force::command(scene, 0)).collect();
        force::starts(scene, &sizes, &(0..sizes.len()).map(|i| vec![i]).collect::<Vec<_>>())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let sizes: Vec<String> = values.iter().map(|v| force::in_words(*v, scene)).collect();
        match self.wheel {
            Some(wheel) => format!("the {wheel} wheel alone has dry friction: it uses up {}; the model had none", sizes[0]),
            None => format!("dry friction uses up {} at the left wheel and {} at the right one; the model had none", sizes[0], sizes[1]),
        }
    }

    fn narrower(&self, values: &[f64], scene: &Scene) -> Option<&'static str> {
        let parameters = self.parameters(scene);
        let idle = parameters.iter().zip(values).any(|(p, x)| p.is_neutral(*x));
        (self.wheel.is_none() && idle).then_some("coulomb_friction_one_wheel")
    }

    fn told_as(&self, values: &[f64]) -> Option<&'static str> {
        let [left, right] = values.first_chunk().filter(|_| self.wheel.is_none())?;
        (left.min(*right) > BOTH * left.max(*right)).then_some("coulomb_friction")
    }

    fn contains(&self) -> &'static [&'static str] {
        if self.wheel.is_none() { &["coulomb_friction", "coulomb_friction_one_wheel"] } else { &[] }
    }

    fn excitation(&self) -> &'static str {
        "slow driving and turning in both directions, so that each wheel reverses"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "while no wheel reverses, either is a constant offset of both commands, and the turning offset may be one of the sensor",
            },
            Confusion { with: "gain_asymmetry", because: "at one speed a weaker wheel and a braked wheel pull to the same side alike" },
            Confusion {
                with: "viscous_asymmetry",
                because: "over a narrow range of speeds a constant loss at one wheel looks like one proportional to speed",
            },
            Confusion { with: "slope", because: "while the heading stays the same, a pull to one side may come from the ground" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let frame = &at.scene.frame;
        let signs = frame.wheels(outputs).map(|s| smooth_sign(s, at.scene.scales.speed));
        let (mut forces, mut sizes) = ([0.0; 2], p.iter());
        self.wheels().zip(&mut sizes).for_each(|(wheel, size)| forces[wheel.index()] = size * signs[wheel.index()]);
        frame.add_at_wheels(forces, sizes.next().copied().unwrap_or(1.0), load);
    }
}
