//! A wheel that is not round, or not round its axle: the recorded speed s of it gains s (A cos φ + B sin φ), φ = distance / r.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::Wheel;
use super::words::{digits, quantity};

/// A ripple of the recorded speed once a turn of the wheel, in proportion to speed.
///
/// The angle is that of the distance which the recording says the wheel has rolled, from zero at the start of each stretch: a
/// simulated distance would drift out of phase within a few turns. The radius is a parameter, for over fifty turns the phase needs it
/// to half a percent. Where a gap parts stretches, the wheel's angle behind it is not known, and one A and B serve them all: an
/// eccentricity is found best in one long stretch.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WheelEccentricity {
    /// One wheel only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<Wheel>,
}

impl WheelEccentricity {
    /// The wheels that ripple.
    fn wheels(&self) -> impl Iterator<Item = Wheel> + use<> {
        let only = self.wheel;
        [Wheel::Left, Wheel::Right].into_iter().filter(move |w| only.is_none_or(|only| only == *w))
    }
}

/// Most that a radius can differ from the robot's profile.
const RADIUS: f64 = 0.1;

#[typetag::serde(name = "wheel_eccentricity")]
impl Effect for WheelEccentricity {
    fn name(&self) -> &str {
        "wheel_eccentricity"
    }

    fn about(&self) -> String {
        "a wheel's recorded speed ripples once a turn".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Sensor
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        super::force::needs_wheels(scene).or_else(|| {
            scene.wheel_radius.is_none().then(|| "the wheels' radius is not known (`wheel_radius` in the robot's profile)".to_owned())
        })
    }

    /// A and B of each wheel, and the radius.
    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let amplitude =
            |name: &str, wheel: Wheel| EffectParameter::new(name, "1", (-0.5, 0.5), 0.02).neutral(0.0).of("wheel", wheel.word());
        let mut all: Vec<EffectParameter> = self.wheels().flat_map(|w| [amplitude("cosine", w), amplitude("sine", w)]).collect();
        let radius = scene.wheel_radius.unwrap_or(1.0);
        all.push(EffectParameter::new("radius", "m", ((1.0 - RADIUS) * radius, (1.0 + RADIUS) * radius), 0.002 * radius));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (n, known) = (2 * self.wheels().count(), scene.wheel_radius.unwrap_or(1.0));
        let at = |radius: f64| Start {
            values: std::iter::repeat_n(0.02, n).chain([radius]).collect(),
            columns: (0..n).map(|i| vec![i]).collect(),
            linear: true,
        };
        // Nearest to the known radius first.
        (0..17)
            .map(|i: i32| if i % 2 == 0 { i / 2 } else { -(i + 1) / 2 })
            .map(|step| at(known * (1.0 + 0.005 * f64::from(step))))
            .collect()
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let said = self.wheels().zip(values.chunks_exact(2)).map(|(wheel, pair)| {
            let size = pair[0].value.hypot(pair[1].value);
            format!("the {} wheel's speed ripples by {} % once a turn", wheel.word(), digits(100.0 * size))
        });
        let radius = values.last().map_or(String::new(), |r| format!(" at a radius of {}", quantity(*r, "m")));
        format!("{}{radius}; the model's wheels were round", said.collect::<Vec<_>>().join(", "))
    }

    fn excitation(&self) -> &'static str {
        "many turns of the wheels at a steady, not too high speed"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "timestamp_jitter",
                because: "at a sampling rate near the wheel's turning rate the ripple looks like scatter of the stamps",
            },
            Confusion { with: "slope", because: "on a circle whose length is a whole number of the wheel's turns both come once a round" },
        ]
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, _past: &dyn Fn(f64, &mut [f64]), _state: &mut [f64], outputs: &mut [f64]) {
        let (frame, Some((radius, amplitudes))) = (at.scene.frame, p.split_last()) else { return };
        let speeds = frame.wheels(outputs);
        let mut ripple = [0.0; 2];
        for (wheel, pair) in self.wheels().zip(amplitudes.chunks_exact(2)) {
            let side = wheel.index();
            let (sin, cos) = (at.distance(side) / radius).sin_cos();
            ripple[side] = speeds[side] * (pair[0] * cos + pair[1] * sin);
        }
        outputs.iter_mut().zip(frame.from_wheels(ripple)).for_each(|(x, d)| *x += d);
    }
}
