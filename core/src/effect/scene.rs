//! What an effect may know of a recording: its scales, where a robot was heading, how far its wheels had come.

use crate::channel::Channel;
use crate::dataset::{Dataset, Stretch};
use crate::model::RegressorModel;
use crate::simulation::Readout;

use super::{Frame, course};

/// Share of an output's root mean square below which it counts as none at the start of a stretch: noise of a few percent.
const STANDING: f64 = 0.1;

/// By how much a command may differ from the speed that it has settled at, as a share of that.
const SETTLED: f64 = 0.2;

/// Typical sizes in the recording that is diagnosed: search ranges and the width of a friction's kink are shares of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Scales {
    /// Root mean square of each input.
    pub inputs: Vec<f64>,
    /// Largest magnitude of each input.
    pub largest: Vec<f64>,
    /// Root mean square of each output.
    pub outputs: Vec<f64>,
    /// Root mean square of the wheels' commands, left and right together, in the unit of a wheel's command; of all inputs
    /// without wheels.
    pub command: f64,
    /// Largest magnitude of a wheel's command.
    pub largest_command: f64,
    /// Root mean square of the wheels' ground speeds, left and right together \[m/s\]; of all outputs without wheels.
    pub speed: f64,
    /// First and last time of the recording \[s\].
    pub time: (f64, f64),
    /// Median step between samples \[s\].
    pub period: f64,
}

/// The course of one stretch, for effects that act by place. From the record, not from the free run that they are part of: errors of
/// phase would otherwise grow with time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// Heading at each sample \[rad\].
    pub heading: Vec<f64>,
    /// Whether it was measured against something that stays; otherwise it counts from where the robot happened to stand when the stretch began,
    /// as one does that begins at exactly zero: an odometry's.
    pub headed: bool,
    /// Distance that each wheel had rolled at each sample \[m\]: left, right.
    pub distance: [Vec<f64>; 2],
    /// Where the robot was at each sample \[m\], from where the stretch began: forward speed along the heading.
    pub place: [Vec<f64>; 2],
    /// Whether the robot stood still when the stretch began: then nothing was commanded before.
    pub from_rest: bool,
}

/// A data set as effects see it.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// How channels are motion.
    pub frame: Frame,
    /// The model's input channels.
    pub inputs: Vec<Channel>,
    /// The model's output channels.
    pub outputs: Vec<Channel>,
    /// Radius of the wheels \[m\], if known.
    pub wheel_radius: Option<f64>,
    /// Typical sizes.
    pub scales: Scales,
    /// One track a stretch.
    pub tracks: Vec<Track>,
}

impl Scene {
    /// The scene of a data set. `headings` are measured ones, one vector a stretch; without them they are integrated from the
    /// measured angular velocity, from zero at each segment's start.
    pub fn new(
        data: &Dataset,
        model: &dyn RegressorModel,
        track_width: f64,
        wheel_radius: Option<f64>,
        headings: Option<&[Vec<f64>]>,
    ) -> Self {
        let frame = Frame::of(model, track_width);
        let scales = scales(data, frame);
        let (inputs, outputs) = (model.inputs().to_vec(), model.outputs().to_vec());
        let mut scene = Self { frame, inputs, outputs, wheel_radius, scales, tracks: Vec::new() };
        scene.tracks = scene.tracks_of(data, headings);
        scene
    }

    /// Another data set seen with this scene's scales, so that parameters mean the same: held-out data, another recording.
    #[must_use]
    pub fn like(&self, data: &Dataset, headings: Option<&[Vec<f64>]>) -> Self {
        Self { tracks: self.tracks_of(data, headings), ..self.clone() }
    }

    /// The same with the wheels' distances by the likeliest course that a model and the record tell together. `simulated` are the model's
    /// outputs, one vector an output in each stretch.
    #[must_use]
    pub fn followed(&self, data: &Dataset, simulated: &[Vec<Vec<f64>>]) -> Self {
        let mut scene = self.clone();
        if !self.frame.has_wheels() {
            return scene;
        }
        let speeds = |outputs: &[Vec<f64>], k: usize| self.frame.wheels(&[outputs[0][k], outputs[1][k]]);
        for side in [0, 1] {
            let rates = data.stretches.iter().zip(simulated).map(|(stretch, model)| {
                let foreseen: Vec<f64> = (0..stretch.len()).map(|k| speeds(model, k)[side]).collect();
                let misfit: Vec<f64> = (0..stretch.len()).map(|k| speeds(&stretch.outputs, k)[side] - foreseen[k]).collect();
                foreseen.iter().zip(course::level(&misfit)).map(|(foreseen, level)| foreseen + level).collect()
            });
            for (track, distance) in scene.tracks.iter_mut().zip(course::covered(&data.stretches, rates)) {
                track.distance[side] = distance;
            }
        }
        scene
    }

    fn tracks_of(&self, data: &Dataset, headings: Option<&[Vec<f64>]>) -> Vec<Track> {
        let still = |stretch: &Stretch| Track { from_rest: self.from_rest(stretch), ..Track::default() };
        let mut tracks: Vec<Track> = data.stretches.iter().map(still).collect();
        if !self.frame.has_wheels() {
            return tracks;
        }
        let covered = |rate: &dyn Fn(&[f64; 2]) -> f64| {
            let rates = data.stretches.iter().map(|s| (0..s.len()).map(|k| rate(&[s.outputs[0][k], s.outputs[1][k]])).collect());
            course::covered(&data.stretches, rates)
        };
        for (s, (track, turned)) in tracks.iter_mut().zip(covered(&|pair| self.frame.body(pair)[1])).enumerate() {
            let measured = headings.and_then(|h| h.get(s));
            track.headed = measured.and_then(|h| h.first()).is_some_and(|first| *first != 0.0);
            track.heading = measured.cloned().unwrap_or(turned);
        }
        let along = |s: &Stretch, track: &Track, part: fn(f64) -> f64| -> Vec<f64> {
            (0..s.len()).map(|k| self.frame.body(&[s.outputs[0][k], s.outputs[1][k]])[0] * part(track.heading[k])).collect()
        };
        for (axis, part) in [f64::cos, f64::sin].into_iter().enumerate() {
            let rates: Vec<Vec<f64>> = data.stretches.iter().zip(&tracks).map(|(s, track)| along(s, track, part)).collect();
            for (track, place) in tracks.iter_mut().zip(course::covered(&data.stretches, rates.into_iter())) {
                track.place[axis] = place;
            }
        }
        for side in [0, 1] {
            for (track, distance) in tracks.iter_mut().zip(covered(&|pair| self.frame.wheels(pair)[side])) {
                track.distance[side] = distance;
            }
        }
        tracks
    }

    /// Whether the robot stands still when a stretch begins, by its first outputs.
    pub fn from_rest(&self, stretch: &Stretch) -> bool {
        let slow = |(values, typical): (&Vec<f64>, &f64)| values.first().is_some_and(|first| first.abs() < STANDING * typical);
        stretch.outputs.iter().zip(&self.scales.outputs).all(slow)
    }
}

fn scales(data: &Dataset, frame: Frame) -> Scales {
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        let (n, sum) = values.fold((0_usize, 0.0), |(n, s), x| (n + 1, s + x * x));
        let rms = (sum / n.max(1) as f64).sqrt();
        if rms > 0.0 { rms } else { 1.0 }
    };
    let of = |pick: fn(&Stretch) -> &Vec<Vec<f64>>, i: usize| data.stretches.iter().flat_map(move |s| pick(s)[i].iter().copied());
    let wheels = |pick: fn(&Stretch) -> &Vec<Vec<f64>>| -> Vec<f64> {
        let columns = data.stretches.iter().map(pick);
        if frame.has_wheels() {
            columns.flat_map(|c| c[0].iter().zip(&c[1]).flat_map(|(a, b)| frame.wheels(&[*a, *b]))).collect()
        } else {
            columns.flat_map(|c| c.iter().flatten().copied()).collect()
        }
    };
    let commands = wheels(|s| &s.inputs);
    let largest = |i: usize| of(|s| &s.inputs, i).fold(0.0_f64, |m, x| m.max(x.abs()));
    let first = data.stretches.iter().map(|s| s.time[0]).fold(f64::INFINITY, f64::min);
    let last = data.stretches.iter().map(|s| s.time[s.len() - 1]).fold(f64::NEG_INFINITY, f64::max);
    Scales {
        inputs: (0..data.inputs.len()).map(|i| rms(&mut of(|s| &s.inputs, i))).collect(),
        largest: (0..data.inputs.len()).map(largest).collect(),
        outputs: (0..data.outputs.len()).map(|i| rms(&mut of(|s| &s.outputs, i))).collect(),
        command: rms(&mut commands.iter().copied()),
        largest_command: commands.iter().fold(0.0, |m, x| x.abs().max(m)),
        speed: rms(&mut wheels(|s| &s.outputs).into_iter()),
        time: (first, last),
        period: data.period(),
    }
}

/// One instant of a simulation, with the sub-step that leads to it.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a> {
    /// Time \[s\], on the recording's clock.
    pub time: f64,
    /// Time that passes up to now in this call \[s\]; zero where a state is only looked at.
    pub span: f64,
    /// Length of the step that is being taken \[s\]: zero where none is. An effect behind the plugin boundary is told twice the span, or the sampling period
    /// where that is zero.
    pub step: f64,
    /// Row of the stretch whose command is held.
    pub row: usize,
    /// The stretch.
    pub stretch: &'a Stretch,
    /// Its course.
    pub track: &'a Track,
    /// The scene.
    pub scene: &'a Scene,
    /// How the outputs are read that sensors see.
    pub readout: Readout,
}

impl<'a> Instant<'a> {
    /// The instant of a sample, in which no time passes.
    pub fn of_sample(stretch: &'a Stretch, row: usize, track: &'a Track, scene: &'a Scene, readout: Readout) -> Self {
        Self { time: stretch.time[row], span: 0.0, step: 0.0, row, stretch, track, scene, readout }
    }

    /// Time from the sample before this row to it \[s\]; zero at the first.
    pub fn interval(&self) -> f64 {
        match self.row.checked_sub(1) {
            Some(before) => self.stretch.time[self.row] - self.stretch.time[before],
            None => 0.0,
        }
    }

    /// The command of an input before the stretch began: none for a robot that stood still. In motion its first, as far as that may be what its
    /// speed has settled at: where speeds are commanded, and the first is another, it has just come.
    pub fn before(&self, input: usize) -> f64 {
        let Stretch { inputs, outputs, .. } = self.stretch;
        let first = inputs[input][0];
        match (self.scene.frame, outputs.get(input).and_then(|own| own.first())) {
            _ if self.track.from_rest => 0.0,
            (Frame::Body { .. }, Some(speed)) => {
                let near = SETTLED * speed.abs();
                speed + (first - speed).clamp(-near, near)
            }
            _ => first,
        }
    }

    /// The command of an input that was held at an earlier time.
    pub fn held(&self, time: f64, input: usize) -> f64 {
        if self.precedes(time) { self.before(input) } else { self.stretch.inputs[input][self.row_at(time)] }
    }

    /// The next time after an earlier one at which the command changed; that of the first command if it lies before the stretch.
    pub fn next_command(&self, time: f64) -> Option<f64> {
        if self.precedes(time) {
            return self.stretch.time.first().copied();
        }
        self.stretch.time.get(self.row_at(time) + 1).copied()
    }

    fn precedes(&self, time: f64) -> bool {
        self.stretch.time.first().is_some_and(|first| time < first - self.rounding())
    }

    /// A time that differs from a stamp by rounding is at the stamp: the step has just been cut there.
    fn rounding(&self) -> f64 {
        1e-9 * self.scene.scales.period
    }

    /// The row whose command is held at a time that is not later than now.
    pub fn row_at(&self, time: f64) -> usize {
        let stamps = &self.stretch.time;
        let tolerance = self.rounding();
        let mut row = self.row.min(stamps.len() - 1);
        while row > 0 && stamps[row] > time + tolerance {
            row -= 1;
        }
        row
    }

    /// Measured heading now \[rad\].
    pub fn heading(&self) -> f64 {
        self.between(&self.track.heading)
    }

    /// Measured distance that a wheel has rolled \[m\]: 0 left, 1 right.
    pub fn distance(&self, side: usize) -> f64 {
        self.between(&self.track.distance[side])
    }

    /// Place now, by the measured motion \[m\]. Behind the plugin boundary nobody tells it, and it is the origin.
    pub fn place(&self) -> [f64; 2] {
        self.track.place.each_ref().map(|of| self.between(of))
    }

    fn between(&self, values: &[f64]) -> f64 {
        let (Some(&a), time) = (values.get(self.row), &self.stretch.time) else { return 0.0 };
        match (values.get(self.row + 1), time.get(self.row + 1)) {
            (Some(&b), Some(&end)) => a + (b - a) * (self.time - time[self.row]) / (end - time[self.row]),
            _ => a,
        }
    }
}
