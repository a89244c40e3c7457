//! Numbers in sentences, and shapes that several effects share.

use wheelwright_core::effect::Estimate;

use super::parts::Part;

/// A value with its unit and, if there is one, its interval: `0.31 V (0.29 to 0.33)`.
pub(super) fn quantity(estimate: Estimate, unit: &str) -> String {
    let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
    match estimate.ci95 {
        Some((low, high)) => format!("{}{unit} ({} to {})", digits(estimate.value), digits(low), digits(high)),
        None => format!("{}{unit}", digits(estimate.value)),
    }
}

/// The same with every number passed through `of`, such as a share turned into percent.
pub(super) fn scaled(estimate: Estimate, of: impl Fn(f64) -> f64) -> Estimate {
    let ends = |(a, b): (f64, f64)| (of(a).min(of(b)), of(a).max(of(b)));
    Estimate { value: of(estimate.value), ci95: estimate.ci95.map(ends) }
}

/// A share in percent, to two digits.
pub(super) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent.abs() < 10.0 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// What is said of each part with its value, joined.
pub(super) fn each(parts: &[Part], values: &[Estimate], say: impl Fn(&Part, Estimate) -> String) -> String {
    parts.iter().zip(values).map(|(part, value)| say(part, *value)).collect::<Vec<_>>().join(", ")
}

/// Most decimals that are told.
const DECIMALS: i32 = 9;

/// Three significant digits; what no decimal shows is 0.
pub(crate) fn digits(value: f64) -> String {
    if !value.is_finite() {
        return format!("{value}");
    }
    if value.abs() < 0.5 * 10_f64.powi(-DECIMALS) {
        return "0".to_owned();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, DECIMALS) as usize;
    format!("{value:.decimals$}")
}

/// Width of the smooth sign of a friction, as a share of the typical wheel speed: narrow against any motion that matters, wide
/// enough to be stepped through.
pub(super) const KINK: f64 = 0.008;

/// The sign of a speed, smooth within the kink.
pub(super) fn smooth_sign(speed: f64, typical: f64) -> f64 {
    2.0 * passage(speed / (KINK * typical)) - 1.0
}

/// From 0 to 1 through ½ at zero: (1 + tanh x)/2, of which it takes half as long.
pub(super) fn passage(x: f64) -> f64 {
    1.0 / (1.0 + (-2.0 * x).exp())
}

/// The length of a vector. A free run is over long before a square overflows, so nothing is scaled first as `hypot` does.
pub(super) fn length<const N: usize>(parts: [f64; N]) -> f64 {
    parts.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::digits;

    #[test]
    fn three_digits_are_told_and_what_no_decimal_shows_is_nothing() {
        let told = [0.0, -1e-13, 2e-9, 0.012_34, -1.234_5, 123.4, f64::INFINITY].map(digits);
        assert_eq!(told, ["0", "0", "0.000000002", "0.0123", "-1.23", "123", "inf"]);
    }
}
