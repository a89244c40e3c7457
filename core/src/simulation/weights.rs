//! Weights of an exponential Runge-Kutta step, from the φ functions of step × linear part.
//!
//! φ0(z) = e^z, φk(z) = (φk−1(z) − 1/(k−1)!) / z. The recursion cancels near zero, so z is halved until it is small, the
//! series of φ4 is summed, the others follow upwards, and the halvings are undone by the doubling formulas
//! (Skaflestad and Wright, Appl. Numer. Math. 59, 2009): accurate to rounding for every z, without a call of `exp`.

use nalgebra::{DMatrix, SMatrix};

/// Weights of one step length, one entry an output where the linear part is diagonal, else a row-major square matrix.
#[derive(Debug)]
pub(crate) struct Weights {
    pub(crate) step: f64,
    /// e^{hL}, on the state.
    pub(crate) full: Vec<f64>,
    /// e^{hL/2}, on the state at half step.
    pub(crate) half: Vec<f64>,
    /// (h/2) φ1(hL/2), on the forcing at half step.
    pub(crate) half_forcing: Vec<f64>,
    /// h (φ1 − 3φ2 + 4φ3), on the forcing at the start.
    pub(crate) first: Vec<f64>,
    /// h (2φ2 − 4φ3), on each forcing in the middle.
    pub(crate) middle: Vec<f64>,
    /// h (4φ3 − φ2), on the forcing at the end.
    pub(crate) last: Vec<f64>,
    /// The four above for the integral of the state over the step: one index of φ and one power of h higher.
    pub(crate) integral: [Vec<f64>; 4],
    /// Whether the integral is wanted.
    pub(crate) integrates: bool,
}

impl Weights {
    pub(crate) fn new(outputs: usize) -> Self {
        let square = || vec![0.0; outputs * outputs];
        Self {
            step: f64::NAN,
            full: square(),
            half: square(),
            half_forcing: square(),
            first: square(),
            middle: square(),
            last: square(),
            integral: [square(), square(), square(), square()],
            integrates: false,
        }
    }

    /// Computes the weights of a step length. Allocates nothing for a diagonal linear part or up to four outputs.
    pub(crate) fn set(&mut self, step: f64, linear: &[f64], outputs: usize, diagonal: bool) {
        self.step = step;
        if diagonal {
            for i in 0..outputs {
                self.set_block(step, &linear[i * outputs + i], |weight, value| weight[i] = *value);
            }
            return;
        }
        match outputs {
            2 => self.set_square::<2>(step, linear),
            3 => self.set_square::<3>(step, linear),
            4 => self.set_square::<4>(step, linear),
            n => self.set_block(step, &DMatrix::from_row_slice(n, n, linear), |weight, m: &DMatrix<f64>| {
                weight.iter_mut().enumerate().for_each(|(k, w)| *w = m[(k / n, k % n)]);
            }),
        }
    }

    fn set_square<const N: usize>(&mut self, step: f64, linear: &[f64]) {
        self.set_block(step, &SMatrix::<f64, N, N>::from_row_slice(linear), |weight, m: &SMatrix<f64, N, N>| {
            weight.iter_mut().enumerate().for_each(|(k, w)| *w = m[(k / N, k % N)]);
        });
    }

    fn set_block<T: Ring>(&mut self, h: f64, linear: &T, store: impl Fn(&mut [f64], &T)) {
        let half = phi(&linear.times(0.5 * h));
        let full = doubled(&half);
        store(&mut self.full, &full[0]);
        store(&mut self.half, &half[0]);
        store(&mut self.half_forcing, &half[1].times(0.5 * h));
        let pattern = |k: usize, factor: f64| {
            let sum = |a: f64, b: f64, c: f64| full[k].times(a * factor).plus(&full[k + 1], b * factor).plus(&full[k + 2], c * factor);
            (sum(1.0, -3.0, 4.0), sum(0.0, 2.0, -4.0), sum(0.0, -1.0, 4.0))
        };
        let (first, middle, last) = pattern(1, h);
        store(&mut self.first, &first);
        store(&mut self.middle, &middle);
        store(&mut self.last, &last);
        if !self.integrates {
            return;
        }
        let (first, middle, last) = pattern(2, h * h);
        store(&mut self.integral[0], &full[1].times(h));
        store(&mut self.integral[1], &first);
        store(&mut self.integral[2], &middle);
        store(&mut self.integral[3], &last);
    }
}

/// What the φ functions need of a number or of a square matrix.
trait Ring: Clone {
    fn product(&self, other: &Self) -> Self;
    fn times(&self, factor: f64) -> Self;
    /// self + factor × other.
    fn plus(&self, other: &Self, factor: f64) -> Self;
    /// self + value × identity.
    fn shifted(self, value: f64) -> Self;
    /// Upper bound of the largest absolute eigenvalue.
    fn bound(&self) -> f64;
}

impl Ring for f64 {
    fn product(&self, other: &Self) -> Self {
        self * other
    }
    fn times(&self, factor: f64) -> Self {
        self * factor
    }
    fn plus(&self, other: &Self, factor: f64) -> Self {
        self + factor * other
    }
    fn shifted(self, value: f64) -> Self {
        self + value
    }
    fn bound(&self) -> f64 {
        self.abs()
    }
}

impl<const N: usize> Ring for SMatrix<f64, N, N> {
    fn product(&self, other: &Self) -> Self {
        self * other
    }
    fn times(&self, factor: f64) -> Self {
        self * factor
    }
    fn plus(&self, other: &Self, factor: f64) -> Self {
        self + other * factor
    }
    fn shifted(mut self, value: f64) -> Self {
        (0..N).for_each(|i| self[(i, i)] += value);
        self
    }
    fn bound(&self) -> f64 {
        self.row_iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
    }
}

impl Ring for DMatrix<f64> {
    fn product(&self, other: &Self) -> Self {
        self * other
    }
    fn times(&self, factor: f64) -> Self {
        self * factor
    }
    fn plus(&self, other: &Self, factor: f64) -> Self {
        self + other * factor
    }
    fn shifted(mut self, value: f64) -> Self {
        (0..self.nrows()).for_each(|i| self[(i, i)] += value);
        self
    }
    fn bound(&self) -> f64 {
        self.row_iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
    }
}

/// 1/m! for m = 4..=16: the series of φ4, which for |z| ≤ 1/2 ends below rounding.
const SERIES: [f64; 13] = {
    let (mut series, mut term, mut m) = ([0.0; 13], 1.0 / 24.0, 0);
    while m < 13 {
        series[m] = term;
        m += 1;
        term /= (m + 4) as f64;
    }
    series
};

/// φ0..φ4.
fn phi<T: Ring>(z: &T) -> [T; 5] {
    let mut scale = 1.0;
    // A bound that is not a number falls through and shows in the result.
    while z.bound() * scale > 0.5 && scale > f64::MIN_POSITIVE {
        scale *= 0.5;
    }
    let y = z.times(scale);
    let zero = y.times(0.0);
    let p4 = SERIES.iter().rev().fold(zero, |sum, &c| sum.product(&y).shifted(c));
    let p3 = y.product(&p4).shifted(1.0 / 6.0);
    let p2 = y.product(&p3).shifted(0.5);
    let p1 = y.product(&p2).shifted(1.0);
    let p0 = y.product(&p1).shifted(1.0);
    let mut values = [p0, p1, p2, p3, p4];
    while scale < 1.0 {
        values = doubled(&values);
        scale *= 2.0;
    }
    values
}

/// φ0..φ4 of 2z from those of z.
fn doubled<T: Ring>([p0, p1, p2, p3, p4]: &[T; 5]) -> [T; 5] {
    [
        p0.product(p0),
        p0.product(p1).plus(p1, 1.0).times(0.5),
        p1.product(p1).plus(p2, 2.0).times(0.25),
        p1.product(p2).plus(p2, 1.0).plus(p3, 2.0).times(0.125),
        p2.product(p2).plus(p3, 2.0).plus(p4, 2.0).times(0.0625),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Python's `decimal` with 80 digits: sum of z^m / (m + k)! over 600 terms.
    #[test]
    fn phi_agrees_with_eighty_digit_values() {
        let reference: [(f64, [f64; 5]); 5] = [
            (-50.0, [1.9287498479639178e-22, 0.02, 0.0196, 0.009608, 0.0031411733333333333]),
            (-3.0, [0.049787068367863944, 0.3167376438773787, 0.22775411870754045, 0.09074862709748652, 0.025306013189726716]),
            (-1e-3, [0.999000499833375, 0.9995001666250083, 0.4998333749916681, 0.16662500833194463, 0.041658334722023835]),
            (0.7, [2.0137527074704766, 1.4482181535292522, 0.6403116478989317, 0.2004452112841881, 0.048255063739316345]),
            (20.0, [485165195.4097903, 24258259.720489513, 1212912.9360244756, 60645.62180122379, 3032.2727567278557]),
        ];
        for (z, values) in reference {
            for (k, (found, expected)) in phi(&z).iter().zip(values).enumerate() {
                // e^z itself loses a bit a doubling, relative to the largest of the φ that a step adds it to.
                let tolerance = 1e-15 * (4.0 + z.abs()) * if k == 0 { expected.max(values[1]) } else { expected };
                assert!((found - expected).abs() <= tolerance, "φ{k}({z}) = {found:e}, not {expected:e}");
            }
        }
    }
}
