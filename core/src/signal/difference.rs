//! Differentiation by differences.

/// Time derivative by central differences of second order, one-sided at the ends; the values of
/// `numpy.gradient(x, time)`. Empty for fewer than two samples; steps may differ.
pub fn gradient(time: &[f64], x: &[f64]) -> Vec<f64> {
    let n = time.len().min(x.len());
    if n < 2 {
        return Vec::new();
    }
    let slope = |i: usize| (x[i + 1] - x[i]) / (time[i + 1] - time[i]);
    let mut out = Vec::with_capacity(n);
    out.push(slope(0));
    // The parabola through three samples: both slopes, each weighted by the other's step.
    out.extend((1..n - 1).map(|i| {
        let (before, after) = (time[i] - time[i - 1], time[i + 1] - time[i]);
        ((x[i] - x[i - 1]) / before * after + (x[i + 1] - x[i]) / after * before) / (before + after)
    }));
    out.push(slope(n - 2));
    out
}
