//! Decimal numbers in text, read at memory speed where that is exact, and what is wrong with a cell that is none.

/// Powers of ten that a double holds exactly.
static EXACT_POWERS: [f64; 23] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22];

/// Powers of ten by which a run of up to eight digits shifts what stands before it.
static POWERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// Digits that an unsigned 64-bit integer holds whatever they are.
const MOST_DIGITS: usize = 19;

/// Integers up to here are doubles.
const EXACT_INTEGER: u64 = 1 << 53;

/// Reads a decimal number at the start of `bytes`; returns it with its length, or nothing if there is none.
///
/// Where mantissa and power of ten are both doubles one multiplication or division rounds correctly (Clinger, "How to read
/// floating point numbers accurately", 1990), and so does one long division of integers for numbers of up to nineteen digits;
/// the standard library reads the rest. The caller checks what follows.
pub(crate) fn leading(bytes: &[u8]) -> Option<(f64, usize)> {
    let negative = bytes.first() == Some(&b'-');
    let start = usize::from(negative);
    let (mut mantissa, whole_end) = few_digits(bytes, start, 0);
    let mut end = whole_end;
    let mut count = whole_end - start;
    let mut exponent = 0i32;
    if bytes.get(end) == Some(&b'.') {
        let fraction_end;
        (mantissa, fraction_end) = digits(bytes, end + 1, mantissa);
        let fraction = fraction_end - end - 1;
        count += fraction;
        exponent = -i32::try_from(fraction).ok()?;
        end = fraction_end;
    }
    if count == 0 {
        return None;
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let (power, power_end) = power(bytes, end + 1)?;
        exponent += power;
        end = power_end;
    }
    if let Some(size) = exact(mantissa, exponent).filter(|_| count - leading_zeros(bytes, start, count) <= MOST_DIGITS) {
        return Some((if negative { -size } else { size }, end));
    }
    let value: f64 = std::str::from_utf8(&bytes[..end]).ok()?.parse().ok()?;
    value.is_finite().then_some((value, end))
}

/// `mantissa` times ten to the `exponent`, correctly rounded; nothing where that takes longer arithmetic.
#[inline]
fn exact(mantissa: u64, exponent: i32) -> Option<f64> {
    let power = exponent.unsigned_abs() as usize;
    if mantissa <= EXACT_INTEGER && power < EXACT_POWERS.len() {
        let factor = EXACT_POWERS[power];
        return Some(if exponent < 0 { mantissa as f64 / factor } else { mantissa as f64 * factor });
    }
    (exponent < 0 && power <= MOST_DIGITS).then(|| quotient(mantissa, 10u64.pow(exponent.unsigned_abs())))
}

/// A quotient of integers other than zero, correctly rounded.
///
/// Both are shifted until their top bits are set, so that the whole part of 2⁶³ m / d has at least 62 bits. A remainder only
/// decides ties, for which the lowest bit speaks; the conversion to a double rounds once and the power of two is exact.
fn quotient(mantissa: u64, divisor: u64) -> f64 {
    let (shift_m, shift_d) = (mantissa.leading_zeros(), divisor.leading_zeros());
    let (m, d) = (u128::from(mantissa << shift_m) << 63, u128::from(divisor << shift_d));
    let whole = (m / d) as u64 | u64::from(m % d != 0);
    let exponent = 1023 - 63 + u64::from(shift_d) - u64::from(shift_m);
    whole as f64 * f64::from_bits(exponent << 52)
}

/// How many of the digits are zeros that stand before any other; looked at only where there are too many digits.
#[inline]
fn leading_zeros(bytes: &[u8], start: usize, count: usize) -> usize {
    let zeros = || bytes[start..].iter().take_while(|b| matches!(b, b'0' | b'.')).filter(|b| **b == b'0').count();
    if count > MOST_DIGITS { zeros() } else { 0 }
}

/// Appends the digits at `start` to `mantissa`; returns it with where they end. Wraps beyond nineteen digits.
#[inline]
fn digits(bytes: &[u8], start: usize, mantissa: u64) -> (u64, usize) {
    let (mut value, mut end) = (mantissa, start);
    while let Some(chunk) = bytes.get(end..).and_then(|rest| rest.first_chunk::<8>()) {
        let (part, count) = eight_digits(u64::from_le_bytes(*chunk));
        value = value.wrapping_mul(POWERS[count]).wrapping_add(part);
        end += count;
        if count < 8 {
            return (value, end);
        }
    }
    few_digits(bytes, end, value)
}

/// As [`digits`], one by one: quicker for the few digits before a decimal point.
#[inline]
fn few_digits(bytes: &[u8], start: usize, mantissa: u64) -> (u64, usize) {
    let (mut value, mut end) = (mantissa, start);
    while let Some(digit) = bytes.get(end).map(|b| b.wrapping_sub(b'0')).filter(|d| *d < 10) {
        value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        end += 1;
    }
    (value, end)
}

/// The number that the leading digits of eight characters make, first character lowest, with how many digits they are.
///
/// All eight are looked at together: in neighbouring pairs, then fours, then eight (D. Lemire, "Quickly parsing eight
/// digits", 2018).
#[inline]
fn eight_digits(characters: u64) -> (u64, usize) {
    const EACH: u64 = 0x0101_0101_0101_0101;
    let values = characters ^ (EACH * u64::from(b'0'));
    // A byte above nine reaches its top bit when 0x76 is added; carries only spoil bytes behind the first such one.
    let others = (values.wrapping_add(EACH * 0x76) | values) & (EACH * 0x80);
    let count = (others.trailing_zeros() / 8) as usize;
    if count == 0 {
        return (0, 0);
    }
    let digits = values << (64 - 8 * count);
    let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
    const LANES: u64 = 0x0000_00ff_0000_00ff;
    let high = (pairs & LANES).wrapping_mul(100 + (1_000_000 << 32));
    let low = ((pairs >> 16) & LANES).wrapping_mul(1 + (10_000 << 32));
    (high.wrapping_add(low) >> 32, count)
}

/// The signed integer after an `e`, with its end; nothing for more than four digits.
fn power(bytes: &[u8], start: usize) -> Option<(i32, usize)> {
    let sign = usize::from(matches!(bytes.get(start), Some(b'-' | b'+')));
    let (value, end) = few_digits(bytes, start + sign, 0);
    let length = end - start - sign;
    let value = if (1..=4).contains(&length) { i32::try_from(value).ok()? } else { return None };
    Some((if bytes.get(start) == Some(&b'-') { -value } else { value }, end))
}

/// A cell as a finite number.
///
/// # Errors
/// What is wrong with it and what to do, as the end of a sentence about the cell.
pub(crate) fn cell(cell: &[u8]) -> Result<f64, String> {
    let cell = cell.trim_ascii();
    if let Some((value, length)) = leading(cell)
        && length == cell.len()
    {
        return Ok(value);
    }
    if cell.is_empty() {
        return Err("the cell is empty; fill it or remove the row".to_owned());
    }
    let text = String::from_utf8_lossy(cell);
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(format!("{text} is not a finite number; remove the row or repair the export")),
        Err(_) if text.replacen(',', ".", 1).parse::<f64>().is_ok() => {
            Err(format!("`{text}` has a decimal comma; export the file with a decimal point"))
        }
        Err(_) => Err(format!("`{}` is not a number", shortened(&text))),
    }
}

/// At most forty characters of a cell, for messages.
fn shortened(text: &str) -> String {
    if text.chars().count() <= 40 { text.to_owned() } else { text.chars().take(40).chain("...".chars()).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_double_reads_as_the_standard_library_reads_it(bits in any::<u64>(), digits in 0usize..20) {
            let value = f64::from_bits(bits);
            prop_assume!(value.is_finite());
            for text in [format!("{value}"), format!("{value:e}"), format!("{:.*}", digits, value % 1e6)] {
                let expected: f64 = text.parse().unwrap();
                prop_assert_eq!(leading(text.as_bytes()).map(|(v, n)| (v.to_bits(), n)), Some((expected.to_bits(), text.len())));
            }
        }

        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = leading(&bytes);
            let _ = cell(&bytes);
        }
    }

    #[test]
    fn runs_of_digits_are_read_to_their_end() {
        for text in ["1", "12345678", "123456789", "00000000000000000001", "1234567.", "12345678/1", "1234:5678", "99999999\u{e4}"] {
            let expected = text.bytes().take_while(u8::is_ascii_digit).count();
            let (value, end) = digits(text.as_bytes(), 0, 0);
            assert_eq!((value, end), (text[..expected].parse().unwrap(), expected), "{text}");
        }
    }

    #[test]
    fn numbers_stop_where_they_end() {
        assert_eq!(leading(b"1.5,2"), Some((1.5, 3)));
        assert_eq!(leading(b"-0.0\n"), Some((-0.0, 4)));
        assert_eq!(leading(b"5.e-3 "), Some((0.005, 5)));
        for none in [&b""[..], b"-", b".", b"x", b"1e", b"1e99999", b"1e400"] {
            assert_eq!(leading(none), None, "{none:?}");
        }
    }

    #[test]
    fn cells_that_are_no_numbers_say_why() {
        for (text, expected) in
            [("", "empty"), ("NaN", "not a finite"), ("-inf", "not a finite"), ("0,05", "decimal comma"), ("fast", "not a number")]
        {
            assert!(cell(text.as_bytes()).unwrap_err().contains(expected), "{text}");
        }
        assert_eq!(cell(b" +1.5 "), Ok(1.5));
    }
}
