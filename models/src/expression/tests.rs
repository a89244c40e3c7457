use super::*;
use crate::VwPdConfig;
use proptest::prelude::*;
use wheelwright_core::config::tagged;
use wheelwright_core::conformance::check_model;

const VW_PD: &str = r#"
type = "expression"
name = "vw-pd by hand"
inputs = { v_ref = "m/s", omega_ref = "rad/s" }
outputs = { v = "m/s", omega = "rad/s" }
equations = [
  "v_ref = theta1*der(v) - theta3*omega^2 + theta4*v",
  "omega_ref = theta2*der(omega) + theta5*v*omega + theta6*omega",
]
[parameters]
theta1 = { unit = "s", min = 0.0, meaning = "lag of the forward velocity" }
theta2 = { unit = "s", min = 0.0 }
theta3 = { unit = "m s" }
theta4 = { unit = "1" }
theta5 = { unit = "s/m" }
theta6 = { unit = "1", min = 0.5, max = 2, excitation = "turning" }
"#;

fn build(text: &str) -> Result<Box<dyn RegressorModel>, String> {
    let config: Box<dyn ModelConfig> = tagged(toml::from_str(text).unwrap()).map_err(|e| e.to_string())?;
    config.build().map_err(|e| e.to_string())
}

/// A model of v and omega with parameters a and b and the constant g.
fn with_equations(equations: &[&str]) -> Result<Box<dyn RegressorModel>, String> {
    let mut config: ExpressionConfig = toml::from_str(
        "name = 'test'\ninputs = { v_ref = 'm/s' }\noutputs = { v = 'm/s', omega = 'rad/s' }
        constants = { g = 9.81 }\nparameters = { a = { unit = '1' }, b = { unit = '1' } }",
    )
    .unwrap();
    config.equations = equations.iter().map(|e| (*e).to_owned()).collect();
    config.build().map_err(|e| e.to_string())
}

/// Φ and y of a model at the point used throughout.
fn rows(model: &dyn RegressorModel) -> (Vec<f64>, Vec<f64>) {
    let (mut phi, mut y) = (vec![f64::NAN; model.equations() * model.parameters().len()], vec![f64::NAN; model.equations()]);
    model.regressor(Sample { inputs: &[0.4], outputs: &[0.7, -1.3], accelerations: &[2.0, 3.0] }, &mut phi, &mut y);
    (phi, y)
}

/// Values by Python, `eval(text.replace("^", "**"))` with v = 0.7, omega = -1.3, v_ref = 0.4, g = 9.81.
#[test]
fn expressions_have_their_usual_meaning() {
    for (text, expected) in [
        ("1 + 2*3^2 - 4/2/2", 18.0),
        ("-v^2", -0.489_999_999_999_999_94),
        ("2^-1^2", 0.5),
        ("2^3^2", 512.0),
        ("v - omega - v_ref", 1.6),
        ("v/omega/v_ref", -1.346_153_846_153_846),
        ("-2*-v", 1.4),
        ("+v--omega", -0.600_000_000_000_000_1),
        ("sin(v)*cos(omega)+tan(v_ref)", 0.595_120_695_453_484_9),
        ("exp(-v)+ln(v)+sqrt(v)", 0.976_570_386_386_752_6),
        ("abs(omega)+sign(omega)+tanh(omega)", -0.561_723_159_313_306_3),
        ("min(v,omega)*max(v,v_ref)", -0.909_999_999_999_999_9),
        ("g*(v+omega)^3/1.5e-2", -141.264_000_000_000_1),
        ("v^2.5", 0.409_963_413_001_697),
        ("abs(omega)^v", 1.201_601_181_292_952_6),
        ("1.e2*.5+2E+1*v", 64.0),
        ("((v))", 0.7),
        ("v^-2", 2.040_816_326_530_612_3),
        ("sign(0) + sign(v-v)", 0.0),
    ] {
        let model = with_equations(&[&format!("{text} = a*v + b*v")]).unwrap();
        let (_, y) = rows(&*model);
        assert!((y[0] - expected).abs() <= 1e-14 * expected.abs(), "{text}: {} {expected}", y[0]);
    }
}

#[test]
fn parameters_may_stand_anywhere_that_is_linear() {
    for (text, phi, y) in [
        ("v_ref = a*der(v) + b*v", [2.0, 0.7], 0.4),
        ("a*der(v) + b*v = v_ref", [2.0, 0.7], 0.4),
        ("der(v) = a*v_ref - b*v", [0.4, -0.7], 2.0),
        ("v_ref - b*v = a*der(v)", [2.0, 0.7], 0.4),
        ("v_ref = 3*(a - b/2)*der(omega)*v + v - v", [6.3, -3.15], 0.4),
        ("0 = -(a*v) - (der(v)*v + omega)*b + v_ref", [-0.7, -0.1], -0.4),
        ("v_ref + 1 = a*(der(v) + der(omega)*v) + b/(1 + v^2)", [4.1, 1.0 / 1.49], 1.4),
    ] {
        let (found_phi, found_y) = rows(&*with_equations(&[text]).unwrap());
        for (found, expected) in found_phi.iter().chain(&found_y).zip(phi.iter().chain(&[y])) {
            assert!((found - expected).abs() < 1e-14, "{text}: {found_phi:?} {found_y:?}");
        }
    }
}

#[test]
fn what_is_not_linear_is_refused_where_it_stands() {
    for (text, message) in [
        ("v_ref = a*b*v", "column 10: `a` is multiplied by `b`: an equation must be linear in its parameters"),
        ("v_ref = a*v + (b+v)*(a-1)", "column 20: `b` is multiplied by `a`: an equation must be linear in its parameters"),
        ("v_ref = sin(a)*v", "column 13: `a` stands inside sin(): an equation must be linear in its parameters"),
        ("v_ref = max(v, 2*b)", "column 17: `b` stands inside max(): an equation must be linear in its parameters"),
        ("v_ref = a^2*v", "column 9: `a` stands under an exponent: an equation must be linear in its parameters"),
        ("v_ref = 2^b*v", "column 11: `b` stands in an exponent: an equation must be linear in its parameters"),
        ("v_ref = v/(1 + a*v)", "column 14: `a` stands in a divisor: an equation must be linear in its parameters"),
        ("v_ref = a*der(v)*der(omega)", "column 17: der(v) is multiplied by der(omega): an equation must be affine in the derivatives"),
        ("v_ref = a*abs(der(v))", "column 15: der(v) stands inside abs(): an equation must be affine in the derivatives"),
        ("v_ref = a*der(v)^2", "column 11: der(v) stands under an exponent: an equation must be affine in the derivatives"),
        ("v_ref = a/der(v)", "column 11: der(v) stands in a divisor: an equation must be affine in the derivatives"),
        ("v_ref = a*v/0", "column 12: this divides by zero"),
        ("v_ref = a*v + ln(0-1)", "column 15: this is NaN, not a finite number"),
        ("v_ref = v", "holds no parameter: nothing can be identified from it"),
        ("v_ref = (a - a)*v", "holds no parameter: nothing can be identified from it"),
    ] {
        assert_eq!(with_equations(&[text]).unwrap_err(), format!("`equations[0]`: {message}"), "{text}");
    }
}

#[test]
fn what_cannot_be_read_is_refused_where_it_stands() {
    let long = format!("v_ref = a*v{}", " + b*v".repeat(400));
    let deep = format!("v_ref = {}a{}", "(".repeat(65), ")".repeat(65));
    for (text, message) in [
        ("", "column 1: a number, a name or ( is expected here, not the end"),
        ("v_ref", "column 6: an operator, or the = between the two sides, is expected here, not the end"),
        ("v_ref = a*v = b", "column 13: an operator or the end of the equation is expected here, not `=`"),
        ("v_ref = 2 v", "column 11: an operator or the end of the equation is expected here, not `v`"),
        ("v_ref = (a*v", "column 13: an operator or the closing ) is expected here, not the end"),
        ("v_ref = a*sin(v", "column 16: an operator, a comma or the closing ) is expected here, not the end"),
        ("v_ref = a*", "column 11: a number, a name or ( is expected here, not the end"),
        ("v_ref = a**v", "column 11: a number, a name or ( is expected here, not `*`"),
        ("v_ref = a*v!", "column 12: `!` has no meaning here: names, numbers and + - * / ^ ( ) , = make an equation"),
        ("v_ref = ä*v", "column 9: `ä` has no meaning here: names, numbers and + - * / ^ ( ) , = make an equation"),
        ("v_ref = 1.2.3*a", "column 9: `1.2.3` is not a number"),
        ("v_ref = 1e999*a", "column 9: `1e999` is not a number"),
        ("v_ref = a*omga", "column 11: nothing is named `omga`; did you mean `omega`?"),
        ("v_ref = a*x", "column 11: nothing is named `x`; there are v_ref, v, omega, a, b, g"),
        ("v_ref = a*sine(v)", "column 11: no function is named `sine`; did you mean `sin`?"),
        ("v_ref = a(v)", "column 9: `a` is no function; write a*(...) for a product"),
        ("v_ref = a*sin", "column 11: `sin` is a function: write sin(...)"),
        ("v_ref = a*min(v)", "column 11: min() takes 2 argument(s), not 1"),
        ("v_ref = a*der(v_ref)", "column 15: `v_ref` is an input: inputs are held between samples and have no derivative"),
        ("v_ref = a*der(omeg)", "column 15: `omeg` is no output of this model; did you mean `omega`?"),
        ("v_ref = a*der(v + v)", "column 11: der() takes the name of one output, as in der(v)"),
        (&long, "column 2001: the equation has 2411 characters: at most 2000 are read"),
        (&deep, "column 74: nested more than 64 levels deep"),
    ] {
        assert_eq!(with_equations(&[text]).unwrap_err(), format!("`equations[0]`: {message}"), "{text}");
    }
}

#[test]
fn tables_are_checked() {
    let changed = |from: &str, to: &str| build(&VW_PD.replace(from, to)).unwrap_err();
    for (from, to, message) in [
        ("v = \"m/s\"", "v = \"km/h\"", "`outputs.v`: the unit must be `m/s`, not `km/h`"),
        ("theta6 = { unit = \"1\"", "theta6 = { unit = \" \"", "`parameters.theta6.unit`: must be an SI unit, `1` for a pure number"),
        ("max = 2", "max = 0.25", "`parameters.theta6.min`: 0.5 must not lie above the upper bound 0.25"),
        ("[parameters]", "[parameters]\nv = { unit = \"1\" }", "`parameters.v`: `v` has a meaning already: choose another name"),
        ("[parameters]", "[parameters]\nsin = { unit = \"1\" }", "`parameters.sin`: `sin` has a meaning already: choose another name"),
        (
            "[parameters]",
            "[parameters]\n2x = { unit = \"1\" }",
            "`parameters.2x`: a name is made of letters, digits and _, and begins with no digit",
        ),
        ("[parameters]", "[parameters]\nidle = { unit = \"1\" }", "`parameters.idle`: occurs in no equation: remove it, or use it"),
        ("[parameters]", "[constants]\ng = inf\n[parameters]", "`constants.g`: must be a finite number, not inf"),
        ("name = \"vw-pd by hand\"", "", "`name`: is missing: reports call the model by it"),
    ] {
        assert_eq!(changed(from, to), message);
    }
    let error = changed("min = 0.5", "minimum = 0.5");
    assert!(error.starts_with("`parameters.theta6.minimum`: unknown field `minimum`"), "{error}");
    let error = changed("equations = [", "equation = [");
    assert!(error.starts_with("`equation`: unknown field `equation`") && error.ends_with("did you mean `equations`?"), "{error}");
    let error = build("type = 'expression'\nname = 'nothing'").unwrap_err();
    assert!(error.starts_with("`inputs`: is empty"), "{error}");
}

#[test]
fn order_bounds_and_words_are_those_of_the_file() {
    let model =
        build(&VW_PD.replace("[parameters]", "[parameters]\nzeta = { unit = \"m/s\" }").replace("*omega^2", "*omega^2 + zeta")).unwrap();
    let names: Vec<_> = model.parameters().iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["zeta", "theta1", "theta2", "theta3", "theta4", "theta5", "theta6"]);
    assert_eq!(model.parameters()[1].bounds, (0.0, f64::INFINITY));
    assert_eq!(model.parameters()[6].bounds, (0.5, 2.0));
    assert_eq!(model.parameters()[1].meaning, "lag of the forward velocity");
    assert_eq!(model.parameters()[6].excitation, "turning");
    assert_eq!(model.outputs()[1], wheelwright_core::channel::OMEGA);
}

#[test]
fn one_equation_of_one_output() {
    let model = build(
        "type = 'expression'\nname = 'lag'\ninputs = { u = 'V' }\noutputs = { speed = 'm/s' }
        equations = ['u = kA*der(speed) + kV*speed + kS*sign(speed)']
        [parameters]\nkA = { unit = 'V s^2/m' }\nkV = { unit = 'V s/m' }\nkS = { unit = 'V' }",
    )
    .unwrap();
    assert_eq!(check_model(&*model), Ok(()));
    let mut a = [0.0];
    model.accelerations(&[0.5, 2.0, 1.0], &[6.0], &[1.5], &mut a).unwrap();
    assert_eq!(a, [4.0]);
}

#[test]
fn five_coupled_equations() {
    let names = ["p", "q", "r", "s", "w"];
    let outputs: Vec<String> = names.iter().map(|n| format!("{n} = 'rad/s'")).collect();
    let equations: Vec<String> = (0..5)
        .map(|i| {
            let (own, next, over) = (names[i], names[(i + 1) % 5], names[(i + 2) % 5]);
            format!("'u = m*(3*der({own}) + cos({over})*der({next})) + k*{own}*{next} + c{i}*tanh({own})'")
        })
        .collect();
    let damping: Vec<String> = (0..5).map(|i| format!("c{i} = {{ unit = 'N m' }}")).collect();
    let model = build(&format!(
        "type = 'expression'\nname = 'chain'\ninputs = {{ u = 'N m' }}\noutputs = {{ {} }}\nequations = [{}]\n[parameters]\nm = {{ unit = 'kg m^2' }}
        k = {{ unit = 'kg m^2' }}\n{}",
        outputs.join(", "),
        equations.join(", "),
        damping.join("\n")
    ))
    .unwrap();
    assert_eq!((model.equations(), model.outputs().len(), model.parameters().len()), (5, 5, 7));
    // Checks, among the rest, the elimination here against the LU decomposition of the general solution.
    assert_eq!(check_model(&*model), Ok(()));
}

#[test]
fn more_outputs_than_the_small_solution_holds() {
    let list = |item: &dyn Fn(usize) -> String| (0..9).map(item).collect::<Vec<_>>().join(", ");
    let model = build(&format!(
        "type = 'expression'\nname = 'nine'\ninputs = {{ u = 'V' }}\noutputs = {{ {} }}\nequations = [{}]\nparameters = {{ m = {{ unit = '1' }} }}",
        list(&|i| format!("x{i} = 'm'")),
        list(&|i| format!("'u = m*der(x{i}) + {i}*x{i}'"))
    ))
    .unwrap();
    assert_eq!(check_model(&*model), Ok(()));
}

#[test]
fn a_zero_lag_or_too_few_equations_cannot_be_simulated() {
    let mut a = [0.0; 2];
    let model = build(VW_PD).unwrap();
    let end = model.accelerations(&[0.0, 0.2, 0.0, 1.0, 0.0, 1.0], &[1.0, 1.0], &[0.0, 0.0], &mut a);
    assert_eq!(end, Err(ModelError::Singular { model: "vw-pd by hand".into() }));
    let model = with_equations(&["v_ref = a*v + b*omega"]).unwrap();
    let end = model.accelerations(&[1.0, 1.0], &[1.0], &[0.0, 0.0], &mut a);
    assert_eq!(end, Err(ModelError::NotSquare { model: "test".into(), equations: 1, outputs: 2 }));
}

#[test]
fn a_configuration_survives_a_round_trip() {
    let mut table: toml::Table = toml::from_str(VW_PD).unwrap();
    table.remove("type");
    let config: ExpressionConfig = wheelwright_core::config::plain(table).unwrap();
    assert_eq!(toml::from_str::<ExpressionConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_built_in_model_written_by_hand_is_the_built_in_model(
        inputs in prop::array::uniform2(-3.0..3.0f64), outputs in prop::array::uniform2(-6.0..6.0f64),
        accelerations in prop::array::uniform2(-9.0..9.0f64),
        lags in prop::array::uniform2(0.01..2.0f64), rest in prop::array::uniform4(-2.0..2.0f64),
    ) {
        let (written, built_in) = (build(VW_PD).unwrap(), VwPdConfig::default().build().unwrap());
        let evaluate = |model: &dyn RegressorModel| {
            let (mut phi, mut y) = ([f64::NAN; 12], [f64::NAN; 2]);
            model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
            (phi, y)
        };
        prop_assert_eq!(evaluate(&*written), evaluate(&*built_in));
        let theta = [lags[0], lags[1], rest[0], rest[1], rest[2], rest[3]];
        let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
        written.accelerations(&theta, &inputs, &outputs, &mut a).unwrap();
        built_in.accelerations(&theta, &inputs, &outputs, &mut b).unwrap();
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{} {}", a, b);
        }
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in ".{0,80}", tokens in prop::collection::vec("[-+*/^(),=]|a|v|der|sin|1e|2\\.", 0..60)) {
        for text in [text, tokens.concat()] {
            if let Ok(model) = with_equations(&[&text]) {
                rows(&*model);
            }
        }
    }
}
