//! An identified model for other tools: what they can use of it, under their own names, and nothing that was not identified.
//!
//! | format | for | needs |
//! |---|---|---|
//! | `wpilib` | the feed-forward of an FRC program: kS, kV, kA a side | a `wheel-voltage` model |
//! | `ros2` | `diff_drive_controller` of ros2_control, and the model under a node of its own | the robot's profile for the former |
//! | `python` | a class that simulates and inverts the model, without any package | a six-parameter model |

use std::fmt::Write;

use serde_json::{Map, Value, json};
use wheelwright_core::RegressorModel;
use wheelwright_core::profile::{Limits, RobotProfile};

use crate::error::Error;
use crate::model_file::ModelFile;

/// Formats by name.
pub const FORMATS: [&str; 3] = ["wpilib", "ros2", "python"];

/// A file for another tool.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Its customary name.
    pub name: &'static str,
    /// Its text.
    pub text: String,
    /// What the file does not say.
    pub warnings: Vec<String>,
}

/// Writes a model in a format.
///
/// # Errors
/// [`Error::Config`] for an unknown format, or a model that the format cannot hold.
pub fn export(file: &ModelFile, model: &dyn RegressorModel, format: &str) -> Result<Exported, Error> {
    let theta = file.theta(model).map_err(|e| Error::setting("parameter", e.to_string()))?;
    let named: Vec<(&str, f64)> = model.parameters().iter().map(|p| p.name.as_str()).zip(theta.iter().copied()).collect();
    let (name, text) = match format {
        "wpilib" => ("feedforward.json", wpilib(model, &named)?),
        "ros2" => ("wheelwright.yaml", ros2(model, &named, file.robot.as_ref())),
        "python" => ("robot_model.py", python(model, &theta)?),
        other => return Err(Error::Usage(format!("no format is named \"{other}\"; known: {}", FORMATS.join(", ")))),
    };
    let left_out: Vec<&str> = file.effect.iter().filter_map(|e| e.settings.get("type").and_then(toml::Value::as_str)).collect();
    let warnings = match left_out.is_empty() {
        true => Vec::new(),
        false => vec![format!("the file has no place for the effects {}; it holds the base model alone", left_out.join(", "))],
    };
    Ok(Exported { name, text, warnings })
}

fn unsuited(model: &dyn RegressorModel, format: &str, needs: &str) -> Error {
    Error::setting("model.type", format!("model `{}` cannot be written as {format}, which needs {needs}", model.name()))
}

/// kS \[V\], kV \[V s/m\] and kA \[V s²/m\] of each side, as SimpleMotorFeedforward takes them.
fn wpilib(model: &dyn RegressorModel, named: &[(&str, f64)]) -> Result<String, Error> {
    if model.name() != "wheel-voltage" {
        return Err(unsuited(model, "wpilib", "a model from voltages: identify with --model wheel-voltage"));
    }
    let mut sides = Map::new();
    for (name, value) in named {
        // kV_left and so on; a symmetrical model has one value for both sides.
        let (gain, side) = name.split_once('_').unwrap_or((name, "both"));
        let entry = sides.entry(side.to_owned()).or_insert_with(|| json!({}));
        entry[gain] = json!(value);
    }
    let document = json!({ "units": { "kS": "V", "kV": "V s/m", "kA": "V s^2/m" }, "sides": Value::Object(sides) });
    Ok(format!("{document:#}\n"))
}

/// Parameters of ros2_control's `diff_drive_controller` from the profile, and of the model.
fn ros2(model: &dyn RegressorModel, named: &[(&str, f64)], profile: Option<&RobotProfile>) -> String {
    let mut text = String::from("# Written by wheelwright.\n");
    // Writing to a String cannot fail.
    if let Some(profile) = profile {
        let _ = write!(
            text,
            "diff_drive_controller:\n  ros__parameters:\n    wheel_separation: {:?}  # m\n    wheel_radius: {:?}  # m\n",
            profile.track_width, profile.wheel_radius
        );
        let Limits { v, omega, v_dot, omega_dot, .. } = profile.limits;
        for (axis, speed, acceleration) in [("linear.x", v, v_dot), ("angular.z", omega, omega_dot)] {
            for (name, value) in [("velocity", speed), ("acceleration", acceleration)] {
                if let Some(value) = value {
                    let _ = write!(text, "    {axis}.max_{name}: {value:?}\n    {axis}.min_{name}: {:?}\n", -value);
                }
            }
        }
    }
    let _ = write!(text, "wheelwright_model:\n  ros__parameters:\n    model: \"{}\"\n", model.name());
    for (name, value) in named {
        let _ = writeln!(text, "    {name}: {value:?}");
    }
    text
}

/// A class with the model's accelerations and its inverse.
fn python(model: &dyn RegressorModel, theta: &[f64]) -> Result<String, Error> {
    if !matches!(model.name(), "vw-pd" | "wheel-pd") {
        return Err(unsuited(model, "python", "the six parameters of vw-pd or wheel-pd"));
    }
    let values: Vec<String> = theta.iter().map(|t| format!("{t:?}")).collect();
    Ok(format!(
        r#""""{name}, identified by wheelwright. SI units; angles counter-clockwise.

v_ref     = theta1 v' - theta3 omega^2 + theta4 v
omega_ref = theta2 omega' + theta5 v omega + theta6 omega
"""

from math import cos, sin

THETA = ({values})


def accelerations(v, omega, v_ref, omega_ref, theta=THETA):
    """v' [m/s^2] and omega' [rad/s^2] under a command."""
    t1, t2, t3, t4, t5, t6 = theta
    return (v_ref + t3 * omega**2 - t4 * v) / t1, (omega_ref - t5 * v * omega - t6 * omega) / t2


def command(v, omega, v_dot, omega_dot, theta=THETA):
    """The command (v_ref, omega_ref) that gives wanted accelerations."""
    t1, t2, t3, t4, t5, t6 = theta
    return t1 * v_dot - t3 * omega**2 + t4 * v, t2 * omega_dot + t5 * v * omega + t6 * omega


def step(state, v_ref, omega_ref, dt, theta=THETA):
    """The state (x, y, phi, v, omega) after `dt` [s] of a held command, by a fourth-order Runge-Kutta step."""

    def rate(s):
        return (s[3] * cos(s[2]), s[3] * sin(s[2]), s[4], *accelerations(s[3], s[4], v_ref, omega_ref, theta))

    def plus(k, h):
        return tuple(a + h * b for a, b in zip(state, k))

    k1 = rate(state)
    k2 = rate(plus(k1, dt / 2))
    k3 = rate(plus(k2, dt / 2))
    k4 = rate(plus(k3, dt))
    return tuple(a + dt / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(state, k1, k2, k3, k4))
"#,
        name = model.name(),
        values = values.join(", ")
    ))
}
