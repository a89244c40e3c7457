//! A robot without hidden physics in six lumped numbers, and its fit to noise-free signals by Gauss-Newton with damping.
//!
//! A symmetric robot that rolls without slipping, has no dry friction and a proportional-derivative servo obeys
//!
//! `M v' = S v_ref - D v + c omega²` and `J omega' = T omega_ref - E omega - c v omega`,
//!
//! with moved mass `M`, yaw inertia `J`, servo stiffnesses `S`, `T`, losses `D`, `E` and the moment of mass `c`. Commands fix only ratios, so
//! the forces are taken over `S` and the torques over `T`, and `c` counts once in each line.

use crate::firmware::Command;

/// Ratios `[M/S, J/T, c/S, D/S, c/T, E/T]`, then factors of wheel radius and track against the nominal ones.
pub type Lumped = [f64; 8];

/// Speeds at the rows of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Speeds {
    /// Channels `v`, `omega`, and, where wheels are recorded, left and right rim speed \[m/s\].
    pub channels: Vec<Vec<f64>>,
}

/// What a fit weighs its residuals with.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Noise standard deviation per channel.
    pub sigma: Vec<f64>,
    /// Correlation of the noise from row to row.
    pub memory: f64,
}

/// Standard deviation to which a user knows radius and track (2 % at most, evenly).
const DIMENSIONS_KNOWN: f64 = 0.012;

/// Runs the lumped robot from rest over the rows of `commands` (each held until the next), with wheels at half track `half_track` if given.
pub fn run(p: &Lumped, commands: &[Command], half_track: Option<f64>) -> Speeds {
    let rate =
        |x: [f64; 2], u: &Command| [(u.v - p[3] * x[0] + p[2] * x[1] * x[1]) / p[0], (u.omega - p[5] * x[1] - p[4] * x[0] * x[1]) / p[1]];
    let longest = (0.2 * p[0].min(p[1])).max(1e-4);
    let mut x = [0.0; 2];
    let mut channels = vec![Vec::with_capacity(commands.len()); if half_track.is_some() { 4 } else { 2 }];
    for (k, u) in commands.iter().enumerate() {
        channels[0].push(x[0]);
        channels[1].push(x[1]);
        if let Some(h) = half_track {
            channels[2].push((x[0] - p[7] * h * x[1]) / p[6]);
            channels[3].push((x[0] + p[7] * h * x[1]) / p[6]);
        }
        let Some(next) = commands.get(k + 1) else { break };
        let steps = ((next.t - u.t) / longest).ceil().clamp(1.0, 200.0);
        let h = (next.t - u.t) / steps;
        for _ in 0..steps as usize {
            x = runge_kutta(x, h, |x| rate(x, u));
        }
        if !(x[0].abs() + x[1].abs()).is_finite() {
            x = [1e6; 2];
        }
    }
    Speeds { channels }
}

fn runge_kutta(x: [f64; 2], h: f64, f: impl Fn([f64; 2]) -> [f64; 2]) -> [f64; 2] {
    let off = |k: [f64; 2], s: f64| [x[0] + s * k[0], x[1] + s * k[1]];
    let a = f(x);
    let b = f(off(a, 0.5 * h));
    let c = f(off(b, 0.5 * h));
    let d = f(off(c, h));
    [x[0] + h / 6.0 * (a[0] + 2.0 * (b[0] + c[0]) + d[0]), x[1] + h / 6.0 * (a[1] + 2.0 * (b[1] + c[1]) + d[1])]
}

/// Residuals over noise, with the noise's memory taken out, and the prior of the dimensions behind.
pub fn residuals(p: &Lumped, ran: &Speeds, seen: &Speeds, weights: &Weights) -> Vec<f64> {
    let fresh = (1.0 - weights.memory * weights.memory).sqrt();
    let mut out = Vec::new();
    for (c, (model, data)) in ran.channels.iter().zip(&seen.channels).enumerate() {
        let mut before = 0.0;
        for (m, y) in model.iter().zip(data) {
            let e = (y - m) / weights.sigma[c];
            out.push((e - weights.memory * before) / fresh);
            before = e;
        }
    }
    if ran.channels.len() > 2 {
        out.extend([(p[6] - 1.0) / DIMENSIONS_KNOWN, (p[7] - 1.0) / DIMENSIONS_KNOWN]);
    }
    out
}

/// The lumped robot that comes nearest to `seen`, and the squared weighted distance that is left.
pub fn fit(start: Lumped, commands: &[Command], seen: &Speeds, half_track: Option<f64>, weights: &Weights) -> (Lumped, f64) {
    let count = if half_track.is_some() { 8 } else { 6 };
    let at = |p: &Lumped| residuals(p, &run(p, commands, half_track), seen, weights);
    let cost = |r: &[f64]| r.iter().map(|e| e * e).sum::<f64>();
    let (mut p, mut r) = (start, at(&start));
    let mut best = cost(&r);
    let mut damping = 1e-3;
    for _ in 0..40 {
        let columns: Vec<Vec<f64>> = (0..count)
            .map(|k| {
                let step = 1e-5 * p[k].abs().max(1e-2);
                let mut q = p;
                q[k] += step;
                at(&q).iter().zip(&r).map(|(a, b)| (a - b) / step).collect()
            })
            .collect();
        let mut gained = 0.0;
        for _ in 0..8 {
            let mut q = p;
            for (k, d) in solve_normal(&columns, &r, damping).into_iter().enumerate() {
                q[k] -= d;
            }
            for k in [0, 1, 3, 5, 6, 7] {
                q[k] = q[k].max(1e-3);
            }
            let tried = at(&q);
            if cost(&tried) < best {
                gained = best - cost(&tried);
                (p, r, best) = (q, tried, best - gained);
                damping = (damping * 0.1).max(1e-12);
                break;
            }
            damping *= 10.0;
        }
        // A ten-thousandth of what is left is more than the number is worth.
        if gained <= 1e-4 * best + 1e-9 {
            break;
        }
    }
    (p, best)
}

/// Solves the damped normal equations of columns and residual.
fn solve_normal(columns: &[Vec<f64>], r: &[f64], damping: f64) -> Vec<f64> {
    let n = columns.len();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut m: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let mut row: Vec<f64> = (0..n).map(|j| dot(&columns[i], &columns[j])).collect();
            row[i] = row[i] * (1.0 + damping) + 1e-12;
            row.push(dot(&columns[i], r));
            row
        })
        .collect();
    solve(&mut m)
}

/// Gaussian elimination with row pivoting; the right-hand side is the last column.
pub fn solve(m: &mut [Vec<f64>]) -> Vec<f64> {
    let n = m.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| m[a][k].abs().total_cmp(&m[b][k].abs())).unwrap_or(k);
        m.swap(k, pivot);
        let (above, below) = m.split_at_mut(k + 1);
        let row = &above[k];
        for other in below {
            let factor = if row[k] == 0.0 { 0.0 } else { other[k] / row[k] };
            for (a, b) in other.iter_mut().zip(row).skip(k) {
                *a -= factor * b;
            }
        }
    }
    let mut x = vec![0.0; n];
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|j| m[k][j] * x[j]).sum();
        x[k] = if m[k][k] == 0.0 { 0.0 } else { (m[k][n] - rest) / m[k][k] };
    }
    x
}
