//! Wheel on ground: ideal rolling, or a tyre that must creep to push and can push no more than friction allows.

/// How one wheel holds the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact {
    /// Rolls without slipping.
    Rolling,
    /// A tyre of the brush kind.
    Tyre(Tyre),
}

/// The brush tyre: bristles that stick until the friction limit, then slide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tyre {
    /// Force per unit of slip ratio at small slip \[N\].
    pub stiffness: f64,
    /// Largest force: friction coefficient times load \[N\].
    pub grip: f64,
    /// Speed below which slip is taken against this speed \[m/s\] (the contact's own length at standstill).
    pub floor: f64,
}

impl Tyre {
    /// Force of the brush \[N\] at a slip ratio.
    pub fn force(&self, slip: f64) -> f64 {
        let sliding = 3.0 * self.grip / self.stiffness;
        if slip.abs() >= sliding {
            return self.grip * slip.signum();
        }
        let part = slip / sliding;
        3.0 * self.grip * part * (1.0 - part.abs() + part * part / 3.0)
    }

    /// Slip velocity per force \[m/s/N\] about the present slip velocity; `reference` is the faster of rim and hub \[m/s\].
    pub fn compliance(&self, slip_velocity: f64, reference: f64) -> f64 {
        let reference = reference.abs().max(self.floor);
        let slip = slip_velocity / reference;
        if slip.abs() < 1e-9 { reference / self.stiffness } else { slip_velocity / self.force(slip) }
    }
}

impl Contact {
    /// Slip velocity per force \[m/s/N\]; zero where the wheel cannot slip.
    pub fn compliance(&self, slip_velocity: f64, reference: f64) -> f64 {
        match self {
            Contact::Rolling => 0.0,
            Contact::Tyre(tyre) => tyre.compliance(slip_velocity, reference),
        }
    }
}

/// Sideways scrub of four patches on a robot that turns by skidding: patches `arm` ahead of and behind the middle are dragged sideways
/// by turning, while the wheels roll.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scrub {
    /// Distance of the patches from the middle, along the robot \[m\].
    pub arm: f64,
    /// The tyre across its rolling direction, one patch.
    pub patch: Tyre,
}

impl Scrub {
    /// Yaw torque against turning \[N m\], for the speeds at which the two sides roll \[m/s\].
    pub fn torque(&self, omega: f64, sides: [f64; 2]) -> f64 {
        let dragged = self.arm * omega;
        let across = |rolling: f64| self.patch.force(dragged / rolling.abs().max(self.patch.floor));
        -2.0 * self.arm * (across(sides[0]) + across(sides[1]))
    }
}
