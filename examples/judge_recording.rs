//! Library use: what a recording can tell, before anything is fitted and beside the fit.
//!
//!     cargo run --release --example judge_recording -- LOG.csv [wheel-voltage]

use wheelwright::core::{agreement, ceiling, identifiability, lag};
use wheelwright::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: judge_recording LOG.csv [wheel-voltage]")?;
    let recording = wheelwright::recordings::open(path.as_ref(), &ReadOptions::default())?;
    let model: Box<dyn RegressorModel> = match std::env::args().nth(2).as_deref() {
        Some("wheel-voltage") => WheelVoltageConfig::default().build()?,
        _ => VwPdConfig::default().build()?,
    };
    let (train, held_out) = Dataset::new(&recording, &*model)?.hold_out(0.3);

    println!("Can it tell the parameters?");
    let judged = identifiability::assess(&*model, &model.map(), None, &train)?;
    let parameters = judged.parameters.iter().map(|p| p.statement());
    for sentence in parameters.chain(judged.sampling.iter().map(|s| s.statement.clone())) {
        println!("  {sentence}");
    }

    println!("Is the response late?");
    for axis in lag::estimate(&*model, &model.map(), &train)?.axes {
        println!("  {}", axis.statement);
    }

    println!("How good can a free run get?");
    let solver = OutputError::default();
    let found = identify(&Problem::new(&*model, &train), &solver, &held_out)?;
    println!("  this model: {:.1?} % on held-out data", found.held_out.map(|h| h.fit).unwrap_or_default());
    for output in ceiling::estimate(&*model, &found.solution.theta, &train, &held_out)? {
        println!("  {}", output.statement);
    }

    println!("Do its two halves agree?");
    let (first, second) = train.hold_out(0.5);
    let halves = [("first".to_owned(), first), ("second".to_owned(), second)];
    let problem = Problem::new(&*model, &train);
    let (runs, unfitted) = agreement::fit_each(&*model, &problem.map, &problem.bounds, 0, &solver, &halves);
    for run in unfitted {
        println!("  {} half: {}", run.label, run.error);
    }
    if let Some(agreement) = agreement::compare(model.parameters(), &runs) {
        println!("  {}", agreement.statement);
        agreement.parameters.iter().for_each(|p| println!("  {}", p.statement));
    }
    Ok(())
}
