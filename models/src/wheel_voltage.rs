//! `wheel-voltage`: a robot whose motors are given voltages, such as an FRC drive. Per side, with v the wheels' ground speed,
//!
//! u = kS sgn v + kV v + kA v'
//!
//! so that v' = (1/kA) u − (kV/kA) v where there is no friction. The friction term is what the FRC community means by kS; kV and
//! kA are not comparable with anybody's without it. It can be switched off, so that a diagnosis finds it for itself.

use serde::{Deserialize, Serialize};
use wheelwright_core::Channel;
use wheelwright_core::channel::{U_LEFT, U_RIGHT, VEL_LEFT, VEL_RIGHT};
use wheelwright_core::model::{Flow, ModelConfig, ModelError, Parameter, ParameterMap, RegressorModel, Sample};

static INPUTS: [Channel; 2] = [U_LEFT, U_RIGHT];
static OUTPUTS: [Channel; 2] = [VEL_LEFT, VEL_RIGHT];

/// Configuration of `wheel-voltage`; no key is needed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WheelVoltageConfig {
    /// kS sgn v on each side. Default true. Rows at rest (v = 0) say nothing on kS, so data must hold motion in both
    /// directions or at several speeds.
    pub static_friction: bool,
    /// Ties left and right together: one kV and one kA (and one kS). Default false.
    pub symmetric: bool,
}

impl Default for WheelVoltageConfig {
    fn default() -> Self {
        Self { static_friction: true, symmetric: false }
    }
}

#[typetag::serde(name = "wheel-voltage")]
impl ModelConfig for WheelVoltageConfig {
    fn about(&self) -> String {
        "robot driven by motor voltages: u_left, u_right to vel_left, vel_right, kS, kV and kA a side".to_owned()
    }

    fn build(&self) -> Result<Box<dyn RegressorModel>, ModelError> {
        Ok(Box::new(WheelVoltage::new(self)))
    }
}

/// How one side answers a voltage: v' = `gain` u − `rate` v.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MotorResponse {
    /// 1/kA \[m/(V s²)\].
    pub gain: f64,
    /// kV/kA \[1/s\].
    pub rate: f64,
}

/// The model object of `wheel-voltage`.
#[derive(Debug, Clone)]
pub struct WheelVoltage {
    parameters: Vec<Parameter>,
    map: ParameterMap,
    /// Parameters a side: kV, kA and perhaps kS.
    side: usize,
}

impl WheelVoltage {
    /// Builds the model.
    pub fn new(config: &WheelVoltageConfig) -> Self {
        let side = if config.static_friction { 3 } else { 2 };
        let parameters: Vec<Parameter> = ["left", "right"].iter().flat_map(|s| parameters(s, config.static_friction)).collect();
        let map = if config.symmetric { tied(side) } else { ParameterMap::identity(&parameters) };
        Self { parameters, map, side }
    }

    /// 1/kA and kV/kA of left and right, the numbers the FRC community compares, from this model's θ.
    pub fn responses(&self, theta: &[f64]) -> [MotorResponse; 2] {
        let of = |p: &[f64]| MotorResponse { gain: 1.0 / p[1], rate: p[0] / p[1] };
        [of(&theta[..self.side]), of(&theta[self.side..])]
    }
}

impl RegressorModel for WheelVoltage {
    fn name(&self) -> &str {
        "wheel-voltage"
    }

    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }

    fn outputs(&self) -> &[Channel] {
        &OUTPUTS
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        phi.fill(0.0);
        for i in 0..2 {
            let row = &mut phi[i * 3 * self.side..][..self.side];
            let v = sample.outputs[i];
            row[0] = v;
            row[1] = sample.accelerations[i];
            if let Some(friction) = row.get_mut(2) {
                *friction = sign(v);
            }
            y[i] = sample.inputs[i];
        }
    }

    fn map(&self) -> ParameterMap {
        self.map.clone()
    }

    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        for i in 0..2 {
            let p = &theta[i * self.side..][..self.side];
            let (u, v) = (inputs[i], outputs[i]);
            accelerations[i] = match p {
                [kv, ka] => (u - kv * v) / ka,
                [kv, ka, ks, ..] => with_friction(*kv, *ka, *ks, u, v),
                _ => f64::NAN,
            };
        }
        self.finite(theta, accelerations)
    }

    fn flow(&self) -> Option<&dyn Flow> {
        Some(self)
    }
}

impl Flow for WheelVoltage {
    fn advance(&self, theta: &[f64], inputs: &[f64], interval: f64, outputs: &mut [f64], travelled: &mut [f64]) -> Result<(), ModelError> {
        for i in 0..2 {
            let p = &theta[i * self.side..][..self.side];
            (outputs[i], travelled[i]) = held(p[0], p[1], p.get(2).copied().unwrap_or(0.0), inputs[i], outputs[i], interval);
        }
        self.finite(theta, outputs)
    }
}

impl WheelVoltage {
    /// Whether values computed from `theta` are numbers, and why not.
    fn finite(&self, theta: &[f64], values: &[f64]) -> Result<(), ModelError> {
        let model = || self.name().to_owned();
        match values.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            // kA is the second parameter of a side.
            false if (0..2).any(|i| theta[i * self.side + 1] == 0.0) => Err(ModelError::Singular { model: model() }),
            false => Err(ModelError::Overflow { model: model() }),
        }
    }
}

/// Speed after, and way during, `interval` under a held voltage: exactly what the law says, with friction up to kS holding a wheel at
/// rest. A wheel under way keeps its sense until it stops; what is left of the interval it stands, or runs on in the sense of u.
fn held(kv: f64, ka: f64, ks: f64, u: f64, v: f64, interval: f64) -> (f64, f64) {
    let lag = Lag { rate: kv / ka, ka };
    let (mut v, mut way, mut left) = (v, 0.0, interval);
    if v != 0.0 {
        let drive = u - ks * sign(v);
        let stop = lag.stop(drive, v);
        let (end, moved) = lag.after(drive, v, stop.min(left));
        if stop >= left {
            return (end, moved);
        }
        (v, way, left) = (0.0, moved, left - stop);
    }
    if u.abs() <= ks {
        return (v, way);
    }
    let (end, moved) = lag.after(u - ks * sign(u), v, left);
    (end, way + moved)
}

/// v' = `drive`/kA − `rate` v.
struct Lag {
    rate: f64,
    ka: f64,
}

impl Lag {
    /// Speed and way after a time `t`.
    fn after(&self, drive: f64, v: f64, t: f64) -> (f64, f64) {
        let z = -self.rate * t;
        let phi1 = if z == 0.0 { 1.0 } else { z.exp_m1() / z };
        // φ2 = (φ1 − 1)/z, by its series where the difference would cancel.
        let phi2 = if z.abs() > 0.1 { (phi1 - 1.0) / z } else { (2..12).rev().fold(0.0, |sum, k| (1.0 + z * sum) / f64::from(k)) };
        let gain = drive / self.ka * t;
        (v + phi1 * (gain + z * v), t * (phi1 * v + phi2 * gain))
    }

    /// Time until a wheel of speed `v` stands; infinite if it never does.
    fn stop(&self, drive: f64, v: f64) -> f64 {
        let needed = -v * self.ka / drive;
        if needed.is_nan() || needed <= 0.0 {
            return f64::INFINITY;
        }
        let bent = self.rate * needed;
        match bent {
            0.0 => needed,
            _ if bent > -1.0 => bent.ln_1p() / self.rate,
            _ => f64::INFINITY,
        }
    }
}

/// Acceleration under static friction. The law u = kV v + kA v' + kS sgn v has no value at rest: there friction is whatever
/// holds the wheel, up to kS. A wheel that has slowed to the capture speed kS/(4 (kV + kS)) under |u| ≤ kS is therefore brought to
/// rest exponentially; elsewhere the law holds as written, with a wheel at rest breaking away in the direction of u.
///
/// The capture speed is below 0.25 m/s for any parameters and about 0.02 m/s for usual ones (kS counts as a voltage a unit of speed
/// here: the simulator's linear part is taken over one unit). It is the narrowest that a step of a quarter of kA/(kV + kS) cannot
/// jump over; the decay, at (kV + kS)/kA, is what that linear part steps exactly.
fn with_friction(kv: f64, ka: f64, ks: f64, u: f64, v: f64) -> f64 {
    let capture = ks / (4.0 * (kv + ks));
    if u.abs() <= ks && v.abs() < capture {
        return -(kv + ks) / ka * v;
    }
    let direction = if v == 0.0 { sign(u) } else { sign(v) };
    (u - kv * v - ks * direction) / ka
}

/// −1, 0 or 1; `signum` of a float knows no zero.
fn sign(x: f64) -> f64 {
    f64::from(i8::from(x > 0.0) - i8::from(x < 0.0))
}

/// Both sides' parameters from one set named kV, kA, kS.
fn tied(side: usize) -> ParameterMap {
    let mut matrix = vec![0.0; 2 * side * side];
    for i in 0..2 * side {
        matrix[i * side + i % side] = 1.0;
    }
    let free = ["kV", "kA", "kS"][..side].iter().map(|&n| n.to_owned()).collect();
    ParameterMap { free, matrix, offset: vec![0.0; 2 * side] }
}

fn parameters(side: &str, static_friction: bool) -> Vec<Parameter> {
    let parameter = |symbol: &str, unit: &str, meaning: &str, excitation: &str| {
        Parameter::new(&format!("{symbol}_{side}"), unit, &format!("{meaning} ({side} side)"), &format!("{excitation} ({side} side)"))
            .within(0.0, f64::INFINITY)
    };
    let mut all = vec![
        parameter("kV", "V s/m", "voltage that holds one unit of speed", "driving at several steady speeds"),
        parameter("kA", "V s^2/m", "voltage that gives one unit of acceleration", "steps of voltage, so that the speed changes quickly"),
    ];
    if static_friction {
        all.push(parameter("kS", "V", "voltage that just overcomes friction at rest", "slow driving in both directions"));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use wheelwright_core::Dataset;
    use wheelwright_core::Stretch;
    use wheelwright_core::effect::{EffectSimulator, Scene};
    use wheelwright_core::model::solve_accelerations;
    use wheelwright_core::simulation::{Direction, Readout, Simulator};

    fn model(static_friction: bool, symmetric: bool) -> WheelVoltage {
        WheelVoltage::new(&WheelVoltageConfig { static_friction, symmetric })
    }

    fn names(model: &WheelVoltage) -> Vec<&str> {
        model.parameters.iter().map(|p| p.name.as_str()).collect()
    }

    #[test]
    fn rows_are_the_equations() {
        let sample = Sample { inputs: &[6.0, -4.0], outputs: &[2.0, -1.0], accelerations: &[3.0, 0.5] };
        let (mut phi, mut y) = ([f64::NAN; 8], [f64::NAN; 2]);
        model(false, false).regressor(sample, &mut phi, &mut y);
        assert_eq!((phi, y), ([2.0, 3.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.5], [6.0, -4.0]));
        let mut phi = [f64::NAN; 12];
        model(true, false).regressor(sample, &mut phi, &mut y);
        assert_eq!(phi, [2.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.5, -1.0]);
    }

    #[test]
    fn parameters_and_ties() {
        assert_eq!(names(&model(false, false)), ["kV_left", "kA_left", "kV_right", "kA_right"]);
        assert_eq!(names(&model(true, false)), ["kV_left", "kA_left", "kS_left", "kV_right", "kA_right", "kS_right"]);
        let map = model(true, true).map();
        assert_eq!(map.free, ["kV", "kA", "kS"]);
        assert_eq!(map.theta(&[2.0, 0.3, 0.1]), [2.0, 0.3, 0.1, 2.0, 0.3, 0.1]);
    }

    #[test]
    fn responses_are_those_of_the_field() {
        let [left, right] = model(false, false).responses(&[2.0, 0.5, 3.0, 0.25]);
        assert_eq!((left, right), (MotorResponse { gain: 2.0, rate: 4.0 }, MotorResponse { gain: 4.0, rate: 12.0 }));
    }

    #[test]
    fn friction_holds_the_wheel_and_lets_it_go() {
        let mut a = [f64::NAN; 2];
        let theta = [2.5, 0.2, 0.4, 2.5, 0.2, 0.4];
        model(true, false).accelerations(&theta, &[0.3, 0.5], &[0.0, 0.0], &mut a).unwrap();
        assert_eq!(a[0], 0.0);
        assert!((a[1] - 0.5).abs() < 1e-12);
    }

    /// A stretch of `n` samples every `dt` with the same voltages on both sides.
    fn stretch(n: usize, dt: f64, u: impl Fn(f64) -> f64) -> Stretch {
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let column: Vec<f64> = time.iter().map(|t| u(*t)).collect();
        Stretch { label: "0".into(), outputs: vec![vec![0.0; n]; 2], inputs: vec![column.clone(), column], time }
    }

    const FRICTIONS: [(f64, f64, f64); 4] = [(2.5, 0.2, 0.4), (2.5, 1.0, 0.1), (0.5, 0.2, 2.0), (3.0, 0.05, 1.0)];

    /// What steps with the accelerations brings a wheel to rest within the widest step that the capture speed is made for.
    #[test]
    fn a_coasting_wheel_stops_and_stays_in_steps() {
        let model = model(true, false);
        for (kv, ka, ks) in FRICTIONS {
            let longest = 0.25 * ka / (kv + ks);
            for (dt, u) in [(0.1 * longest, 0.0), (longest, 0.0), (longest, 0.9 * ks), (longest, -0.5 * ks), (longest, -ks)] {
                let run = stretch((10.0 * (1.0 + 1.0 / ks) / dt) as usize, dt, |_| u);
                let data = Dataset { inputs: INPUTS.to_vec(), outputs: OUTPUTS.to_vec(), stretches: vec![run] };
                let scene = Scene::new(&data, &model, 0.5, None, None);
                let mut simulated = vec![Vec::new(); 2];
                let mut simulator = EffectSimulator::new(&model, &[kv, ka, ks, kv, ka, ks], &[], &scene).unwrap();
                simulator.run(0, &data.stretches[0], &[1.0, -0.7], &mut simulated).unwrap();
                for side in &simulated {
                    let last = side[side.len() - 1];
                    assert!(last.abs() < 1e-9, "kV {kv} kA {ka} kS {ks} dt {dt} u {u}: still {last} m/s");
                }
            }
        }
    }

    /// Moreau's implicit time stepping, which knows of no crossing: each step ends where friction, up to kS, brings it.
    fn moreau(kv: f64, ka: f64, ks: f64, run: &Stretch, start: f64, h: f64) -> (Vec<f64>, f64) {
        let (mut v, mut way) = (start, 0.0);
        let mut speeds = vec![v];
        for k in 1..run.len() {
            let parts = ((run.time[k] - run.time[k - 1]) / h).round();
            for _ in 0..parts as usize {
                let free = v + h / ka * (run.inputs[0][k - 1] - kv * v);
                let next = free - free.clamp(-h * ks / ka, h * ks / ka);
                way += 0.5 * h * (v + next);
                v = next;
            }
            speeds.push(v);
        }
        (speeds, way)
    }

    #[test]
    fn stops_stands_and_reversals_are_where_an_implicit_scheme_of_fine_steps_has_them() {
        let model = model(true, false);
        for (kv, ka, ks) in FRICTIONS {
            // Samples far apart against the lag: several things happen between two of them.
            let run = stretch(160, 0.05, |t| 2.0 * ks * (1.5 * t).sin());
            let (expected, way) = moreau(kv, ka, ks, &run, 0.8, 1e-6);
            let theta = [kv, ka, ks, kv, ka, ks];
            let mut simulated = vec![Vec::new(); 2];
            Simulator::new(&model, &theta).unwrap().run(&run, &[0.8, 0.8], &mut simulated).unwrap();
            let size = simulated[0].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (k, (found, expected)) in simulated[0].iter().zip(&expected).enumerate() {
                assert!((found - expected).abs() < 2e-5 * size, "kV {kv} kA {ka} kS {ks}, sample {k}: {found} {expected}");
            }
            assert!(simulated[0].contains(&0.0) && simulated[0].iter().any(|v| *v < 0.0), "it stands and reverses");
            let mut means = Simulator::new(&model, &theta).unwrap().with_readout(Readout::IntervalMean);
            means.run(&run, &[0.8, 0.8], &mut simulated).unwrap();
            let found: f64 = simulated[0][1..].iter().map(|mean| 0.05 * mean).sum();
            assert!((found - way).abs() < 2e-5 * size * 8.0, "{found} {way}");
        }
    }

    /// A difference of runs is a derivative only if the course from stop to start does not jump with the parameters.
    #[test]
    fn differences_of_runs_do_not_depend_on_their_step() {
        let model = model(true, false);
        let theta = [2.5, 0.4, 0.3, 2.6, 0.45, 0.25];
        let run = stretch(500, 0.02, |t| 4.0 * (1.3 * t).sin() + 0.2);
        let of = |step: f64| {
            let directions: Vec<Direction> =
                (0..6).map(|i| Direction { along: (0..6).map(|k| f64::from(u8::from(k == i))).collect(), step }).collect();
            Simulator::new(&model, &theta).unwrap().sensitivities(&run, &[0.0, 0.0], &directions).unwrap().parameters
        };
        let (wide, narrow) = (of(1e-5), of(1e-6));
        for (wide, narrow) in wide.iter().flatten().flatten().zip(narrow.iter().flatten().flatten()) {
            assert!((wide - narrow).abs() < 1e-6, "{wide} {narrow}");
        }
    }

    #[test]
    fn without_back_voltage_or_friction_the_motion_keeps_its_limits() {
        // v' = u/kA, and a wheel that only friction slows.
        let (v, way) = held(0.0, 0.5, 0.0, 1.0, 0.2, 0.1);
        assert!((v - 0.4).abs() < 1e-15 && (way - 0.03).abs() < 1e-15, "{v} {way}");
        let (v, way) = held(0.0, 0.5, 1.0, 0.0, 0.2, 1.0);
        assert!(v == 0.0 && (way - 0.01).abs() < 1e-15, "{v} {way}");
        let mut at = [0.1, 0.1];
        assert!(model(true, false).advance(&[1.0, 0.0, 0.1, 1.0, 0.0, 0.1], &[1.0; 2], 0.1, &mut at, &mut [0.0; 2]).is_err());
    }

    #[test]
    fn the_linear_model_is_simulated_exactly() {
        let (kv, ka, u, dt) = (2.5, 0.2, 6.0, 0.1);
        let run = stretch(20, dt, |_| u);
        let simulated = Simulator::new(&model(false, false), &[kv, ka, kv, ka]).unwrap().run_measured(&run).unwrap();
        for (k, v) in simulated[0].iter().enumerate() {
            let exact = u / kv * (1.0 - (-kv / ka * k as f64 * dt).exp());
            assert!((v - exact).abs() < 1e-13, "{v} {exact}");
        }
    }

    #[test]
    fn friction_delays_but_follows_the_exact_solution_under_way() {
        let (kv, ka, ks, u, dt) = (2.5, 0.2, 0.4, 6.0, 0.02);
        let run = stretch(100, dt, |_| u);
        let theta = [kv, ka, ks, kv, ka, ks];
        let simulated = Simulator::new(&model(true, false), &theta).unwrap().run_measured(&run).unwrap();
        for (k, v) in simulated[0].iter().enumerate() {
            let exact = (u - ks) / kv * (1.0 - (-kv / ka * k as f64 * dt).exp());
            assert!((v - exact).abs() < 1e-5, "{v} {exact}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn closed_form_equals_the_general_solution(
            side in prop::array::uniform3(0.05..3.0f64), friction: bool,
            inputs in prop::array::uniform2(-12.0..12.0f64), outputs in prop::array::uniform2(0.25..5.0f64), backwards: bool,
        ) {
            let model = model(friction, false);
            let theta: Vec<f64> = [&side[..model.side], &side[..model.side]].concat();
            let outputs = if backwards { [-outputs[0], outputs[1]] } else { outputs };
            let (mut closed, mut solved) = ([0.0; 2], [0.0; 2]);
            model.accelerations(&theta, &inputs, &outputs, &mut closed).unwrap();
            solve_accelerations(&model, &theta, &inputs, &outputs, &mut solved).unwrap();
            for (c, s) in closed.iter().zip(&solved) {
                prop_assert!((c - s).abs() <= 1e-11 * (1.0 + c.abs()), "{closed:?} {solved:?}");
            }
        }
    }
}
