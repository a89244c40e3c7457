//! Numbers as a reader wants them: as many digits as they deserve, a true minus sign, powers of ten written out.

/// Decimals beyond which a power of ten reads better.
const MAX_DECIMALS: i32 = 6;
/// Narrow no-break space, between groups of digits and before units.
pub const THIN: char = '\u{202f}';
/// What stands for a number that there is not.
pub const NONE: &str = "—";

/// A unit as printed: `V s^2/m` becomes V s²/m.
pub fn unit(text: &str) -> String {
    text.replace("^2", "²").replace("^3", "³")
}

/// `x` with `decimals` digits after the point.
pub fn fixed(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    let zero = text.bytes().all(|b| matches!(b, b'-' | b'0' | b'.'));
    if zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "−") }
}

/// `x` with `digits` significant digits.
pub fn significant(x: f64, digits: usize) -> String {
    if !x.is_finite() {
        return NONE.to_owned();
    }
    let decimals = digits as i32 - 1 - magnitude(x);
    if !(-3..=MAX_DECIMALS).contains(&decimals) {
        return scientific(x, magnitude(x), digits.saturating_sub(1));
    }
    fixed(x, decimals.max(0) as usize)
}

/// A whole number with its digits in groups of three.
pub fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        // Four digits read well without a space.
        if i > 0 && digits.len() > 4 && (digits.len() - i).is_multiple_of(3) {
            text.push(THIN);
        }
        text.push(digit);
    }
    text
}

/// A fit in percent: one decimal, more where one would round it up to perfection.
pub fn percent(x: f64) -> String {
    let decimals = (1..=4).find(|&d| x >= 100.0 || format!("{x:.d$}").parse::<f64>().is_ok_and(|shown| shown < 100.0)).unwrap_or(4);
    format!("{}{THIN}%", fixed(x, decimals))
}

/// Writes a value and whatever belongs to it with the decimals that its uncertainty leaves meaningful.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    exponent: i32,
    decimals: usize,
}

impl Scale {
    /// Two significant digits of the uncertainty; five of the value where there is none.
    pub fn of(value: f64, uncertainty: Option<f64>) -> Self {
        let last = match uncertainty {
            Some(u) if u.is_finite() && u > 0.0 => (magnitude(u) - 1).max(magnitude(value) - 9),
            _ if value == 0.0 => 0,
            _ => magnitude(value) - 4,
        };
        let first = magnitude(value).max(last);
        // A power of ten where plain digits would be mostly zeros.
        let exponent = if -last > MAX_DECIMALS || last > 0 { first } else { 0 };
        Self { exponent, decimals: (exponent - last).max(0) as usize }
    }

    /// A number in this scale.
    pub fn show(self, x: f64) -> String {
        if !x.is_finite() {
            NONE.to_owned()
        } else if self.exponent == 0 {
            fixed(x, self.decimals)
        } else {
            scientific(x, self.exponent, self.decimals)
        }
    }
}

/// Power of ten of the leading digit; zero counts as one.
fn magnitude(x: f64) -> i32 {
    if x == 0.0 || !x.is_finite() { 0 } else { x.abs().log10().floor() as i32 }
}

fn scientific(x: f64, exponent: i32, decimals: usize) -> String {
    let digits: String = exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            digit => char::from_u32(digit as u32 - '0' as u32 + 0x2070).unwrap_or(digit),
        })
        .collect();
    format!("{}{THIN}×{THIN}10{digits}", fixed(x / 10f64.powi(exponent), decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_uncertainty() {
        let shown = |value, uncertainty| {
            let scale = Scale::of(value, uncertainty);
            (scale.show(value), uncertainty.map(|u| scale.show(u)))
        };
        assert_eq!(shown(0.260_213, Some(0.001_04)), ("0.2602".to_owned(), Some("0.0010".to_owned())));
        assert_eq!(shown(-0.004_98, Some(0.000_31)), ("−0.00498".to_owned(), Some("0.00031".to_owned())));
        assert_eq!(shown(12.3456, Some(2.5)), ("12.3".to_owned(), Some("2.5".to_owned())));
        assert_eq!(shown(0.260_213, None), ("0.26021".to_owned(), None));
        assert_eq!(shown(1.5e-9, Some(2.0e-11)), ("1.500\u{202f}×\u{202f}10⁻⁹".to_owned(), Some("0.020\u{202f}×\u{202f}10⁻⁹".to_owned())));
        assert_eq!(shown(f64::NAN, None).0, NONE);
        assert_eq!(shown(0.0, Some(0.0)).0, "0");
    }

    #[test]
    fn numbers_carry_true_signs_and_groups() {
        assert_eq!(fixed(-0.000_1, 2), "0.00");
        assert_eq!(fixed(-3.25, 1), "−3.2");
        assert_eq!(count(24_120), "24\u{202f}120");
        assert_eq!(count(4074), "4074");
        assert_eq!(significant(1234.56, 3), "1235");
        assert_eq!(significant(0.000_012_34, 3), "1.23\u{202f}×\u{202f}10⁻⁵");
        assert_eq!(significant(f64::INFINITY, 3), NONE);
    }

    #[test]
    fn a_fit_is_never_rounded_to_perfection() {
        assert_eq!(percent(96.14), "96.1\u{202f}%");
        assert_eq!(percent(99.97), "99.97\u{202f}%");
        assert_eq!(percent(99.999_6), "99.9996\u{202f}%");
        assert_eq!(percent(-12.34), "−12.3\u{202f}%");
        assert_eq!(percent(100.0), "100.0\u{202f}%");
    }
}
