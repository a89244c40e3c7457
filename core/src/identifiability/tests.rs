//! A two-axis robot with six parameters, as `vw-pd` has them, driven in ways that show some of them or none.

use super::*;
use crate::channel::{Channel, OMEGA, OMEGA_REF, V, V_REF};
use crate::dataset::Stretch;
use crate::model::{Parameter, RegressorModel, Sample};
use crate::noise::tests::Normal;
use crate::simulation::Simulator;

#[derive(Debug)]
pub(crate) struct TwoAxes(Vec<Parameter>);

impl TwoAxes {
    pub(crate) fn new() -> Self {
        let lag = |name, needs| Parameter::new(name, "s", "", needs).within(0.0, f64::INFINITY);
        let other = |name, unit, needs| Parameter::new(name, unit, "", needs);
        Self(vec![
            lag("theta1", "changes of forward speed"),
            lag("theta2", "changes of turning rate"),
            other("theta3", "m s", "fast turning"),
            other("theta4", "1", "driving at several forward speeds"),
            other("theta5", "s/m", "turning at several forward speeds"),
            other("theta6", "1", "turning at several rates"),
        ])
    }
}

impl RegressorModel for TwoAxes {
    fn name(&self) -> &str {
        "two-axes"
    }

    fn inputs(&self) -> &[Channel] {
        const { &[V_REF, OMEGA_REF] }
    }

    fn outputs(&self) -> &[Channel] {
        const { &[V, OMEGA] }
    }

    fn parameters(&self) -> &[Parameter] {
        &self.0
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        let (v, w, a) = (sample.outputs[0], sample.outputs[1], sample.accelerations);
        phi.copy_from_slice(&[a[0], 0.0, -w * w, v, 0.0, 0.0, 0.0, a[1], 0.0, 0.0, v * w, w]);
        y.copy_from_slice(sample.inputs);
    }
}

/// θ of the Pioneer in simulation (Laut 2011, section 4.2).
pub(crate) const THETA: [f64; 6] = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];

/// Runs the robot with commands of time and adds white noise.
pub(crate) fn driven(commands: impl Fn(f64) -> [f64; 2], seconds: f64, rate: f64, noise: f64, seed: u64) -> Dataset {
    let model = TwoAxes::new();
    let n = (seconds * rate) as usize;
    let time: Vec<f64> = (0..n).map(|k| k as f64 / rate).collect();
    let inputs: Vec<Vec<f64>> = (0..2).map(|i| time.iter().map(|t| commands(*t)[i]).collect()).collect();
    let mut stretch = Stretch { label: String::new(), time, inputs, outputs: vec![vec![0.0; n]; 2] };
    let mut simulated = vec![Vec::new(); 2];
    Simulator::new(&model, &THETA).unwrap().run(&stretch, &[0.0, 0.0], &mut simulated).unwrap();
    let mut normal = Normal::new(seed);
    simulated.iter_mut().flatten().for_each(|x| *x += noise * normal.next());
    stretch.outputs = simulated;
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

/// What drove the Pioneer of the thesis.
pub(crate) fn thesis(t: f64) -> [f64; 2] {
    [
        0.4 + 0.1 * ((2.0 * t).sin() + t.sin() + (t / 3.0).sin() + (t / 11.0).sin()),
        0.75 + 0.25 * ((1.5 * t).sin() + t.sin() + (0.5 * t).sin() + (0.2 * t).sin()),
    ]
}

fn verdicts(data: &Dataset) -> (Vec<Verdict>, Identifiability) {
    let model = TwoAxes::new();
    let found = assess(&model, &model.map(), None, data).unwrap();
    (found.parameters.iter().map(|p| p.verdict).collect(), found)
}

#[test]
fn the_drive_of_the_thesis_shows_every_parameter() {
    let (verdicts, found) = verdicts(&driven(thesis, 150.0, 20.0, 0.005, 1));
    assert_eq!(verdicts, [Verdict::Identifiable; 6], "{:#?}", found.parameters);
    assert!(found.concerns().is_empty(), "{:?}", found.concerns());
    assert!(found.noise.iter().all(|s| (s / 0.005 - 1.0).abs() < 0.05), "{:?}", found.noise);
}

#[test]
fn predicted_standard_errors_are_the_scatter_over_seeds() {
    let model = TwoAxes::new();
    let fits: Vec<Vec<f64>> = (0..60)
        .map(|seed| {
            let found = assess(&model, &model.map(), None, &driven(thesis, 40.0, 20.0, 0.005, seed)).unwrap();
            found.parameters.iter().map(|p| p.value).chain(found.parameters.iter().map(|p| p.predicted_std.unwrap())).collect()
        })
        .collect();
    for j in 0..6 {
        let mean = fits.iter().map(|f| f[j]).sum::<f64>() / 60.0;
        let scatter = (fits.iter().map(|f| (f[j] - mean).powi(2)).sum::<f64>() / 59.0).sqrt();
        let predicted = fits.iter().map(|f| f[6 + j]).sum::<f64>() / 60.0;
        // The standard deviation of 60 numbers is known to 9 %: three of those.
        assert!((scatter / predicted - 1.0).abs() < 0.28, "theta{}: {scatter} {predicted}", j + 1);
        assert!((mean - THETA[j]).abs() < 4.0 * predicted / 60.0_f64.sqrt() + 1e-6, "theta{}: {mean}", j + 1);
    }
}

#[test]
fn a_robot_that_never_turns_tells_nothing_of_turning() {
    let (verdicts, found) = verdicts(&driven(|t| [thesis(t)[0], 0.0], 60.0, 20.0, 0.005, 2));
    use Verdict::{Identifiable, Not};
    assert_eq!(verdicts, [Identifiable, Not, Not, Identifiable, Not, Not], "{:#?}", found.parameters);
    assert!(
        found.parameters[4].statement().starts_with("theta5 is not identifiable: the robot never turns; theta5 needs"),
        "{:?}",
        found.concerns()
    );
}

#[test]
fn turning_only_at_rest_hides_the_coupling_to_speed() {
    // With three seconds of rest in between, in which whatever moved dies away.
    let alternating = |t: f64| match (t % 20.0, t) {
        (phase, _) if phase % 10.0 > 7.0 => [0.0, 0.0],
        (phase, t) if phase < 10.0 => [0.4 * (2.0 * t).sin(), 0.0],
        (_, t) => [0.0, (1.5 * t).sin()],
    };
    let (_, found) = verdicts(&driven(alternating, 120.0, 20.0, 0.005, 3));
    let theta5 = &found.parameters[4];
    assert!(matches!(theta5.verdict, Verdict::Weak | Verdict::Not), "{theta5:?}");
    assert!(theta5.reason.contains("never turns while driving"), "{}", theta5.reason);
    assert_eq!(found.parameters[0].verdict, Verdict::Identifiable, "{:?}", found.parameters[0]);
}

#[test]
fn constant_commands_show_no_lag_once_the_start_is_cut_off() {
    let mut data = driven(|_| [0.5, 0.8], 60.0, 20.0, 0.005, 4);
    data.stretches[0] = data.stretches[0].slice(200..1200);
    let (verdicts, found) = verdicts(&data);
    // One steady state tells neither lag, nor what within an equation is due to which term.
    assert!(verdicts.iter().all(|v| *v == Verdict::Not), "{:#?}", found.parameters);
    assert!(found.parameters[0].reason.contains("forward speed hardly ever changes"), "{}", found.parameters[0].reason);
    assert_eq!(found.sampling, None);
}

#[test]
fn a_fixed_parameter_needs_no_data() {
    let model = TwoAxes::new();
    let mut map = model.map();
    map.impose(&[(4, 1.0)], 0.0026).unwrap();
    let found = assess(&model, &map, None, &driven(thesis, 60.0, 20.0, 0.005, 5)).unwrap();
    assert_eq!(found.parameters[4].verdict, Verdict::Fixed);
    assert_eq!(found.parameters[5].verdict, Verdict::Identifiable);
}

#[test]
fn verdicts_do_not_depend_on_units() {
    // Angles in degrees: theta3 is divided by (180/π)², nothing else changes but noise in its unit.
    let alternating = |t: f64| [0.4 * (0.7 * t).sin(), 0.3 * (0.4 * t).sin()];
    let data = driven(alternating, 25.0, 10.0, 0.02, 6);
    let mut scaled = data.clone();
    let factor = 180.0 / std::f64::consts::PI;
    let stretch = &mut scaled.stretches[0];
    stretch.outputs[1].iter_mut().chain(&mut stretch.inputs[1]).for_each(|x| *x *= factor);
    let (first, a) = verdicts(&data);
    let (second, b) = verdicts(&scaled);
    assert_eq!(first, second);
    for (j, scale) in [1.0, 1.0, factor * factor, 1.0, 1.0, 1.0].iter().enumerate() {
        let (a, b) = (a.parameters[j].predicted_std.unwrap(), b.parameters[j].predicted_std.unwrap());
        assert!((a / (b * scale) - 1.0).abs() < 0.02, "theta{}: {a} {}", j + 1, b * scale);
    }
}

#[test]
fn sampling_is_judged_against_the_time_constant() {
    let at = |rate: f64| verdicts(&driven(thesis, 150.0, rate, 0.005, 7)).1.sampling.unwrap();
    // 1.0768/0.2509 = 4.29/s is the faster rate: 0.233 s.
    let slow = at(5.0);
    assert_eq!(slow.rate, Rate::TooSlow, "{slow:?}");
    assert!((slow.fastest_s - 0.233).abs() < 0.02, "{slow:?}");
    assert!((slow.recommended_hz - 43.0).abs() < 4.0, "{slow:?}");
    assert_eq!(at(20.0).rate, Rate::Adequate);
}

#[test]
fn excitation_is_counted() {
    let square = |t: f64| if (t as i64 / 2) % 2 == 0 { [0.5, 0.0] } else { [-0.5, 0.0] };
    let facts = Excitation::of(&driven(square, 40.0, 20.0, 0.0, 8), &[1e-6, 1e-6]);
    assert_eq!(facts.inputs[0].steps, 19);
    assert_eq!(facts.inputs[0].reversals, 19);
    assert_eq!(facts.outputs[0].reversals, 19);
    assert_eq!(facts.inputs[1].band_hz, None);
    assert!(facts.inputs[0].steady > 0.7 && facts.outputs[0].moving > 0.9, "{facts:?}");
    let (low, high) = facts.inputs[0].band_hz.unwrap();
    assert!(low < 0.26 && high > 0.26 && high < 5.0, "{low} {high}");
}
