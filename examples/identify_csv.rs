//! Library use: identify a CSV and print parameters with the held-out fit.
//!
//!     cargo run --release --example identify_csv -- LOG.csv

use wheelwright::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: identify_csv LOG.csv")?;
    let recording = wheelwright::recordings::open(path.as_ref(), &ReadOptions::default())?;
    let model = VwPdConfig::default().build()?;
    let (train, held_out) = Dataset::new(&recording, &*model)?.hold_out(0.3);
    let found = identify(&Problem::new(&*model, &train), &OutputError::default(), &held_out)?;
    for estimate in &found.estimates {
        println!("{:<8} {:>12.6} {}", estimate.parameter.name, estimate.value, estimate.parameter.unit);
    }
    if let Some(free_run) = &found.held_out {
        for (channel, fit) in model.outputs().iter().zip(&free_run.fit) {
            println!("{channel}: {:.2} % on held-out data", fit.unwrap_or(f64::NAN));
        }
    }
    Ok(())
}
