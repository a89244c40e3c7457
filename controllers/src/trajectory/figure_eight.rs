//! The figure-eight of Laut 2011, appendix A.1.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};
use wheelwright_core::trajectory::{Envelope, Reference, Trajectory, TrajectoryConfig, TrajectoryError};

use super::dither::Dither;
use super::jet::{Jet, motion};
use super::{nonzero, positive};

/// x = a_x sin 2ft, y = a_y sin ft: one round takes 2π/f. It is never at rest; from the middle it first climbs to the
/// right lobe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureEight {
    /// Half the width of the two lobes along x \[m\].
    pub ax: f64,
    /// Half the height along y \[m\].
    pub ay: f64,
    /// f, an angular frequency \[rad/s\], though the thesis calls it a frequency.
    pub frequency: f64,
    /// An oscillation laid over it; none by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dither: Option<Dither>,
}

#[typetag::serde(name = "figure-eight")]
impl TrajectoryConfig for FigureEight {
    fn about(&self) -> String {
        "x = ax sin 2ft, y = ay sin ft, with a dither if wanted (Laut 2011, A.1 and A.2)".to_owned()
    }

    fn build(&self, _envelope: &Envelope) -> Result<Box<dyn Trajectory>, TrajectoryError> {
        nonzero("ax", self.ax)?;
        nonzero("ay", self.ay)?;
        positive("frequency", self.frequency)?;
        if let Some(dither) = &self.dither {
            for (key, value) in [("amplitude", dither.amplitude), ("h", dither.h), ("k", dither.k), ("growth", dither.growth)] {
                if !value.is_finite() {
                    return Err(TrajectoryError::config(format!("dither.{key}"), format!("must be a finite number, not {value}")));
                }
            }
            self.check_motion()?;
        }
        Ok(Box::new(self.clone()))
    }
}

impl FigureEight {
    /// A dither must not bring the point to rest: |d'| + |d ω| stays below the undithered speed, or the heading flips.
    fn check_motion(&self) -> Result<(), TrajectoryError> {
        const LOOKS: usize = 2000;
        let round = self.duration();
        let plain = Self { dither: None, ..self.clone() };
        for i in 0..=LOOKS {
            let t = round * i as f64 / LOOKS as f64;
            let (dithered, undithered) = (self.at(t), plain.at(t));
            let backwards = (dithered.phi - undithered.phi).abs() > 0.5 * PI;
            if backwards || dithered.v < 0.05 * undithered.v {
                let reason = "lower dither.amplitude, dither.h or dither.k".to_owned();
                return Err(TrajectoryError::Standstill { t, reason });
            }
        }
        Ok(())
    }
}

impl Trajectory for FigureEight {
    fn duration(&self) -> f64 {
        TAU / self.frequency
    }

    fn at(&self, t: f64) -> Reference {
        let f = self.frequency;
        let (s2, c2) = (2.0 * f * t).sin_cos();
        let (s1, c1) = (f * t).sin_cos();
        let jet = |a: f64, w: f64, s: f64, c: f64| -> Jet { [a * s, a * w * c, -a * w * w * s, -a * w.powi(3) * c, a * w.powi(4) * s] };
        let (x, y) = (jet(self.ax, 2.0 * f, s2, c2), jet(self.ay, f, s1, c1));
        // At the lobes' ends the point moves against ax, and never the other way along x alone: a heading counted from
        // that direction never jumps.
        let against = if self.ax > 0.0 { PI } else { 0.0 };
        let plain = motion(&x, &y, against);
        self.dither.as_ref().map_or(plain, |dither| dither.apply(t, &x, &y, &plain))
    }
}
