//! What becomes of the two clocks of a bag, and of messages that no clock can place.

use crate::ros_files::{Sent, bag1, db3, mcap};
use wheelwright_core::recording::{ReadOptions, Recording};

const MS: i64 = 1_000_000;

fn open(sent: &[Sent]) -> Result<Recording, String> {
    open_bytes(&mcap(sent, None), &[])
}

fn open_bytes(bytes: &[u8], topics: &[(&str, &str)]) -> Result<Recording, String> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let topics = topics.iter().map(|(role, topic)| ((*role).to_owned(), (*topic).to_owned())).collect();
    wheelwright_recordings::open(file.path(), &ReadOptions { topics, ..ReadOptions::default() }).map_err(|e| e.to_string())
}

fn speed(k: i64) -> f64 {
    (0.1 * k as f64).sin()
}

/// 100 rows at 20 Hz; row k is stamped at `stamp(50 k ms)`, logged at `log(50 k ms)`; a command of value k is logged with it.
fn bag(log: impl Fn(i64) -> i64, stamp: impl Fn(i64) -> i64) -> Vec<Sent> {
    let row = |k: i64| {
        let t = k * 50 * MS;
        [Sent::cmd(log(t), k as f64, -k as f64), Sent::odom(log(t), stamp(t), speed(k), -speed(k))]
    };
    (0..100).flat_map(row).collect()
}

#[track_caller]
fn warned(recording: &Recording, part: &str) {
    assert!(recording.warnings.iter().any(|w| w.contains(part)), "no `{part}` in {:?}", recording.warnings);
}

#[test]
fn bursts_of_log_times_do_not_reach_the_rows() {
    // Receiving is 9 ms late, and every fourth message 20 ms more.
    let late = |t: i64| if (t / (50 * MS)) % 4 == 3 { 29 * MS } else { 9 * MS };
    let recording = open(&bag(|t| t + late(t), |t| t)).unwrap();
    assert_eq!(recording.clock.source, "header stamp");
    assert_eq!(recording.clock.offset_s, Some(0.009));
    assert_eq!(recording.clock.jitter_s, Some((0.0, 0.020)));
    assert!(recording.time().windows(2).all(|w| (w[1] - w[0] - 0.05).abs() < 1e-12));
    // Row 3's command came 20 ms into its interval, row 2's holds until then.
    let v_ref = recording.column("v_ref").unwrap();
    assert_eq!(v_ref[..3], [0.0, 1.0, 2.0]);
    assert!((v_ref[3] - (0.4 * 2.0 + 0.6 * 3.0)).abs() < 1e-12);
    assert_eq!(v_ref[4], 4.0);
}

#[test]
fn frozen_stamps_while_moving_fall_back_to_log_time() {
    for frozen in [0, 5_000 * MS] {
        let recording = open(&bag(|t| t + 1_000 * MS, |_| frozen)).unwrap();
        assert_eq!(recording.clock.source, "log time");
        assert_eq!(recording.clock.offset_s, None);
        assert_eq!(recording.rows(), 100);
        assert_eq!(recording.column("v_ref").unwrap()[7], 7.0);
        warned(&recording, "header stamps do not advance");
    }
}

#[test]
fn standing_under_frozen_stamps_is_no_repetition() {
    let stop = |s: Sent| if (1_000 * MS..2_000 * MS).contains(&s.log) { Sent { v: 0.0, omega: 0.0, pose: [0.0; 3], ..s } } else { s };
    let recording = open(&bag(|t| t, |_| 0).into_iter().map(stop).collect::<Vec<_>>()).unwrap();
    assert_eq!(recording.rows(), 100);
}

#[test]
fn frozen_stamps_without_motion_are_refused_for_both_reasons() {
    let still: Vec<Sent> =
        bag(|t| t, |_| 77).into_iter().map(|s| if s.stamp.is_some() { Sent { v: 0.0, omega: 0.0, ..s } } else { s }).collect();
    let error = open(&still).unwrap_err();
    assert!(error.contains("topic `/odom`: frozen stamps and no motion: all 100 messages carry the one stamp"), "{error}");
    assert!(error.contains("use_sim_time"), "{error}");
}

#[test]
fn repeated_stamps_are_dropped_and_counted() {
    let mut sent = bag(|t| t + 2 * MS, |t| t);
    let twice = sent[41].clone();
    sent.insert(42, Sent { log: twice.log + MS, ..twice.clone() });
    sent.insert(42, Sent { log: twice.log + 2 * MS, v: 0.5, ..twice });
    let recording = open(&sent).unwrap();
    assert_eq!(recording.rows(), 100);
    assert_eq!(recording.column("v").unwrap()[20], speed(20));
    warned(&recording, "1 message(s) repeated stamp and content");
    warned(&recording, "1 message(s) with the stamp of the one before were dropped");
}

#[test]
fn messages_out_of_order_are_sorted_in() {
    let mut sent = bag(|t| t, |t| t);
    sent.reverse();
    let recording = open(&sent).unwrap();
    assert_eq!((recording.rows(), recording.column("v_ref").unwrap()[9]), (100, 9.0));
    assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
    let mut late = bag(|t| t, |t| t);
    late[21].log += 120 * MS; // odometry 10 is logged behind 11 and 12
    let recording = open(&late).unwrap();
    assert_eq!(recording.column("v").unwrap()[10], speed(10));
    warned(&recording, "1 message(s) arrived after later ones");
}

#[test]
fn a_clock_that_starts_anew_is_refused() {
    let error = open(&bag(|t| t, |t| if t < 2_500 * MS { t + 60_000 * MS } else { t })).unwrap_err();
    assert!(error.contains("topic `/odom`, message 51 in the order of log time: its stamp goes back from 62.45"), "{error}");
}

#[test]
fn stamps_of_a_simulation_slower_than_real_time_are_the_rows_clock() {
    // The simulation runs at half of real time; wall time is a time of day.
    let wall = |t: i64| 1_700_000_000_000 * MS + 2 * t;
    let recording = open(&bag(wall, |t| t)).unwrap();
    assert_eq!(recording.clock.source, "header stamp");
    assert!((recording.period() - 0.05).abs() < 1e-12);
    warned(&recording, "at 0.50 of real time");
    let v_ref = recording.column("v_ref").unwrap();
    assert!(v_ref.iter().enumerate().all(|(k, v)| (v - k as f64).abs() < 1e-12), "{v_ref:?}");
}

#[test]
fn a_simulation_at_real_time_is_one_offset_away() {
    let recording = open(&bag(|t| 1_700_000_000_000 * MS + t, |t| t)).unwrap();
    assert_eq!(recording.clock.offset_s, Some(1.7e9));
    assert_eq!(recording.column("v_ref").unwrap()[50], 50.0);
    assert_eq!(recording.time()[1], 0.05);
    warned(&recording, "two clocks (use_sim_time?)");
}

#[test]
fn the_slow_drift_of_two_computers_is_followed() {
    // 200 s in which one clock gains 1e-4: 20 ms, most of a period.
    let row = |k: i64| {
        let t = k * 50 * MS;
        let log = t + t / 8_000 + 3 * MS;
        [Sent::cmd(log, k as f64, 0.0), Sent::odom(log, t, speed(k), 0.0)]
    };
    let recording = open(&(0..4000).flat_map(row).collect::<Vec<_>>()).unwrap();
    let v_ref = recording.column("v_ref").unwrap();
    assert!(v_ref.iter().enumerate().all(|(k, v)| (v - k as f64).abs() < 1e-9), "{:?}", &v_ref[3990..]);
}

#[test]
fn stamps_that_wander_give_way_to_log_time() {
    let wander = |t: i64| if (t / (50 * MS)) % 20 < 10 { t } else { t - 600 * MS };
    let recording = open(&bag(|t| t, wander)).unwrap();
    assert_eq!(recording.clock.source, "log time");
    assert_eq!(recording.rows(), 100);
    warned(&recording, "wanders over 0.600 s");
}

#[test]
fn rows_before_the_first_command_stand_or_are_dropped() {
    let late: Vec<Sent> = bag(|t| t, |t| t).into_iter().filter(|s| s.stamp.is_some() || s.log >= 500 * MS).collect();
    let recording = open(&late).unwrap();
    assert_eq!(recording.rows(), 90);
    assert_eq!((recording.time()[0], recording.column("v_ref").unwrap()[0]), (0.5, 10.0));
    warned(&recording, "10 row(s) before the first command were dropped");
    let standing: Vec<Sent> = late.into_iter().map(|s| if s.log < 500 * MS { Sent { v: 0.001, omega: 0.0, ..s } } else { s }).collect();
    let recording = open(&standing).unwrap();
    assert_eq!(recording.rows(), 100);
    assert_eq!(recording.column("v_ref").unwrap()[8..11], [0.0, 0.0, 10.0]);
}

#[test]
fn commands_that_never_overlap_or_are_missing_are_said() {
    let after: Vec<Sent> =
        bag(|t| t, |t| t).into_iter().map(|s| if s.stamp.is_none() { Sent { log: s.log + 60_000 * MS, ..s } } else { s }).collect();
    let error = open(&after).unwrap_err();
    assert!(error.contains("topic `/cmd_vel`: its commands begin when the odometry ends"), "{error}");
    let none: Vec<Sent> = bag(|t| t, |t| t).into_iter().filter(|s| s.stamp.is_some()).collect();
    let recording = open(&none).unwrap();
    assert!(recording.column("v_ref").is_err());
    warned(&recording, "no commands");
    let early: Vec<Sent> = bag(|t| t, |t| t).into_iter().filter(|s| s.stamp.is_some() || s.log < 1_000 * MS).collect();
    warned(&open(&early).unwrap(), "no command in the last 4.000 s");
}

#[test]
fn the_only_topic_of_its_type_is_used_and_several_are_not_guessed_from() {
    let rename = |sent: Vec<Sent>, topic: &'static str| -> Vec<Sent> {
        sent.into_iter().map(|s| if s.stamp.is_some() { Sent { topic, ..s } } else { s }).collect()
    };
    let robot = rename(bag(|t| t, |t| t), "/nitrabot/odom");
    let recording = open(&robot).unwrap();
    warned(&recording, "no messages on `/odom`: `/nitrabot/odom`, the only topic of type nav_msgs/msg/Odometry, is used instead");
    let both = [robot, rename(bag(|t| t, |t| t), "/wheel/odom")].concat();
    let error = open(&both).unwrap_err();
    assert!(
        error.contains("several topics could be meant: /nitrabot/odom, /wheel/odom; choose one, as in --topic odom=/nitrabot/odom"),
        "{error}"
    );
    let chosen = open_bytes(&db3(&both), &[("odom", "wheel/odom"), ("cmd", "/cmd_vel")]).unwrap();
    assert!(chosen.streams.iter().all(|s| s.used == (s.name != "/nitrabot/odom")));
}

#[test]
fn numbers_that_are_none_are_refused_where_they_are() {
    for (index, name) in [(40, "topic `/cmd_vel`, message 21 in the order of time: linear.x = NaN"), (41, "row 21, column `v`: NaN")] {
        let mut sent = bag(|t| t, |t| t);
        sent[index].v = f64::NAN;
        for bytes in [mcap(&sent, Some(mcap::Compression::Lz4)), db3(&sent), bag1(&sent, "lz4")] {
            let error = open_bytes(&bytes, &[]).unwrap_err();
            assert!(error.contains(name), "{error}");
        }
    }
}

#[test]
fn nothing_that_moves_is_refused() {
    let still: Vec<Sent> = bag(|t| t, |t| t).into_iter().map(|s| Sent { v: 0.0, omega: 0.0, ..s }).collect();
    let error = open(&still).unwrap_err();
    assert!(error.contains("no motion"), "{error}");
}

#[test]
fn a_pose_that_is_not_filled_in_is_left_out() {
    let unset: Vec<Sent> = bag(|t| t, |t| t).into_iter().map(|s| Sent { pose: [0.0; 3], ..s }).collect();
    let recording = open(&unset).unwrap();
    assert!(recording.column("x").is_err() && recording.column("phi").is_err());
    warned(&recording, "the pose never changes while the robot moves");
}
