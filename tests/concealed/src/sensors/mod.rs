//! What the recording sees of a drive: where speeds are measured, how late, how coarsely, and when really.

pub mod noise;
pub mod trace;

use crate::plant::{LEFT, RIGHT};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use trace::Trace;

/// Where forward and turning speed come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// From the body itself: motion capture, radar, gyroscope.
    Body,
    /// From the wheels' encoders with the dimensions the firmware believes.
    Wheels,
}

/// How recorded times differ from the moments of measuring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lateness {
    /// Normally distributed.
    Normal,
    /// Mostly on time, now and then (one in eight) far off.
    Bursts,
}

/// The sensors of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Where the speeds come from.
    pub source: Source,
    /// Wheel radius believed \[m\].
    pub radius: f64,
    /// Half track believed \[m\].
    pub half_track: f64,
    /// Age of forward and turning speed when they are stamped \[s\].
    pub delay: [f64; 2],
    /// Path on the rim per encoder count \[m\]; zero: speeds are not made from counts.
    pub tick: f64,
    /// Rounding of forward \[m/s\] and turning speed \[rad/s\] in the message.
    pub rounding: [f64; 2],
    /// Standard deviation of the moment of measuring about its stamp \[s\].
    pub jitter: f64,
    /// How that moment scatters.
    pub lateness: Lateness,
    /// Largest forward and turning speed the sensor can show.
    pub range: [f64; 2],
    /// Slow bias of the turning speed: size \[rad/s\] and period \[s\].
    pub drift: (f64, f64),
    /// Off-centre encoder discs: share of the speed that ripples, once a turn.
    pub disc: f64,
}

/// The columns of one recording, without noise or with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    /// Forward speed \[m/s\].
    pub v: Vec<f64>,
    /// Turning speed \[rad/s\].
    pub omega: Vec<f64>,
    /// Wheel speeds, left and right \[rad/s\].
    pub wheel: [Vec<f64>; 2],
    /// Place \[m\] and heading \[rad\].
    pub pose: [Vec<f64>; 3],
}

impl Sensors {
    /// Ideal sensors on a body.
    pub fn ideal(source: Source, radius: f64, half_track: f64) -> Sensors {
        Sensors {
            source,
            radius,
            half_track,
            delay: [0.0; 2],
            tick: 0.0,
            rounding: [0.0; 2],
            jitter: 0.0,
            lateness: Lateness::Normal,
            range: [f64::INFINITY; 2],
            drift: (0.0, 1.0),
            disc: 0.0,
        }
    }

    /// What can be foreseen of the measurements at `stamps`: no jitter, no rounding, no noise.
    pub fn foreseen(&self, trace: &Trace, stamps: &[f64]) -> Columns {
        self.columns(trace, stamps, stamps, false)
    }

    /// What is measured at `stamps` before noise is added.
    pub fn measured<R: Rng>(&self, trace: &Trace, stamps: &[f64], rng: &mut R) -> Columns {
        if self.jitter == 0.0 {
            return self.columns(trace, stamps, stamps, true);
        }
        let moments: Vec<f64> = stamps
            .iter()
            .map(|t| {
                let off: f64 = StandardNormal.sample(rng);
                let scale = match self.lateness {
                    Lateness::Normal => 1.0,
                    Lateness::Bursts if rng.random::<f64>() < 0.125 => 8f64.sqrt(),
                    Lateness::Bursts => 0.0,
                };
                t + self.jitter * scale * off
            })
            .collect();
        self.columns(trace, stamps, &moments, true)
    }

    fn columns(&self, trace: &Trace, stamps: &[f64], moments: &[f64], coarse: bool) -> Columns {
        let mut out = Columns::default();
        for k in 0..stamps.len() {
            let [v, omega] = self.twist(trace, moments, k, coarse);
            let bias = self.drift.0 * (std::f64::consts::TAU * stamps[k] / self.drift.1).sin();
            out.v.push(self.shown(0, v, coarse));
            out.omega.push(self.shown(1, omega + bias, coarse));
            let here = trace.at(moments[k]);
            for i in [LEFT, RIGHT] {
                let speed = if self.tick > 0.0 { self.counted(trace, moments, k, i, coarse) } else { self.disc_speed(&here, i) };
                out.wheel[i].push(speed);
            }
            for (column, value) in out.pose.iter_mut().zip([here.pose.0, here.pose.1, here.pose.2]) {
                column.push(value);
            }
        }
        out
    }

    fn shown(&self, axis: usize, value: f64, coarse: bool) -> f64 {
        let held = value.clamp(-self.range[axis], self.range[axis]);
        let step = self.rounding[axis];
        if coarse && step > 0.0 { (held / step).round() * step } else { held }
    }

    fn twist(&self, trace: &Trace, moments: &[f64], k: usize, coarse: bool) -> [f64; 2] {
        if self.source == Source::Body {
            return [trace.at(moments[k] - self.delay[0]).twist[0], trace.at(moments[k] - self.delay[1]).twist[1]];
        }
        let of = |axis: usize| {
            let speed = |i: usize| {
                if self.tick > 0.0 {
                    self.counted(trace, moments, k, i, coarse)
                } else {
                    self.disc_speed(&trace.at(moments[k] - self.delay[axis]), i)
                }
            };
            let (left, right) = (self.radius * speed(LEFT), self.radius * speed(RIGHT));
            if axis == 0 { 0.5 * (left + right) } else { 0.5 * (right - left) / self.half_track }
        };
        [of(0), of(1)]
    }

    /// Wheel speed as an off-centre disc shows it.
    fn disc_speed(&self, here: &trace::Moment, i: usize) -> f64 {
        here.wheel[i] * (1.0 + if self.disc == 0.0 { 0.0 } else { self.disc * (here.angle[i] + i as f64).cos() })
    }

    /// Wheel speed from the counts since the last row.
    fn counted(&self, trace: &Trace, moments: &[f64], k: usize, i: usize, coarse: bool) -> f64 {
        let (now, before) =
            (moments[k], if k > 0 { moments[k - 1] } else { moments[k] - (moments[1.min(moments.len() - 1)] - moments[0]) });
        let tick = self.tick / self.radius;
        let count = |t: f64| if coarse { (trace.at(t).angle[i] / tick).floor() } else { trace.at(t).angle[i] / tick };
        let span = now - before;
        if span > 0.0 { tick * (count(now) - count(before)) / span } else { 0.0 }
    }
}
