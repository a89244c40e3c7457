//! Saturation control: a command beyond the robot's limits is scaled as a whole, so that the robot drives the same curve
//! more slowly instead of another curve.

use wheelwright_core::Reference;
use wheelwright_core::trajectory::Envelope;

/// Scales v_ref and omega_ref, whose places in `command` are given, alike until the limits on forward, angular and wheel
/// speed hold. Returns the share that is left, 1 for all of it. Commands of other kinds know no such limits.
pub fn saturate(envelope: &Envelope, places: [Option<usize>; 2], command: &mut [f64]) -> f64 {
    let value = |place: Option<usize>| place.map_or(0.0, |i| command[i]);
    let asked = Reference { v: value(places[0]), omega: value(places[1]), ..Reference::default() };
    let most = envelope.shares(&asked).into_iter().fold(1.0, f64::max);
    let share = 1.0 / most;
    places.into_iter().flatten().for_each(|i| command[i] *= share);
    share
}

#[cfg(test)]
mod tests {
    use wheelwright_core::profile::Limits;

    use super::*;

    #[test]
    fn the_curve_stays_and_the_wheels_are_within() {
        let limits = Limits { v: Some(1.0), omega: Some(4.0), wheel_speed: Some(10.0), ..Limits::default() };
        let envelope = Envelope { limits, track_width: Some(0.4), wheel_radius: Some(0.1) };
        let mut command = [0.9, 3.0];
        let share = saturate(&envelope, [Some(0), Some(1)], &mut command);
        assert!((share - 1.0 / 1.5).abs() < 1e-15 && (command[0] - 0.6).abs() < 1e-15 && (command[1] - 2.0).abs() < 1e-15);
        assert_eq!(saturate(&envelope, [Some(0), Some(1)], &mut command), 1.0);
        assert_eq!(saturate(&Envelope::default(), [Some(0), Some(1)], &mut [1e6, -1e6]), 1.0);
    }
}
