//! `type = "simulator"`: a preset, everything in it overridable, or all constants.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};
use wheelwright_core::config::{self, ConfigError};
use wheelwright_core::profile::Limits;
use wheelwright_core::robot::{Robot, RobotConfig, RobotError};

use super::SimulatedRobot;
use super::control::ControlLaw;
use super::physics::Physics;
use super::plant::PlantConstants;
use super::sensors::Sensors;
use crate::profiles;

/// Constants and gains of known robots, by name.
const PRESETS: [(&str, &str); 2] =
    [("pioneer-3dx", include_str!("presets/pioneer-3dx.toml")), ("khepera-3", include_str!("presets/khepera-3.toml"))];

/// A period may take this many integration steps, which is some milliseconds.
const MOST_STEPS: f64 = 20_000.0;

/// No robot is commanded more seldom \[s\].
const LONGEST_PERIOD: f64 = 10.0;

/// A simulated robot as configured.
///
/// In TOML, `robot = "pioneer-3dx"` or `"khepera-3"` fills in a preset, of which every key can be overridden.
/// `fidelity = "ideal"` (default) has no limits and exact sensors; `"typical"` adds the preset's limits, encoders and
/// noise. Without `robot`, the period, the plant and the controller must be given. Serialized, the preset is written out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Table", into = "Settings")]
pub struct SimulatorConfig {
    /// The settings after presets and overrides.
    pub settings: Settings,
}

/// All settings of a simulated robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Control period \[s\].
    pub period: f64,
    /// Each period lasts `period` × (1 ± jitter), uniformly; stamps tell the true time.
    #[serde(default)]
    pub jitter: f64,
    /// A control period takes its time by the world's clock, as on a robot; without it, as little as the machine can.
    #[serde(default)]
    pub realtime: bool,
    /// Body, wheels and motors.
    pub plant: PlantConstants,
    /// Low-level controller.
    pub controller: ControlLaw,
    /// Limits inside the robot; none by default. `v_dot` and `omega_dot` are the firmware's ramp on the set point.
    #[serde(default, skip_serializing_if = "Limits::is_empty")]
    pub limits: Limits,
    /// Measurement; exact by default.
    #[serde(default)]
    pub sensors: Sensors,
    /// Physics beyond the rigid plant, each part by a table of its own; none by default.
    #[serde(default, skip_serializing_if = "Physics::is_none")]
    pub physics: Physics,
}

impl From<SimulatorConfig> for Settings {
    fn from(config: SimulatorConfig) -> Self {
        config.settings
    }
}

impl TryFrom<Table> for SimulatorConfig {
    type Error = ConfigError;

    fn try_from(mut given: Table) -> Result<Self, ConfigError> {
        let robot = take_text(&mut given, "robot")?;
        let typical = match take_text(&mut given, "fidelity")?.as_deref() {
            None | Some("ideal") => false,
            Some("typical") => true,
            Some(other) => return Err(ConfigError::new("fidelity", format!("must be \"ideal\" or \"typical\", not \"{other}\""))),
        };
        let settings = match robot {
            Some(robot) => {
                let mut table = preset(&robot, typical)?;
                overlay(&mut table, given);
                config::plain(table)?
            }
            None if typical => return Err(ConfigError::new("fidelity", "\"typical\" is a property of a preset: set `robot`")),
            None => config::plain(given).map_err(|mut e: ConfigError| {
                e.message.push_str("; robot = \"pioneer-3dx\" or \"khepera-3\" fills in a preset");
                e
            })?,
        };
        Ok(Self { settings })
    }
}

impl SimulatorConfig {
    /// The preset of that name with ideal sensors and no limits.
    ///
    /// # Errors
    /// [`ConfigError`] listing the presets there are.
    pub fn preset(robot: &str) -> Result<Self, ConfigError> {
        Self::try_from(Table::from_iter([("robot".to_owned(), Value::from(robot))]))
    }

    /// The robot, standing at the origin.
    ///
    /// # Errors
    /// [`RobotError::Config`] for a value that cannot be.
    pub fn build(&self, seed: u64) -> Result<SimulatedRobot, RobotError> {
        self.settings.check()?;
        let robot = SimulatedRobot::new(&self.settings, seed);
        check_effort(&self.settings, robot.step_length())?;
        Ok(robot)
    }
}

#[typetag::serde(name = "simulator")]
impl RobotConfig for SimulatorConfig {
    fn about(&self) -> String {
        "differential drive from first principles: body, motors, wheels, low-level controller, encoders".to_owned()
    }

    fn connect(&self, seed: u64) -> Result<Box<dyn Robot>, RobotError> {
        Ok(Box::new(self.build(seed)?))
    }
}

impl Settings {
    /// Every value must be possible.
    ///
    /// # Errors
    /// [`RobotError::Config`] with the key.
    pub fn check(&self) -> Result<(), RobotError> {
        let (p, s) = (&self.plant, &self.sensors);
        let positive = [
            ("period", self.period),
            ("plant.mass", p.mass),
            ("plant.yaw_inertia", p.yaw_inertia),
            ("plant.track_width", p.track_width),
            ("plant.wheel_radius", p.wheel_radius),
            ("plant.tyre_radius", p.tyre_radius.unwrap_or(1.0)),
            ("plant.resistance", p.resistance),
            ("plant.torque_constant", p.torque_constant),
            ("plant.supply_voltage", p.supply_voltage.unwrap_or(1.0)),
            ("sensors.ticks_per_revolution", s.ticks_per_revolution.unwrap_or(1.0)),
        ];
        let not_negative = [
            ("plant.emf_constant", p.emf_constant),
            ("plant.wheel_inertia", p.wheel_inertia),
            ("plant.wheel_friction", p.wheel_friction),
            ("sensors.wheel_noise", s.wheel_noise),
            ("sensors.v_noise", s.v_noise),
            ("sensors.omega_noise", s.omega_noise),
            ("sensors.v_resolution", s.v_resolution),
            ("sensors.omega_resolution", s.omega_resolution),
        ];
        for (key, value) in positive {
            require(key, value, value > 0.0, "a positive number")?;
        }
        require("period", self.period, self.period <= LONGEST_PERIOD, "at most 10 (it is in seconds)")?;
        for (key, value) in not_negative {
            require(key, value, value >= 0.0, "zero or a positive number")?;
        }
        for (key, value, needed) in self.controller.gains() {
            require(
                key,
                value,
                value > 0.0 || (!needed && value == 0.0),
                if needed { "a positive number" } else { "zero or a positive number" },
            )?;
        }
        require("plant.com_offset", p.com_offset, true, "a finite number")?;
        for (key, value) in [("jitter", self.jitter), ("sensors.noise_correlation", s.noise_correlation)] {
            require(key, value, (0.0..1.0).contains(&value), "at least 0 and below 1")?;
        }
        self.physics.check()?;
        self.limits.check().map_err(|e| e.inside("limits")).map_err(|e| RobotError::Config { key: e.path, reason: e.message })
    }
}

/// Refuses a loop so fast that a period would take for ever to integrate.
fn check_effort(settings: &Settings, step: f64) -> Result<(), RobotError> {
    let steps = settings.period / step;
    if steps <= MOST_STEPS {
        return Ok(());
    }
    let reason = format!(
        "a period of {} s would take {steps:.0} integration steps, more than {MOST_STEPS}: the closed loop is too fast; lower the gains or \
         raise the inertias",
        settings.period
    );
    Err(RobotError::Config { key: "controller".to_owned(), reason })
}

fn require(key: &str, value: f64, holds: bool, what: &str) -> Result<(), RobotError> {
    if value.is_finite() && holds {
        return Ok(());
    }
    Err(RobotError::Config { key: key.to_owned(), reason: format!("must be {what}, not {value}") })
}

/// The preset's table; its `typical` part is laid over it or taken out, and the limits come from the robot's profile.
fn preset(name: &str, typical: bool) -> Result<Table, ConfigError> {
    let known = || PRESETS.iter().map(|(name, _)| (*name).to_owned()).collect::<Vec<_>>();
    let (_, text) = PRESETS
        .iter()
        .find(|(preset, _)| *preset == name)
        .ok_or_else(|| ConfigError::new("robot", config::unknown_name(name, &known())))?;
    let mut table: Table = text.parse().map_err(|e: toml::de::Error| ConfigError::new("robot", e.message()))?;
    let Some(Value::Table(extra)) = table.remove("typical") else { return Ok(table) };
    if typical {
        overlay(&mut table, extra);
        let limits = Table::try_from(profiles::built_in(name)?.limits).map_err(|e| ConfigError::new("limits", e.to_string()))?;
        table.insert("limits".to_owned(), Value::Table(limits));
    }
    Ok(table)
}

/// Lays `over` on `base`: tables key by key, anything else replaced. A controller of another kind replaces the whole.
fn overlay(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) if key != "controller" || above.keys().all(|k| below.contains_key(k)) => {
                overlay(below, above);
            }
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

fn take_text(table: &mut Table, key: &str) -> Result<Option<String>, ConfigError> {
    match table.remove(key) {
        None => Ok(None),
        Some(Value::String(text)) => Ok(Some(text)),
        Some(other) => Err(ConfigError::new(key, format!("must be a text, not {other}"))),
    }
}
