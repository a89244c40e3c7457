//! The experiments of Laut 2011, chapter 4, over many seeds: root mean square of the distance error by window of time.
//!
//!     cargo run --release -p wheelwright-controllers --example orderings -- 10

mod experiments;

use experiments::{BALANCED, Bench, KHEPERA_BENCH, PIONEER_BENCH, Trial, box_around, ones};

const WINDOWS: [(f64, f64); 4] = [(10.0, 30.0), (30.0, 60.0), (60.0, 90.0), (90.0, 120.0)];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seeds: u64 = std::env::args().nth(1).map_or(Ok(10), |n| n.parse())?;
    println!("rms distance error, mm: mean over {seeds} seeds (smallest to largest)\n");
    println!("| case | 10-30 s | 30-60 s | 60-90 s | 90-120 s |\n|---|---|---|---|---|");
    let (light, heavy) = ([1.5, 1.6], [4.5, 5.0]);
    let bounds = |bench: Bench| Ok::<_, Box<dyn std::error::Error>>(Some(box_around(&bench.theta(None)?)));
    let tamed = |bench: Bench| {
        Ok::<_, Box<dyn std::error::Error>>(Trial {
            theta: ones(),
            adapt: Some(30.0),
            thaw: true,
            saturation: true,
            projection: bounds(bench)?,
            ..Trial::default()
        })
    };
    let k = KHEPERA_BENCH;
    let light_theta = k.theta(Some(light))?;
    show(k, "all ones, adapt@30", &Trial { theta: ones(), adapt: Some(30.0), thaw: true, ..Trial::default() }, seeds)?;
    show(k, "all ones, no adapt", &Trial { theta: ones(), ..Trial::default() }, seeds)?;
    show(k, "all ones, adapt@30, projection and saturation control", &tamed(k)?, seeds)?;
    show(k, "identified, no adapt", &Trial::default(), seeds)?;
    show(k, "identified, adapt@3", &Trial { adapt: Some(3.0), ..Trial::default() }, seeds)?;
    show(k, "light payload, old theta", &Trial { payload: Some(light), ..Trial::default() }, seeds)?;
    show(k, "light payload, re-identified", &Trial { payload: Some(light), theta: light_theta.clone(), ..Trial::default() }, seeds)?;
    show(
        k,
        "light payload, re-identified, adapt@3",
        &Trial { payload: Some(light), theta: light_theta, adapt: Some(3.0), ..Trial::default() },
        seeds,
    )?;
    show(k, "heavy payload, no adapt", &Trial { payload: Some(heavy), ..Trial::default() }, seeds)?;
    show(k, "heavy payload, adapt@30", &Trial { payload: Some(heavy), adapt: Some(30.0), ..Trial::default() }, seeds)?;
    let p = PIONEER_BENCH;
    let heavy = [2.0, 1.8];
    show(p, "all ones, adapt@30", &Trial { theta: ones(), adapt: Some(30.0), thaw: true, ..Trial::default() }, seeds)?;
    show(p, "all ones, no adapt", &Trial { theta: ones(), ..Trial::default() }, seeds)?;
    show(p, "all ones, adapt@30, projection and saturation control", &tamed(p)?, seeds)?;
    show(p, "identified, no adapt", &Trial::default(), seeds)?;
    show(p, "identified, adapt@30", &Trial { adapt: Some(30.0), ..Trial::default() }, seeds)?;
    show(p, "heavy payload, no adapt", &Trial { payload: Some(heavy), ..Trial::default() }, seeds)?;
    show(p, "heavy payload, adapt@30", &Trial { payload: Some(heavy), adapt: Some(30.0), ..Trial::default() }, seeds)?;
    for (bench, payload) in [(k, [4.5, 5.0]), (p, heavy)] {
        put_on(bench, payload, seeds)?;
    }
    Ok(())
}

/// A payload put on at 30 s, and what becomes of it with more and more of the adaptation.
fn put_on(bench: Bench, payload: [f64; 2], seeds: u64) -> Result<(), Box<dyn std::error::Error>> {
    let native = Trial { theta: bench.theta(Some(payload))?, payload: Some(payload), ..Trial::default() };
    show(bench, "payload, identified with it", &native, seeds)?;
    let still = Trial { theta: Vec::new(), loaded_at: Some(30.0), ..native };
    let adapting = Trial { adapt: Some(30.0), ..still.clone() };
    let (balanced, noise) = (Some(BALANCED), bench.noise);
    show(bench, "payload put on at 30 s, no adapt", &still, seeds)?;
    show(bench, "payload put on at 30 s, gamma = 1", &adapting, seeds)?;
    show(bench, "payload put on at 30 s, gamma = 1, noise known", &Trial { noise, ..adapting.clone() }, seeds)?;
    show(bench, "payload put on at 30 s, gamma balanced", &Trial { balanced, ..adapting.clone() }, seeds)?;
    show(bench, "payload put on at 30 s, gamma balanced, noise known", &Trial { balanced, noise, ..adapting }, seeds)
}

fn show(bench: Bench, name: &str, trial: &Trial, seeds: u64) -> Result<(), Box<dyn std::error::Error>> {
    let mut errors = [const { Vec::new() }; WINDOWS.len()];
    for seed in 0..seeds {
        let log = bench.run(trial, seed, 120.0)?;
        for (errors, (from, to)) in errors.iter_mut().zip(WINDOWS) {
            errors.push(1e3 * log.rms(from, to).unwrap_or(f64::INFINITY));
        }
    }
    let cell = |errors: &Vec<f64>| {
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let (low, high) = errors.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), e| (l.min(*e), h.max(*e)));
        format!("{mean:.1} ({low:.1} to {high:.1})")
    };
    println!("| {} {name} | {} |", bench.name, errors.iter().map(cell).collect::<Vec<_>>().join(" | "));
    Ok(())
}
