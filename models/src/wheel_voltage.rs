//! `wheel-voltage`: a robot whose motors are given voltages, such as an FRC drive. Per side, with v the wheels' ground speed,
//!
//! u = kS sgn v + kV v + kA v'
//!
//! so that v' = (1/kA) u − (kV/kA) v where there is no friction. The friction term is what the FRC community means by kS; kV and
//! kA are not comparable with anybody's without it. It can be switched off, so that a diagnosis finds it for itself.

use serde::{Deserialize, Serialize};
use wheelwright_core::Channel;
use wheelwright_core::channel::{U_LEFT, U_RIGHT, VEL_LEFT, VEL_RIGHT};
use wheelwright_core::model::{ModelConfig, ModelError, Parameter, ParameterMap, RegressorModel, Sample};

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
        let model = || self.name().to_owned();
        match accelerations.iter().all(|a| a.is_finite()) {
            true => Ok(()),
            // kA is the second parameter of a side.
            false if (0..2).any(|i| theta[i * self.side + 1] == 0.0) => Err(ModelError::Singular { model: model() }),
            false => Err(ModelError::Overflow { model: model() }),
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
    use wheelwright_core::Stretch;
    use wheelwright_core::model::solve_accelerations;
    use wheelwright_core::simulation::Simulator;

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

    #[test]
    fn a_coasting_wheel_stops_and_stays() {
        let model = model(true, false);
        for (kv, ka, ks) in [(2.5, 0.2, 0.4), (2.5, 1.0, 0.1), (0.5, 0.2, 2.0), (3.0, 0.05, 1.0)] {
            let longest = 0.25 * ka / (kv + ks);
            for (dt, u) in [(0.1 * longest, 0.0), (longest, 0.0), (longest, 0.9 * ks), (longest, -0.5 * ks), (longest, -ks)] {
                let theta = [kv, ka, ks, kv, ka, ks];
                let run = stretch((10.0 * (1.0 + 1.0 / ks) / dt) as usize, dt, |_| u);
                let mut simulated = vec![Vec::new(); 2];
                Simulator::new(&model, &theta).unwrap().run(&run, &[1.0, -0.7], &mut simulated).unwrap();
                for side in &simulated {
                    let last = side[side.len() - 1];
                    assert!(last.abs() < 1e-9, "kV {kv} kA {ka} kS {ks} dt {dt} u {u}: still {last} m/s");
                }
            }
        }
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
