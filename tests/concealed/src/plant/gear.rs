//! Between rotor and wheel: a gap with a stiff flank on either side, or a soft shaft.

/// An elastic coupling with a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gear {
    /// Whole width of the gap, at the wheel \[rad\].
    pub gap: f64,
    /// Stiffness of the flanks or shaft \[N m/rad\].
    pub stiffness: f64,
    /// Damping while in contact \[N m s/rad\].
    pub damping: f64,
    /// Inertia of the rotor, at the wheel \[kg m²\].
    pub rotor: f64,
}

impl Gear {
    /// Torque from rotor to wheel \[N m\] for the twist between them \[rad\] and its rate \[rad/s\]; flanks push, they do not pull.
    pub fn torque(&self, twist: f64, rate: f64) -> f64 {
        let linear = |deflection: f64| self.stiffness * deflection + self.damping * rate;
        let half = 0.5 * self.gap;
        if half == 0.0 {
            linear(twist)
        } else if twist > half {
            linear(twist - half).max(0.0)
        } else if twist < -half {
            linear(twist + half).min(0.0)
        } else {
            0.0
        }
    }
}
