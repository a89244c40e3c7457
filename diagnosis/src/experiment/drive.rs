//! Drives as segments of pieces, from rest to rest, rendered within a robot's limits.

use rand::Rng;
use rand::rngs::StdRng;
use wheelwright_core::effect::{Frame, Scene};
use wheelwright_core::profile::Limits;
use wheelwright_core::{RegressorModel, Stretch};

/// Length of a segment \[s\].
const SEGMENT: f64 = 8.0;
/// Time at rest at its end \[s\].
const REST: f64 = 1.0;
/// Shortest and longest piece \[s\].
const PIECE: (f64, f64) = (0.5, 3.0);

/// What may be commanded.
pub(super) struct Envelope {
    /// Largest magnitude of each input.
    largest: Vec<f64>,
    /// Largest change per second of each input; infinite without a limit.
    fastest: Vec<f64>,
    /// Largest ground speed of a wheel \[m/s\]; infinite without a limit.
    wheel: f64,
    frame: Frame,
    period: f64,
    /// Time of the first row: after the recording, for effects that go with the clock.
    start: f64,
    outputs: usize,
}

impl Envelope {
    /// The robot's limits; where it has none, what was commanded in the recording.
    pub(super) fn of(model: &dyn RegressorModel, scene: &Scene, limits: &Limits) -> Self {
        let body = matches!(scene.frame, Frame::Body { .. });
        let known = |i: usize, of: [Option<f64>; 2]| if body { of.get(i).copied().flatten() } else { None };
        let inputs = model.inputs().len();
        let largest = (0..inputs).map(|i| known(i, [limits.v, limits.omega]).unwrap_or(f64::INFINITY).min(recorded(scene, i))).collect();
        let fastest = (0..inputs).map(|i| known(i, [limits.v_dot, limits.omega_dot]).unwrap_or(f64::INFINITY)).collect();
        let wheel = match (body, limits.wheel_speed, scene.wheel_radius) {
            (true, Some(speed), Some(radius)) => speed * radius,
            _ => f64::INFINITY,
        };
        Self {
            largest,
            fastest,
            wheel,
            frame: scene.frame,
            period: scene.scales.period,
            start: scene.scales.time.1 + 1.0,
            outputs: model.outputs().len(),
        }
    }

    /// Keeps wheels and rates within their limits.
    fn clamp(&self, inputs: &mut [Vec<f64>]) {
        let rows = inputs.first().map_or(0, Vec::len);
        for k in 0..rows {
            if self.wheel.is_finite() {
                let pair = [inputs[0][k], inputs[1][k]];
                let fastest = self.frame.wheels(&pair).iter().fold(0.0_f64, |m, s| m.max(s.abs()));
                let scale = (self.wheel / fastest).min(1.0);
                inputs[0][k] *= scale;
                inputs[1][k] *= scale;
            }
            for (series, fastest) in inputs.iter_mut().zip(&self.fastest) {
                let before = if k == 0 { 0.0 } else { series[k - 1] };
                let most = fastest * self.period;
                series[k] = series[k].clamp(before - most, before + most);
            }
        }
    }
}

/// The largest command of a recording: a drive no harder than one that went well.
fn recorded(scene: &Scene, input: usize) -> f64 {
    let largest = scene.scales.largest[input];
    if largest > 0.0 { largest } else { 1.0 }
}

/// What one input does during a piece; levels are shares of its largest magnitude.
#[derive(Debug, Clone, Copy)]
enum Wave {
    Hold(f64),
    Ramp(f64, f64),
    Square(f64, f64),
    Sine(f64, f64),
}

impl Wave {
    fn random(random: &mut StdRng) -> Self {
        let level = |random: &mut StdRng| random.random_range(-1.0..1.0);
        match random.random_range(0..8) {
            0 => Self::Hold(0.0),
            1 => Self::Hold(if random.random_bool(0.5) { 1.0 } else { -1.0 }),
            2 => Self::Hold(0.1 * level(random)),
            3 | 4 => Self::Hold(level(random)),
            5 => Self::Ramp(level(random), level(random)),
            6 => Self::Square(level(random), random.random_range(0.3..1.5)),
            _ => Self::Sine(level(random), random.random_range(0.3..3.0)),
        }
    }

    /// Value at a time since the piece's start, of a piece of some length.
    fn at(self, t: f64, length: f64) -> f64 {
        match self {
            Self::Hold(level) => level,
            Self::Ramp(from, to) => from + (to - from) * t / length,
            Self::Square(level, period) => level * if (t / period).fract() < 0.5 { 1.0 } else { -1.0 },
            Self::Sine(level, hertz) => level * (std::f64::consts::TAU * hertz * t).sin(),
        }
    }
}

/// Pieces one after the other.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    pieces: Vec<(f64, Vec<Wave>)>,
}

impl Segment {
    pub(super) fn random(envelope: &Envelope, random: &mut StdRng) -> Self {
        let (mut pieces, mut left) = (Vec::new(), SEGMENT - REST);
        while left > PIECE.0 {
            let length = random.random_range(PIECE.0..PIECE.1).min(left);
            pieces.push((length, waves(envelope, random)));
            left -= length;
        }
        Self { pieces }
    }

    /// The same with one piece replaced.
    pub(super) fn varied(&self, envelope: &Envelope, random: &mut StdRng) -> Self {
        let mut segment = self.clone();
        if let Some(count) = std::num::NonZeroUsize::new(segment.pieces.len()) {
            segment.pieces[random.random_range(0..count.get())].1 = waves(envelope, random);
        }
        segment
    }
}

fn waves(envelope: &Envelope, random: &mut StdRng) -> Vec<Wave> {
    envelope.largest.iter().map(|_| Wave::random(random)).collect()
}

/// Commands of a drive of segments with a rest after each, at the recording's rate and within the limits.
pub(super) fn rendered<'d>(drive: impl IntoIterator<Item = &'d Segment>, envelope: &Envelope) -> Stretch {
    let period = envelope.period;
    let mut inputs: Vec<Vec<f64>> = vec![Vec::new(); envelope.largest.len()];
    let rest = (REST / period).ceil() as usize;
    for segment in drive {
        for (length, waves) in &segment.pieces {
            let rows = (length / period).round() as usize;
            for k in 0..rows {
                for ((series, wave), largest) in inputs.iter_mut().zip(waves).zip(&envelope.largest) {
                    series.push(wave.at(k as f64 * period, *length).clamp(-1.0, 1.0) * largest);
                }
            }
        }
        inputs.iter_mut().for_each(|series| series.extend(std::iter::repeat_n(0.0, rest)));
    }
    inputs.iter_mut().for_each(|series| series.push(0.0));
    envelope.clamp(&mut inputs);
    let rows = inputs.first().map_or(0, Vec::len);
    let time = (0..rows).map(|k| envelope.start + k as f64 * period).collect();
    Stretch { label: "experiment".to_owned(), time, inputs, outputs: vec![vec![0.0; rows]; envelope.outputs] }
}
