//! Library use: what a recording can tell of each parameter, before anything is fitted.
//!
//!     cargo run --release --example judge_recording -- LOG.csv [wheel-voltage]

use wheelwright::core::identifiability;
use wheelwright::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: judge_recording LOG.csv [wheel-voltage]")?;
    let recording = wheelwright::recordings::open(path.as_ref(), &ReadOptions::default())?;
    let model: Box<dyn RegressorModel> = match std::env::args().nth(2).as_deref() {
        Some("wheel-voltage") => wheelwright::models::WheelVoltageConfig::default().build()?,
        _ => VwPdConfig::default().build()?,
    };
    let (train, _held_out) = Dataset::new(&recording, &*model)?.hold_out(0.3);
    let judged = identifiability::assess(&*model, &model.map(), None, &train)?;
    for parameter in &judged.parameters {
        println!("{}", parameter.statement());
    }
    if let Some(sampling) = &judged.sampling {
        println!("{}", sampling.statement);
    }
    for facts in judged.excitation.inputs.iter().chain(&judged.excitation.outputs) {
        println!("{facts:?}");
    }
    Ok(())
}
