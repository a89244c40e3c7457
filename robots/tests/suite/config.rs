//! `type = "simulator"` in a configuration.

use crate::common::*;
use toml::Table;
use wheelwright_core::config::{ConfigError, names, tagged};
use wheelwright_core::robot::{RobotConfig, RobotError};
use wheelwright_robots::SimulatorConfig;
use wheelwright_robots::profiles;
use wheelwright_robots::simulator::{ControlLaw, PoseSource};

fn parse(text: &str) -> Result<Box<dyn RobotConfig>, ConfigError> {
    tagged(text.parse::<Table>().unwrap())
}

#[test]
fn the_simulator_is_registered() {
    assert!(names::<Box<dyn RobotConfig>>().contains(&"simulator".to_owned()));
    for robot in ["pioneer-3dx", "khepera-3"] {
        let config = parse(&format!("type = 'simulator'\nrobot = '{robot}'")).unwrap();
        let robot = config.connect(1).unwrap();
        assert_eq!(robot.inputs().iter().map(|c| c.name.as_ref()).collect::<Vec<_>>(), ["v_ref", "omega_ref"]);
        let outputs: Vec<&str> = robot.outputs().iter().map(|c| c.name.as_ref()).collect();
        assert_eq!(outputs, ["v", "omega", "x", "y", "phi", "omega_left", "omega_right"]);
    }
}

#[test]
fn every_constant_of_a_preset_can_be_overridden() {
    let base = SimulatorConfig::preset("pioneer-3dx").unwrap().settings;
    assert!(base.limits.is_empty() && base.sensors == Default::default() && base.plant.supply_voltage.is_none());
    let changed = config("robot = 'pioneer-3dx'\nperiod = 0.3\n[plant]\nmass = 12.0\n[controller.vw-pd]\nkpt = 1.0").settings;
    assert_eq!((changed.period, changed.plant.mass, changed.plant.yaw_inertia), (0.3, 12.0, base.plant.yaw_inertia));
    match (changed.controller, base.controller) {
        (ControlLaw::VwPd(changed), ControlLaw::VwPd(base)) => assert_eq!((changed.kpt, changed.kdt), (1.0, base.kdt)),
        other => panic!("{other:?}"),
    }
    let other = config("robot = 'pioneer-3dx'\n[controller.wheel-pd]\nkp = 6.0\nkd = 0.9").settings;
    assert!(matches!(other.controller, ControlLaw::WheelPd(gains) if gains.kp == 6.0));
}

#[test]
fn typical_fidelity_has_the_profiles_limits_and_real_sensors() {
    for name in ["pioneer-3dx", "khepera-3"] {
        let settings = config(&format!("robot = '{name}'\nfidelity = 'typical'\nsensors = {{ wheel_noise = 0.5 }}")).settings;
        let profile = profiles::built_in(name).unwrap();
        assert_eq!(settings.limits, profile.limits);
        assert_eq!((settings.sensors.pose, settings.sensors.wheel_noise), (PoseSource::Odometry, 0.5));
        assert!(settings.sensors.ticks_per_revolution.is_some() && settings.plant.supply_voltage.is_some());
        // The facts stand in two files, for two readers.
        assert_eq!(Some(settings.plant.mass), profile.mass);
        assert_eq!((settings.plant.track_width, settings.plant.wheel_radius), (profile.track_width, profile.wheel_radius));
    }
}

#[test]
fn a_configuration_survives_being_written_and_read() {
    let config = config("robot = 'khepera-3'\nfidelity = 'typical'\njitter = 0.1");
    let boxed: Box<dyn RobotConfig> = Box::new(config.clone());
    let text = toml::to_string(&boxed).unwrap();
    assert_eq!(toml::from_str::<SimulatorConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    assert!(text.contains("[simulator.plant]") && text.contains("yaw_inertia"), "{text}");
    let json = serde_json::to_string(&config).unwrap();
    assert_eq!(serde_json::from_str::<SimulatorConfig>(&json).unwrap(), config);
}

#[test]
fn a_key_that_is_wrong_is_named() {
    for (text, expected) in [
        ("robot = 'pioneer'", "did you mean \"pioneer-3dx\"? Known: pioneer-3dx, khepera-3"),
        ("robot = 3", "`robot`: must be a text, not 3"),
        ("robot = 'pioneer-3dx'\nfidelity = 'real'", "`fidelity`: must be \"ideal\" or \"typical\", not \"real\""),
        ("fidelity = 'typical'", "set `robot`"),
        ("period = 0.1", "missing field `plant`; robot = \"pioneer-3dx\" or \"khepera-3\" fills in a preset"),
        ("robot = 'pioneer-3dx'\nperoid = 0.1", "unknown field `peroid`"),
        ("robot = 'pioneer-3dx'\n[plant]\nmas = 1.0", "did you mean `mass`?"),
        ("robot = 'pioneer-3dx'\n[plant]\nmass = 'heavy'", "`plant.mass`"),
        ("robot = 'pioneer-3dx'\n[controller.pid]\nkp = 1.0", "unknown variant `pid`"),
        ("robot = 'pioneer-3dx'\n[controller.wheel-pd]\nkp = 1.0", "missing field `kd`"),
        ("robot = 'pioneer-3dx'\n[limits]\nvmax = 1.0", "unknown field `vmax`"),
        ("robot = 'pioneer-3dx'\n[sensors]\npose = 'gps'", "unknown variant `gps`"),
    ] {
        let message = parse(&format!("type = 'simulator'\n{text}")).unwrap_err().to_string();
        assert!(message.contains(expected), "{text}: {message}");
        assert!(message.matches("did you mean").count() <= 1, "{message}");
    }
}

#[test]
fn a_value_that_cannot_be_is_refused_with_its_key() {
    for (text, key, number) in [
        ("period = 0.0", "period", "0"),
        ("period = inf", "period", "inf"),
        ("period = 1e9", "period", "1000000000"),
        ("jitter = 1.0", "jitter", "1"),
        ("plant = { mass = -9.0 }", "plant.mass", "-9"),
        ("plant = { yaw_inertia = 0.0 }", "plant.yaw_inertia", "0"),
        ("plant = { com_offset = nan }", "plant.com_offset", "NaN"),
        ("plant = { track_width = -0.34 }", "plant.track_width", "-0.34"),
        ("plant = { tyre_radius = 0.0 }", "plant.tyre_radius", "0"),
        ("plant = { resistance = 0.0 }", "plant.resistance", "0"),
        ("plant = { wheel_friction = -0.1 }", "plant.wheel_friction", "-0.1"),
        ("plant = { supply_voltage = -12.0 }", "plant.supply_voltage", "-12"),
        ("controller = { vw-pd = { kpt = 0.0 } }", "controller.vw-pd.kpt", "0"),
        ("controller = { vw-pd = { kdr = -1.0 } }", "controller.vw-pd.kdr", "-1"),
        ("controller = { vw-pd = { kpt = 1e15 } }", "controller", "integration steps"),
        ("controller = { vw-pd = { kpt = 1e308 } }", "controller", "integration steps"),
        ("limits = { v = -1.0 }", "limits.v", "-1"),
        ("limits = { omega_dot = nan }", "limits.omega_dot", "NaN"),
        ("sensors = { v_noise = -0.1 }", "sensors.v_noise", "-0.1"),
        ("sensors = { noise_correlation = 1.0 }", "sensors.noise_correlation", "1"),
        ("sensors = { ticks_per_revolution = 0.0 }", "sensors.ticks_per_revolution", "0"),
    ] {
        let config = config(&format!("robot = 'pioneer-3dx'\n{text}"));
        match config.connect(0).err() {
            Some(RobotError::Config { key: found, reason }) => {
                assert_eq!(found, key, "{text}: {reason}");
                assert!(reason.contains(number), "{text}: {reason}");
            }
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[cfg(not(feature = "ros2"))]
#[test]
fn a_ros_2_robot_without_the_feature_says_how_to_build_with_it() {
    use wheelwright_robots::EmulatorConfig;
    let told = |error: RobotError| match error {
        RobotError::Config { key, reason } => {
            assert!(key == "type" && reason.contains("cargo build --release --features ros2"), "{reason}")
        }
        other => panic!("{other}"),
    };
    told(parse("type = 'ros2'\ndomain = 0").unwrap().connect(1).err().unwrap());
    let emulator: EmulatorConfig = "type = 'ros2'\ndomain = 0".parse::<Table>().unwrap().try_into().unwrap();
    let robot = parse("type = 'simulator'\nrobot = 'pioneer-3dx'").unwrap().connect(1).unwrap();
    told(emulator.start(wheelwright_core::robot::Live::new(robot)).err().unwrap());
}

#[test]
fn settings_of_a_ros_2_robot_that_cannot_be_are_named() {
    for (text, expected) in [
        ("command_topic = 'cmd_vel'", "command_topic"),
        ("odometry_topic = '/a//b'", "odometry_topic"),
        ("domain = 300", "domain"),
        ("domain = 0\ninterfaces = ['203.0.113.7']", "interfaces"),
        ("limits = { v_dot = 1.0 }", "limits.v_dot"),
        ("clock = 'stepped'", "period"),
        ("timeout = 0.0", "timeout"),
    ] {
        let error = parse(&format!("type = 'ros2'\n{text}")).unwrap().connect(1).err().unwrap();
        assert!(matches!(&error, RobotError::Config { key, .. } if key == expected), "{text}: {error}");
    }
    assert!(parse("type = 'ros2'\ncommand_type = 'twists'").is_err() && parse("type = 'ros2'\nmaster = 'x'").is_err());
}
