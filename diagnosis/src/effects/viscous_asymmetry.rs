//! Viscous friction that is not the same left and right, or forwards and backwards.
//!
//! What both wheels and both directions share is in the model (θ4, θ6; kV). The rest is f = ±a s on the right and left wheel, so that
//! forward motion turns the robot (a ρ v/h of the turning command) and turning brakes it (a h ω of the forward command); or
//! f = a |s| on either wheel, positive where forwards is the harder way.
//!
//! With `thinning` it is that of grease at one of the wheels, which thins as it is sheared: f = |a| s/(1 + |s|/s0) (Cross's law with the exponent 1,
//! J. Colloid Science 20, 1965), at the right wheel if a is positive and at the left one otherwise. Nothing of that is the model's.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{quantity, scaled};

/// Between what viscous friction differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Between {
    /// The right and the left wheel.
    #[default]
    Wheels,
    /// Forwards and backwards.
    Directions,
}

/// Asymmetry of viscous friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ViscousAsymmetry {
    /// Between what it differs. Default `wheels`.
    pub between: Between,
    /// Whether it is grease at one wheel, which thins as it is sheared.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub thinning: bool,
}

/// Speed, in terms of the typical one, by which grease may have thinned to a half.
const THINS: (f64, f64) = (0.02, 10.0);

impl ViscousAsymmetry {
    /// Unit of a friction in proportion to speed.
    fn unit(scene: &Scene) -> &'static str {
        if matches!(scene.frame, Frame::Sides { .. }) { "V s/m" } else { "1" }
    }

    /// All the command at the typical speed.
    fn all(scene: &Scene) -> f64 {
        force::command(scene, 0) / scene.scales.speed
    }

    /// The speed by which grease has thinned to a half.
    fn thins_by(scene: &Scene) -> EffectParameter {
        let speed = scene.scales.speed;
        EffectParameter::new("thins_by", "m/s", (THINS.0 * speed, THINS.1 * speed), 0.1 * speed)
    }
}

#[typetag::serde(name = "viscous_asymmetry")]
impl Effect for ViscousAsymmetry {
    fn name(&self) -> &str {
        "viscous_asymmetry"
    }

    fn about(&self) -> String {
        match self.between {
            _ if self.thinning => "viscous friction at one wheel that thins as it is sheared, as grease does".to_owned(),
            Between::Wheels => "viscous friction greater at one wheel than at the other".to_owned(),
            Between::Directions => "viscous friction greater in one direction than in the other".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        let both = self.thinning && self.between == Between::Directions;
        let either = both.then(|| "it is set to differ between directions and to thin: it does one of them".to_owned());
        either.or_else(|| force::needs_wheels(scene))
    }

    fn stands_in(&self) -> bool {
        self.thinning
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // More than all the command could not be driven against.
        let all = Self::all(scene);
        let (name, which) = match self.between {
            _ if self.thinning => ("difference", "right minus left"),
            Between::Wheels => ("half_difference", "right minus left"),
            Between::Directions => ("half_difference", "forwards minus backwards"),
        };
        let size = EffectParameter::new(name, Self::unit(scene), (-all, all), 0.05 * all).neutral(0.0).of("between", which);
        let thins = self.thinning.then(|| Self::thins_by(scene));
        std::iter::once(size).chain(thins).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (all, speed) = (Self::all(scene), scene.scales.speed);
        if self.thinning {
            let greased = |thins: f64| [-0.2, 0.2].map(|size| [size * all, thins * speed]);
            return [0.2, 1.0].into_iter().flat_map(greased).flat_map(|values| force::starts(scene, &values, &[vec![0]])).collect();
        }
        force::starts(scene, &[0.05 * all], &[vec![0]])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if self.thinning {
            return format!(
                "grease resists by {} for each m/s at the {} wheel while it turns slowly, and thins as it is sheared, at {} to a half; the model had none",
                quantity(scaled(values[0], |a| a * values[0].value.signum()), force::unit(scene)),
                if values[0].value >= 0.0 { "right" } else { "left" },
                quantity(values[1], "m/s")
            );
        }
        let (more, less) = match (self.between, values[0].value >= 0.0) {
            (Between::Wheels, true) => ("at the right wheel", "at the left"),
            (Between::Wheels, false) => ("at the left wheel", "at the right"),
            (Between::Directions, true) => ("forwards", "backwards"),
            (Between::Directions, false) => ("backwards", "forwards"),
        };
        let difference = scaled(values[0], |a| 2.0 * a * values[0].value.signum());
        format!(
            "resistance that grows with speed is greater {more} than {less}, by {} for each m/s; the model had them equal",
            quantity(difference, force::unit(scene))
        )
    }

    fn excitation(&self) -> &'static str {
        match self.between {
            Between::Wheels => "straight driving at several speeds in both directions, and turning in place",
            Between::Directions => "driving forwards and backwards at several speeds",
        }
    }

    fn confusions(&self) -> &'static [Confusion] {
        match self.between {
            Between::Wheels => &[
                Confusion {
                    with: "gain_asymmetry",
                    because: "at constant speed a weaker wheel and a braked wheel are one; only acceleration tells them apart",
                },
                Confusion {
                    with: "wheel_radius_mismatch",
                    because: "a robot that pulls to one side in proportion to speed may have unequal wheels",
                },
                Confusion {
                    with: "coulomb_friction_one_wheel",
                    because: "over a narrow range of speeds a loss at one wheel may be constant or proportional to speed",
                },
                Confusion { with: "theta4", because: "what both wheels share is a parameter of the model" },
            ],
            Between::Directions => &[
                Confusion {
                    with: "direction_asymmetry",
                    because: "over a narrow range of speeds a loss by direction may be constant or proportional to speed",
                },
                Confusion { with: "theta4", because: "while the robot drives one way only, it is a parameter of the model" },
            ],
        }
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let frame = &at.scene.frame;
        let [left, right] = frame.wheels(outputs);
        if self.thinning {
            let grease = |size: f64, speed: f64| size.max(0.0) * speed / (1.0 + speed.abs() / p[1]);
            return frame.add_at_wheels([grease(-p[0], left), grease(p[0], right)], p.get(2).copied().unwrap_or(1.0), load);
        }
        let forces = match self.between {
            Between::Wheels => [-p[0] * left, p[0] * right],
            Between::Directions => [p[0] * left.abs(), p[0] * right.abs()],
        };
        frame.add_at_wheels(forces, p.get(1).copied().unwrap_or(1.0), load);
    }
}
