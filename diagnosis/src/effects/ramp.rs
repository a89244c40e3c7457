//! Courses of a command on its way to a goal.

/// Share of a command by which it misses its goal where it has come to it but for rounding.
const ROUNDING: f64 = 1e-12;

/// Time below which a rate is there at once \[s\].
const AT_ONCE: f64 = 1e-9;

/// Where a command is after a time on its way to a goal on which it settles.
pub(super) fn settled(from: f64, to: f64, rate: f64, time_constant: f64, span: f64) -> f64 {
    let far = (to - from).abs();
    let ramp = (far / rate - time_constant).max(0.0);
    if span < ramp {
        return from + (rate * span).copysign(to - from);
    }
    let left = if time_constant > 0.0 { far.min(rate * time_constant) * (-(span - ramp) / time_constant).exp() } else { 0.0 };
    to - left.copysign(to - from)
}

/// How far a command goes on its way before its rate changes, and which of the rates (for speeding up, slowing down, and slowing down in order to
/// reverse) it has until then.
pub(super) fn leg(from: f64, to: f64, rates: [f64; 3]) -> (f64, f64) {
    if from * to < 0.0 { (0.0, rates[2]) } else { (to, rates[usize::from(to.abs() < from.abs())]) }
}

/// Where a command is after a time on its way.
pub(super) fn ramped(from: f64, to: f64, rates: [f64; 3], span: f64) -> f64 {
    let (end, rate) = leg(from, to, rates);
    let way = (end - from).abs();
    if way > rate * span {
        from + (rate * span).copysign(end - from)
    } else if end == to {
        to
    } else {
        // On from zero.
        (rates[0] * (span - way / rate)).min(to.abs()).copysign(to)
    }
}

/// The quickest way to a goal, on which it comes to rest, for a command whose rate and jerk are limited.
pub(super) struct Eased {
    /// Where it is, and how fast it changes.
    from: [f64; 2],
    to: f64,
    jerk: f64,
    /// How long it has the jerk one way, none, and the jerk the other way.
    legs: [f64; 3],
}

impl Eased {
    /// From a place and a rate there; the limit of its jerk is that of its rate over the time in which it comes up to that.
    pub(super) fn new(from: [f64; 2], to: f64, rate: f64, rising: f64) -> Self {
        let ([at, pace], rising) = (from, rising.max(AT_ONCE));
        let jerk = rate / rising;
        let stops_within = pace * pace.abs() / (2.0 * jerk);
        let arrived = ROUNDING * at.abs().max(to.abs()).max(rate * rising);
        if rate.is_infinite() || (to - at).abs() <= arrived && stops_within.abs() <= arrived {
            return Self { from, to, jerk: 0.0, legs: [0.0; 3] };
        }
        let way = (to - at - stops_within).signum();
        let (far, pace) = (way * (to - at), way * pace);
        let most = (jerk * far + 0.5 * pace * pace).max(0.0).sqrt().min(rate);
        let steady = far - (most * most - 0.5 * pace * pace) / jerk;
        let legs = [(most - pace) / jerk, if most > 0.0 { steady / most } else { 0.0 }, most / jerk];
        Self { from, to, jerk: way * jerk, legs: legs.map(|time| time.max(0.0)) }
    }

    /// How long it takes to each end of a leg.
    pub(super) fn ends(&self) -> [f64; 3] {
        let [rises, steady, falls] = self.legs;
        [rises, rises + steady, rises + steady + falls]
    }

    /// Where it is after a time, and how fast it changes.
    pub(super) fn after(&self, span: f64) -> [f64; 2] {
        if span >= self.ends()[2] {
            return [self.to, 0.0];
        }
        let ([mut at, mut pace], mut left) = (self.from, span);
        for (time, jerk) in self.legs.iter().zip([self.jerk, 0.0, -self.jerk]) {
            let time = time.min(left);
            at += time * (pace + 0.5 * time * jerk);
            pace += time * jerk;
            left -= time;
        }
        [at, pace]
    }
}

#[cfg(test)]
mod tests {
    use super::Eased;

    /// Against steps of a tenth of a millisecond under the law that a firmware has: the rate that still comes to rest on the goal, with limited jerk.
    #[test]
    fn the_quickest_way_is_that_of_a_follower_with_limited_jerk() {
        let (rate, rising, step) = (0.8, 0.25, 1e-4);
        let jerk: f64 = rate / rising;
        for (from, to) in [([0.0, 0.0], 1.0), ([0.0, 0.0], 0.1), ([0.2, 0.5], -0.6), ([0.2, 0.7], 0.25), ([0.5, -0.3], 0.4)] {
            let way = Eased::new(from, to, rate, rising);
            let [mut at, mut pace] = from;
            for k in 1..=25_000 {
                let far: f64 = to - at;
                let wanted = rate.min((2.0 * jerk * far.abs()).sqrt()).copysign(far);
                pace += (wanted - pace).clamp(-jerk * step, jerk * step);
                at += step * pace;
                let [there, _] = way.after(step * f64::from(k));
                assert!((there - at).abs() < 2e-3, "{from:?} to {to}: {there} and {at} at {k}");
            }
            assert_eq!(way.after(10.0), [to, 0.0]);
        }
    }

    /// Every leg ends where the next one begins but for rounding, of which no leg is made.
    #[test]
    fn it_arrives() {
        for (rate, rising) in [(0.8, 0.25), (0.3, 1e-4), (5.0, 2.0), (0.02, 1e-9)] {
            for (from, to) in [(0.0, 0.3), (0.3, 0.0), (-0.7, 0.1), (0.1, 0.1 + 1e-9)] {
                let mut at = [from, 0.0];
                let mut legs = 0;
                while let Some(end) = Eased::new(at, to, rate, rising).ends().into_iter().find(|end| *end > 1e-11) {
                    at = Eased::new(Eased::new(at, to, rate, rising).after(0.5 * end), to, rate, rising).after(0.5 * end);
                    legs += 1;
                    assert!(legs < 20, "{rate} {rising} {from} {to}: {at:?}");
                }
                assert!((at[0] - to).abs() < 1e-9, "{rate} {rising} {from} {to}: {at:?}");
            }
        }
    }

    #[test]
    fn it_is_the_same_way_in_pieces() {
        let (rate, rising) = (0.8, 0.25);
        let whole = Eased::new([0.0, 0.0], 1.0, rate, rising);
        let mut in_pieces = [0.0, 0.0];
        for k in 1..=200 {
            in_pieces = Eased::new(in_pieces, 1.0, rate, rising).after(0.01);
            let [at, pace] = whole.after(0.01 * f64::from(k));
            assert!((in_pieces[0] - at).abs() < 1e-9 && (in_pieces[1] - pace).abs() < 1e-6, "{k}: {in_pieces:?} and {at} {pace}");
        }
    }
}
