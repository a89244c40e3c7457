//! The battery: a voltage behind a resistance, which falls with the charge drawn, and the capacitor of the motor driver that both feed.

use serde::{Deserialize, Serialize};

use super::{FINITE, Flaw, NOT_NEGATIVE, POSITIVE, first_flaw};

/// A battery. Where the firmware commands duty cycles it believes in `nominal` volts, so what the motors get falls with the battery.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Battery {
    /// Voltage of the full battery without load \[V\].
    pub open_circuit: f64,
    /// Internal resistance \[Ω\].
    #[serde(default)]
    pub resistance: f64,
    /// Charge until it is empty \[A h\]; it never empties without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capacity: Option<f64>,
    /// Voltage of the empty battery without load \[V\]; nine tenths of the full one if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub empty: Option<f64>,
    /// Current of everything but the motors \[A\].
    #[serde(default)]
    pub idle: f64,
    /// Voltage that the firmware believes in \[V\]; it measures the battery and makes up for it if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal: Option<f64>,
    /// Charge drawn before the start \[A h\].
    #[serde(default)]
    pub drawn: f64,
}

/// Capacitance of the motor driver's supply \[F\], at least; with a small resistance it is larger, so that the bus is not stiff.
const CAPACITANCE: f64 = 5e-3;
/// Time constant of the bus, at least \[s\].
const FASTEST: f64 = 2e-3;

impl Battery {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[
            ("open_circuit", self.open_circuit, self.open_circuit > 0.0, POSITIVE),
            ("resistance", self.resistance, self.resistance >= 0.0, NOT_NEGATIVE),
            ("capacity", self.capacity.unwrap_or(1.0), self.capacity.unwrap_or(1.0) > 0.0, POSITIVE),
            ("empty", self.empty.unwrap_or(1.0), self.empty.unwrap_or(1.0) > 0.0, POSITIVE),
            ("idle", self.idle, self.idle >= 0.0, NOT_NEGATIVE),
            ("nominal", self.nominal.unwrap_or(1.0), self.nominal.unwrap_or(1.0) > 0.0, POSITIVE),
            ("drawn", self.drawn, true, FINITE),
        ])
    }

    /// Voltage without load after a charge was drawn \[A s\].
    pub fn open_voltage(&self, charge: f64) -> f64 {
        let Some(capacity) = self.capacity else { return self.open_circuit };
        let empty = self.empty.unwrap_or(0.9 * self.open_circuit);
        let share = ((charge / 3600.0 + self.drawn) / capacity).clamp(0.0, 1.0);
        self.open_circuit + share * (empty - self.open_circuit)
    }

    fn capacitance(&self) -> f64 {
        if self.resistance > 0.0 { CAPACITANCE.max(FASTEST / self.resistance) } else { CAPACITANCE }
    }

    /// Change of the bus voltage \[V/s\] and of the charge drawn \[A\] when the motors take `power` \[W\].
    pub(super) fn rates(&self, bus: f64, charge: f64, power: f64) -> (f64, f64) {
        let open = self.open_voltage(charge);
        // A motor that brakes hands power back; the battery takes it.
        let load = self.idle + power / bus.max(0.1 * self.open_circuit);
        if self.resistance == 0.0 {
            return ((open - bus) / FASTEST, load);
        }
        let supplied = (open - bus) / self.resistance;
        ((supplied - load) / self.capacitance(), supplied)
    }

    /// What the driver makes of a voltage that the firmware asks for: the factor, and the most it can give \[V\].
    pub(super) fn driver(&self, bus: f64) -> (f64, f64) {
        (self.nominal.map_or(1.0, |nominal| bus / nominal), bus)
    }

    /// Fastest rate of the part \[1/s\].
    pub(super) fn rate(&self) -> f64 {
        1.0 / FASTEST
    }
}
