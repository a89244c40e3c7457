//! One clock out of two: when the source stamped a message, and when the recorder received it.
//!
//! Odometry carries both times, a `Twist` only the second. Stamps are the better clock wherever they advance: log times
//! arrive in bursts, and differentiating on them would ruin a velocity. Commands are then carried from log time to stamps
//! by log − stamp of the odometry: its low quantile, since receiving can only be late, never early.

use wheelwright_core::recording::ClockReport;

use super::collect::Message;

/// Quantile of log − stamp that is taken as the offset between the clocks.
const OFFSET_QUANTILE: f64 = 0.05;
/// Spread of log − stamp (5 % to 95 %) up to which stamps and log times are held to be two views of one clock \[ns\].
const STABLE_SPREAD: i64 = 250_000_000;
/// Rates at which log − stamp may drift before the two clocks are held to run at different speeds (clocks of computers stay
/// below 1e-4; a simulation at 99 % of real time gives 1e-2).
const SAME_RATE: f64 = 1e-3;
/// Drift over a whole recording below which the offset is constant \[ns\].
const CONSTANT_DRIFT: f64 = 20e6;

/// How log times become row times.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum ClockMap {
    /// Rows are on log time.
    Log,
    /// Rows are on stamps: stamp = log − offset − rate (log − origin).
    Offset { offset: i64, rate: f64, origin: i64 },
    /// Rows are on stamps that run at their own speed: interpolated between pairs (log, stamp), both nondecreasing.
    Pairs(Vec<(i64, i64)>),
}

impl ClockMap {
    /// The row time \[ns\] of a log time \[ns\].
    pub(crate) fn row_time(&self, log: i64) -> i64 {
        match self {
            Self::Log => log,
            Self::Offset { offset, rate, origin } => {
                let drift = (rate * log.saturating_sub(*origin) as f64).round() as i64;
                log.saturating_sub(*offset).saturating_sub(drift)
            }
            Self::Pairs(pairs) => interpolate(pairs, log),
        }
    }

    /// The row time of an odometry message.
    pub(crate) fn time_of(&self, message: &Message) -> i64 {
        match self {
            Self::Log => message.log,
            _ => message.motion.stamp.unwrap_or(message.log),
        }
    }

    /// True if rows are on stamps.
    pub(crate) fn uses_stamps(&self) -> bool {
        *self != Self::Log
    }
}

fn interpolate(pairs: &[(i64, i64)], log: i64) -> i64 {
    let after = pairs.partition_point(|p| p.0 <= log);
    let last = pairs.len().saturating_sub(1);
    let (Some(from), Some(to)) = (pairs.get(after.clamp(1, last.max(1)) - 1), pairs.get(after.clamp(1, last.max(1)))) else {
        return log;
    };
    let span = to.0.saturating_sub(from.0);
    let share = if span > 0 { log.saturating_sub(from.0) as f64 / span as f64 } else { 0.0 };
    from.1.saturating_add((share * to.1.saturating_sub(from.1) as f64).round() as i64)
}

/// True if at least half of the steps between consecutive messages advance the stamp.
pub(crate) fn stamps_advance(messages: &[Message]) -> bool {
    let advancing = messages.windows(2).filter(|w| w[1].motion.stamp > w[0].motion.stamp).count();
    messages.iter().all(|m| m.motion.stamp.is_some()) && advancing * 2 >= messages.len().saturating_sub(1)
}

/// What was found about the two clocks.
pub(crate) struct Clocks {
    /// The mapping to row times.
    pub(crate) map: ClockMap,
    /// For the recording.
    pub(crate) report: ClockReport,
    /// What the user should know.
    pub(crate) warning: Option<String>,
}

/// Chooses the clock of the rows from odometry in the order of its log times, `topic` for messages.
pub(crate) fn choose(messages: &[Message], topic: &str) -> Clocks {
    let on_log = |warning: Option<String>| Clocks {
        map: ClockMap::Log,
        report: ClockReport { source: "log time".to_owned(), ..ClockReport::default() },
        warning,
    };
    if messages.is_empty() || !stamps_advance(messages) {
        return on_log(Some(format!(
            "`{topic}`: header stamps do not advance with the messages; log times are used, which carry the jitter of the recorder"
        )));
    }
    let lag: Vec<(i64, i64)> = messages.iter().filter_map(|m| Some((m.log, m.log.saturating_sub(m.motion.stamp?)))).collect();
    let drift = Drift::of(&lag);
    if drift.rate.abs() > SAME_RATE && drift.is_steady(&lag) {
        let mut pairs: Vec<(i64, i64)> = lag.iter().map(|(log, lag)| (*log, log.saturating_sub(*lag))).collect();
        make_nondecreasing(&mut pairs);
        let report = ClockReport { source: "header stamp".to_owned(), ..ClockReport::default() };
        let warning = format!(
            "`{topic}`: log − stamp drifts by {:.3} s a second: stamps come from a clock of their own (use_sim_time, a simulation at {:.2} of real \
             time?); rows are on stamps, commands are carried over by the odometry messages around them",
            drift.rate,
            1.0 - drift.rate
        );
        return Clocks { map: ClockMap::Pairs(pairs), report, warning: Some(warning) };
    }
    let rate = if (drift.rate * drift.span).abs() > CONSTANT_DRIFT && drift.rate.abs() <= SAME_RATE { drift.rate } else { 0.0 };
    let origin = lag[0].0;
    let rest = without_drift(&lag, rate);
    let spread = quantile(&rest, 0.95).saturating_sub(quantile(&rest, 0.05));
    let limit = STABLE_SPREAD.max(median_step(messages).saturating_mul(5));
    if spread > limit {
        return on_log(Some(format!(
            "`{topic}`: log − stamp wanders over {:.3} s without a steady drift; log times are used, which carry the jitter of the recorder",
            seconds(spread)
        )));
    }
    let offset = quantile(&rest, OFFSET_QUANTILE);
    let above = |q: f64| seconds(quantile(&rest, q).saturating_sub(offset));
    let report =
        ClockReport { source: "header stamp".to_owned(), offset_s: Some(seconds(offset)), jitter_s: Some((above(0.5), above(0.95))) };
    let warning = (offset.abs() > 1_000_000_000).then(|| {
        format!(
            "`{topic}`: log time is {:.3} s ahead of the header stamps: two clocks (use_sim_time?); commands are shifted by it",
            seconds(offset)
        )
    });
    Clocks { map: ClockMap::Offset { offset, rate, origin }, report, warning }
}

/// How log − stamp changes over the recording, from the medians of its first and last quarter.
struct Drift {
    /// Seconds a second.
    rate: f64,
    /// Length of the recording \[ns\].
    span: f64,
}

impl Drift {
    fn of(lag: &[(i64, i64)]) -> Self {
        let quarter = (lag.len() / 4).max(1);
        let middle = |part: &[(i64, i64)]| {
            let median = |mut values: Vec<i64>| {
                values.sort_unstable();
                quantile(&values, 0.5)
            };
            (median(part.iter().map(|p| p.0).collect()), median(part.iter().map(|p| p.1).collect()))
        };
        let (first, last) = (middle(&lag[..quarter]), middle(&lag[lag.len() - quarter..]));
        let between = last.0.saturating_sub(first.0) as f64;
        let rate = if between > 0.0 { last.1.saturating_sub(first.1) as f64 / between } else { 0.0 };
        Self { rate, span: lag[lag.len() - 1].0.saturating_sub(lag[0].0) as f64 }
    }

    /// True if the line explains most of the change: the spread around it is less than half of what it drifts.
    fn is_steady(&self, lag: &[(i64, i64)]) -> bool {
        let rest = without_drift(lag, self.rate);
        let spread = quantile(&rest, 0.95).saturating_sub(quantile(&rest, 0.05));
        (spread as f64) < 0.5 * (self.rate * self.span).abs()
    }
}

/// Sorted values of log − stamp \[ns\] with a drift of `rate` from the first message on taken out.
fn without_drift(lag: &[(i64, i64)], rate: f64) -> Vec<i64> {
    let origin = lag[0].0;
    let mut rest: Vec<i64> =
        lag.iter().map(|(log, lag)| lag.saturating_sub((rate * log.saturating_sub(origin) as f64).round() as i64)).collect();
    rest.sort_unstable();
    rest
}

/// Stamps that arrive out of order would make the mapping go back.
fn make_nondecreasing(pairs: &mut [(i64, i64)]) {
    let mut highest = i64::MIN;
    for pair in pairs {
        highest = highest.max(pair.1);
        pair.1 = highest;
    }
}

fn median_step(messages: &[Message]) -> i64 {
    let stamps = messages.iter().filter_map(|m| m.motion.stamp).collect::<Vec<i64>>();
    let mut steps: Vec<i64> = stamps.windows(2).map(|w| w[1].saturating_sub(w[0]).max(0)).collect();
    steps.sort_unstable();
    quantile(&steps, 0.5)
}

/// The value below which a share of the sorted values lies; zero for none.
fn quantile(sorted: &[i64], share: f64) -> i64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((share * last as f64).round() as usize).copied().unwrap_or(0)
}

/// Nanoseconds as seconds.
pub(crate) fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}
