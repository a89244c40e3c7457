//! Drives: how a robot is commanded, in four manners.

use super::{pick, sign};
use crate::firmware::Command;
use rand::Rng;
use std::f64::consts::TAU;

/// Manners of driving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manner {
    /// Reversals, stops, steps of all sizes, multisines.
    Rich,
    /// Sums of sines about forward driving with turning to one side (Laut 2011, chapter 4).
    Thesis,
    /// Steps and ramps, always forward, no wheel ever backward.
    OneDirectional,
    /// Loops of a lying eight.
    FigureEight,
}

/// All manners.
pub const MANNERS: [Manner; 4] = [Manner::Rich, Manner::Thesis, Manner::OneDirectional, Manner::FigureEight];

impl Manner {
    /// The word the key uses.
    pub fn word(self) -> &'static str {
        match self {
            Manner::Rich => "rich",
            Manner::Thesis => "thesis",
            Manner::OneDirectional => "one_directional",
            Manner::FigureEight => "figure_eight",
        }
    }

    /// Highest angular frequency with much in it \[rad/s\]; infinite where there are steps.
    pub fn bandwidth(self) -> f64 {
        match self {
            Manner::Rich | Manner::OneDirectional => f64::INFINITY,
            Manner::Thesis => 2.5,
            Manner::FigureEight => 4.0,
        }
    }

    /// Another manner, for validation.
    pub fn another<R: Rng>(self, rng: &mut R) -> Manner {
        let others: Vec<Manner> = MANNERS.iter().copied().filter(|m| *m != self).collect();
        *pick(rng, &others)
    }

    /// Draws commands at `stamps` for a robot with typical speeds `typical` and half track `half_track` \[m\].
    pub fn commands<R: Rng>(self, stamps: &[f64], typical: [f64; 2], half_track: f64, rng: &mut R) -> Vec<Command> {
        let start = stamps.first().copied().unwrap_or(0.0);
        let length = stamps.last().copied().unwrap_or(0.0) - start;
        let twists: Vec<[f64; 2]> = match self {
            Manner::Thesis => {
                let (speed, turn) = (Sines::draw(typical[0], 0.25, rng), Sines::draw(typical[1], 0.33, rng));
                stamps.iter().map(|t| [speed.at(t - start), turn.at(t - start)]).collect()
            }
            Manner::FigureEight => eights(stamps, typical, rng),
            Manner::Rich => pieces(stamps, length, rng, |rng| rich_piece(typical, rng)),
            Manner::OneDirectional => pieces(stamps, length, rng, |rng| forward_piece(typical, half_track, rng)),
        };
        stamps.iter().zip(twists).map(|(&t, [v, omega])| Command { t, v, omega }).collect()
    }
}

/// A mean and four sines, with the thesis' ratios of frequency.
struct Sines {
    mean: f64,
    parts: [(f64, f64, f64); 4],
}

impl Sines {
    fn draw<R: Rng>(mean: f64, depth: f64, rng: &mut R) -> Sines {
        let pace = rng.random_range(0.75..1.3);
        let depth = mean * depth * rng.random_range(0.8..1.3);
        let part = |ratio: f64, rng: &mut R| (depth, pace * ratio, rng.random_range(0.0..TAU));
        Sines { mean, parts: [part(2.0, rng), part(1.0, rng), part(1.0 / 3.0, rng), part(1.0 / 11.0, rng)] }
    }

    fn at(&self, t: f64) -> f64 {
        self.mean + self.parts.iter().map(|(size, pace, phase)| size * (pace * t + phase).sin()).sum::<f64>()
    }
}

/// One stretch of driving: `[v, omega]` at its begin and end and a wiggle on both.
struct Piece {
    length: f64,
    from: [f64; 2],
    to: [f64; 2],
    wiggle: [f64; 2],
    pace: f64,
}

fn pieces<R: Rng>(stamps: &[f64], length: f64, rng: &mut R, mut draw: impl FnMut(&mut R) -> Piece) -> Vec<[f64; 2]> {
    let start = stamps.first().copied().unwrap_or(0.0);
    let mut plan = Vec::new();
    let mut planned = 0.0;
    while planned <= length {
        let piece = draw(rng);
        planned += piece.length;
        plan.push((planned, piece));
    }
    let mut k = 0;
    stamps
        .iter()
        .map(|t| {
            let t = t - start;
            while k + 1 < plan.len() && t >= plan[k].0 {
                k += 1;
            }
            let (end, piece) = &plan[k];
            let part = ((t - (end - piece.length)) / piece.length).clamp(0.0, 1.0);
            let at = |i: usize, shift: f64| {
                piece.from[i] + part * (piece.to[i] - piece.from[i]) + piece.wiggle[i] * (piece.pace * t + shift).sin()
            };
            [at(0, 0.0), at(1, 1.0)]
        })
        .collect()
}

fn rich_piece<R: Rng>(typical: [f64; 2], rng: &mut R) -> Piece {
    let length = rng.random_range(0.8..4.0);
    let speed = |rng: &mut R| typical[0] * rng.random_range(-1.6..1.6);
    let turn = |rng: &mut R| typical[1] * rng.random_range(-1.8..1.8);
    let still = Piece { length, from: [0.0; 2], to: [0.0; 2], wiggle: [0.0; 2], pace: 1.0 };
    match rng.random_range(0..10) {
        0 => Piece { length: 0.5 * length, ..still },
        1 => {
            let spin = turn(rng);
            Piece { from: [0.0, spin], to: [0.0, spin], ..still }
        }
        2 | 3 => Piece { from: [speed(rng), turn(rng)], to: [speed(rng), turn(rng)], ..still },
        4 | 5 => {
            let (v, w) = (speed(rng), turn(rng));
            let wiggle = [typical[0] * rng.random_range(0.2..0.7), typical[1] * rng.random_range(0.2..0.8)];
            Piece { length: 1.5 * length, from: [0.5 * v, 0.5 * w], to: [0.5 * v, 0.5 * w], wiggle, pace: rng.random_range(2.0..9.0) }
        }
        _ => {
            let (v, w) = (speed(rng), turn(rng));
            Piece { from: [v, w], to: [v, w], ..still }
        }
    }
}

fn forward_piece<R: Rng>(typical: [f64; 2], half_track: f64, rng: &mut R) -> Piece {
    let target = |rng: &mut R| {
        let v = typical[0] * rng.random_range(0.4..1.6);
        let most = (0.6 * v / half_track).min(1.8 * typical[1].abs());
        [v, sign(rng) * most * rng.random_range(0.0..1.0)]
    };
    let from = target(rng);
    let to = if rng.random::<f64>() < 0.3 { target(rng) } else { from };
    Piece { length: rng.random_range(1.0..4.5), from, to, wiggle: [0.0; 2], pace: 1.0 }
}

/// Loops of a lying eight `(A/2 sin 2ft, A sin ft)`, each with a size and pace of its own.
fn eights<R: Rng>(stamps: &[f64], typical: [f64; 2], rng: &mut R) -> Vec<[f64; 2]> {
    let start = stamps.first().copied().unwrap_or(0.0);
    let mut began = 0.0;
    let draw = |rng: &mut R| {
        let pace = typical[1].abs() / 2.2 * rng.random_range(0.7..1.5);
        (pace, typical[0] / pace * rng.random_range(0.6..1.3), typical[1].signum())
    };
    let (mut pace, mut size, side) = draw(rng);
    let mut out = Vec::with_capacity(stamps.len());
    for t in stamps {
        let mut t = t - start - began;
        if t * pace >= TAU {
            began += TAU / pace;
            t -= TAU / pace;
            (pace, size, _) = draw(rng);
        }
        let (x1, y1) = (size * pace * (2.0 * pace * t).cos(), size * pace * (pace * t).cos());
        let (x2, y2) = (-2.0 * size * pace * pace * (2.0 * pace * t).sin(), -size * pace * pace * (pace * t).sin());
        out.push([x1.hypot(y1), side * (y2 * x1 - x2 * y1) / (x1 * x1 + y1 * y1)]);
    }
    out
}
