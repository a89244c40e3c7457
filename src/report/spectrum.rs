//! Power spectral density by Welch's method, averaged over stretches; nothing is transformed across a break.
//!
//! P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967): Hann windows, half overlapping, each less its mean, one-sided
//! density. The same definition and numbers as `scipy.signal.welch`.

use std::f64::consts::PI;

/// Longest window.
const MAX_WINDOW: usize = 1024;
/// Shortest window worth drawing.
const MIN_WINDOW: usize = 16;
/// Deviation of a step from the median step, as a share of it, beyond which a stretch is resampled.
const EVEN: f64 = 0.01;

/// Density of a signal over frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Frequencies \[Hz\], from zero to half the sampling rate.
    pub frequency: Vec<f64>,
    /// One-sided density \[unit²/Hz\].
    pub density: Vec<f64>,
    /// Samples a window.
    pub window: usize,
    /// Windows averaged.
    pub windows: usize,
    /// Stretches too short for a window.
    pub skipped: usize,
}

/// Density of a signal given as stretches of (times \[s\], values) with median step `period` \[s\]. The window is the
/// longest power of two, up to 1024, that stretches with four fifths of the samples can fill. `None` if it would be too
/// short to show anything.
pub fn welch(stretches: &[(&[f64], &[f64])], period: f64) -> Option<Spectrum> {
    let even: Vec<Vec<f64>> = stretches.iter().map(|(time, values)| evenly(time, values, period)).collect();
    let window = window_length(&even);
    if window < MIN_WINDOW || period <= 0.0 || !period.is_finite() {
        return None;
    }
    let hann: Vec<f64> = (0..window).map(|i| 0.5 - 0.5 * (2.0 * PI * i as f64 / window as f64).cos()).collect();
    let power: f64 = hann.iter().map(|w| w * w).sum();
    let mut density = vec![0.0; window / 2 + 1];
    let mut windows = 0;
    for part in even.iter().flat_map(|values| values.windows(window).step_by(window / 2)) {
        let mean = part.iter().sum::<f64>() / window as f64;
        let mut re: Vec<f64> = part.iter().zip(&hann).map(|(x, w)| (x - mean) * w).collect();
        let mut im = vec![0.0; window];
        fft(&mut re, &mut im);
        for (k, d) in density.iter_mut().enumerate() {
            let sides = if k == 0 || k == window / 2 { 1.0 } else { 2.0 };
            *d += sides * (re[k] * re[k] + im[k] * im[k]) * period / power;
        }
        windows += 1;
    }
    density.iter_mut().for_each(|d| *d /= windows as f64);
    let frequency = (0..density.len()).map(|k| k as f64 / (window as f64 * period)).collect();
    let skipped = even.iter().filter(|v| v.len() < window).count();
    Some(Spectrum { frequency, density, window, windows, skipped })
}

fn window_length(stretches: &[Vec<f64>]) -> usize {
    let total: usize = stretches.iter().map(Vec::len).sum();
    let reach = |window: usize| 5 * stretches.iter().map(Vec::len).filter(|n| *n >= window).sum::<usize>() >= 4 * total.max(1);
    let mut window = MAX_WINDOW;
    while window > 1 && !reach(window) {
        window /= 2;
    }
    window
}

/// Values at even steps of `period`, linear between samples; as they are where the steps are even already.
fn evenly(time: &[f64], values: &[f64], period: f64) -> Vec<f64> {
    let n = time.len().min(values.len());
    let (time, values) = (&time[..n], &values[..n]);
    if n < 2 || period <= 0.0 || time.windows(2).all(|w| (w[1] - w[0] - period).abs() <= EVEN * period) {
        return values.to_vec();
    }
    let mut i = 0;
    // A step of a millionth of the stretch would only fill the memory.
    let count = (((time[n - 1] - time[0]) / period).floor() as usize + 1).min(16 * n);
    (0..count)
        .map(|k| {
            let t = time[0] + k as f64 * period;
            while i + 2 < n && time[i + 1] <= t {
                i += 1;
            }
            let share = ((t - time[i]) / (time[i + 1] - time[i])).clamp(0.0, 1.0);
            values[i] + share * (values[i + 1] - values[i])
        })
        .collect()
}

/// Fourier transform in place, radix 2 (Cooley and Tukey 1965); the length is a power of two.
fn fft(re: &mut [f64], im: &mut [f64]) {
    let n = re.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            re.swap(i, j);
            im.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        for k in 0..half {
            let (sin, cos) = (-PI * k as f64 / half as f64).sin_cos();
            for a in (k..n).step_by(2 * half) {
                let b = a + half;
                let (x, y) = (re[b] * cos - im[b] * sin, re[b] * sin + im[b] * cos);
                (re[b], im[b]) = (re[a] - x, im[a] - y);
                re[a] += x;
                im[a] += y;
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal() -> Vec<f64> {
        let x = |i: f64| (0.37 * i).sin() + 0.5 * (1.9 * i).cos() + 0.01 * i * (i % 7.0);
        (0..600).map(|i| x(f64::from(i))).collect()
    }

    fn times(n: usize) -> Vec<f64> {
        (0..n).map(|i| i as f64 / 20.0).collect()
    }

    fn assert_close(spectrum: &Spectrum, expected: &[(usize, f64)]) {
        for &(k, p) in expected {
            assert!((spectrum.density[k] - p).abs() <= 1e-10 * p.max(1e-3), "bin {k}: {} instead of {p}", spectrum.density[k]);
        }
    }

    // i = np.arange(600); x = np.sin(0.37*i) + 0.5*np.cos(1.9*i) + 0.01*i*(i%7)
    // scipy.signal.welch(x[:400], fs=20.0, window='hann', nperseg=256), SciPy 1.17.1
    #[test]
    fn one_stretch_as_scipy() {
        let (x, t) = (signal(), times(400));
        let spectrum = welch(&[(&t, &x[..400])], 0.05).unwrap();
        assert_eq!((spectrum.window, spectrum.windows, spectrum.skipped), (256, 2, 0));
        assert!((spectrum.frequency[77] - 6.015_625).abs() < 1e-12);
        let expected = [
            (0, 0.004551602743153255),
            (1, 14.345122606946347),
            (5, 0.0017676087220727483),
            (15, 4.236404843804141),
            (40, 0.006589626516775414),
            (77, 0.8976674352621934),
            (100, 1.7934739681729301e-06),
            (128, 1.4549414873199773e-08),
        ];
        assert_close(&spectrum, &expected);
    }

    // (welch(x[:300], fs=20.0, nperseg=256)[1] + welch(x[300:], fs=20.0, nperseg=256)[1]) / 2
    #[test]
    fn stretches_are_averaged_and_never_joined() {
        let (x, t) = (signal(), times(300));
        let short = [0.0; 20];
        let spectrum = welch(&[(&t, &x[..300]), (&t, &x[300..]), (&t[..20], &short)], 0.05).unwrap();
        assert_eq!((spectrum.window, spectrum.windows, spectrum.skipped), (256, 2, 1));
        let expected = [
            (0, 0.02809682800016019),
            (1, 14.35682162145466),
            (5, 0.0017666085172060308),
            (15, 4.236223105242801),
            (40, 0.016035062250297626),
            (77, 0.8913805138850628),
            (100, 3.971754976871984e-06),
            (128, 1.275435862690436e-07),
        ];
        assert_close(&spectrum, &expected);
    }

    #[test]
    fn uneven_samples_are_resampled_and_too_few_refused() {
        // A straight line stays one whatever its sampling.
        let t: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.05 + if i % 2 == 0 { 0.0 } else { 0.01 }).collect();
        let x: Vec<f64> = t.iter().map(|t| 3.0 * t + 1.0).collect();
        let even = evenly(&t, &x, 0.05);
        for (k, value) in even.iter().enumerate() {
            assert!((value - (1.0 + 0.15 * k as f64)).abs() < 1e-12);
        }
        assert!(even.len() >= 99);
        assert!(welch(&[(&t[..10], &x[..10])], 0.05).is_none());
        assert!(welch(&[], 0.05).is_none());
        assert!(welch(&[(&t, &x)], 0.0).is_none());
    }
}
