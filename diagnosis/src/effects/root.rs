//! Roots of functions of one number.

/// Most steps to a root: halving alone needs no more.
const STEPS: usize = 60;
/// A step of Newton's that is this small is the last: what it leaves is its square.
const LAST: f64 = 1e-10;

/// The root of a function that is negative at the lower end of a bracket and positive at the upper, given with its slope: by Newton's steps,
/// and by halving where they leave the bracket.
pub(super) fn root(bracket: (f64, f64), first: f64, mut function: impl FnMut(f64) -> (f64, f64)) -> f64 {
    let ((mut low, mut high), mut x) = (bracket, first);
    for _ in 0..STEPS {
        let (value, slope) = function(x);
        if value < 0.0 {
            low = x
        } else {
            high = x
        }
        let newton = x - value / slope;
        // Beside the root rounding takes a step out of a bracket that ends there, and halving would begin anew.
        if (newton - x).abs() <= LAST {
            return newton.clamp(low, high);
        }
        x = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
    }
    x
}
