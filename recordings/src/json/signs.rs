//! Signs: both logs may hold the motors of one side reversed, since they are mounted mirrored.

use super::document::Test;
use super::turned;

/// Turns each side's voltage, and each side's position and velocity, so that they are positive in the forward tests.
///
/// A motor or encoder that is mounted mirrored has its sign turned in every row alike, so one sign a column suffices: that of
/// its sum over forward tests less its sum over backward tests. A column without such tests stays as it is.
pub(super) fn make_forward_positive(columns: &mut [Vec<f64>], tests: &[Test], names: &[&str]) -> Option<String> {
    let directions: Vec<f64> = tests.iter().flat_map(|test| std::iter::repeat_n(direction(&test.name), test.rows.len())).collect();
    let mut reversed = Vec::new();
    for side in ["left", "right"] {
        for (judge, followers) in [("u", &["u"][..]), ("vel", &["pos", "vel"])] {
            let column = |name: &str| names.iter().position(|n| *n == format!("{name}_{side}"));
            let Some(index) = column(judge) else { continue };
            let score: f64 = columns[index].iter().zip(&directions).map(|(value, direction)| value * direction).sum();
            if score < 0.0 {
                for index in followers.iter().filter_map(|name| column(name)) {
                    columns[index].iter_mut().for_each(|v| *v = -*v);
                    reversed.push(names[index]);
                }
            }
        }
    }
    turned(&reversed, "the file holds them negative in the forward tests")
}

fn direction(test: &str) -> f64 {
    if test.ends_with("forward") {
        1.0
    } else if test.ends_with("backward") {
        -1.0
    } else {
        0.0
    }
}

/// Gives every voltage the sign of its velocity, the rule of SysId's own analysis. At rest a velocity has no sign: there the
/// voltage keeps its own, turned if most moving rows had to be.
pub(super) fn copy_from_velocity(columns: &mut [Vec<f64>], names: &[&str], voltage: &str, velocity: &str) -> Option<String> {
    let index = |name: &str| names.iter().position(|n| *n == name);
    let (index_u, index_v) = (index(voltage)?, index(velocity)?);
    let v = std::mem::take(&mut columns[index_v]);
    let u = &mut columns[index_u];
    let differs = |u: f64, v: f64| u * v < 0.0;
    let agree = u.iter().zip(&v).filter(|(u, v)| **u * **v > 0.0).count();
    let disagree = u.iter().zip(&v).filter(|(u, v)| differs(**u, **v)).count();
    for (u, v) in u.iter_mut().zip(&v) {
        if *v != 0.0 {
            *u = u.copysign(*v);
        } else if disagree > agree {
            *u = -*u;
        }
    }
    columns[index_v] = v;
    if disagree == 0 { None } else { turned(&[voltage], &format!("{disagree} row(s) had another sign than the velocity")) }
}
