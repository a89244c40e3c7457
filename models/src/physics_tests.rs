//! Golden values of the formulas were computed with sympy from the equations of motion, independently of this file.

use super::*;

fn pioneer() -> (PhysicalConstants, WheelGains, VwGains) {
    let robot = PhysicalConstants {
        mass: 9.0,
        yaw_inertia: 0.21,
        com_offset: -0.035,
        track_width: 0.34,
        wheel_radius: 0.0975,
        tyre_radius: Some(0.0965),
        wheel_inertia: 0.012,
        wheel_friction: 0.03,
        resistance: 1.2,
        torque_constant: 0.9,
        emf_constant: 0.85,
    };
    (robot, WheelGains { kp: 6.0, kd: 0.9 }, VwGains { kpt: 30.0, kdt: 4.0, kpr: 7.0, kdr: 1.1 })
}

fn khepera() -> (PhysicalConstants, WheelGains, VwGains) {
    let robot = PhysicalConstants {
        mass: 0.742,
        yaw_inertia: 0.0016,
        com_offset: 0.008,
        track_width: 0.089,
        wheel_radius: 0.0205,
        tyre_radius: None,
        wheel_inertia: 4e-5,
        wheel_friction: 2e-4,
        resistance: 8.0,
        torque_constant: 0.25,
        emf_constant: 0.24,
    };
    (robot, WheelGains { kp: 2.0, kd: 0.02 }, VwGains { kpt: 90.0, kdt: 1.0, kpr: 4.0, kdr: 0.05 })
}

fn assert_near(found: [f64; 6], expected: [f64; 6]) {
    for i in 0..6 {
        assert!((found[i] - expected[i]).abs() <= 1e-12 * expected[i].abs().max(1e-3), "theta{}: {} {}", i + 1, found[i], expected[i]);
    }
}

#[test]
fn formulas_equal_the_golden_values() {
    let (robot, wheel, vw) = pioneer();
    assert_near(
        wheel_pd_theta(&robot, &wheel),
        [
            0.162_075_416_666_666_67,
            0.160_661_933_751_441_75,
            -0.000_329_306_25,
            1.148_333_333_333_333_2,
            -0.011_394_679_930_795_846,
            1.148_333_333_333_333_2,
        ],
    );
    assert_near(
        vw_pd_theta(&robot, &vw),
        [
            0.158_103_418_803_418_8,
            0.173_077_175_716_440_43,
            -0.000_675_500_000_000_000_1,
            1.304_273_504_273_504_3,
            -0.017_029_411_764_705_88,
            1.221_684_981_684_981_7,
        ],
    );
    let (robot, wheel, vw) = khepera();
    assert_near(
        wheel_pd_theta(&robot, &wheel),
        [0.013_134_604, 0.013_437_048_178_765_308, 1.995_683_2e-5, 1.123_2, 0.010_077_935_614_190_129, 1.123_2],
    );
    assert_near(
        vw_pd_theta(&robot, &vw),
        [
            0.014_509_055_826_558_268,
            0.016_230_454_730_611_13,
            2.163_342_222_222_222_6e-5,
            1.133_550_135_501_355,
            0.010_938_247_191_011_238,
            1.133_717_073_170_731_6,
        ],
    );
}

#[test]
fn golden_file_where_it_is_present() {
    let path = std::env::var("WHEELWRIGHT_SHARED").unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared").to_owned());
    let Ok(text) = std::fs::read_to_string(format!("{path}/thesis/golden.json")) else {
        println!("skipped: no golden.json under {path}");
        return;
    };
    let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (name, (robot, wheel, vw)) in [("pioneer_like", pioneer()), ("khepera_like", khepera())] {
        let entry = &golden["theta_formulas"][name];
        let listed = |key: &str| std::array::from_fn(|i| entry[key][i].as_f64().unwrap());
        assert_eq!(entry["params"]["m"].as_f64(), Some(robot.mass));
        assert_near(wheel_pd_theta(&robot, &wheel), listed("wheel"));
        assert_near(vw_pd_theta(&robot, &vw), listed("vw"));
    }
}

#[test]
fn the_wheel_controller_is_a_velocity_controller() {
    for (robot, wheel, _) in [pioneer(), khepera()] {
        let as_vw = wheel.as_vw(robot.wheel_radius, robot.track_width);
        assert_near(vw_pd_theta(&robot, &as_vw), wheel_pd_theta(&robot, &wheel));
    }
}

#[test]
fn parameters_keep_the_physical_constraints() {
    for (robot, wheel, vw) in [pioneer(), khepera()] {
        let d = robot.track_width;
        let [t1, t2, t3, t4, t5, t6] = wheel_pd_theta(&robot, &wheel);
        assert_eq!(t4, t6);
        assert!((t3 - d * d / 4.0 * t5).abs() < 1e-15);
        let difference = robot.resistance
            * robot.tyre_radius()
            * robot.wheel_radius
            * (4.0 * robot.yaw_inertia + 4.0 * robot.mass * robot.com_offset.powi(2) - robot.mass * d * d)
            / (2.0 * d * d * robot.torque_constant * wheel.kp);
        assert!((t2 - t1 - difference).abs() < 1e-14);
        let [_, _, t3, t4, t5, t6] = vw_pd_theta(&robot, &vw);
        assert!((t3 / t5 - d * vw.kpr / (2.0 * vw.kpt)).abs() < 1e-12);
        assert!(((t4 - 1.0) / (t6 - 1.0) - 2.0 * vw.kpr / (d * vw.kpt)).abs() < 1e-10);
        assert!(t4 > 1.0 && t6 > 1.0 && t3.signum() == robot.com_offset.signum());
    }
}

/// Raises one constant or gain by a tenth.
fn raised(key: &str) -> (PhysicalConstants, WheelGains, VwGains) {
    let (mut robot, mut wheel, mut vw) = pioneer();
    let field = match key {
        "mass" => &mut robot.mass,
        "yaw_inertia" => &mut robot.yaw_inertia,
        "com_offset" => &mut robot.com_offset,
        "track_width" => &mut robot.track_width,
        "wheel_radius" => &mut robot.wheel_radius,
        "tyre_radius" => robot.tyre_radius.as_mut().unwrap(),
        "wheel_inertia" => &mut robot.wheel_inertia,
        "wheel_friction" => &mut robot.wheel_friction,
        "resistance" => &mut robot.resistance,
        "torque_constant" => &mut robot.torque_constant,
        "emf_constant" => &mut robot.emf_constant,
        "kp" => &mut wheel.kp,
        "kd" => &mut wheel.kd,
        "kpt" => &mut vw.kpt,
        "kdt" => &mut vw.kdt,
        "kpr" => &mut vw.kpr,
        "kdr" => &mut vw.kdr,
        other => panic!("no constant is named {other}"),
    };
    *field *= 1.1;
    (robot, wheel, vw)
}

#[test]
fn influences_are_those_of_the_formulas() {
    let changed = |before: [f64; 6], after: [f64; 6]| -> Vec<&str> {
        (0..6).filter(|&i| (after[i] - before[i]).abs() > 1e-9 * before[i].abs()).map(|i| ALL[i]).collect()
    };
    let (robot, wheel, vw) = pioneer();
    for influence in INFLUENCES {
        let (r, w, v) = raised(influence.key);
        assert_eq!(changed(wheel_pd_theta(&robot, &wheel), wheel_pd_theta(&r, &w)), influence.wheel_pd, "{}", influence.key);
        assert_eq!(changed(vw_pd_theta(&robot, &vw), vw_pd_theta(&r, &v)), influence.vw_pd, "{}", influence.key);
    }
}

#[test]
fn impossible_constants_are_refused_with_their_key() {
    let (robot, wheel, vw) = pioneer();
    let refused = PhysicalConstants { mass: 0.0, ..robot }.check().unwrap_err();
    assert_eq!(refused.to_string(), "`physical.mass`: must be a number above zero, not 0");
    let refused = PhysicalConstants { com_offset: f64::NAN, ..robot }.check().unwrap_err();
    assert_eq!(refused.to_string(), "`physical.com_offset`: must be a finite number, not NaN");
    assert!(WheelGains { kd: -0.1, ..wheel }.check().unwrap_err().to_string().starts_with("`gains.kd`"));
    assert!(VwGains { kpr: 0.0, ..vw }.check().unwrap_err().to_string().starts_with("`gains.kpr`"));
    assert_eq!(robot.check(), Ok(()));
}
