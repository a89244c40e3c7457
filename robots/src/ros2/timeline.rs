//! When odometry was measured: by the robot's stamps where they can tell, else by arrival.

use std::time::Instant;

use wheelwright_core::robot::RobotError;

use super::TimeSource;
use super::message::Time;
use crate::wire::config;

/// One message in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// `header.stamp` \[ns\].
    pub stamp: i64,
    /// When it came.
    pub arrival: Instant,
}

/// How often odometry comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rhythm {
    /// What tells the time.
    pub source: TimeSource,
    /// Odometry's period \[s\] by that.
    pub cycle: f64,
    /// The same by this machine's clock \[s\]; a slow simulation has another.
    pub interval: f64,
}

impl Rhythm {
    /// From the first few messages. Stamps tell the time if they never go back and most of them advance.
    pub(super) fn of(first: &[Moment], wanted: Option<TimeSource>) -> Result<Self, RobotError> {
        let steps = |time: fn(&Moment, &Moment) -> f64| -> Vec<f64> { first.windows(2).map(|pair| time(&pair[0], &pair[1])).collect() };
        let arrivals = steps(|a, b| b.arrival.duration_since(a.arrival).as_secs_f64());
        let stamps = steps(|a, b| 1e-9 * b.stamp.saturating_sub(a.stamp) as f64);
        let advancing: Vec<f64> = stamps.iter().copied().filter(|step| *step > 0.0).collect();
        let tell = stamps.iter().all(|step| *step >= 0.0) && 2 * advancing.len() > stamps.len();
        if wanted == Some(TimeSource::Stamp) && !tell {
            return Err(config("time", "is `stamp`, but the stamps of the odometry stand still or go back: leave it out"));
        }
        let source = wanted.unwrap_or(if tell { TimeSource::Stamp } else { TimeSource::Arrival });
        // Messages come in bursts; their mean knows nothing of it.
        let interval = arrivals.iter().sum::<f64>() / arrivals.len().max(1) as f64;
        let cycle = if source == TimeSource::Stamp { median(advancing) } else { interval };
        // Finer differences are those of the clocks.
        Ok(Self { source, cycle: (1e6 * cycle).round() / 1e6, interval })
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// The time of the messages since the first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Timeline {
    source: TimeSource,
    origin: Moment,
    last: Moment,
}

impl Timeline {
    /// A time that begins with a message.
    pub(super) fn new(source: TimeSource, origin: Moment) -> Self {
        Self { source, origin, last: origin }
    }

    /// The time of a message \[s\]; `None` if it is not newer than the last, as one that came twice or overtaken.
    pub(super) fn advance(&mut self, moment: Moment) -> Option<f64> {
        let newer = match self.source {
            TimeSource::Stamp => moment.stamp > self.last.stamp,
            TimeSource::Arrival => moment.arrival > self.last.arrival,
        };
        newer.then(|| {
            self.last = moment;
            match self.source {
                TimeSource::Stamp => 1e-9 * moment.stamp.saturating_sub(self.origin.stamp) as f64,
                TimeSource::Arrival => moment.arrival.duration_since(self.origin.arrival).as_secs_f64(),
            }
        })
    }

    /// Now, by the robot's own clock, as robots compare it with when a command comes; the stamp that means now where that clock is
    /// not known.
    pub(super) fn now(&self) -> Time {
        match self.source {
            TimeSource::Stamp => Time::from_nanoseconds(self.last.stamp.saturating_add(self.last.arrival.elapsed().as_nanos() as i64)),
            TimeSource::Arrival => Time::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Messages at 50 Hz with stamps \[ms\].
    fn moments(stamps: &[i64]) -> Vec<Moment> {
        let begin = Instant::now();
        let moment = |(i, stamp): (usize, &i64)| Moment { stamp: stamp * 1_000_000, arrival: begin + Duration::from_millis(20 * i as u64) };
        stamps.iter().enumerate().map(moment).collect()
    }

    #[test]
    fn stamps_tell_the_time_if_they_can() {
        // A simulation at half the speed, with one message that came twice.
        let slow = Rhythm::of(&moments(&[100, 110, 110, 120, 130]), None).unwrap();
        assert_eq!((slow.source, slow.cycle), (TimeSource::Stamp, 0.01));
        assert!((slow.interval - 0.02).abs() < 1e-9);
        for useless in [[0, 0, 0, 0], [9, 8, 7, 6], [1, 1, 1, 2]] {
            let arrivals = Rhythm::of(&moments(&useless), None).unwrap();
            assert_eq!((arrivals.source, arrivals.cycle), (TimeSource::Arrival, 0.02));
            assert!(Rhythm::of(&moments(&useless), Some(TimeSource::Stamp)).is_err());
        }
    }

    #[test]
    fn what_came_twice_or_was_overtaken_is_not_newer() {
        let moments = moments(&[100, 120, 120, 110, 140]);
        let mut timeline = Timeline::new(TimeSource::Stamp, moments[0]);
        let times: Vec<_> = moments[1..].iter().map(|m| timeline.advance(*m)).collect();
        assert_eq!(times, [Some(0.02), None, None, Some(0.04)]);
        assert!(timeline.now().nanoseconds() >= 140_000_000);
        assert_eq!(Timeline::new(TimeSource::Arrival, moments[0]).now(), Time::default());
    }
}
