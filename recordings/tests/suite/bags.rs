//! Every bag of the shared collection, written by programs that are not ours, is read with its known content or refused
//! with the reason.

use std::path::{Path, PathBuf};

use wheelwright_core::recording::{ReadOptions, Recording};

fn bags() -> Option<PathBuf> {
    let shared = std::env::var_os("WHEELWRIGHT_SHARED").map(PathBuf::from);
    let shared = shared.unwrap_or_else(|| Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).to_owned());
    let bags = shared.join("bags");
    if !bags.is_dir() {
        println!("SKIPPED: no folder {}", bags.display());
        return None;
    }
    Some(bags)
}

fn open(path: &Path) -> Recording {
    open_with(path, &[])
}

fn open_with(path: &Path, topics: &[(&str, &str)]) -> Recording {
    match wheelwright_recordings::open(path, &options(topics)) {
        Ok(recording) => recording,
        Err(e) => panic!("{}: {e}", path.display()),
    }
}

fn options(topics: &[(&str, &str)]) -> ReadOptions {
    let topics = topics.iter().map(|(role, topic)| ((*role).to_owned(), (*topic).to_owned())).collect();
    ReadOptions { topics, ..ReadOptions::default() }
}

fn refusal(path: &Path) -> String {
    match wheelwright_recordings::open(path, &ReadOptions::default()) {
        Ok(_) => panic!("{} was read", path.display()),
        Err(e) => e.to_string(),
    }
}

/// The files and folders whose odometry follows its commands.
const DRIVEN: [&str; 11] = [
    "db3_plain",
    "db3_plain/db3_plain.db3",
    "db3_zstd_file",
    "db3_zstd_file/db3_zstd_file.db3.zstd",
    "db3_zstd_message",
    "db3_zstd_message/db3_zstd_message.db3",
    "mcap_plain/metadata.yaml",
    "mcap_plain/mcap_plain.mcap",
    "mcap_zstd_storage",
    "ros1_plain.bag",
    "ros1_bz2.bag",
];

fn command(k: usize) -> (f64, f64) {
    (0.3 * (0.02 * k as f64).sin(), 0.8 * (0.045 * k as f64).sin())
}

fn assert_near(name: &str, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{name}");
    for (row, (f, e)) in found.iter().zip(expected).enumerate() {
        assert!((f - e).abs() <= 1e-12, "{name}, row {row}: {f} instead of {e}");
    }
}

/// The odometry that the writers computed: each step follows the command sent at that step.
fn odometry() -> (Vec<f64>, Vec<f64>) {
    let (mut v, mut omega) = (0.0, 0.0);
    (0..200)
        .map(|k| {
            let (v_cmd, omega_cmd) = command(k);
            v += (v_cmd - v) * 0.2;
            omega += (omega_cmd - omega) * 0.05 / 0.18;
            (v, omega)
        })
        .unzip()
}

#[test]
fn every_container_holds_the_same_drive() {
    let Some(bags) = bags() else { return };
    let (v, omega) = odometry();
    let (v_ref, omega_ref): (Vec<f64>, Vec<f64>) = (0..200).map(command).unzip();
    let time: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.05).collect();
    for name in DRIVEN.iter().chain(&["ros1_lz4.bag", "db3_plain/metadata.yaml", "mcap_zstd_storage/mcap_zstd_storage.mcap"]) {
        let recording = open(&bags.join(name));
        assert_near(name, recording.time(), &time);
        assert_near(name, recording.column("v").unwrap(), &v);
        assert_near(name, recording.column("omega").unwrap(), &omega);
        // Command k is received 2 ms before odometry k is stamped, once the 5 ms between log time and stamp are taken off:
        // 4 % of a period, within the snap, so row k holds command k exactly.
        assert_near(name, recording.column("v_ref").unwrap(), &v_ref);
        assert_near(name, recording.column("omega_ref").unwrap(), &omega_ref);
        assert_eq!(recording.clock.source, "header stamp", "{name}");
        assert_eq!(recording.clock.offset_s, Some(0.005), "{name}");
        assert_eq!(recording.clock.jitter_s, Some((0.0, 0.0)), "{name}");
        let streams: Vec<_> = recording.streams.iter().map(|s| (s.name.as_str(), s.count, s.used)).collect();
        assert_eq!(streams, [("/cmd_vel", 200, true), ("/cmd_vel_stamped", 200, false), ("/odom", 200, true)], "{name}");
        assert_eq!(recording.warnings.iter().filter(|w| !w.contains("pose")).count(), 0, "{name}: {:?}", recording.warnings);
    }
}

#[test]
fn stamped_commands_keep_their_own_stamps() {
    let Some(bags) = bags() else { return };
    // Command k is stamped at its step, 3 ms behind the stamp of odometry k: 6 % of a row's interval before it still belong to
    // the command before.
    let v_ref: Vec<f64> = (0..200usize)
        .map(|k| if k == 0 || k == 199 { command(k.saturating_sub(k / 199)).0 } else { 0.06 * command(k - 1).0 + 0.94 * command(k).0 })
        .collect();
    for name in ["db3_plain", "mcap_plain", "ros1_lz4.bag"] {
        let recording = open_with(&bags.join(name), &[("cmd", "/cmd_vel_stamped")]);
        assert_near(name, recording.column("v_ref").unwrap(), &v_ref);
        assert!(recording.streams.iter().all(|s| s.used == (s.name != "/cmd_vel")));
    }
}

#[test]
fn bags_of_the_reference_writers_are_read() {
    let Some(bags) = bags() else { return };
    let (v_ref, omega_ref): (Vec<f64>, Vec<f64>) = (0..200).map(command).unzip();
    for name in ["off_none.mcap", "off_lz4.mcap", "off_zstd.mcap"] {
        let recording = open(&bags.join(name));
        assert_near(name, recording.column("v_ref").unwrap(), &v_ref);
        assert_near(name, recording.column("omega_ref").unwrap(), &omega_ref);
        assert!(
            recording.warnings.iter().any(|w| w.contains("no odometry") && w.contains("/cmd_vel (geometry_msgs/msg/Twist, 200 messages)")),
            "{name}"
        );
    }
    for name in ["ref_none.bag", "ref_bz2.bag", "ref_lz4.bag"] {
        let recording = open(&bags.join(name));
        assert_near(name, recording.column("v_ref").unwrap(), &v_ref);
        assert_near(name, recording.column("omega_ref").unwrap(), &omega_ref);
        assert_near(name, recording.column("v").unwrap(), &[0.2; 200]);
        assert_eq!(recording.clock.offset_s, Some(0.0), "{name}");
        assert!(recording.warnings.iter().any(|w| w.contains("measured velocities never change")), "{name}: {:?}", recording.warnings);
    }
}

#[test]
fn bags_of_rosbag2_without_a_drive_are_refused_with_what_they_hold() {
    let Some(bags) = bags() else { return };
    let expected = |name: &str| -> &[&str] {
        match name {
            n if n.contains("empty_bag") => &["/rosout (rcl_interfaces/msg/Log, 0 messages)", "/parameter_events"],
            n if n.contains("only_services") => &["/add_two_ints/_service_event (example_interfaces/srv/AddTwoInts_Event, 12 messages)"],
            n if n.contains("only_topics") => &["/parameter_events (rcl_interfaces/msg/ParameterEvent, 7 messages)"],
            n if n.contains("bags_topics_and_services") => {
                &["/add_two_ints/_service_event", ", 6 messages)", "ParameterEvent, 7 messages)"]
            }
            n if n.contains("rewriter_a") => {
                &["a_empty (test_msgs/msg/Empty, 100 messages)", "b_basictypes (test_msgs/msg/BasicTypes, 50 messages)"]
            }
            n if n.contains("rewriter_b") => {
                &["a_empty (test_msgs/msg/Empty, 25 messages)", "c_strings (test_msgs/msg/Strings, 50 messages)"]
            }
            n if n.contains("multiple_files_2") => &["/chatter (std_msgs/msg/String, 529 messages)"],
            n if n.contains("multiple_files") => &["/chatter (std_msgs/msg/String, 1324 messages)"],
            n if n.contains("talker") => &["/rosout (rcl_interfaces/msg/Log, 10 messages)", "/topic (std_msgs/msg/String, 10 messages)"],
            n if n.contains("wbag_0") => &["EEE (std_msgs/msg/String, 147 messages)", "HHH (std_msgs/msg/String, 148 messages)"],
            n if n.contains("wbag") => &["AAA (std_msgs/msg/String, "],
            n if n.contains("service_events") => &["/test_topic1 (test_msgs/msg/Strings, 1 messages)", "/test_service2/_service_event"],
            n if n.contains("cdr_test") || n.contains("wrong_rmw") => {
                &["/test_topic (test_msgs/msg/BasicTypes, 3 messages)", "/array_topic (test_msgs/msg/Arrays, 4 messages)"]
            }
            n if n.contains("for_seek") => &["topic1 (test_msgs/BasicTypes, 5 messages)"],
            other => panic!("unknown file {other}"),
        }
    };
    let mut files: Vec<PathBuf> = std::fs::read_dir(bags.join("rosbag2")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    let mut seen = 0;
    for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "mcap" || e == "db3")) {
        let message = refusal(path);
        for part in expected(path.file_name().unwrap().to_str().unwrap()) {
            assert!(message.contains(part), "{}: {message}", path.display());
        }
        assert!(message.contains("nav_msgs/Odometry is needed") && message.contains("--topic odom="), "{message}");
        seen += 1;
    }
    assert_eq!(seen, 39);
}

#[test]
fn wanted_topics_of_other_types_or_encodings_are_refused() {
    let Some(bags) = bags() else { return };
    let cases = [
        ("mcap_plain", ("odom", "/cmd_vel"), "its type is `geometry_msgs/msg/Twist`; read are nav_msgs/Odometry"),
        ("mcap_plain", ("cmd", "/odom"), "its type is `nav_msgs/msg/Odometry`; read are geometry_msgs/Twist"),
        (
            "ros1_plain.bag",
            ("odom", "/robot/odom"),
            "topic `/robot/odom`: is not in the bag; the bag has /cmd_vel (geometry_msgs/msg/Twist, 200",
        ),
        ("mcap_plain", ("imu", "/imu"), "the roles are cmd and odom"),
    ];
    for (name, topic, expected) in cases {
        let error = wheelwright_recordings::open(&bags.join(name), &options(&[topic])).unwrap_err().to_string();
        assert!(error.contains(expected.replace("/msg/", if name.starts_with("ros1") { "/" } else { "/msg/" }).as_str()), "{error}");
    }
}
