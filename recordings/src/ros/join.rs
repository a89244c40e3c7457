//! From two topics to rows: odometry gives the times, commands are held onto them.

use std::path::Path;

use wheelwright_core::recording::{ClockReport, Column, ReadError, ReadOptions, Recording, RecordingError, Source};

use super::clock::{self, ClockMap, Clocks, seconds};
use super::collect::{Collector, Message, Topic, malformed, streams};
use super::hold::{SNAP_SHARE, held_means};
use super::message::Kind;
use super::select::{Role, inventory, select};

/// Velocities up to which a robot counts as standing \[m/s, rad/s\].
const STANDING: f64 = 0.01;
/// Stamps beyond this are times of day: the recording then starts at zero, since a double holds such times only to a
/// quarter of a microsecond. Below, as in a simulation, they are kept. \[ns\]
const TIME_OF_DAY: i64 = 100_000_000 * 1_000_000_000;
/// A stamp that goes back by more is a restarted clock, not a late message \[ns\].
const LATE: i64 = 1_000_000_000;

/// Builds the recording from what was collected.
///
/// # Errors
/// See [`select`]; `Malformed` without odometry and commands, for frozen stamps without motion and a clock that starts
/// anew; `Content` for values that are not finite.
pub(crate) fn recording(collector: Collector, path: &Path, format: &str, options: &ReadOptions) -> Result<Recording, ReadError> {
    if let Some((role, _)) = options.topics.iter().find(|(role, _)| role != "cmd" && role != "odom") {
        return Err(malformed(format!("--topic {role}=…"), "no such role; the roles are cmd and odom"));
    }
    let (topics, mut warnings) = collector.into_topics();
    let odom = select(Role::Odom, &topics, options, &mut warnings)?;
    let cmd = select(Role::Cmd, &topics, options, &mut warnings)?;
    let rows = match (odom, cmd) {
        (Some(odom), cmd) => driven(odom, cmd, &mut warnings)?,
        (None, Some(cmd)) => {
            warnings.push(format!("no odometry: the recording holds commands only; {}; choose with --topic odom=NAME", inventory(&topics)));
            commands_only(cmd)?
        }
        (None, None) => {
            let hint = "nothing to identify from: nav_msgs/Odometry is needed; name the topic, as in --topic odom=/robot/odom";
            return Err(malformed("topics", format!("{}; {hint}", inventory(&topics))));
        }
    };
    let used: Vec<(&str, &str)> = odom.iter().chain(&cmd).map(|t| (t.name.as_str(), t.kind.as_str())).collect();
    let source = Source { path: path.to_owned(), format: format.to_owned() };
    let times = row_seconds(&rows.times);
    let mut recording = Recording::new(source, times, rows.columns, None)?;
    recording.require_motion(&["v", "omega", "v_ref", "omega_ref"])?;
    if recording.require_motion(&["v", "omega"]).is_err() {
        warnings.push("the measured velocities never change: nothing can be learned from them".to_owned());
    }
    recording.clock = rows.clock;
    recording.streams = streams(&topics, &used);
    recording.warnings = warnings;
    Ok(recording)
}

/// Rows before they are a recording.
struct Rows {
    times: Vec<i64>,
    columns: Vec<Column>,
    clock: ClockReport,
}

fn row_seconds(times: &[i64]) -> Vec<f64> {
    let origin = times.first().copied().filter(|t| *t >= TIME_OF_DAY).unwrap_or(0);
    times.iter().map(|t| seconds(t.saturating_sub(origin))).collect()
}

/// Rows at the times of the odometry.
fn driven(odom: &Topic, cmd: Option<&Topic>, warnings: &mut Vec<String>) -> Result<Rows, ReadError> {
    let mut messages = odom.messages.clone();
    messages.sort_by_key(|m| m.log);
    refuse_frozen(odom, &messages)?;
    drop_repeats(&mut messages, &odom.name, warnings);
    if clock::stamps_advance(&messages) {
        refuse_restart(odom, &messages)?;
    }
    let Clocks { map, report, warning } = clock::choose(&messages, &odom.name);
    warnings.extend(warning);
    order_rows(&mut messages, &map, odom, warnings);
    if messages.len() < 2 {
        return Err(RecordingError::TooShort { rows: messages.len() }.into());
    }
    let held = match cmd {
        Some(cmd) => Some(commands(cmd, &map, &messages, warnings)?),
        None => {
            warnings.push(
                "no commands (geometry_msgs/Twist or TwistStamped): the recording holds odometry only; --topic cmd=NAME names a topic"
                    .to_owned(),
            );
            None
        }
    };
    let first = held.as_ref().map_or(0, |h| h.first);
    let rows = &messages[first..];
    let mut columns = motion_columns(rows, warnings);
    if let Some(held) = held {
        columns.push(Column::new("v_ref", held.v));
        columns.push(Column::new("omega_ref", held.omega));
    }
    Ok(Rows { times: rows.iter().map(|m| map.time_of(m)).collect(), columns, clock: report })
}

/// One stamp on every message is survivable while the robot moves: log times remain. With nothing moving either, the
/// publisher was not running.
fn refuse_frozen(odom: &Topic, messages: &[Message]) -> Result<(), ReadError> {
    let [first, .., _] = messages else {
        return Ok(());
    };
    let frozen = messages.iter().all(|m| m.motion.stamp == first.motion.stamp);
    let still = messages.iter().all(|m| (m.motion.v, m.motion.omega) == (first.motion.v, first.motion.omega));
    if !(frozen && still) {
        return Ok(());
    }
    let stamp = first.motion.stamp.map_or(0.0, seconds);
    let velocities = format!("v = {} m/s, omega = {} rad/s", first.motion.v, first.motion.omega);
    Err(malformed(
        format!("topic `{}`", odom.name),
        format!(
            "frozen stamps and no motion: all {} messages carry the one stamp {stamp:.9} s and the one velocity {velocities}; the publisher was not running \
             (check use_sim_time and the robot's driver), or choose another topic with --topic odom=NAME",
            messages.len()
        ),
    ))
}

/// Messages sent twice, stamp and content alike. On a clock that stands, messages of a robot that stands look the same.
fn drop_repeats(messages: &mut Vec<Message>, topic: &str, warnings: &mut Vec<String>) {
    let mut distinct = messages.clone();
    distinct.dedup_by(|later, earlier| later.motion.stamp.is_some() && later.motion == earlier.motion);
    let repeats = messages.len() - distinct.len();
    if repeats > 0 && clock::stamps_advance(&distinct) {
        warnings.push(format!("`{topic}`: {repeats} message(s) repeated stamp and content of the one before and were dropped"));
        *messages = distinct;
    }
}

/// Stamps that go back belong to two runs in one bag, on whichever clock their rows would be.
fn refuse_restart(odom: &Topic, messages: &[Message]) -> Result<(), ReadError> {
    let mut highest = i64::MIN;
    for (number, stamp) in messages.iter().filter_map(|m| m.motion.stamp).enumerate() {
        if stamp < highest.saturating_sub(LATE) {
            return Err(malformed(
                format!("topic `{}`, message {} in the order of log time", odom.name, number + 1),
                format!(
                    "its stamp goes back from {:.9} s to {:.9} s: the clock was set or the simulation started anew; cut the bag there",
                    seconds(highest),
                    seconds(stamp)
                ),
            ));
        }
        highest = highest.max(stamp);
    }
    Ok(())
}

/// Sorts messages by row time and drops equal times, of which the first message is kept.
fn order_rows(messages: &mut Vec<Message>, map: &ClockMap, odom: &Topic, warnings: &mut Vec<String>) {
    let mut highest = i64::MIN;
    let mut late = 0;
    for time in messages.iter().map(|m| map.time_of(m)) {
        late += usize::from(time < highest);
        highest = highest.max(time);
    }
    if late > 0 {
        warnings.push(format!("`{}`: {late} message(s) arrived after later ones and were sorted in by their stamps", odom.name));
    }
    messages.sort_by_key(|m| map.time_of(m));
    let before = messages.len();
    messages.dedup_by_key(|m| map.time_of(m));
    if messages.len() < before {
        let clock = if map.uses_stamps() { "stamp" } else { "log time" };
        warnings.push(format!("`{}`: {} message(s) with the {clock} of the one before were dropped", odom.name, before - messages.len()));
    }
}

/// Measured velocities, and the pose where the publisher fills it in.
fn motion_columns(rows: &[Message], warnings: &mut Vec<String>) -> Vec<Column> {
    let column = |name: &str, value: fn(&Message) -> f64| Column::new(name, rows.iter().map(value).collect());
    let mut columns = vec![column("v", |m| m.motion.v), column("omega", |m| m.motion.omega)];
    let moving = |columns: &[Column]| columns.iter().any(|c| c.values.iter().any(|value| *value != c.values[0]));
    let mut pose = vec![column("x", |m| m.motion.pose.x), column("y", |m| m.motion.pose.y), column("phi", |m| m.motion.pose.yaw)];
    match (moving(&columns), moving(&pose)) {
        (true, false) => warnings.push("the pose never changes while the robot moves: x, y and phi are left out".to_owned()),
        (false, true) => {
            warnings
                .push("the pose changes but the velocities never do: the publisher of the odometry does not fill in its twist".to_owned());
            unwrap(&mut pose[2].values);
            columns.extend(pose);
        }
        _ => {
            unwrap(&mut pose[2].values);
            columns.extend(pose);
        }
    }
    columns
}

/// Takes the jumps by a turn out of an angle \[rad\].
fn unwrap(angle: &mut [f64]) {
    use std::f64::consts::TAU;
    let mut turns = 0.0;
    for row in 1..angle.len() {
        let step = angle[row] + turns - angle[row - 1];
        if step.is_finite() {
            turns -= TAU * (step / TAU).round();
        }
        angle[row] += turns;
    }
}

/// Commands on the rows from `first` on.
struct Held {
    first: usize,
    v: Vec<f64>,
    omega: Vec<f64>,
}

fn commands(cmd: &Topic, map: &ClockMap, rows: &[Message], warnings: &mut Vec<String>) -> Result<Held, ReadError> {
    let mut sent: Vec<(i64, f64, f64)> =
        command_times(cmd, map, rows).zip(&cmd.messages).map(|(t, m)| (t, m.motion.v, m.motion.omega)).collect();
    sent.sort_by_key(|s| s.0);
    refuse_infinite(cmd, &sent)?;
    let grid: Vec<i64> = rows.iter().map(|m| map.time_of(m)).collect();
    let mut steps: Vec<f64> = grid.windows(2).map(|w| w[1].saturating_sub(w[0]) as f64).collect();
    let snap = (wheelwright_core::recording::median(&mut steps) * SNAP_SHARE) as i64;
    let begin = sent.first().map_or(i64::MAX, |s| s.0.saturating_sub(snap));
    let before = grid.partition_point(|t| *t < begin);
    let standing = rows[..before].iter().all(|m| m.motion.v.abs() <= STANDING && m.motion.omega.abs() <= STANDING);
    if before > 0 && standing && before < grid.len() {
        // A robot that stands and was sent nothing yet stands on the command zero.
        sent.insert(0, (i64::MIN, 0.0, 0.0));
    }
    let (times, v): (Vec<i64>, Vec<f64>) = sent.iter().map(|s| (s.0, s.1)).unzip();
    let omega: Vec<f64> = sent.iter().map(|s| s.2).collect();
    let (v, omega) = (held_means(&times, &v, &grid, snap), held_means(&times, &omega, &grid, snap));
    let first = v.iter().position(Option::is_some).unwrap_or(rows.len());
    if rows.len() - first < 2 {
        return Err(malformed(
            format!("topic `{}`", cmd.name),
            "its commands begin when the odometry ends: nothing overlaps; check the clocks of both topics".to_owned(),
        ));
    }
    if first > 0 {
        warnings.push(format!("{first} row(s) before the first command were dropped: the robot moved, and what drove it is unknown"));
    }
    warn_of_silence(cmd, &times, &grid, warnings);
    Ok(Held { first, v: v.into_iter().flatten().collect(), omega: omega.into_iter().flatten().collect() })
}

/// Row times of the commands: their own stamps, if they have any that advance on the same clock as the odometry's, else
/// their log times mapped.
fn command_times<'a>(cmd: &'a Topic, map: &'a ClockMap, rows: &[Message]) -> impl Iterator<Item = i64> + 'a {
    let lag = |messages: &[Message]| {
        let mut lags: Vec<f64> = messages.iter().filter_map(|m| Some(m.log.saturating_sub(m.motion.stamp?) as f64)).collect();
        wheelwright_core::recording::median(&mut lags)
    };
    let same_clock = (lag(&cmd.messages) - lag(rows)).abs() <= LATE as f64;
    let stamped = map.uses_stamps() && cmd.message_kind() == Some(Kind::TwistStamped) && clock::stamps_advance(&cmd.messages) && same_clock;
    cmd.messages.iter().map(move |m| m.motion.stamp.filter(|_| stamped).unwrap_or_else(|| map.row_time(m.log)))
}

fn refuse_infinite(cmd: &Topic, sent: &[(i64, f64, f64)]) -> Result<(), ReadError> {
    match sent.iter().position(|s| !(s.1.is_finite() && s.2.is_finite())) {
        Some(index) => Err(malformed(
            format!("topic `{}`, message {} in the order of time", cmd.name, index + 1),
            format!("linear.x = {}, angular.z = {}: not finite numbers", sent[index].1, sent[index].2),
        )),
        None => Ok(()),
    }
}

/// Commands that stop long before the odometry does: many drivers then stop the robot by themselves.
fn warn_of_silence(cmd: &Topic, times: &[i64], grid: &[i64], warnings: &mut Vec<String>) {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1].saturating_sub(w[0]) as f64).collect();
    let usual = wheelwright_core::recording::median(&mut steps);
    if let (Some(last), Some(end)) = (times.last(), grid.last()) {
        let silence = end.saturating_sub(*last);
        if silence as f64 > 10.0 * usual && silence > LATE {
            warnings.push(format!(
                "`{}`: no command in the last {:.3} s; the last one is held, though a robot with a watchdog would have stopped",
                cmd.name,
                seconds(silence)
            ));
        }
    }
}

/// A recording of what was sent, for simulation.
fn commands_only(cmd: &Topic) -> Result<Rows, ReadError> {
    let mut messages = cmd.messages.clone();
    messages.sort_by_key(|m| m.log);
    let stamped = clock::stamps_advance(&messages);
    let time = |m: &Message| m.motion.stamp.filter(|_| stamped).unwrap_or(m.log);
    messages.sort_by_key(time);
    // Of commands at one time, the last one acts.
    messages.reverse();
    messages.dedup_by_key(|m| time(m));
    messages.reverse();
    let column = |name: &str, value: fn(&Message) -> f64| Column::new(name, messages.iter().map(value).collect());
    let columns = vec![column("v_ref", |m| m.motion.v), column("omega_ref", |m| m.motion.omega)];
    let source = if stamped { "header stamp" } else { "log time" };
    let clock = ClockReport { source: source.to_owned(), ..ClockReport::default() };
    Ok(Rows { times: messages.iter().map(time).collect(), columns, clock })
}
