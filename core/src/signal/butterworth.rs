//! Butterworth low-pass filters of any order, as second-order sections.

use std::f64::consts::PI;

use super::SignalError;

/// Highest order designed: beyond it the response is a brick wall whose ringing no recording is long enough for.
const MAX_ORDER: usize = 32;

/// Share of its peak to which an impulse response has to decay before the filter counts as settled.
const SETTLED: f64 = 1e-3;

/// One section, H(z) = (b0 + b1 z⁻¹ + b2 z⁻²) / (1 + a1 z⁻¹ + a2 z⁻²), of unit gain at zero frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// b0, b1, b2.
    pub b: [f64; 3],
    /// a1, a2.
    pub a: [f64; 2],
}

impl Section {
    /// A section with double zero at Nyquist. The numerator is taken from the rounded denominator, so that the gain at
    /// zero frequency is 1 for the filter that runs, not only for the one that was meant.
    fn second_order(a1: f64, a2: f64) -> Self {
        let b = (1.0 + a1 + a2) / 4.0;
        Self { b: [b, 2.0 * b, b], a: [a1, a2] }
    }

    fn first_order(a1: f64) -> Self {
        let b = (1.0 + a1) / 2.0;
        Self { b: [b, b, 0.0], a: [a1, 0.0] }
    }

    /// Magnitude of the slowest pole.
    fn radius(&self) -> f64 {
        let [a1, a2] = self.a;
        let discriminant = a1 * a1 - 4.0 * a2;
        if discriminant < 0.0 { a2.sqrt() } else { (a1.abs() + discriminant.sqrt()) / 2.0 }
    }
}

/// A digital Butterworth low-pass filter, |H(f)|² = 1 / (1 + (tan(π f/f_s) / tan(π f_c/f_s))^(2n)).
#[derive(Debug, Clone, PartialEq)]
pub struct Butterworth {
    order: usize,
    sections: Vec<Section>,
}

impl Butterworth {
    /// Designs a filter of `order` with cut-off (−3 dB) `cutoff_hz` for signals of `rate_hz` samples per second, by the
    /// bilinear transform with pre-warping; the filter of `scipy.signal.butter(order, cutoff_hz, fs=rate_hz)`.
    ///
    /// # Errors
    /// [`SignalError::Order`], [`SignalError::CutOff`].
    pub fn low_pass(order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Self, SignalError> {
        if order == 0 || order > MAX_ORDER {
            return Err(SignalError::Order { order, max: MAX_ORDER });
        }
        if !(cutoff_hz > 0.0 && cutoff_hz < rate_hz / 2.0 && rate_hz.is_finite()) {
            return Err(SignalError::CutOff { cutoff_hz, rate_hz });
        }
        let k = (PI * cutoff_hz / rate_hz).tan();
        let mut sections = Vec::with_capacity(order.div_ceil(2));
        if order % 2 == 1 {
            sections.push(Section::first_order((k - 1.0) / (k + 1.0)));
        }
        // Pole pairs of the unit analogue filter, s² + 2 cos(angle) s + 1, least damped last.
        for pair in 0..order / 2 {
            let angle = if order % 2 == 1 { PI * (pair + 1) as f64 } else { PI * (pair as f64 + 0.5) } / order as f64;
            let damping = 2.0 * angle.cos() * k;
            let norm = 1.0 / (1.0 + damping + k * k);
            sections.push(Section::second_order(2.0 * (k * k - 1.0) * norm, (1.0 - damping + k * k) * norm));
        }
        Ok(Self { order, sections })
    }

    /// Order, the number of poles.
    pub fn order(&self) -> usize {
        self.order
    }

    /// The cascade.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// Samples after which the impulse response has decayed to a thousandth: what an edge of the data still disturbs.
    pub fn settling(&self) -> usize {
        let slowest = self.sections.iter().map(Section::radius).fold(0.0, f64::max);
        (SETTLED.ln() / slowest.ln()).ceil().max(1.0) as usize
    }

    /// Numerator and denominator multiplied out, highest power first: (b, a) of `scipy.signal.butter`. Loses precision
    /// at high orders; filtering uses the sections.
    pub fn transfer_function(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut b, mut a) = (vec![1.0], vec![1.0]);
        for section in &self.sections {
            let used = if section.b[2] == 0.0 { 2 } else { 3 };
            b = product(&b, &section.b[..used]);
            a = product(&a, &[1.0, section.a[0], section.a[1]][..used]);
        }
        (b, a)
    }
}

/// Coefficients of the product of two polynomials.
fn product(p: &[f64], q: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; p.len() + q.len() - 1];
    for (i, x) in p.iter().enumerate() {
        for (j, y) in q.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}
