//! Friction of one wheel's bearing and gear: viscous, and dry by one of three laws.

/// Friction that acts on one wheel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    /// Viscous torque per speed \[N m s/rad\].
    pub viscous: f64,
    /// Viscous torque of cold grease on top \[N m s/rad\], fading with `warm_time` \[s\].
    pub cold: f64,
    /// Time constant of warming up \[s\].
    pub warm_time: f64,
    /// Dry friction, where there is any.
    pub dry: Option<Dry>,
}

/// Dry friction: kinetic torque per direction, a higher one at rest, and the speed at which it falls from one to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dry {
    /// Kinetic torque when the wheel turns forward \[N m\].
    pub forward: f64,
    /// Kinetic torque when it turns backward \[N m\].
    pub backward: f64,
    /// Torque at rest over kinetic torque, at least 1.
    pub breakaway: f64,
    /// Speed over which breakaway falls off \[rad/s\].
    pub stribeck_speed: f64,
    /// Which law carries it.
    pub law: Law,
}

/// Laws of dry friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Set-valued: holds the wheel entirely up to breakaway (solved as an inequality in each step).
    SetValued,
    /// Bristles of LuGre: deflect by up to `deflection` \[rad\] before they slide, with `damping` \[s\] of theirs.
    Bristles {
        /// Deflection at which the kinetic torque is reached \[rad\].
        deflection: f64,
        /// Damping over stiffness of the bristles \[s\].
        damping: f64,
    },
    /// A soft sign: torque grows with speed over `speed` \[rad/s\] (a thick film of grease).
    Soft {
        /// Speed at which three quarters of the torque are reached \[rad/s\].
        speed: f64,
    },
}

impl Dry {
    /// Kinetic torque at a speed \[N m\], always positive, direction `sign`.
    pub fn kinetic(&self, sign: f64, speed: f64) -> f64 {
        let base = if sign >= 0.0 { self.forward } else { self.backward };
        if self.breakaway <= 1.0 {
            return base;
        }
        base * (1.0 + (self.breakaway - 1.0) * (-(speed / self.stribeck_speed).powi(2)).exp())
    }
}

impl Bearing {
    /// A bearing without any friction.
    pub const FREE: Bearing = Bearing { viscous: 0.0, cold: 0.0, warm_time: 1.0, dry: None };

    /// Viscous torque against motion \[N m\].
    pub fn viscous_torque(&self, speed: f64, t: f64) -> f64 {
        let cold = if self.cold == 0.0 { 0.0 } else { self.cold * (-t / self.warm_time).exp() };
        (self.viscous + cold) * speed
    }

    /// Largest torque that set-valued friction can hold against motion in each direction `(against forward, against backward)` \[N m\],
    /// with `rolling` \[N m\] of rolling resistance added to it.
    pub fn bounds(&self, speed: f64, rolling: f64) -> (f64, f64) {
        match self.dry {
            Some(dry) if dry.law == Law::SetValued => (dry.kinetic(1.0, speed) + rolling, dry.kinetic(-1.0, speed) + rolling),
            _ => (rolling, rolling),
        }
    }

    /// Torque against motion of the laws that need no inequality \[N m\]; `bristle` is the deflection of LuGre's bristles \[rad\].
    pub fn smooth_torque(&self, speed: f64, bristle: f64) -> f64 {
        match self.dry {
            Some(dry) => match dry.law {
                Law::SetValued => 0.0,
                Law::Soft { speed: soft } => dry.kinetic(speed, speed) * (speed / soft).tanh(),
                Law::Bristles { deflection, damping } => {
                    let stiffness = dry.forward.max(dry.backward) / deflection;
                    let rate = speed - stiffness * speed.abs() / dry.kinetic(speed, speed).max(1e-12) * bristle;
                    stiffness * (bristle + damping * rate)
                }
            },
            None => 0.0,
        }
    }

    /// Bristle deflection after `step` seconds at `speed` (implicit, so that any step is stable).
    pub fn bristle_after(&self, bristle: f64, speed: f64, step: f64) -> f64 {
        match self.dry {
            Some(Dry { law: Law::Bristles { deflection, .. }, .. }) => {
                let dry = self.dry.map_or(1e-12, |d| d.kinetic(speed, speed).max(1e-12));
                let stiffness = self.dry.map_or(0.0, |d| d.forward.max(d.backward)) / deflection;
                (bristle + step * speed) / (1.0 + step * stiffness * speed.abs() / dry)
            }
            _ => 0.0,
        }
    }
}
