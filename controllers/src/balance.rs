//! Adaptation gains of equal pace: what a parameter learns is not γ alone but γ times how much the course asks of it.
//!
//! Where adaptation and course are slow against the velocity loop, D(ν̃' + K ν̃) = Φ θ̃ leaves ν̃ = Φ θ̃/(D K), and (3.21) lets the error of a
//! parameter that is wrong alone fade at the rate γ E\[φ²\]/(D K). One γ for all, on a small robot that drives figure-eights, gives its
//! parameters time constants from seconds to minutes. It is slow against the loop as long as the two together do not ring, which they
//! do when γ φ²/D exceeds K²/4.

use wheelwright_core::trajectory::Reference;

use crate::law::Law;

/// The square of the damping of loop and adaptation together is this times K D/(γ φ²): at one they are critically damped.
const CRITICAL: f64 = 4.0;

/// γ by which each parameter's error would fade, if it were the only one, with the time constant `time` \[s\] on a course, but nowhere
/// faster than the velocity loop bears. A parameter of which the course asks nothing gets none.
pub(crate) fn gains(law: &mut Law, theta: &[f64], course: &[Reference], time: f64) -> Vec<f64> {
    let stiffness = law.stiffness(theta);
    let (mut mean, mut peak) = (vec![0.0; theta.len()], vec![0.0_f64; theta.len()]);
    for at in course {
        let phi = law.demand(at);
        for (row, (stiffness, bandwidth)) in phi.chunks_exact(theta.len()).zip(stiffness) {
            for (i, phi) in row.iter().enumerate() {
                mean[i] += phi * phi / (stiffness * course.len() as f64);
                peak[i] = peak[i].max(CRITICAL * phi * phi / (stiffness * bandwidth));
            }
        }
    }
    let gain = |(mean, peak): (&f64, &f64)| if *peak > 0.0 { 1.0 / (time * mean).max(*peak) } else { 0.0 };
    mean.iter().zip(&peak).map(gain).collect()
}
