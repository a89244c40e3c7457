//! Play in the gears: while a wheel's drive crosses the gap nothing arrives at the wheel.
//!
//! The motor's side of the gap moves against the wheel's at a, the drive in terms of speed at the rim; z' = a while |z| < g/2. The
//! drive arrives where z is at the end towards which it pushes, and the wheel coasts in between. The teeth take up the drive over the last
//! tenth of the gap, in proportion, so that the moment of contact is no jump:
//!
//! τ = min(1, max(0, (2 z sgn a/g − 0.8)/0.2)),   z' = a (1 − τ),   the drive becomes τ a.
//!
//! Encoders mostly sit at the motors. Then the recorded speed is the wheel's and z' on top: the motor runs ahead while it crosses the gap.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;

use super::force;
use super::words::{quantity, scaled};

/// Backlash at both wheels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Backlash {
    /// Whether the recorded speeds are those of the motors, not of wheels or body. Default `false`.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub at_motor: bool,
}

/// Share of half the gap over which the teeth take up the drive.
const TEETH: f64 = 0.2;
/// Where in the state it says whether the middle of a step has been reached.
const MIDDLE: usize = 4;
/// Where in the state the motors' speeds against the wheels stand.
const AHEAD: usize = 5;
/// Where in the state the places in the gaps at the last sample stand.
const SAMPLED: usize = 7;
/// Gaps that are tried, as shares of half the track: 1 to 16 mm for a robot of 0.34 m.
const GAPS: [f64; 8] = [0.006, 0.012, 0.02, 0.03, 0.044, 0.06, 0.08, 0.1];

/// Metres at the rim for one unit of a wheel's drive and second.
fn speed_of_drive(scene: &Scene) -> f64 {
    match scene.frame {
        Frame::Body { .. } => 1.0,
        _ => scene.scales.speed / force::command(scene, 0),
    }
}

/// Share of a drive that arrives, at a place in the gap from −1 to 1 towards which it pushes.
fn taken_up(place: f64) -> f64 {
    ((place - (1.0 - TEETH)) / TEETH).clamp(0.0, 1.0)
}

/// The same on average over a time from that place on: what the gap does not take arrives.
fn taken_up_over(place: f64, rate: f64, span: f64) -> f64 {
    let whole = rate * span;
    if whole > 1e-9 { (1.0 - (across(place, rate, span) - place) / whole).clamp(0.0, 1.0) } else { taken_up(place) }
}

#[typetag::serde(name = "backlash")]
impl Effect for Backlash {
    fn name(&self) -> &str {
        "backlash"
    }

    fn about(&self) -> String {
        match self.at_motor {
            false => "play in the gears of both wheels".to_owned(),
            true => "play in the gears of both wheels, speeds recorded at the motors".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Drive
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let h = scene.frame.half_track();
        vec![EffectParameter::new("gap", "m", (0.0, 0.5 * h), 0.004 * h).neutral(0.0)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let h = scene.frame.half_track();
        GAPS.map(|gap| Start { values: vec![gap * h], columns: vec![vec![0]], linear: false }).into()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let play = quantity(scaled(values[0], |g| 1000.0 * g), "mm");
        let angle = scene.wheel_radius.map(|r| quantity(scaled(values[0], |g| (g / r).to_degrees()), "degrees"));
        let angle = angle.map_or_else(String::new, |a| format!(", {a} of the wheel"));
        format!("the gears have a play of {play} at the rim{angle}; the model had none")
    }

    fn excitation(&self) -> &'static str {
        "frequent changes between pushing and braking, best about standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "actuator_lag",
                because: "under smooth commands the time in the gap is a lag after each change of direction",
            },
            Confusion {
                with: "command_delay",
                because: "crossing the gap takes time, as a delay does; but only when the drive changes sign",
            },
            Confusion { with: "dead_zone", because: "about standstill either makes small commands without effect" },
        ]
    }

    /// Place in each wheel's gap, from −1 to 1; the places at the start of a step, and whether its middle has been reached; each motor's
    /// speed against its wheel; the places at the last sample.
    fn states(&self, _scene: &Scene) -> usize {
        9
    }

    /// The gap is closed in the direction of the first command.
    fn begin(&self, _p: &[f64], at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state.fill(0.0);
        let commands = at.scene.frame.wheels(inputs);
        state.iter_mut().zip(commands).for_each(|(place, u)| *place = if u == 0.0 { 0.0 } else { u.signum() });
        state.copy_within(0..2, SAMPLED);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, _motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        if p[0] <= 0.0 {
            return;
        }
        let (frame, rim) = (&at.scene.frame, speed_of_drive(at.scene));
        let mut drives = frame.wheels(drive);
        for (side, drive) in drives.iter_mut().enumerate() {
            let way = drive.signum();
            let rate = 2.0 * rim * drive.abs() / p[0];
            *drive *=
                if state[MIDDLE] == 0.0 { taken_up(state[side] * way) } else { taken_up_over(state[2 + side] * way, rate, 2.0 * at.span) };
        }
        drive.copy_from_slice(&frame.from_wheels(drives));
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], drive: &[f64], state: &mut [f64]) {
        if p[0] <= 0.0 {
            return;
        }
        // The whole step at the drive of its middle: of second order, as the motion is.
        let (from, span) = if state[MIDDLE] == 0.0 { (0, at.span) } else { (2, 2.0 * at.span) };
        let rim = speed_of_drive(at.scene);
        let drives = at.scene.frame.wheels(drive);
        for side in 0..2 {
            let (start, way) = (state[from + side], drives[side].signum());
            state[2 + side] = start;
            state[side] = way * across(start * way, 2.0 * rim * drives[side].abs() / p[0], span);
            state[AHEAD + side] = rim * drives[side] * (1.0 - taken_up(state[side] * way));
        }
        state[MIDDLE] = 1.0 - state[MIDDLE];
    }

    fn senses(&self) -> bool {
        self.at_motor
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let interval = at.interval();
        let ahead = [0, 1].map(|side| match at.readout {
            Readout::IntervalMean if interval > 0.0 => 0.5 * p[0] * (state[side] - state[SAMPLED + side]) / interval,
            _ => state[AHEAD + side],
        });
        state.copy_within(0..2, SAMPLED);
        outputs.iter_mut().zip(at.scene.frame.from_wheels(ahead)).for_each(|(x, d)| *x += d);
    }
}

/// Where the drive's side of a gap is after a time at a rate: straight up to the teeth, then against what they take up.
fn across(place: f64, rate: f64, span: f64) -> f64 {
    let free = (1.0 - TEETH - place).max(0.0);
    if rate * span <= free {
        return place + rate * span;
    }
    let rest = (rate * span - free) / TEETH;
    let to_go = (1.0 - place).min(TEETH);
    1.0 - to_go * (-rest).exp()
}
