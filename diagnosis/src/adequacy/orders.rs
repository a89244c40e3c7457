//! Lines in wheel angle: what returns with every turn of a wheel is in the wheel, its gear or its encoder.
//!
//! The innovations' periodogram is taken over wheel angle instead of time, with constant weight (a force, a torque ripple) and
//! with weight proportional to speed (geometry). Broad low-order structure raises neighbouring orders as well; a line does not.

use crate::comparison::Comparison;

use super::sweep::{self, powers, stands_out};

/// Orders searched: below, a slow wander looks like a line; above, sampling rarely sees any.
const ORDERS: (f64, f64) = (0.5, 12.5);
/// Orders to either side that count as neighbourhood, as a share of the order.
const NEIGHBOURHOOD: f64 = 0.25;
/// Most orders looked at: over many turns the grid is as fine as this allows.
const MOST: usize = 1200;

/// A line of the residual at a multiple of a wheel's turning.
#[derive(Debug, Clone, PartialEq)]
pub struct OrderLine {
    /// 0 left, 1 right.
    pub wheel: usize,
    /// Cycles per turn of the wheel.
    pub order: f64,
    /// Power: twice a log-likelihood ratio, of two degrees of freedom by chance.
    pub power: f64,
    /// True if the amplitude grows with speed, as geometry does; false if it does not, as a force does.
    pub kinematic: bool,
}

/// The strongest line, if there is one.
pub(crate) fn find(comparison: &Comparison<'_>) -> Option<OrderLine> {
    let radius = comparison.scene.wheel_radius.filter(|_| comparison.scene.frame.has_wheels())?;
    let innovations: Vec<Vec<f64>> = (0..comparison.outputs()).map(|i| comparison.innovations(i)).collect();
    let mut best: Option<OrderLine> = None;
    for wheel in 0..2 {
        let turned = |distance: &f64| distance / (radius * std::f64::consts::TAU);
        let angle: Vec<f64> = comparison.scene.tracks.iter().flat_map(|t| t.distance[wheel].iter().map(turned)).collect();
        let speed: Vec<f64> = comparison
            .model
            .iter()
            .flat_map(|run| (0..run[0].len()).map(|k| comparison.scene.frame.wheels(&[run[0][k], run[1][k]])[wheel]))
            .collect();
        let turns = angle.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>();
        if turns < 3.0 {
            continue;
        }
        let count = (((ORDERS.1 - ORDERS.0) * turns) as usize).clamp(32, MOST);
        let step = (ORDERS.1 - ORDERS.0) / count as f64;
        for kinematic in [false, true] {
            let power = powers(&innovations, &angle, kinematic.then_some(&speed[..]), [ORDERS.0, step], count);
            let Some(line) = strongest(&power, step, wheel, kinematic, 8 * count) else { continue };
            if best.as_ref().is_none_or(|b| line.power > b.power) {
                best = Some(line);
            }
        }
    }
    best
}

fn strongest(power: &[f64], step: f64, wheel: usize, kinematic: bool, looks: usize) -> Option<OrderLine> {
    let (at, largest) = sweep::strongest(power, looks)?;
    let order = ORDERS.0 + at as f64 * step;
    // A peak at the lowest orders is a wander, whatever its height.
    if order < 0.9 {
        return None;
    }
    let reach = ((NEIGHBOURHOOD * order / step) as usize).max(6);
    stands_out(power, at, reach).then_some(OrderLine { wheel, order, power: largest, kinematic })
}
