//! Are the estimates as good as the data allow, and do their intervals cover? Recordings of robots whose parameters are
//! known, with several kinds of noise and sampling, over many seeds:
//!
//! ```text
//! cargo run --release --example calibration -- [SEEDS] [VARIANT or SOLVER or ways...]
//! ```
//!
//! prints for every variant and solver the root mean square error of each parameter over its Cramér-Rao bound, the share
//! of 95 % intervals that cover the truth, and the bias in units of the bound; then, for `ways`, the coverage and width of other
//! ways to an interval. The robots are integrated by classical Runge-Kutta with short steps, those with dry friction by Moreau's
//! implicit time stepping, which share nothing with the simulator of the solvers. Seeds run in parallel; results are gathered in
//! their order, so the bytes printed do not depend on the number of threads.

mod intervals;

use std::error::Error;

use nalgebra::DMatrix;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use rayon::prelude::*;
use wheelwright_core::model::{ModelError, RegressorModel};
use wheelwright_core::simulation::{DIFFERENCE, Direction, Readout, Simulator};
use wheelwright_core::solver::{Problem, Solver, Status};
use wheelwright_core::{Dataset, ModelConfig, Stretch};
use wheelwright_models::{VwPdConfig, WheelVoltageConfig};
use wheelwright_solvers::{InstrumentalVariables, NoiseModel, Ols, OutputError, Recursive, Thesis, Velocity};

use intervals::{Plain, WAYS};

type Theta = [f64; 6];

/// "B0": the thesis' simulated robot (Laut 2011, section 4.2) under the excitation of its Pioneer.
const B0: Theta = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
const B0_NOISE: [f64; 2] = [0.005, 0.005];
/// The identified Khepera III (section 4.3), with 3 mm/s of noise on each wheel, 89 mm apart.
const KHEPERA: Theta = [0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981];
const KHEPERA_NOISE: [f64; 2] = [0.003 / std::f64::consts::SQRT_2, 0.003 * std::f64::consts::SQRT_2 / 0.089];
/// kV, kA and kS of the left and the right side of a robot driven by voltages, with noise in m/s.
const WHEELS: Theta = [2.5, 0.4, 0.3, 2.6, 0.45, 0.25];
/// Step of a wheel with friction \[s\]: the error of its speed is of this order, far below the noise.
const FINE: f64 = 2e-5;
/// Track width \[m\] and travel of a wheel between two encoder counts \[m\] in the variant with encoders: at 20 Hz a count
/// is 4 mm/s of wheel speed.
const ENCODER: [f64; 2] = [0.34, 0.2e-3];

#[derive(Clone, Copy, PartialEq)]
enum Noise {
    White,
    /// AR(1) with this coefficient and the same variance.
    Autoregressive(f64),
    /// Velocities from differences of wheel encoder counts, no other noise.
    Encoder,
}

#[derive(Clone, Copy, PartialEq)]
enum Robot {
    Pioneer,
    Khepera,
    /// Driven by voltages, with dry friction.
    Wheels,
}

#[derive(Clone, Copy)]
struct Variant {
    name: &'static str,
    robot: Robot,
    theta: Theta,
    deviation: [f64; 2],
    period: f64,
    duration: f64,
    /// Each stamp is off its even place by up to this share of the period; commands change at the stamps.
    jitter: f64,
    noise: Noise,
}

const VARIANTS: [Variant; 10] = [
    Variant {
        name: "white",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.05,
        duration: 150.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "short",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.05,
        duration: 30.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "ar1",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.05,
        duration: 150.0,
        jitter: 0.0,
        noise: Noise::Autoregressive(0.7),
    },
    Variant {
        name: "10hz",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.1,
        duration: 150.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "3.3hz",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.3,
        duration: 150.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "jitter",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.05,
        duration: 150.0,
        jitter: 0.3,
        noise: Noise::White,
    },
    // Without a little jitter every seed would round the same distances, shifted by one random number a wheel.
    Variant {
        name: "encoder",
        robot: Robot::Pioneer,
        theta: B0,
        deviation: B0_NOISE,
        period: 0.05,
        duration: 150.0,
        jitter: 0.02,
        noise: Noise::Encoder,
    },
    Variant {
        name: "khepera",
        robot: Robot::Khepera,
        theta: KHEPERA,
        deviation: KHEPERA_NOISE,
        period: 0.02,
        duration: 120.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "friction",
        robot: Robot::Wheels,
        theta: WHEELS,
        deviation: [0.01; 2],
        period: 0.02,
        duration: 40.0,
        jitter: 0.0,
        noise: Noise::White,
    },
    Variant {
        name: "friction-noisy",
        robot: Robot::Wheels,
        theta: WHEELS,
        deviation: [0.1; 2],
        period: 0.02,
        duration: 40.0,
        jitter: 0.0,
        noise: Noise::White,
    },
];

/// What may be asked for by name besides a variant.
const SOLVERS: [&str; 6] = ["output-error", "recursive", "iv", "ols", "thesis", "ways"];

impl Variant {
    fn model(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        match self.robot {
            Robot::Pioneer | Robot::Khepera => VwPdConfig::default().build(),
            Robot::Wheels => WheelVoltageConfig::default().build(),
        }
    }

    fn command(&self, t: f64) -> [f64; 2] {
        let sines = |rates: &[f64]| rates.iter().map(|r| (r * t).sin()).sum::<f64>();
        let forward = sines(&[2.0, 1.0, 1.0 / 3.0, 1.0 / 11.0]);
        match self.robot {
            Robot::Pioneer => [0.4 + 0.1 * forward, 0.75 + 0.25 * sines(&[1.5, 1.0, 0.5, 0.2])],
            Robot::Khepera => [0.1 + 0.05 * forward, 1.5 + 0.5 * sines(&[1.5, 1.0]) + 0.25 * sines(&[0.5, 0.2])],
            Robot::Wheels => [4.0 * (1.3 * t).sin() + 1.0, 4.0 * (0.9 * t).sin() - 1.0],
        }
    }

    fn drive(&self, time: &[f64]) -> Vec<[f64; 4]> {
        if self.robot == Robot::Wheels { self.roll(time) } else { self.track(time) }
    }

    /// Wheels' speeds at the stamps, from rest, under voltages held between them: friction brings each small step as near to rest as
    /// it can.
    fn roll(&self, time: &[f64]) -> Vec<[f64; 4]> {
        let mut x = [0.0; 4];
        let mut states = vec![x];
        for k in 1..time.len() {
            let u = self.command(time[k - 1]);
            let parts = ((time[k] - time[k - 1]) / FINE).ceil();
            let h = (time[k] - time[k - 1]) / parts;
            for (i, p) in self.theta.chunks_exact(3).enumerate() {
                for _ in 0..parts as usize {
                    let free = x[i] + h / p[1] * (u[i] - p[0] * x[i]);
                    x[i] = free - free.clamp(-h * p[2] / p[1], h * p[2] / p[1]);
                }
            }
            states.push(x);
        }
        states
    }

    fn stamps(&self, random: &mut StdRng) -> Vec<f64> {
        let rows = (self.duration / self.period).round() as usize;
        (0..rows)
            .map(|k| self.period * (k as f64 + if self.jitter > 0.0 { random.random_range(-self.jitter..self.jitter) } else { 0.0 }))
            .collect()
    }

    /// v, omega, distance and heading at the stamps, from rest, under commands held between them.
    fn track(&self, time: &[f64]) -> Vec<[f64; 4]> {
        let th = self.theta;
        let rate = |x: [f64; 4], u: [f64; 2]| {
            [(u[0] + th[2] * x[1] * x[1] - th[3] * x[0]) / th[0], (u[1] - th[4] * x[0] * x[1] - th[5] * x[1]) / th[1], x[0], x[1]]
        };
        // A twentieth of the shortest lag: the error of a step is below 1e-9.
        let longest = th[0].min(th[1]) / 20.0;
        let mut x = [0.0; 4];
        let mut states = vec![x];
        for k in 1..time.len() {
            let u = self.command(time[k - 1]);
            let parts = ((time[k] - time[k - 1]) / longest).ceil();
            let h = (time[k] - time[k - 1]) / parts;
            for _ in 0..parts as usize {
                let at = |d: [f64; 4], f: f64| std::array::from_fn(|i| x[i] + f * d[i]);
                let k1 = rate(x, u);
                let k2 = rate(at(k1, h / 2.0), u);
                let k3 = rate(at(k2, h / 2.0), u);
                let k4 = rate(at(k3, h), u);
                x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            }
            states.push(x);
        }
        states
    }

    fn recording(&self, seed: u64) -> Stretch {
        let mut random = StdRng::seed_from_u64(seed);
        let time = self.stamps(&mut random);
        let states = self.drive(&time);
        let inputs = (0..2).map(|i| time.iter().map(|t| self.command(*t)[i]).collect()).collect();
        let outputs = match self.noise {
            Noise::White => self.noisy(&states, 0.0, &mut random),
            Noise::Autoregressive(coefficient) => self.noisy(&states, coefficient, &mut random),
            Noise::Encoder => encoders(&states, &time, &mut random),
        };
        Stretch { label: "0".to_owned(), time, inputs, outputs }
    }

    fn noisy(&self, states: &[[f64; 4]], coefficient: f64, random: &mut StdRng) -> Vec<Vec<f64>> {
        let mut outputs = Vec::new();
        for channel in 0..2 {
            let innovation = self.deviation[channel] * (1.0 - coefficient * coefficient).sqrt();
            let mut error = self.deviation[channel] * random.sample::<f64, _>(StandardNormal);
            let mut values = Vec::with_capacity(states.len());
            for state in states {
                values.push(state[channel] + error);
                error = coefficient * error + innovation * random.sample::<f64, _>(StandardNormal);
            }
            outputs.push(values);
        }
        outputs
    }

    fn velocity(&self) -> Velocity {
        if self.noise == Noise::Encoder { Velocity::Difference } else { Velocity::Instantaneous }
    }

    fn readout(&self) -> Readout {
        if self.noise == Noise::Encoder { Readout::IntervalMean } else { Readout::Instantaneous }
    }

    /// Cramér-Rao bounds of the standard errors, the velocities at the start being unknown too; for encoders the bound of
    /// estimators linear in the counts, whose rounding errors are taken as independent.
    fn bounds(&self, model: &dyn RegressorModel, recording: &Stretch) -> Result<Theta, Box<dyn Error>> {
        let mut simulator =
            Simulator::new(model, &self.theta)?.with_readout(self.readout()).with_max_step(self.theta[0].min(self.theta[1]) / 20.0);
        let direction = |i: usize| Direction {
            along: (0..6).map(|k| f64::from(u8::from(k == i))).collect(),
            step: DIFFERENCE * self.theta[i].abs().max(0.01),
        };
        let found = simulator.sensitivities(recording, &[0.0, 0.0], &(0..6).map(direction).collect::<Vec<_>>())?;
        let rows = recording.len();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for column in found.parameters.iter().chain(&found.initial) {
            columns.push(match self.noise {
                Noise::White => (0..2).flat_map(|c| column[c].iter().map(move |s| s / self.deviation[c])).collect(),
                Noise::Autoregressive(a) => {
                    let white = |c: usize, k: usize| {
                        if k == 0 { column[c][0] } else { (column[c][k] - a * column[c][k - 1]) / (1.0 - a * a).sqrt() }
                    };
                    (0..2).flat_map(|c| (0..rows).map(move |k| (c, k))).map(|(c, k)| white(c, k) / self.deviation[c]).collect()
                }
                Noise::Encoder => wheel_positions(column, &recording.time),
            });
        }
        if self.noise == Noise::Encoder {
            // Where each encoder stood between two counts at the start is unknown as well.
            let deviation = ENCODER[1] / 12.0_f64.sqrt();
            columns.extend((0..2).map(|c| (0..2 * rows).map(|k| f64::from(u8::from(k / rows == c)) / deviation).collect()));
        }
        let jacobian = DMatrix::from_columns(&columns.into_iter().map(nalgebra::DVector::from_vec).collect::<Vec<_>>());
        let unknowns = jacobian.ncols();
        let r = jacobian.qr().r();
        let inverse = r.solve_upper_triangular(&DMatrix::identity(unknowns, unknowns)).ok_or("the bound does not exist")?;
        Ok(std::array::from_fn(|i| inverse.row(i).norm()))
    }
}

/// Wheel travel from the start in units of its rounding error, both wheels, from sensitivities of mean velocities.
fn wheel_positions(column: &[Vec<f64>], time: &[f64]) -> Vec<f64> {
    let deviation = ENCODER[1] / 12.0_f64.sqrt();
    let mut values = Vec::new();
    for side in [-0.5, 0.5] {
        let mut travelled = 0.0;
        values.push(0.0);
        for k in 1..time.len() {
            travelled += (time[k] - time[k - 1]) * (column[0][k] + side * ENCODER[0] * column[1][k]);
            values.push(travelled / deviation);
        }
    }
    values
}

/// Velocities as a driver differences encoder counts; the encoders stand anywhere between two counts at the start.
fn encoders(states: &[[f64; 4]], time: &[f64], random: &mut StdRng) -> Vec<Vec<f64>> {
    let [track, tick] = ENCODER;
    let start: [f64; 2] = [random.random(), random.random()];
    let counts = |state: &[f64; 4]| [-0.5, 0.5].map(|side| (state[2] + side * track * state[3]) / tick);
    let read = |state: &[f64; 4]| -> [f64; 2] { std::array::from_fn(|i| (counts(state)[i] + start[i]).floor() * tick) };
    let mut outputs = vec![vec![0.0], vec![0.0]];
    for k in 1..states.len() {
        let (before, now) = (read(&states[k - 1]), read(&states[k]));
        let [left, right] = [0, 1].map(|i| (now[i] - before[i]) / (time[k] - time[k - 1]));
        outputs[0].push(0.5 * (left + right));
        outputs[1].push((right - left) / track);
    }
    outputs
}

/// What one solver made of one recording.
struct Trial {
    theta: Theta,
    covered: Option<[bool; 6]>,
    /// It warned, although the model is right: `output-error` does if it takes the noise for a fault of the model.
    warned: bool,
    /// It ran out of iterations.
    unsettled: bool,
}

fn trial(solver: &dyn Solver, model: &dyn RegressorModel, recording: Stretch, truth: &Theta) -> Option<Trial> {
    let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![recording] };
    let solution = solver.solve(&Problem::new(model, &data)).ok()?;
    let covered = solution.ci95.map(|ci| std::array::from_fn(|i| (ci[i].0..=ci[i].1).contains(&truth[i])));
    Some(Trial {
        theta: std::array::from_fn(|i| solution.theta[i]),
        covered,
        warned: !solution.warnings.is_empty(),
        unsettled: solution.status == Status::IterationLimit,
    })
}

fn row(numbers: [f64; 6], decimals: usize) -> String {
    numbers.map(|x| format!("{x:8.decimals$}")).concat()
}

fn report(name: &str, trials: &[Option<Trial>], truth: &Theta, bounds: &Theta) {
    let solved: Vec<&Trial> = trials.iter().flatten().collect();
    let mean = |f: &dyn Fn(&Trial) -> f64| solved.iter().map(|t| f(t)).sum::<f64>() / solved.len() as f64;
    let ratio = std::array::from_fn(|i| mean(&|t| (t.theta[i] - truth[i]).powi(2)).sqrt() / bounds[i]);
    let bias = std::array::from_fn(|i| mean(&|t| t.theta[i] - truth[i]) / bounds[i]);
    let warned = solved.iter().filter(|t| t.warned).count();
    let unsettled = solved.iter().filter(|t| t.unsettled).count();
    let settled = solved.len() - unsettled;
    println!("{name:<22} RMSE / bound {}   ({settled} of {} settled, {unsettled} did not, {warned} warned)", row(ratio, 2), trials.len());
    let stated: Vec<[bool; 6]> = solved.iter().filter_map(|t| t.covered).collect();
    if !stated.is_empty() {
        let share = |i: usize| 100.0 * stated.iter().filter(|c| c[i]).count() as f64 / stated.len() as f64;
        println!("{:<22} coverage [%] {}   ({} stated)", "", row(std::array::from_fn(share), 1), stated.len());
    }
    println!("{:<22} bias / bound {}", "", row(bias, 2));
}

/// What one way to an interval gave: by parameter whether it covers the truth, and its half width over that of the bound.
type Interval = [(bool, f64); 6];

/// The intervals of the plain fit in the ways of [`WAYS`], and that of `output-error` for autoregressive noise before them.
fn ways(variant: &Variant, model: &dyn RegressorModel, seed: u64, bounds: &Theta) -> Option<Vec<Interval>> {
    let recording = variant.recording(seed);
    let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![recording.clone()] };
    let solver = OutputError { velocity: variant.velocity(), noise: NoiseModel::White, ..OutputError::default() };
    let solution = solver.solve(&Problem::new(model, &data)).ok()?;
    let plain = Plain::new(model, &recording, variant.readout(), std::array::from_fn(|i| solution.theta[i]))?;
    let own = solution.ci95?;
    let judged = |ci: &[(f64, f64)]| -> Interval {
        std::array::from_fn(|i| {
            let (low, high) = ci[i];
            ((low..=high).contains(&variant.theta[i]), (high - low) / (2.0 * 1.96 * bounds[i]))
        })
    };
    Some(std::iter::once(judged(&own)).chain(plain.intervals(seed).iter().map(|ci| judged(ci))).collect())
}

fn report_ways(trials: &[Option<Vec<Interval>>]) {
    let solved: Vec<&Vec<Interval>> = trials.iter().flatten().collect();
    println!(
        "every sample alike, intervals by                                                 ({} of {} solved)",
        solved.len(),
        trials.len()
    );
    for (way, name) in ["autoregression"].iter().chain(&WAYS).enumerate() {
        let mean = |f: &dyn Fn((bool, f64)) -> f64| -> [f64; 6] {
            std::array::from_fn(|i| solved.iter().map(|t| f(t[way][i])).sum::<f64>() / solved.len() as f64)
        };
        println!("  {name:<20} coverage [%] {}", row(mean(&|(covered, _)| 100.0 * f64::from(u8::from(covered))), 1));
        println!("  {:<20} width/bound  {}", "", row(mean(&|(_, width)| width), 2));
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seeds: u64 = arguments.next().map_or(Ok(500), |a| a.parse())?;
    let wanted: Vec<String> = arguments.collect();
    if let Some(unknown) = wanted.iter().find(|w| !VARIANTS.iter().any(|v| v.name == *w) && !SOLVERS.contains(&w.as_str())) {
        let variants = VARIANTS.map(|v| v.name).join(", ");
        return Err(format!("`{unknown}` is none of the variants {variants}, nor of {}", SOLVERS.join(", ")).into());
    }
    let among = |name: &str, all: &[&str]| wanted.iter().any(|w| w == name) || !wanted.iter().any(|w| all.contains(&w.as_str()));
    let chosen = |v: &&Variant| among(v.name, &VARIANTS.map(|v| v.name));
    for variant in VARIANTS.iter().filter(chosen) {
        let model = variant.model()?;
        let bounds = variant.bounds(&*model, &variant.recording(0))?;
        println!("\n{} ({} s at {:.1} Hz, {seeds} seeds)", variant.name, variant.duration, 1.0 / variant.period);
        println!(
            "{:<22} {:<13} {}",
            "",
            "",
            model.parameters().iter().map(|p| format!("{:>8}", p.name.replace("_left", " l").replace("_right", " r"))).collect::<String>()
        );
        println!("{:<22} {:<13} {}", "Cramér-Rao bound", "", bounds.map(|b| format!(" {b:7.1e}")).concat());
        let velocity = variant.velocity();
        let mut solvers: Vec<(&str, Box<dyn Solver>)> =
            vec![("output-error", Box::new(OutputError { velocity, ..OutputError::default() }))];
        if matches!(variant.noise, Noise::Autoregressive(_)) {
            solvers.push(("  every sample alike", Box::new(OutputError { velocity, noise: NoiseModel::White, ..OutputError::default() })));
        }
        solvers.push(("recursive", Box::new(Recursive { velocity, ..Recursive::default() })));
        solvers.push(("  regression alone", Box::new(Recursive { refine: false, ..Recursive::default() })));
        solvers.push(("iv", Box::new(InstrumentalVariables { velocity, ..InstrumentalVariables::default() })));
        solvers.push(("ols", Box::new(Ols::default())));
        solvers.push(("thesis", Box::new(Thesis::default())));
        for (name, solver) in solvers.iter().filter(|(_, solver)| among(solver.name(), &SOLVERS)) {
            let run = |seed: u64| trial(&**solver, &*model, variant.recording(seed + 1), &variant.theta);
            let trials: Vec<Option<Trial>> = (0..seeds).into_par_iter().map(run).collect();
            report(name, &trials, &variant.theta, &bounds);
        }
        if among("ways", &SOLVERS) {
            let run = |seed: u64| ways(variant, &*model, seed + 1, &bounds);
            let trials: Vec<Option<Vec<Interval>>> = (0..seeds).into_par_iter().map(run).collect();
            report_ways(&trials);
        }
    }
    Ok(())
}
