//! The equations that a robot under PD velocity control obeys, whichever of the two controllers it has:
//!
//! v_ref = θ1 v' − θ3 ω² + θ4 v,   ω_ref = θ2 ω' + θ5 v ω + θ6 ω                                       (2.19)
//!
//! The controllers differ in how physical constants enter θ and in the equalities between parameters, not in form.

use wheelwright_core::Channel;
use wheelwright_core::channel::{OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::model::{ModelError, Parameter, ParameterMap, RegressorModel, Sample};

static INPUTS: [Channel; 2] = [V_REF, OMEGA_REF];
static OUTPUTS: [Channel; 2] = [V, OMEGA];

/// Number of parameters.
pub(crate) const PARAMETERS: usize = 6;

/// Six-parameter model of a differentially driven robot under PD velocity control; `vw-pd` and `wheel-pd` build it.
#[derive(Debug, Clone)]
pub struct PdModel {
    name: &'static str,
    parameters: Vec<Parameter>,
    map: ParameterMap,
}

impl PdModel {
    /// All parameters free.
    pub(crate) fn new(name: &'static str) -> Self {
        let parameters = parameters();
        let map = ParameterMap::identity(&parameters);
        Self { name, parameters, map }
    }

    /// The equalities of the wheel controller: θ4 = θ6 and θ3 = (d²/4) θ5, which leave θ1, θ2, θ4 and θ5 free.
    pub(crate) fn with_wheel_constraints(mut self, track_width: f64) -> Self {
        let free: Vec<String> = [0, 1, 3, 4].iter().map(|&i: &usize| self.parameters[i].name.clone()).collect();
        let z = free.len();
        let mut matrix = vec![0.0; PARAMETERS * z];
        for (parameter, column, factor) in
            [(0, 0, 1.0), (1, 1, 1.0), (2, 3, track_width * track_width / 4.0), (3, 2, 1.0), (4, 3, 1.0), (5, 2, 1.0)]
        {
            matrix[parameter * z + column] = factor;
        }
        self.map = ParameterMap { free, matrix, offset: vec![0.0; PARAMETERS] };
        self
    }
}

impl RegressorModel for PdModel {
    fn name(&self) -> &str {
        self.name
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
        let (v, omega) = (sample.outputs[0], sample.outputs[1]);
        let (v_dot, omega_dot) = (sample.accelerations[0], sample.accelerations[1]);
        phi[..PARAMETERS].copy_from_slice(&[v_dot, 0.0, -omega * omega, v, 0.0, 0.0]);
        phi[PARAMETERS..2 * PARAMETERS].copy_from_slice(&[0.0, omega_dot, 0.0, 0.0, v * omega, omega]);
        y.copy_from_slice(sample.inputs);
    }

    fn map(&self) -> ParameterMap {
        self.map.clone()
    }

    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        let (v, omega) = (outputs[0], outputs[1]);
        // A simulation waits for each acceleration before it can go on: the slow division is done beside, not after.
        let (forward, turning) = (1.0 / theta[0], 1.0 / theta[1]);
        accelerations[0] = (inputs[0] + theta[2] * omega * omega - theta[3] * v) * forward;
        accelerations[1] = (inputs[1] - theta[4] * v * omega - theta[5] * omega) * turning;
        if accelerations[0].is_finite() && accelerations[1].is_finite() {
            Ok(())
        } else if theta[0] == 0.0 || theta[1] == 0.0 {
            Err(ModelError::Singular { model: self.name.to_owned() })
        } else {
            Err(ModelError::Overflow { model: self.name.to_owned() })
        }
    }
}

/// θ1..θ6. Only the lags are bounded: a negative one is an unstable robot. θ4 and θ6 exceed 1 for the nominal robot, but a
/// firmware whose wheel radius or track is wrong scales what it is told and what it measures, and may push them below.
fn parameters() -> Vec<Parameter> {
    vec![
        Parameter::new(
            "theta1",
            "s",
            "lag of the forward velocity behind its command: the larger, the slower the robot picks up speed",
            "changes of forward speed (steps or fast sines in v_ref)",
        )
        .within(0.0, f64::INFINITY),
        Parameter::new(
            "theta2",
            "s",
            "lag of the angular velocity behind its command: the larger, the slower the robot picks up rotation",
            "changes of turning rate (steps or fast sines in omega_ref)",
        )
        .within(0.0, f64::INFINITY),
        Parameter::new(
            "theta3",
            "m s",
            "forward speed gained by turning, because the centre of mass lies ahead of the axle (negative: behind it)",
            "fast turning at several rates while the forward command varies independently",
        ),
        Parameter::new(
            "theta4",
            "1",
            "forward command needed for one unit of forward speed; 1 is a drive that reaches what it is told",
            "driving at several forward speeds",
        ),
        Parameter::new(
            "theta5",
            "s/m",
            "turning rate lost when turning at speed, because the centre of mass lies ahead of the axle (negative: behind it)",
            "turning at several forward speeds, some of them fast",
        ),
        Parameter::new(
            "theta6",
            "1",
            "turning command needed for one unit of turning rate; 1 is a drive that reaches what it is told",
            "turning at several rates, also while driving slowly",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use wheelwright_core::model::solve_accelerations;

    #[test]
    fn rows_are_the_equations() {
        let model = PdModel::new("vw-pd");
        let (mut phi, mut y) = ([f64::NAN; 12], [f64::NAN; 2]);
        model.regressor(Sample { inputs: &[0.5, -0.3], outputs: &[2.0, 3.0], accelerations: &[5.0, 7.0] }, &mut phi, &mut y);
        assert_eq!(phi, [5.0, 0.0, -9.0, 2.0, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0, 6.0, 3.0]);
        assert_eq!(y, [0.5, -0.3]);
    }

    #[test]
    fn a_zero_lag_is_singular_both_ways() {
        let model = PdModel::new("vw-pd");
        let theta = [0.0, 0.2, 0.0, 1.0, 0.0, 1.0];
        let mut a = [0.0; 2];
        let expected = ModelError::Singular { model: "vw-pd".into() };
        assert_eq!(model.accelerations(&theta, &[1.0, 0.0], &[0.0, 0.0], &mut a), Err(expected.clone()));
        assert_eq!(model.accelerations(&theta, &[0.0, 0.0], &[0.0, 0.0], &mut a), Err(expected.clone()));
        assert_eq!(solve_accelerations(&model, &theta, &[1.0, 0.0], &[0.0, 0.0], &mut a), Err(expected));
        let (beyond, expected) = ([1e-320, 0.2, 0.0, 1.0, 0.0, 1.0], ModelError::Overflow { model: "vw-pd".into() });
        assert_eq!(model.accelerations(&beyond, &[1.0, 0.0], &[0.0, 0.0], &mut a), Err(expected.clone()));
        let simulated = wheelwright_core::simulation::Simulator::new(&model, &beyond).map(|_| ());
        assert_eq!(simulated, Err(expected), "no statement on what the equations determine");
    }

    #[test]
    fn wheel_constraints_leave_four_unknowns() {
        let map = PdModel::new("wheel-pd").with_wheel_constraints(0.34).map();
        assert_eq!(map.free, ["theta1", "theta2", "theta4", "theta5"]);
        let theta = map.theta(&[0.2, 0.3, 1.1, 0.4]);
        assert_eq!(theta, [0.2, 0.3, 0.34 * 0.34 / 4.0 * 0.4, 1.1, 0.4, 1.1]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn closed_form_equals_the_general_solution(
            lags in prop::array::uniform2(0.01..2.0f64), rest in prop::array::uniform4(-2.0..2.0f64),
            inputs in prop::array::uniform2(-3.0..3.0f64), outputs in prop::array::uniform2(-6.0..6.0f64),
        ) {
            let model = PdModel::new("vw-pd");
            let theta = [lags[0], lags[1], rest[0], rest[1], rest[2], rest[3]];
            let (mut closed, mut solved) = ([0.0; 2], [0.0; 2]);
            model.accelerations(&theta, &inputs, &outputs, &mut closed).unwrap();
            solve_accelerations(&model, &theta, &inputs, &outputs, &mut solved).unwrap();
            for (c, s) in closed.iter().zip(&solved) {
                prop_assert!((c - s).abs() <= 1e-12 * (1.0 + c.abs()), "{closed:?} {solved:?}");
            }
        }
    }
}
