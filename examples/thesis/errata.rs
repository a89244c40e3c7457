//! What the thesis' formulas give as they are printed, beside what they should give.

use wheelwright::controllers::trajectory::{Direction, Dither, FigureEight, Formulas};
use wheelwright::core::Trajectory;
use wheelwright::models::physics::{PhysicalConstants, WheelGains, wheel_pd_theta};
use wheelwright::report::table::Table;

const ROBOT: PhysicalConstants = PhysicalConstants {
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
const GAINS: WheelGains = WheelGains { kp: 6.0, kd: 0.9 };

/// theta of the wheel controller as section 2.2 prints it: r is missing in theta1, b in theta3, theta4 is half of what it is, and
/// Ra Rt stands for ka in theta6.
fn printed(r: &PhysicalConstants, g: &WheelGains) -> [f64; 6] {
    let right = wheel_pd_theta(r, g);
    let (ra, ka, rt, be) = (r.resistance, r.torque_constant, r.tyre_radius(), r.wheel_friction);
    let theta1 = (ra * rt * r.mass + 2.0 * ka * g.kd + 2.0 * ra * r.wheel_inertia) / (2.0 * ka * g.kp);
    let theta3 = ra * rt * r.wheel_radius * r.mass / (2.0 * ka * g.kp);
    let theta4 = (ka * (g.kp + r.emf_constant) + 2.0 * ra * be) / (2.0 * ka * g.kp);
    let theta6 = (ra * rt * (g.kp + r.emf_constant) + ra * be) / (ka * g.kp);
    [theta1, right[1], theta3, theta4, right[4], theta6]
}

/// The largest difference that the printed (A.26) and (A.27) make to the desired angular velocity.
fn dither_error() -> f64 {
    let with = |formulas| {
        let dither = Dither { amplitude: 0.05, h: 3.0, k: 0.8, growth: -0.01, direction: Direction::Thesis, formulas };
        FigureEight { ax: 0.7, ay: 1.3, frequency: 0.4, dither: Some(dither) }
    };
    let (exact, as_printed) = (with(Formulas::Exact), with(Formulas::Printed));
    (0..2000).map(|i| 0.01 * f64::from(i)).map(|t| (exact.at(t).omega - as_printed.at(t).omega).abs()).fold(0.0, f64::max)
}

/// The section of the page.
pub(crate) fn html() -> String {
    let (right, wrong) = (wheel_pd_theta(&ROBOT, &GAINS), printed(&ROBOT, &GAINS));
    let mut table = Table::new(&["Parameter, wheel controller", "#As derived", "#As printed"]);
    for (i, (right, wrong)) in right.iter().zip(wrong).enumerate() {
        table.row(vec![format!("theta{}", i + 1), format!("{right:.5}"), format!("{wrong:.5}")]);
    }
    format!(
        "{}<p>Constants of a robot like the Pioneer. theta1 and theta6 as printed are not even of their unit. (2.11) prints + kD: with its sign a \
         differential gain above Ra(Rt r m/2 + Ie)/ka makes theta1 negative, which is an unstable robot.</p>\n\
         <p>The dither's (A.26) and (A.27) lack a term in the heading's acceleration: on a dither of 5 cm the desired angular velocity is off by up \
         to {:.3} rad/s.</p>\n",
        table.html(),
        dither_error()
    )
}
