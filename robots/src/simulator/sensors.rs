//! What the robot reports: encoders, velocities and a pose, each as exact or as coarse as configured.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use wheelwright_core::channel::{self, Channel};

use super::noise::{Noise, Source, stream};
use super::physics::sensing::Observed;
use super::plant::{PlantConstants, Sides};

/// Number of measured channels.
pub(super) const CHANNELS: usize = 7;

/// Measured channels, in order.
pub static OUTPUTS: [Channel; CHANNELS] =
    [channel::V, channel::OMEGA, channel::X, channel::Y, channel::PHI, channel::OMEGA_LEFT, channel::OMEGA_RIGHT];

/// How the robot measures. The default is exact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Where velocities come from.
    pub velocity: VelocitySource,
    /// Where the pose comes from.
    pub pose: PoseSource,
    /// Encoder counts a wheel revolution; exact angles without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ticks_per_revolution: Option<f64>,
    /// Standard deviation of each wheel's speed \[rad/s\].
    pub wheel_noise: f64,
    /// Standard deviation added to v \[m/s\].
    pub v_noise: f64,
    /// Standard deviation added to omega \[rad/s\].
    pub omega_noise: f64,
    /// Correlation of each noise with itself one period before, in \[0, 1).
    pub noise_correlation: f64,
    /// v is rounded to multiples of this \[m/s\]; 0 for none.
    pub v_resolution: f64,
    /// omega is rounded to multiples of this \[rad/s\]; 0 for none.
    pub omega_resolution: f64,
}

impl Default for Sensors {
    fn default() -> Self {
        Self {
            velocity: VelocitySource::Instantaneous,
            pose: PoseSource::Exact,
            ticks_per_revolution: None,
            wheel_noise: 0.0,
            v_noise: 0.0,
            omega_noise: 0.0,
            noise_correlation: 0.0,
            v_resolution: 0.0,
            omega_resolution: 0.0,
        }
    }
}

/// Where velocities come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocitySource {
    /// The wheels' speeds at the moment of the measurement.
    Instantaneous,
    /// Encoder differences over the period: the mean speed since the last measurement, zero at the first.
    EncoderDifference,
}

/// Where the pose comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSource {
    /// The true pose.
    Exact,
    /// Dead reckoning from the encoders once a period.
    Odometry,
}

/// The sensors at work.
#[derive(Debug, Clone)]
pub(super) struct Sensing {
    settings: Sensors,
    track_width: f64,
    wheel_radius: f64,
    noise: [Noise; 4],
    /// Time and encoder angles of the last measurement.
    last: Option<(f64, Sides)>,
    odometry: Odometry,
}

impl Sensing {
    pub(super) fn new(settings: Sensors, constants: &PlantConstants, seed: u64) -> Self {
        let noise = |sigma, source| Noise::new(sigma, settings.noise_correlation, stream(seed, source));
        Self {
            settings,
            track_width: constants.track_width,
            wheel_radius: constants.wheel_radius,
            noise: [
                noise(settings.wheel_noise, Source::LeftWheel),
                noise(settings.wheel_noise, Source::RightWheel),
                noise(settings.v_noise, Source::V),
                noise(settings.omega_noise, Source::Omega),
            ],
            last: None,
            odometry: Odometry::default(),
        }
    }

    /// Measures what is there at `time`, in the order of [`OUTPUTS`].
    pub(super) fn measure(&mut self, time: f64, seen: &Observed) -> [f64; CHANNELS] {
        let angles = seen.angles.map(|angle| self.encoder(angle));
        let moved = self.last.map(|(before, last)| (time - before, turned(angles, last)));
        if let Some((_, turned)) = moved {
            self.odometry.advance(turned.to_body(self.track_width, self.wheel_radius));
        }
        self.last = Some((time, angles));
        let speeds = match (self.settings.velocity, moved) {
            (VelocitySource::Instantaneous, _) => seen.speeds,
            (VelocitySource::EncoderDifference, Some((elapsed, turned))) if elapsed > 0.0 => turned.map(|angle| angle / elapsed),
            (VelocitySource::EncoderDifference, _) => Sides::default(),
        };
        let [left_noise, right_noise, v_noise, omega_noise] = self.noise.each_mut().map(Noise::next);
        let speeds = Sides { left: speeds.left + left_noise, right: speeds.right + right_noise };
        let [v, omega] = speeds.to_body(self.track_width, self.wheel_radius);
        let [x, y, phi] = match self.settings.pose {
            PoseSource::Exact => seen.pose,
            PoseSource::Odometry => [self.odometry.x, self.odometry.y, self.odometry.phi],
        };
        [
            round(v + v_noise, self.settings.v_resolution),
            round(omega + omega_noise, self.settings.omega_resolution),
            x,
            y,
            phi,
            speeds.left,
            speeds.right,
        ]
    }

    /// Angle that the encoder shows: whole counts.
    fn encoder(&self, angle: f64) -> f64 {
        self.settings.ticks_per_revolution.map_or(angle, |ticks| (angle / TAU * ticks).floor() * TAU / ticks)
    }
}

fn turned(now: Sides, before: Sides) -> Sides {
    Sides { left: now.left - before.left, right: now.right - before.right }
}

fn round(value: f64, resolution: f64) -> f64 {
    if resolution > 0.0 { (value / resolution).round() * resolution } else { value }
}

/// Dead reckoning: x += Δs cos(φ + Δφ/2), y += Δs sin(φ + Δφ/2), φ += Δφ, whose local error is Δs Δφ²/24.
#[derive(Debug, Clone, Copy, Default)]
struct Odometry {
    x: f64,
    y: f64,
    phi: f64,
}

impl Odometry {
    fn advance(&mut self, [path, turn]: [f64; 2]) {
        let (sin, cos) = (self.phi + 0.5 * turn).sin_cos();
        self.x += path * cos;
        self.y += path * sin;
        self.phi += turn;
    }
}
