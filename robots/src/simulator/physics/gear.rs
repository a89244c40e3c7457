//! Play of the gears: the motor turns a little before the wheel does. The encoders sit on the motor.

use serde::{Deserialize, Serialize};

use super::{Flaw, POSITIVE, first_flaw};

/// A gear with play, between the motor and the wheel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gear {
    /// Play from flank to flank, as an angle of the wheel \[rad\].
    pub play: f64,
    /// Stiffness of the teeth, seen at the wheel \[N m/rad\].
    #[serde(default = "stiffness")]
    pub stiffness: f64,
    /// Share of `wheel_inertia` that is the motor's; the rest turns with the wheel.
    #[serde(default = "motor_share")]
    pub motor_share: f64,
}

fn stiffness() -> f64 {
    200.0
}

fn motor_share() -> f64 {
    0.8
}

impl Gear {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let share = self.motor_share;
        first_flaw(&[
            ("play", self.play, self.play > 0.0, POSITIVE),
            ("stiffness", self.stiffness, self.stiffness > 0.0, POSITIVE),
            ("motor_share", share, share > 0.0 && share < 1.0, "between 0 and 1"),
        ])
    }

    /// Torque from the motor to the wheel when the motor is ahead by `twist` \[rad\] and faster by `faster` \[rad/s\]. Teeth push, they do not pull.
    pub(super) fn torque(&self, twist: f64, faster: f64, inertia: f64) -> f64 {
        let half = 0.5 * self.play;
        let damping = self.damping(inertia);
        if twist > half {
            (self.stiffness * (twist - half) + damping * faster).max(0.0)
        } else if twist < -half {
            (self.stiffness * (twist + half) + damping * faster).min(0.0)
        } else {
            0.0
        }
    }

    /// Half of critical damping on the motor's inertia, so that teeth do not ring for long.
    fn damping(&self, inertia: f64) -> f64 {
        (self.stiffness * self.motor_share * inertia).sqrt()
    }

    /// Fastest rate of the part \[1/s\] on the drive's inertia.
    pub(super) fn rate(&self, inertia: f64) -> f64 {
        2.0 * (self.stiffness / (inertia * self.motor_share.min(1.0 - self.motor_share))).sqrt()
    }
}
