//! A direct-current motor seen from the wheel (gear ratio folded in), and the battery that feeds both.

/// Constants of one motor at the wheel's side of the gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Torque per current \[N m/A\].
    pub torque_constant: f64,
    /// Voltage per wheel speed \[V s/rad\].
    pub back_emf: f64,
    /// Winding resistance \[ohm\].
    pub resistance: f64,
    /// Winding inductance over resistance \[s\]; zero: current follows at once.
    pub electric_time: f64,
    /// Largest current the driver lets through \[A\].
    pub current_limit: f64,
    /// Largest voltage the driver can put out \[V\].
    pub voltage_limit: f64,
    /// Voltage the driver's bridge loses before any reaches the motor \[V\].
    pub voltage_lost: f64,
    /// Factor of the driver's output (amplifier tolerance).
    pub amplifier: f64,
    /// Torque ripple: size \[N m\] and periods per turn of the wheel.
    pub cogging: (f64, f64),
}

impl Motor {
    /// Current \[A\] the winding settles at for what the firmware asks, `voltage` \[V\], at wheel speed `speed` \[rad/s\].
    pub fn settled_current(&self, voltage: f64, speed: f64) -> f64 {
        let asked = voltage * self.amplifier;
        let passed = asked.signum() * (asked.abs() - self.voltage_lost).max(0.0);
        let limited = passed.clamp(-self.voltage_limit, self.voltage_limit);
        ((limited - self.back_emf * speed) / self.resistance).clamp(-self.current_limit, self.current_limit)
    }

    /// Current after `step` seconds from `current` towards where it settles.
    pub fn current_after(&self, current: f64, settled: f64, step: f64) -> f64 {
        if self.electric_time <= 0.0 { settled } else { settled + (current - settled) * (-step / self.electric_time).exp() }
    }

    /// Torque at the wheel \[N m\] for a current and a wheel angle.
    pub fn torque(&self, current: f64, angle: f64) -> f64 {
        let (size, periods) = self.cogging;
        let ripple = if size == 0.0 { 0.0 } else { size * (periods * angle).sin() };
        self.torque_constant * current + ripple
    }
}

/// The battery: how its voltage falls, as a factor of the voltage it had when full.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    /// Loss of open-circuit voltage reached at `span` \[fraction\].
    pub loss: f64,
    /// Time over which `loss` is reached \[s\].
    pub span: f64,
    /// Shape of the discharge.
    pub shape: Discharge,
    /// Loss per ampere drawn \[fraction/A\], from the cells' own resistance.
    pub per_ampere: f64,
}

/// How the open-circuit voltage falls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Discharge {
    /// In proportion to time.
    Even,
    /// Quickly first, then ever slower, with the given time constant as a share of the span.
    Settling(f64),
    /// At once, at the given share of the span (a cell drops out).
    Step(f64),
}

impl Battery {
    /// A battery that never gives way.
    pub const STIFF: Battery = Battery { loss: 0.0, span: 1.0, shape: Discharge::Even, per_ampere: 0.0 };

    /// Voltage now over voltage when full, with `drawn` amperes flowing.
    pub fn factor(&self, t: f64, drawn: f64) -> f64 {
        let passed = t / self.span;
        let lost = match self.shape {
            Discharge::Even => passed,
            Discharge::Settling(share) => (1.0 - (-passed / share).exp()) / (1.0 - (-1.0 / share).exp()),
            Discharge::Step(at) => f64::from(u8::from(passed >= at)),
        };
        (1.0 - self.loss * lost - self.per_ampere * drawn.abs()).max(0.05)
    }
}
