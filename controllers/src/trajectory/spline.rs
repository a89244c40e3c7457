//! A plane curve through points: natural cubic spline over the points' chord lengths, so that its curvature is continuous.

/// Coefficients of one coordinate on one piece: a + b s + c s² + d s³, s counted from the piece's knot.
type Cubic = [f64; 4];

/// The curve.
#[derive(Debug, Clone)]
pub(super) struct Spline {
    knots: Vec<f64>,
    x: Vec<Cubic>,
    y: Vec<Cubic>,
}

impl Spline {
    /// A curve through at least two points, no two neighbours alike.
    pub(super) fn through(points: &[[f64; 2]]) -> Self {
        let mut knots = vec![0.0];
        for pair in points.windows(2) {
            let chord = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
            knots.push(knots[knots.len() - 1] + chord);
        }
        let coordinate = |i: usize| natural(&knots, &points.iter().map(|p| p[i]).collect::<Vec<_>>());
        let (x, y) = (coordinate(0), coordinate(1));
        Self { knots, x, y }
    }

    /// The parameter's end; it begins at 0.
    pub(super) fn end(&self) -> f64 {
        self.knots[self.knots.len() - 1]
    }

    /// Each coordinate with its first three derivatives by the parameter.
    pub(super) fn at(&self, u: f64) -> [[f64; 4]; 2] {
        let piece = self.knots.partition_point(|k| *k <= u).clamp(1, self.x.len()) - 1;
        let s = u - self.knots[piece];
        let value = |[a, b, c, d]: Cubic| [a + s * (b + s * (c + s * d)), b + s * (2.0 * c + 3.0 * s * d), 2.0 * c + 6.0 * s * d, 6.0 * d];
        [value(self.x[piece]), value(self.y[piece])]
    }
}

/// Natural cubic spline: second derivatives m from m₀ = mₙ = 0 and h₋m₋ + 2(h₋ + h)m + h m₊ = 6(slope − slope₋).
fn natural(knots: &[f64], values: &[f64]) -> Vec<Cubic> {
    let n = values.len();
    let step = |i: usize| knots[i + 1] - knots[i];
    let slope = |i: usize| (values[i + 1] - values[i]) / step(i);
    let mut second = vec![0.0; n];
    // Forward elimination of the tridiagonal system, then back substitution.
    let (mut upper, mut right) = (vec![0.0; n], vec![0.0; n]);
    for i in 1..n - 1 {
        let (before, after) = (step(i - 1), step(i));
        let diagonal = 2.0 * (before + after) - before * upper[i - 1];
        upper[i] = after / diagonal;
        right[i] = (6.0 * (slope(i) - slope(i - 1)) - before * right[i - 1]) / diagonal;
    }
    for i in (1..n - 1).rev() {
        second[i] = right[i] - upper[i] * second[i + 1];
    }
    (0..n - 1)
        .map(|i| {
            let (h, m, next) = (step(i), second[i], second[i + 1]);
            [values[i], slope(i) - h * (2.0 * m + next) / 6.0, 0.5 * m, (next - m) / (6.0 * h)]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// scipy.interpolate.CubicSpline(u, p, bc_type="natural") for the points below, at u = 1.7 and its derivatives:
    ///   p = [[0,0],[1,0.5],[2,-0.5],[3.5,1]]; u = concatenate([[0], cumsum(hypot(*diff(p, axis=0).T))])
    ///   [CubicSpline(u, p, bc_type="natural")(1.7, k) for k in range(4)]
    #[test]
    fn it_is_scipys_natural_spline() {
        let spline = Spline::through(&[[0.0, 0.0], [1.0, 0.5], [2.0, -0.5], [3.5, 1.0]]);
        let [x, y] = spline.at(1.7);
        for ((x, y), expected) in x.iter().zip(y).zip(SCIPY) {
            assert!((x - expected[0]).abs() < 1e-13 && (y - expected[1]).abs() < 1e-12, "{x} {y} {expected:?}");
        }
    }

    const SCIPY: [[f64; 2]; 4] = [
        [1.4362955817559342, 0.14190177604007567],
        [0.7038136735140916, -0.8715232970571668],
        [-0.11897837095990627, -0.4190135076872794],
        [0.19944566290149474, 2.378718816063108],
    ];
}
