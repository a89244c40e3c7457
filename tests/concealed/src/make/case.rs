//! Turns a recipe into the files of a case and its entry in the key.

use super::built::Built;
use super::recipe::{Recipe, Sort};
use crate::files::table::{Extra, write};
use crate::firmware::Command;
use crate::firmware::control::Style;
use crate::hidden::equivalents::{Circumstances, acceptable};
use crate::hidden::forms::FORMS;
use crate::hidden::outside::OUTSIDE;
use crate::plant::{LEFT, RIGHT};
use crate::referee::detect::{Left, Scene, jitter_ratio, lattice_ratio, left_over, left_without, percent, regions, times};
use crate::referee::key::{Entry, PerChannel, Region, Truth};
use crate::referee::lumped::{Lumped, Speeds, Weights};
use crate::sensors::Columns;
use crate::sensors::noise::Character;
use crate::sensors::trace::Trace;
use rand::Rng;
use rand::rngs::StdRng;

/// A made case.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its entry in the key.
    pub entry: Entry,
    /// Names and texts of its files.
    pub files: Vec<(&'static str, String)>,
}

/// Noise standard deviations of a case.
#[derive(Clone, Copy, Debug)]
struct Sigma {
    twist: [f64; 2],
    wheel: f64,
    pose: f64,
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

impl Sigma {
    fn of(recipe: &Recipe, built: &Built, train: &Columns) -> Sigma {
        let level = recipe.level;
        let wheel = 0.5 * (rms(&train.wheel[LEFT]) + rms(&train.wheel[RIGHT]));
        Sigma {
            twist: [level[0] * rms(&train.v), level[1] * rms(&train.omega)],
            wheel: level[0] * wheel,
            pose: 0.2 * level[0] * built.plain.typical[0],
        }
    }
}

/// A recording: what can be foreseen of it, and what is written.
struct Recording {
    foreseen: Columns,
    noisy: Columns,
}

fn record(built: &Built, commands: &[Command], trace: &Trace, rng: &mut StdRng) -> Recording {
    let stamps: Vec<f64> = commands.iter().map(|c| c.t).collect();
    let sensors = &built.machine.sensors;
    Recording { foreseen: sensors.foreseen(trace, &stamps), noisy: sensors.measured(trace, &stamps, rng) }
}

fn add_noise(columns: &mut Columns, sigma: &Sigma, noise: Character, rng: &mut StdRng) {
    noise.add(&mut columns.v, sigma.twist[0], rng);
    noise.add(&mut columns.omega, sigma.twist[1], rng);
    for wheel in &mut columns.wheel {
        noise.add(wheel, sigma.wheel, rng);
    }
    for pose in &mut columns.pose {
        Character::White.add(pose, sigma.pose, rng);
    }
}

fn speeds(columns: &Columns, radius: f64, wheels: bool) -> Speeds {
    let mut channels = vec![columns.v.clone(), columns.omega.clone()];
    if wheels {
        channels.extend(columns.wheel.iter().map(|w| w.iter().map(|x| x * radius).collect()));
    }
    Speeds { channels }
}

/// Makes the case called `name`.
pub fn make(name: &str, recipe: &Recipe) -> Case {
    let built = Built::new(recipe, None);
    let [mut train, mut validate] = [0, 1].map(|k| {
        let purpose = 6 + 2 * k as u64;
        let trace = built.drive(recipe, &built.commands[k], purpose);
        record(&built, &built.commands[k], &trace, &mut recipe.chance(purpose + 1))
    });
    let sigma = Sigma::of(recipe, &built, &train.foreseen);
    add_noise(&mut train.noisy, &sigma, recipe.noise, &mut recipe.chance(10));
    add_noise(&mut validate.noisy, &sigma, recipe.noise, &mut recipe.chance(11));

    let extra = Extra { pose: recipe.pose.0, wrapped: recipe.pose.1, wheels: recipe.wheels };
    let mut files = vec![
        ("train.csv", write(&built.written[0], &train.noisy, extra)),
        ("validate.csv", write(&built.written[1], &validate.noisy, extra)),
    ];
    if recipe.profile {
        files.push(("robot.toml", profile(&built, &mut recipe.chance(12))));
    }
    Case { entry: entry(name, recipe, &built, &train, &validate, &sigma), files }
}

/// The robot's dimensions as a user would measure them.
fn profile(built: &Built, rng: &mut StdRng) -> String {
    let m = &built.plain;
    let mut off = || rng.random_range(0.98..1.02);
    let (track, radius, mass) = (2.0 * m.firmware.half_track * off(), m.firmware.radius * off(), m.rig.body.mass * off());
    let model = if m.firmware.control.style == Style::Twist { "vw-pd" } else { "wheel-pd" };
    format!("name = \"robot\"\nmodel = \"{model}\"\ntrack_width = {track:.5}\nwheel_radius = {radius:.5}\nmass = {mass:.3}\n")
}

fn entry(name: &str, recipe: &Recipe, built: &Built, train: &Recording, validate: &Recording, sigma: &Sigma) -> Entry {
    let seen = speeds(&train.foreseen, built.plain.firmware.radius, recipe.wheels);
    let rim = sigma.wheel * built.plain.firmware.radius;
    let weights = Weights { sigma: vec![sigma.twist[0], sigma.twist[1], rim, rim], memory: recipe.noise.memory() };
    let half_track = recipe.wheels.then_some(built.plain.firmware.half_track);
    let scene = Scene { commands: &built.written[0], seen: &seen, weights: &weights, half_track };
    let left = left_over(&scene, built.lumped());
    let ratio = left.ratio + scatter(recipe, built, &train.foreseen, sigma);
    let truth: Vec<Truth> =
        recipe.effects.iter().zip(&built.parameters).map(|(e, p)| Truth { effect: e.name.to_owned(), parameters: p.clone() }).collect();
    let strengths: Vec<f64> = recipe.effects.iter().map(|e| e.strength).chain(recipe.outside.map(|o| o.1)).collect();
    let hidden = recipe.sort != Sort::Nothing;
    Entry {
        case: name.to_owned(),
        kind: recipe.sort.word().to_owned(),
        truth,
        acceptable: same(recipe, built, train, sigma),
        outside: match recipe.outside {
            Some((which, _)) => Some(OUTSIDE[which].words.to_owned()),
            None => (recipe.sort == Sort::Stranger).then(|| "the commands written are those of another drive".to_owned()),
        },
        form: recipe.effects.iter().find_map(|e| e.form).map(|f| FORMS[f].words.to_owned()),
        robot: recipe.kind.word().to_owned(),
        excitation: recipe.manner[0].word().to_owned(),
        validate_excitation: recipe.manner[1].word().to_owned(),
        noise: recipe.noise.word().to_owned(),
        noise_level: PerChannel { v: recipe.level[0], omega: recipe.level[1] },
        rate_hz: recipe.rate,
        strength: strengths.iter().copied().reduce(f64::min),
        strengths,
        detectability: Some(round(ratio)),
        detectability_each: (recipe.effects.len() > 1).then(|| each(recipe, built, &scene, &left.refit, &train.foreseen, sigma)),
        times: if hidden { acting(recipe, built, &left, sigma) } else { None },
        regions: if hidden { places(train, &left, sigma) } else { None },
        noise_ceiling: Some(PerChannel {
            v: round(percent(&validate.noisy.v, &validate.foreseen.v)),
            omega: round(percent(&validate.noisy.omega, &validate.foreseen.omega)),
        }),
        origin: recipe.origin.clone(),
    }
}

/// Visibility of each effect of several, the others kept.
fn each(recipe: &Recipe, built: &Built, scene: &Scene, refit: &Lumped, train: &Columns, sigma: &Sigma) -> Vec<f64> {
    let without = |recipe: &Recipe, k: usize| {
        let built = Built::new(recipe, Some(k));
        let commands = &built.commands[0];
        let stamps: Vec<f64> = commands.iter().map(|c| c.t).collect();
        let foreseen = built.machine.sensors.foreseen(&built.drive(recipe, commands, 6), &stamps);
        (speeds(&foreseen, built.plain.firmware.radius, recipe.wheels), scatter(recipe, &built, &foreseen, sigma))
    };
    let all = scatter(recipe, built, train, sigma);
    (0..recipe.effects.len())
        .map(|k| {
            let (base, scattered) = without(recipe, k);
            let others = (0..recipe.effects.len()).filter(|j| *j != k);
            let moved: Vec<Speeds> = others
                .map(|j| {
                    let mut stronger = recipe.clone();
                    stronger.effects[j].strength *= 1.1;
                    without(&stronger, k).0
                })
                .collect();
            round(left_without(scene, refit, &base, &moved) + (all - scattered).max(0.0))
        })
        .collect()
}

/// Four digits after the point are more than any of these numbers is worth.
fn round(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

/// Expected ratio of effects that change the scatter of the measurements.
fn scatter(recipe: &Recipe, built: &Built, seen: &Columns, sigma: &Sigma) -> f64 {
    let sensors = &built.machine.sensors;
    let mut ratio = 0.0;
    for (axis, signal) in [&seen.v, &seen.omega].into_iter().enumerate() {
        if sensors.jitter > 0.0 {
            ratio += jitter_ratio(signal, 1.0 / recipe.rate, sigma.twist[axis], sensors.jitter);
        }
        let counted = sensors.tick * recipe.rate * if axis == 0 { 0.5 } else { 0.5 / sensors.half_track };
        let step = if sensors.rounding[axis] > 0.0 { sensors.rounding[axis] } else { counted };
        if step > 0.0 {
            ratio += lattice_ratio(signal.len(), step, sigma.twist[axis]);
        }
    }
    ratio
}

/// Other sets of names that are the same mathematics here.
fn same(recipe: &Recipe, built: &Built, train: &Recording, sigma: &Sigma) -> Vec<Vec<String>> {
    let still = 0.02 * built.plain.typical[0] / built.plain.firmware.radius;
    let turned = |i: usize| {
        let both = |pick: fn(f64, f64) -> f64, from: f64| train.foreseen.wheel[i].iter().copied().fold(from, pick);
        both(f64::min, 0.0) < -still && both(f64::max, 0.0) > still
    };
    let stribeck =
        built.machine.rig.wheels[LEFT].bearing.dry.map_or(0.0, |dry| if dry.breakaway > 1.0 { 2.0 * dry.stribeck_speed } else { 0.0 });
    let slow = train.foreseen.wheel[LEFT].iter().zip(&train.foreseen.wheel[RIGHT]).filter(|(l, r)| l.abs().min(r.abs()) < stribeck).count();
    let firmware = &built.machine.firmware;
    let late = firmware.link.latency.max(firmware.shaping.smoothing).max(built.machine.sensors.delay[0]);
    let times = built.plain.times();
    let circumstances = Circumstances {
        reverses: turned(LEFT) || turned(RIGHT),
        crawls: slow as f64 / train.foreseen.v.len().max(1) as f64,
        bandwidth: recipe.manner[0].bandwidth(),
        time: times[0].max(times[1]),
        late,
        wheels: recipe.wheels,
        coarseness: 0.5 * built.machine.sensors.tick * recipe.rate / sigma.twist[0],
    };
    let truth: Vec<(&str, Option<&str>)> = recipe.effects.iter().map(|e| (e.name, e.form.map(|f| FORMS[f].words))).collect();
    let mut sets = if truth.is_empty() { Vec::new() } else { acceptable(&truth, &circumstances) };
    let outside = built.known.same.iter().filter(|(_, fastest)| circumstances.bandwidth <= *fastest);
    sets.extend(outside.map(|(name, _)| vec![(*name).to_owned()]));
    sets
}

/// When what is hidden acts, where only at some times. Beside a cause that has times of its own another one acts at others.
fn acting(recipe: &Recipe, built: &Built, left: &Left, sigma: &Sigma) -> Option<Vec<[f64; 2]>> {
    let commands = &built.commands[0];
    let end = commands.last()?.t;
    let load = built.machine.rig.load.iter().map(|load| (load.on.0, load.off.0));
    let known: Vec<[f64; 2]> =
        load.chain(built.known.during.iter().copied()).filter(|(from, _)| *from < end).map(|(from, to)| [from, to.min(end)]).collect();
    match known.is_empty() {
        true => times(commands, &left.difference, &sigma.twist),
        false => (recipe.effects.len() < 2).then_some(known),
    }
}

/// Where what is hidden acts, where only in some regions.
fn places(train: &Recording, left: &Left, sigma: &Sigma) -> Option<Vec<Region>> {
    let mut all = regions("v", &train.foreseen.v, &left.difference, &sigma.twist);
    all.extend(regions("omega", &train.foreseen.omega, &left.difference, &sigma.twist));
    (!all.is_empty()).then_some(all)
}

/// Drives a case's robot once more through given commands; their times are moved to the case's clock.
pub fn further(recipe: &Recipe, commands: &[Command]) -> String {
    let built = Built::new(recipe, None);
    let begin = built.end() + super::built::PAUSE;
    let offset = begin - commands.first().map_or(0.0, |c| c.t);
    let commands: Vec<Command> = commands.iter().map(|c| Command { t: c.t + offset, ..*c }).collect();
    let words = commands.iter().fold(0u64, |h, c| h.rotate_left(7) ^ c.v.to_bits() ^ c.omega.to_bits().rotate_left(32) ^ c.t.to_bits());
    let mut rng = Built::further_chance(recipe, words);
    let train = record(&built, &built.commands[0], &built.drive(recipe, &built.commands[0], 6), &mut recipe.chance(7));
    let sigma = Sigma::of(recipe, &built, &train.foreseen);
    let trace = built.drive(recipe, &commands, 14);
    let mut recording = record(&built, &commands, &trace, &mut rng);
    add_noise(&mut recording.noisy, &sigma, recipe.noise, &mut rng);
    let extra = Extra { pose: recipe.pose.0, wrapped: recipe.pose.1, wheels: recipe.wheels };
    write(&commands, &recording.noisy, extra)
}
