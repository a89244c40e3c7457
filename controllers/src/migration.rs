//! Migration: a controller tuned on one robot, carried to another.
//!
//! The inverse dynamics carry themselves: with the other robot's θ they ask it for the same accelerations. What does not carry
//! itself are the gains, because a sampled loop bears only so much of them ([`crate::stability`]): they are kept, scaled with the
//! sampling period, or tuned anew to use the same share of what the other robot bears.
//!
//! Scaled or tuned anew, they are raised on a robot that bears more. On one that bears less they are not lowered for the sake of the
//! share alone, which would make the robot slow to come back to its course and win nothing, but only to where the loop does not ring:
//! half the bound. There the pole a + b of the inner loop is zero, and with a measurement or a link that is late by a whole period its
//! poles, of z² − a z + a, are still within the unit circle. Likewise k2, which on a larger course makes the same curve at a higher
//! speed v, is not lowered further than the damping k3/(2 v √k2) of the lateral error asks for.

use serde::{Deserialize, Serialize};
use thiserror::Error;
use wheelwright_core::controller::{ControlError, Subject};

use crate::body::Body;
use crate::law::{Gains, Sigma};
use crate::stability::Axis;
use crate::{AdaptiveConfig, InverseDynamicsConfig};

/// Share of the stability bound above which the sampled loop rings.
const RINGS: f64 = 0.5;

/// Gains of the inverse dynamics as configurations write them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Tuning {
    /// k1 \[1/s\], k2 \[1/m²\], k3 \[1/s\] of the kinematic law.
    pub k: [f64; 3],
    /// k_v \[1/s\].
    pub kv: f64,
    /// k_ω \[1/s\].
    pub kw: f64,
    /// Which derivative enters σ.
    #[serde(default)]
    pub sigma: Sigma,
}

impl From<&InverseDynamicsConfig> for Tuning {
    fn from(c: &InverseDynamicsConfig) -> Self {
        Self { k: c.k, kv: c.kv, kw: c.kw, sigma: c.sigma }
    }
}

impl From<&AdaptiveConfig> for Tuning {
    fn from(c: &AdaptiveConfig) -> Self {
        Self { k: c.k, kv: c.kv, kw: c.kw, sigma: c.sigma }
    }
}

impl From<Tuning> for InverseDynamicsConfig {
    fn from(t: Tuning) -> Self {
        Self { k: t.k, kv: t.kv, kw: t.kw, sigma: t.sigma, saturation: true }
    }
}

/// What becomes of the gains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GainRule {
    /// As they are.
    Kept,
    /// Rates go with the sampling rate: half the period, twice the gain. Twice the period, the same as far as the loop does not ring.
    Scaled,
    /// Each axis uses the same share of its stability bound as on the source. Gains that would be lowered stay as far as the loop does not
    /// ring.
    #[default]
    Retuned,
}

/// Why a controller is not carried over.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MigrationError {
    /// A robot's axis has no lag or no damping, so no command could be computed that its motion answers.
    #[error(
        "refused: the {which} robot's {axis} axis has the lag {inertia:.4} s and the damping {damping:.4}, which must be positive: identify it with \
         more changes of speed, or by output-error"
    )]
    Unphysical {
        /// `source` or `target`.
        which: &'static str,
        /// `v` or `omega`.
        axis: &'static str,
        /// θ1 or θ2 \[s\].
        inertia: f64,
        /// θ4 or θ6.
        damping: f64,
    },
    /// The gains would make the target's sampled loop unstable.
    #[error(
        "refused: on the target the {axis} loop would have the gain {gain:.2}/s, and is unstable from {bound:.2}/s on with its period of \
         {period} s: let the gains be retuned"
    )]
    Unstable {
        /// `v` or `omega`.
        axis: &'static str,
        /// Gain of the loop \[1/s\].
        gain: f64,
        /// Bound \[1/s\].
        bound: f64,
        /// Control period of the target \[s\].
        period: f64,
    },
    /// A model does not suit.
    #[error(transparent)]
    Control(#[from] ControlError),
}

/// One axis' loop on a robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LoopMargin {
    /// Gain of the sampled loop, position loop included \[1/s\].
    pub gain: f64,
    /// Gain from which on it is unstable \[1/s\].
    pub bound: f64,
}

/// The axes v and omega of a robot, which must be physical.
fn axes(which: &'static str, subject: &Subject) -> Result<[Axis; 2], MigrationError> {
    let body = Body::of(&*subject.model, &subject.envelope)?;
    let axes = Axis::of(&*subject.model, &body, &subject.theta);
    for (axis, Axis { inertia, damping }) in ["v", "omega"].into_iter().zip(axes) {
        if !(inertia > 0.0 && damping > 0.0) {
            return Err(MigrationError::Unphysical { which, axis, inertia, damping });
        }
    }
    Ok(axes)
}

/// The loops of gains on a robot whose controller knows the robot's own parameters.
fn margins(tuning: &Tuning, axes: &[Axis; 2], period: f64) -> Result<[LoopMargin; 2], MigrationError> {
    let gains = Gains::new(tuning.k, tuning.kv, tuning.kw, tuning.sigma)?;
    let (rates, position) = (gains.rates(), [gains.kinematic.k1, gains.kinematic.k3]);
    Ok(std::array::from_fn(|i| LoopMargin {
        gain: axes[i].effective_gain(rates[i], position[i], gains.velocity[i], period),
        bound: axes[i].largest_gain(&axes[i], period),
    }))
}

/// Gains of one robot on another, with the loops they make there. `size` is the factor by which the trajectory's lengths change:
/// k2 goes with the square of the heading's bandwidth over speed. The target's course tells how far it need not be lowered.
///
/// # Errors
/// [`MigrationError`] where the result would be unsafe.
pub fn migrate(
    tuning: &Tuning,
    source: &Subject,
    target: &Subject,
    rule: GainRule,
    size: f64,
) -> Result<(Tuning, [LoopMargin; 2]), MigrationError> {
    let (from, to) = (axes("source", source)?, axes("target", target)?);
    let fastest = match target.course.iter().map(|at| at.v.abs()).fold(0.0, f64::max) {
        v if v > 0.0 => v,
        _ => f64::INFINITY,
    };
    let tuned = |[v, omega]: [f64; 2]| {
        let [k1, k2, k3] = tuning.k;
        let k3 = k3 * omega;
        let k = [k1 * v, (k2 * (omega / size).powi(2)).max(k2.min((k3 / fastest).powi(2))), k3];
        Tuning { k, kv: tuning.kv * v, kw: tuning.kw * omega, sigma: tuning.sigma }
    };
    // The effective gain is not quite proportional to the gains, so the factor that makes it a share of the bound is found by bisection.
    let factor = |i: usize, share: f64| {
        let used = |factor: f64| margins(&tuned([factor; 2]), &to, target.period).map_or(f64::INFINITY, |m| m[i].gain / m[i].bound);
        bisect(|factor| used(factor) - share)
    };
    let not_needlessly_lower = |i: usize, wanted: f64| if wanted < 1.0 { wanted.max(factor(i, RINGS).min(1.0)) } else { wanted };
    let migrated = match rule {
        GainRule::Kept => *tuning,
        GainRule::Scaled => tuned([0, 1].map(|i| not_needlessly_lower(i, source.period / target.period))),
        GainRule::Retuned => {
            let there = margins(tuning, &from, source.period)?;
            tuned([0, 1].map(|i| not_needlessly_lower(i, factor(i, there[i].gain / there[i].bound))))
        }
    };
    let margins = margins(&migrated, &to, target.period)?;
    for (axis, LoopMargin { gain, bound }) in ["v", "omega"].into_iter().zip(margins) {
        if gain >= bound {
            return Err(MigrationError::Unstable { axis, gain, bound, period: target.period });
        }
    }
    Ok((migrated, margins))
}

/// The zero of a rising function of a positive number.
fn bisect(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (1e-6_f64, 1e6_f64);
    for _ in 0..200 {
        let middle = (low * high).sqrt();
        if f(middle) < 0.0 { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}
