//! The wheels' radii are not those that are reckoned with: a recorded ground speed of a wheel is (1 + e) times another one.
//!
//! Which other one depends on where the speeds come from. With E = (e/2) [0, h; 1/h, 0], the coupling of forward and angular motion by
//! radii that are e/2 too large on the right and as much too small on the left, and ρ the turning ratio:
//!
//! * `reading`: y = (I + E) x, and the robot moves as if nothing was: the readout alone is wrong.
//! * `ground`: the robot's own motion is recorded, and loops on the wheels keep rates that they take for x − E x. With K what they withdraw for
//!   a unit of speed and B what the wheels' bearings use up besides, by virtual power u − K x − B becomes (I − E') (u − K x − B) + K E x + E B,
//!   E' = (e/2) [0, h/ρ; ρ/h, 0]. Loops that integrate sum up what they take for their error, u − x + E x.
//! * `encoders`: what the loops keep is recorded. The robot moves as in `ground`, with −e, and y = (I + E) x of its motion. Where nothing but
//!   inertia acts on it, this couples the axes by θ7 = (e/2) h (θ1 + θ2/ρ) and θ8 = (e/2) (ρ θ1 + θ2)/h, to the letter what a centre of mass
//!   to one side does (`lateral_com_offset`); a centre of mass ahead adds θ5 (e/2) v²/h. Only a measured pose tells the two apart, so that this
//!   one is never tried without.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::words::{digits, quantity, scaled};

/// Where the recorded speeds come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Speeds {
    /// A readout beside the loops.
    #[default]
    Reading,
    /// The robot's own motion.
    Ground,
    /// The encoders that the loops keep.
    Encoders,
}

/// Wheels whose radii are not those that are reckoned with, and unequal.
///
/// By default the right wheel's speed is recorded (1 + e/2) times and the left one's (1 − e/2) times: an error that both wheels
/// share scales all outputs, and the parameters of a model scale with it (θ1, θ2, θ4, θ6 by 1/(1 + e), θ5 and θ3 by its square for
/// `vw-pd`), so that nothing is left to see. For the same reason which wheel is wrong cannot be told: an error of the
/// right wheel alone is, to first order, half of it shared and half of it opposed. With `wheel` the error of a reading is that of one
/// wheel, for simulating a known one.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelRadiusMismatch {
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
    /// Where the recorded speeds come from. Default `reading`.
    pub speeds: Speeds,
    /// What a measurement beside the model's channels says of the error: its parameter is usually in the middle, and three deviations of that from the ends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub between: Option<(f64, f64)>,
}

impl WheelRadiusMismatch {
    /// e/2 of the wheels that the loops keep; `None` where the readout alone is wrong.
    fn kept(&self, p: &[f64]) -> Option<f64> {
        match self.speeds {
            Speeds::Reading => None,
            Speeds::Ground => Some(0.5 * p[0]),
            Speeds::Encoders => Some(-0.5 * p[0]),
        }
    }
}

/// E of a forward and an angular value, with e/2 and half the track.
fn coupled(half: f64, h: f64, [forward, turn]: [f64; 2]) -> [f64; 2] {
    [half * h * turn, half / h * forward]
}

#[typetag::serde(name = "wheel_radius_mismatch")]
impl Effect for WheelRadiusMismatch {
    fn name(&self) -> &str {
        "wheel_radius_mismatch"
    }

    fn about(&self) -> String {
        "the wheels' radii differ from those of the odometry".to_owned()
    }

    fn stage(&self) -> Stage {
        match self.speeds {
            Speeds::Reading => Stage::Sensor,
            _ => Stage::Drive,
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene).or_else(|| if self.speeds == Speeds::Reading { None } else { force::needs_loops(scene) })
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let error = EffectParameter::new("mismatch", "1", self.between.unwrap_or((-0.5, 0.5)), 0.02).neutral(0.0);
        let error = match self.between {
            Some((low, high)) => error.usually(0.5 * (low + high), (high - low) / 6.0),
            None => error,
        };
        let error = match self.wheel {
            Some(wheel) => error.of("wheel", wheel.word()),
            None => error,
        };
        let ratio = force::turning_ratio(scene).filter(|_| self.speeds != Speeds::Reading);
        std::iter::once(error).chain(ratio).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let size = self.between.map_or(0.02, |(low, high)| 0.5 * (low + high));
        let values = self.parameters(scene).iter().map(|p| if p.neutral.is_some() { size } else { 1.0 }).collect();
        vec![Start { values, columns: vec![vec![0]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let size = scaled(values[0], |e| 100.0 * e * if values[0].value < 0.0 { -1.0 } else { 1.0 });
        let more = if values[0].value < 0.0 { "less" } else { "more" };
        match self.wheel {
            Some(wheel) => {
                format!(
                    "the {} wheel's speed is recorded {} {more} than it is; the model's odometry was right",
                    wheel.word(),
                    quantity(size, "%")
                )
            }
            None => format!(
                "the recorded speed of the right wheel is {} {more} than it should be beside the left one's, as with wheels whose radii differ by as much: \
                 a radius of 0.1 m is off by {} mm; the model's odometry was right",
                quantity(size, "%"),
                digits(100.0 * values[0].value.abs())
            ),
        }
    }

    fn excitation(&self) -> &'static str {
        "straight driving and turning on the spot with quick changes, and a measured pose"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "gain_asymmetry",
                because: "a gain behind the drive and one before it differ only in what the two axes' different time constants leave of them; with equal time constants they are the same",
            },
            Confusion {
                with: "lateral_com_offset",
                because: "where the encoders that the loops keep are all that is recorded, the two are the same mathematics; a measured heading tells",
            },
            Confusion { with: "command_offset", because: "at one forward speed a veer in proportion to it is a constant turning command" },
            Confusion { with: "theta4", because: "always: the part that both wheels share scales all parameters and leaves no trace" },
        ]
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        let (frame, h, ratio) = (&at.scene.frame, at.scene.frame.half_track(), p.get(1).copied().unwrap_or(1.0));
        let Some(half) = self.kept(p) else { return };
        let coupled = |pair| coupled(half, h, pair);
        // What the wheels pass on, and what their loops and bearings used up before: of that, the loops keep what they take for the robot's motion.
        let passed = [0, 1].map(|i| drive[i] + motion.held[i]);
        let kept = |x: &[f64]| [0, 1].map(|i| motion.drag[2 * i] * x[0] + motion.drag[2 * i + 1] * x[1]);
        let by_loops = kept(motion.outputs);
        let by_bearings = frame.body(&[0, 1].map(|i| motion.u[i] - passed[i] - by_loops[i]));
        let unseen = kept(&frame.from_body(coupled(frame.body(motion.outputs))));
        let passed = frame.body(&passed);
        let taken = [half * h / ratio * passed[1], half * ratio / h * passed[0]];
        let seen = coupled(by_bearings);
        let changed = frame.from_body([0, 1].map(|i| seen[i] - taken[i]));
        drive.iter_mut().enumerate().for_each(|(i, drive)| *drive += changed[i] + unseen[i]);
    }

    fn deceives(&self) -> bool {
        self.speeds != Speeds::Reading
    }

    /// x − E x.
    fn perceived(&self, p: &[f64], at: &Instant<'_>, outputs: &mut [f64]) {
        let Some(half) = self.kept(p) else { return };
        let frame = &at.scene.frame;
        let unseen = frame.from_body(coupled(half, frame.half_track(), frame.body(outputs)));
        outputs.iter_mut().zip(unseen).for_each(|(x, d)| *x -= d);
    }

    fn senses(&self) -> bool {
        self.speeds == Speeds::Encoders
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        if self.speeds == Speeds::Ground {
            return;
        }
        let errors = match self.wheel {
            None => [-0.5 * p[0], 0.5 * p[0]],
            Some(wheel) => std::array::from_fn(|side| if side == wheel.index() { p[0] } else { 0.0 }),
        };
        let frame = at.scene.frame;
        let speeds = frame.wheels(outputs);
        let added = frame.from_wheels([errors[0] * speeds[0], errors[1] * speeds[1]]);
        outputs.iter_mut().zip(added).for_each(|(x, d)| *x += d);
    }
}
