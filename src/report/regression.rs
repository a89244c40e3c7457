//! Regression plots: what each parameter rests on.
//!
//! A regression on several columns cannot be drawn over all of them at once. The added-variable plot of a parameter
//! (Cook and Weisberg, Residuals and Influence in Regression, 1982, section 2.3.2) shows its column less what the other
//! columns explain of it, against the response less what they explain of it. By the theorem of Frisch, Waugh and Lovell the
//! slope of that cloud is the least-squares estimate. The line drawn has the estimate as its slope, so that one can see
//! what a bound, a tie between parameters or a correction changes.

use wheelwright_core::RegressorModel;
use wheelwright_core::solver::Solution;

use crate::report::number::{self, Scale};
use crate::report::plot::{Axis, Cloud, Panel, Plot, Role, SCATTER_POINTS, Series, keep_every, scatter};
use crate::report::terms::{Equation, Term, equations};

/// Share of a column that must be left when the others are taken out, for a plot to mean anything.
const INDEPENDENT: f64 = 1e-9;
/// Relative difference between the slope of a cloud and the estimate from which it is stated.
const DIFFERENT: f64 = 0.005;
const HEIGHT: u32 = 260;

/// One equation's rows.
struct Rows<'a> {
    columns: Vec<Vec<f64>>,
    y: &'a [f64],
}

pub(super) fn html(model: &dyn RegressorModel, solution: &Solution) -> String {
    let Some(regression) = &solution.regression else { return String::new() };
    let (p, mut names) = (solution.theta.len(), equations(model));
    if regression.integrated {
        names.iter_mut().for_each(Equation::integrate);
    }
    let mut text = String::new();
    for (e, (phi, y)) in regression.phi.iter().zip(&regression.y).enumerate() {
        let Some(equation) = names.get(e).filter(|_| p > 0 && !y.is_empty() && phi.len() == p * y.len()) else { continue };
        let rows = Rows { columns: (0..p).map(|j| phi.iter().skip(j).step_by(p).copied().collect()).collect(), y };
        text.push_str(&equation_html(model, solution, equation, &rows, e));
    }
    if text.is_empty() {
        return text;
    }
    let thin = format!(" Clouds of more than {} points are drawn thinned.", number::count(SCATTER_POINTS));
    format!(
        "<p>Each parameter against the data that determines it: its term and the response, both less what all other terms \
         explain (their own parts). The slope of the line is the estimate; a cloud that hugs its line determines the parameter well. Bounds, ties between \
         parameters and corrections (of held inputs, of the filter) can turn the line against the cloud.{thin}</p>\n{text}"
    )
}

fn equation_html(model: &dyn RegressorModel, solution: &Solution, equation: &Equation, rows: &Rows<'_>, e: usize) -> String {
    let predicted: Vec<f64> = (0..rows.y.len()).map(|i| rows.columns.iter().zip(&solution.theta).map(|(c, t)| c[i] * t).sum()).collect();
    let mut plots = vec![response_plot(equation, rows.y, &predicted)];
    for (j, parameter) in model.parameters().iter().enumerate() {
        let Some((own, response)) = own_parts(&rows.columns, rows.y, j) else { continue };
        let theta = solution.theta[j];
        let term = equation.columns[j].clone().unwrap_or(Term { label: format!("regressor of {}", parameter.name), unit: None });
        let scale = Scale::of(theta, solution.std.as_ref().map(|s| s[j]));
        let unit = if parameter.unit == "1" { String::new() } else { format!(" {}", number::unit(&parameter.unit)) };
        let slope = format!("{} = {}{unit}", parameter.name, scale.show(theta));
        let alone = dot(&own, &response) / dot(&own, &own);
        let differs = (alone - theta).abs() > DIFFERENT * theta.abs();
        let remark = if differs { format!(" The cloud alone gives {}{unit}.", scale.show(alone)) } else { String::new() };
        let points = keep_every(own.len()).map(|i| (own[i], response[i])).collect();
        let (points, mut series) = scatter(&[Cloud { label: "data", role: Role::Measured, points }]);
        series.push(Series::straight(&slope, Role::Model, theta, 0.0));
        plots.push(Plot {
            group: String::new(),
            x: Axis::linear(&format!("{}, own part", term.label), &column_unit(&term, equation, &parameter.unit)),
            points,
            panels: vec![Panel {
                y: Axis::linear(&format!("{}, own part", equation.response.label), &unit_of(&equation.response)),
                height: HEIGHT,
                limits: None,
                series,
            }],
            breaks: Vec::new(),
            caption: format!("The slope of the line is {slope}.{remark}"),
        });
    }
    let figures: String = plots.iter().map(Plot::html).collect();
    format!("<h3>Equation {} of {}</h3><div class=\"grid\">{figures}</div>\n", e + 1, model.equations())
}

fn response_plot(equation: &Equation, y: &[f64], predicted: &[f64]) -> Plot {
    let cloud = keep_every(y.len()).map(|i| (predicted[i], y[i])).collect();
    let (points, mut series) = scatter(&[Cloud { label: "data", role: Role::Measured, points: cloud }]);
    series.push(Series::straight("response = prediction", Role::Model, 1.0, 0.0));
    let unit = unit_of(&equation.response);
    Plot {
        group: String::new(),
        x: Axis::linear("predicted by the regression", &unit),
        points,
        panels: vec![Panel { y: Axis::linear(&equation.response.label, &unit), height: HEIGHT, limits: None, series }],
        breaks: Vec::new(),
        caption: format!("{} against what the regression predicts of it.", equation.response.label),
    }
}

/// Column `j` and the response, both less their projections on all other columns, by modified Gram-Schmidt run twice,
/// which is as accurate as Householder reflections (Giraud, Langou and Rozložník 2005). `None` if nothing is left of the
/// column.
fn own_parts(columns: &[Vec<f64>], y: &[f64], j: usize) -> Option<(Vec<f64>, Vec<f64>)> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for (_, column) in columns.iter().enumerate().filter(|(k, _)| *k != j) {
        let direction = less_projections(column, &basis);
        let length = dot(&direction, &direction).sqrt();
        if stands_alone(column, length) {
            basis.push(direction.iter().map(|x| x / length).collect());
        }
    }
    let own = less_projections(&columns[j], &basis);
    let length = dot(&own, &own).sqrt();
    stands_alone(&columns[j], length).then(|| (own, less_projections(y, &basis)))
}

fn less_projections(column: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    for direction in basis.iter().chain(basis) {
        let share = dot(&rest, direction);
        rest.iter_mut().zip(direction).for_each(|(a, b)| *a -= share * b);
    }
    rest
}

/// True if what is left of a column is more than rounding.
fn stands_alone(column: &[f64], left: f64) -> bool {
    left.is_finite() && left > INDEPENDENT * dot(column, column).sqrt()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit_of(term: &Term) -> String {
    term.unit.clone().unwrap_or_default()
}

/// Unit of a column: its own, or that of the response over that of the parameter, as the equation demands.
fn column_unit(term: &Term, equation: &Equation, parameter: &str) -> String {
    let derived = || match (equation.response.unit.as_deref(), parameter) {
        (Some(response), "1" | "") => response.to_owned(),
        (Some(response), parameter) => format!("({response})/({})", number::unit(parameter)),
        (None, _) => String::new(),
    };
    term.unit.clone().unwrap_or_else(derived)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_parts_give_the_least_squares_slope() {
        // np.linalg.lstsq(np.column_stack([a, b]), y) with a = i, b = i**2 % 7, y = 2 a - 3 b + (-1)**i, i = 0..9
        let a: Vec<f64> = (0..10).map(f64::from).collect();
        let b: Vec<f64> = (0..10).map(|i| f64::from(i * i % 7)).collect();
        let y: Vec<f64> = (0..10).map(|i| 2.0 * a[i] - 3.0 * b[i] + if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let zero = vec![0.0; 10];
        let columns = [a, b, zero];
        let slope = |j: usize| {
            let (own, response) = own_parts(&columns, &y, j).unwrap();
            dot(&own, &response) / dot(&own, &own)
        };
        assert!((slope(0) - 1.998040656380112).abs() < 1e-12, "{}", slope(0));
        assert!((slope(1) + 3.0477590007347537).abs() < 1e-12, "{}", slope(1));
        assert!(own_parts(&columns, &y, 2).is_none());
    }
}
