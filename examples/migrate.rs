//! A controller tuned on a Pioneer, carried to a Khepera that is identified on the way.

use std::sync::Arc;

use wheelwright::control::migration::{informed, learn};
use wheelwright::controllers::InverseDynamicsConfig;
use wheelwright::controllers::law::Sigma;
use wheelwright::controllers::migration::{GainRule, Tuning, migrate};
use wheelwright::controllers::trajectory::FigureEight;
use wheelwright::core::controller::{ControllerConfig, Subject};
use wheelwright::core::drive::DriveOptions;
use wheelwright::core::excitation::thesis::ThesisKhepera;
use wheelwright::core::trajectory::{Envelope, TrajectoryConfig};
use wheelwright::core::{Live, tracking};
use wheelwright::prelude::*;
use wheelwright::robots::SimulatorConfig;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let khepera =
        || -> Result<Live, Box<dyn std::error::Error>> { Ok(Live::new(Box::new(SimulatorConfig::preset("khepera-3")?.build(1)?))) };
    let theta = vec![0.2183, 0.1918, -0.0050, 0.9993, -0.0279, 1.0142];
    let model = Arc::from(VwPdConfig::default().build()?);
    let pioneer =
        Subject { model, theta, intervals: vec![None; 6], own: None, period: 0.1, envelope: Envelope::default(), course: Vec::new() };
    let unknown = Subject { period: 0.02, ..pioneer.clone() };
    let found = learn(&mut khepera()?, &ThesisKhepera::default(), &unknown, &OutputError::default(), DriveOptions::default())?;
    let target = informed(&unknown, &found);
    let tuned = Tuning { k: [0.8, 2.0, 0.8], kv: 1.5, kw: 1.5, sigma: Sigma::Exact };
    let (gains, _) = migrate(&tuned, &pioneer, &target, GainRule::Retuned, 0.2)?;
    let trajectory = FigureEight { ax: 0.15, ay: 0.3, frequency: 0.3, dither: None }.build(&Envelope::default())?;
    let trajectory = wheelwright::core::trajectory::Placed::new(trajectory).starting_at([0.0; 3]);
    let mut controller = InverseDynamicsConfig::from(gains).build(&target)?;
    let run = tracking::track(&mut khepera()?, &mut *controller, &trajectory, 60.0, 0.5, DriveOptions::default())?;
    println!("distance error {:.4} m", run.log.rms(20.0, 60.0).unwrap_or(f64::NAN));
    Ok(())
}
