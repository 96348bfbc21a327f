//! Decimal numbers in text, correctly rounded.
//!
//! Short numbers take the exact path of Clinger (PLDI 1990): a mantissa up to 2^53 and a power of
//! ten up to 10^22 are both exact in f64, so one multiplication or division rounds once. All else
//! goes to the standard library, which is correctly rounded for any number of digits.
//! Digits are read eight at a time inside a 64-bit word.

use wide::u8x16;

/// ±mantissa · 10^exponent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decimal {
    /// The digits without the point.
    pub mantissa: u64,
    /// The power of ten.
    pub exponent: i32,
    /// A minus sign stands before it (also before zero).
    pub negative: bool,
}

/// What one field holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Number {
    /// A decimal that fits in 19 digits.
    Decimal(Decimal),
    /// A number that needed the long way, already multiplied by 10^shift.
    Long(f64),
    /// Infinity with its sign, or NaN for a missing value.
    Special(f64),
}

const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];
const TENS: [u64; 20] = {
    let mut tens = [1u64; 20];
    let mut i = 1;
    while i < 20 {
        tens[i] = tens[i - 1] * 10;
        i += 1;
    }
    tens
};
const EXACT: u64 = 1 << 53;
const ONES: u64 = 0x0101_0101_0101_0101;

impl Decimal {
    /// The nearest f64 to the value times 10^shift, where one rounding gives it.
    #[inline(always)]
    pub fn exact(self, shift: i32) -> Option<f64> {
        if self.mantissa > EXACT {
            return None;
        }
        let power = self.exponent + shift;
        let scale = *POWERS.get(power.unsigned_abs() as usize)?;
        // Below 2^53, where the signed conversion is one instruction.
        let value = self.mantissa as i64 as f64;
        let value = if power < 0 {
            value / scale
        } else {
            value * scale
        };
        Some(if self.negative { -value } else { value })
    }

    /// The value as a whole number, where it is one that fits.
    #[inline(always)]
    pub fn whole(self) -> Option<i64> {
        let digits = if self.exponent == 0 {
            self.mantissa
        } else if self.exponent == -1 {
            let tenth = self.mantissa / 10;
            if tenth * 10 != self.mantissa {
                return None;
            }
            tenth
        } else {
            let tens = TENS.get(self.exponent.unsigned_abs() as usize);
            if self.mantissa == 0 {
                0
            } else if self.exponent > 0 {
                self.mantissa.checked_mul(*tens?)?
            } else {
                let tens = *tens?;
                if !self.mantissa.is_multiple_of(tens) {
                    return None;
                }
                self.mantissa / tens
            }
        };
        if self.negative {
            0i64.checked_sub_unsigned(digits)
        } else {
            i64::try_from(digits).ok()
        }
    }
}

/// The high bit of each byte that is not an ASCII digit.
#[inline(always)]
fn not_digits(word: u64) -> u64 {
    let low = word ^ (ONES * 0x30);
    (((low & (ONES * 0x7f)) + ONES * 0x76) | low) & (ONES * 0x80)
}

/// One bit for each of 16 bytes that is not a digit, bit 0 for the first byte.
#[inline(always)]
fn stops(window: &[u8; WINDOW], at: usize) -> u32 {
    let bytes = window.get(at..).and_then(|rest| rest.first_chunk::<16>());
    let low = u8x16::new(*bytes.unwrap_or(&[0; 16])) ^ u8x16::splat(0x30);
    low.max(u8x16::splat(10)).simd_eq(low).to_bitmask()
}

/// The value of the first `count` (0 to 8) digits of a word.
#[inline(always)]
fn digits(word: u64, count: u32) -> u64 {
    let aligned = (word ^ (ONES * 0x30))
        .checked_shl(64 - 8 * count)
        .unwrap_or(0);
    let pairs = aligned.wrapping_mul(10).wrapping_add(aligned >> 8);
    let low = (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(0x000f_4240_0000_0064);
    let high = ((pairs >> 16) & 0x0000_00ff_0000_00ff).wrapping_mul(0x0000_2710_0000_0001);
    low.wrapping_add(high) >> 32
}

#[inline(always)]
fn word(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk::<8>()?))
}

/// How far behind a number's start [`short`] reads.
pub const WINDOW: usize = 48;

/// Eight bytes of a window; `at` is at most 39.
#[inline(always)]
fn word_in(window: &[u8; WINDOW], at: u32) -> u64 {
    let rest = window
        .get((at & 31) as usize..)
        .and_then(|rest| rest.first_chunk::<8>());
    rest.map_or(0, |eight| u64::from_le_bytes(*eight))
}

/// Reads `[-]digits[.digits]` at the start of a window where it is short; returns it and its
/// length. `None` means only that [`general`] must look.
#[inline(always)]
pub fn short(window: &[u8; WINDOW], point: u8) -> Option<(Decimal, usize)> {
    let mask = stops(window, 0) | 1 << 16;
    // A first byte that is no digit must be the sign.
    let sign = mask & 1;
    let mask = mask >> sign;
    let whole = mask.trailing_zeros();
    if sign != 0 && window[0] != b'-' || whole.wrapping_sub(1) >= 8 {
        return None;
    }
    let negative = sign != 0;
    let mantissa = digits(word_in(window, sign), whole);
    let end = sign + whole;
    if window[(end & 31) as usize] != point {
        return Some((
            Decimal {
                mantissa,
                exponent: 0,
                negative,
            },
            end as usize,
        ));
    }
    let stop = (mask & (mask - 1)).trailing_zeros();
    if stop + sign >= 16 {
        let (mantissa, places) = many_places(window, end + 1, mantissa, whole)?;
        let decimal = Decimal {
            mantissa,
            exponent: -(places as i32),
            negative,
        };
        return Some((decimal, (end + 1 + places) as usize));
    }
    let places = stop - whole - 1;
    let tail = word_in(window, end + 1);
    let mantissa = if places <= 8 {
        mantissa * TENS[places as usize & 15] + digits(tail, places)
    } else {
        let rest = places - 8;
        let upper = mantissa * TENS[8] + digits(tail, 8);
        upper * TENS[rest as usize & 15] + digits(word_in(window, end + 9), rest)
    };
    Some((
        Decimal {
            mantissa,
            exponent: -(places as i32),
            negative,
        },
        (stop + sign) as usize,
    ))
}

/// Goes on behind the point at more digits than one vector holds: 19 digits in all.
#[inline(never)]
fn many_places(window: &[u8; WINDOW], from: u32, mantissa: u64, whole: u32) -> Option<(u64, u32)> {
    let mask = stops(window, 0) | stops(window, 16) << 16;
    let places = mask.checked_shr(from).unwrap_or(0).trailing_zeros();
    if places > 19 - whole.min(19) || from + places >= 32 {
        return None;
    }
    let mut mantissa = mantissa;
    let mut taken = 0;
    while taken < places {
        let some = (places - taken).min(8);
        let digits = digits(word_in(window, from + taken), some);
        mantissa = mantissa * TENS[some as usize & 15] + digits;
        taken += some;
    }
    Some((mantissa, places))
}

/// Collects digits into `mantissa`; counts them in `count`.
fn run_of_digits(text: &[u8], mut at: usize, mantissa: &mut u64, count: &mut usize) -> usize {
    while *count <= 11
        && let Some(eight) = word(text, at)
        && not_digits(eight) == 0
    {
        *mantissa = *mantissa * TENS[8] + digits(eight, 8);
        *count += if *mantissa == 0 { 0 } else { 8 };
        at += 8;
    }
    while let Some(digit) = text.get(at).filter(|b| b.is_ascii_digit()) {
        *mantissa = mantissa
            .wrapping_mul(10)
            .wrapping_add(u64::from(digit - b'0'));
        *count += usize::from(*count > 0 || *digit != b'0');
        at += 1;
    }
    at
}

/// Reads a whole field (no blanks around it). `None` when it is not a number.
/// `shift` multiplies by a power of ten within the one rounding.
pub fn general(text: &[u8], point: u8, shift: i32) -> Option<Number> {
    let (negative, start) = match text.first() {
        None => return Some(Number::Special(f64::NAN)),
        Some(b'-') => (true, 1),
        Some(b'+') => (false, 1),
        Some(_) => (false, 0),
    };
    let (mut mantissa, mut count) = (0u64, 0usize);
    let mut at = run_of_digits(text, start, &mut mantissa, &mut count);
    let mut seen = at - start;
    let mut exponent = 0i32;
    if text.get(at) == Some(&point) {
        let from = at + 1;
        at = run_of_digits(text, from, &mut mantissa, &mut count);
        seen += at - from;
        exponent = -i32::try_from(at - from).ok()?;
    }
    if seen == 0 {
        return special(text.get(start..)?, negative, start > 0);
    }
    let digits_end = at;
    let mut power = 0i32;
    if matches!(text.get(at), Some(b'e' | b'E')) {
        (power, at) = power_of_ten(text, at + 1)?;
    }
    if at != text.len() {
        return special(text.get(start..)?, negative, start > 0);
    }
    if count <= 19 {
        let decimal = Decimal {
            mantissa,
            exponent: exponent.saturating_add(power),
            negative,
        };
        if mantissa == 0 || decimal.exponent.unsigned_abs() < 100_000 {
            let exponent = if mantissa == 0 { 0 } else { decimal.exponent };
            return Some(Number::Decimal(Decimal {
                exponent,
                ..decimal
            }));
        }
    }
    long(text.get(..digits_end)?, point, power.saturating_add(shift)).map(Number::Long)
}

fn power_of_ten(text: &[u8], from: usize) -> Option<(i32, usize)> {
    let (negative, from) = match text.get(from) {
        Some(b'-') => (true, from + 1),
        Some(b'+') => (false, from + 1),
        _ => (false, from),
    };
    let mut at = from;
    let mut power = 0i32;
    while let Some(digit) = text.get(at).filter(|b| b.is_ascii_digit()) {
        power = power
            .saturating_mul(10)
            .saturating_add(i32::from(digit - b'0'))
            .min(1 << 28);
        at += 1;
    }
    (at > from).then_some((if negative { -power } else { power }, at))
}

/// The standard library's conversion of `digits · 10^power`; `digits` may hold a sign and a point.
fn long(digits: &[u8], point: u8, power: i32) -> Option<f64> {
    let text = std::str::from_utf8(digits).ok()?;
    if power == 0 && point == b'.' {
        return text.parse().ok();
    }
    let mut plain = text.replace(char::from(point), ".");
    plain.push('e');
    plain.push_str(&power.to_string());
    plain.parse().ok()
}

/// The spellings of infinity and of a missing value; `signed` says that a sign stood before it.
fn special(text: &[u8], negative: bool, signed: bool) -> Option<Number> {
    let is = |words: &[&str]| {
        words
            .iter()
            .any(|w| text.eq_ignore_ascii_case(w.as_bytes()))
    };
    if is(&["inf", "infinity", "1.#inf", "1.#inf00", "\u{221e}"]) {
        let value = if negative {
            f64::NEG_INFINITY
        } else {
            f64::INFINITY
        };
        return Some(Number::Special(value));
    }
    let missing = is(&["nan", "nanq", "1.#qnan", "1.#ind", "1.#ind00", "1.#qnan0"])
        || (!signed && is(&["na", "n/a", "#n/a", "null", "none", "<na>", "nan(ind)"]));
    missing.then_some(Number::Special(f64::NAN))
}

/// The f64 of a decimal times 10^shift, by whichever way is needed.
#[inline(always)]
pub fn value(decimal: Decimal, shift: i32) -> f64 {
    match decimal.exact(shift) {
        Some(value) => value,
        None => inexact(decimal, shift),
    }
}

#[inline(never)]
fn inexact(decimal: Decimal, shift: i32) -> f64 {
    let power = decimal.exponent.saturating_add(shift);
    let tens = TENS
        .get(power.unsigned_abs() as usize)
        .filter(|_| power <= 0);
    match tens {
        Some(tens) if decimal.mantissa != 0 => {
            let value = quotient(decimal.mantissa, *tens);
            if decimal.negative { -value } else { value }
        }
        _ => rounded(decimal, shift),
    }
}

/// The nearest f64 to a / b, for a and b above zero. The integer quotient has at least 63 bits,
/// so its last bit may carry "there is a remainder" into the one rounding to 53 bits.
fn quotient(a: u64, b: u64) -> f64 {
    let (up_a, up_b) = (a.leading_zeros(), b.leading_zeros());
    let numerator = u128::from(a << up_a) << 63;
    let denominator = u128::from(b << up_b);
    let whole = numerator / denominator;
    let bits = whole as u64 | u64::from(whole * denominator != numerator);
    let power = i64::from(up_b) - i64::from(up_a) - 63;
    bits as f64 * f64::from_bits(((1023 + power) as u64) << 52)
}

/// The correctly rounded f64 of a decimal that the exact path cannot take.
#[inline(never)]
fn rounded(decimal: Decimal, shift: i32) -> f64 {
    use std::io::Write;
    let mut text = [0u8; 48];
    let mut rest = &mut text[..];
    let power = decimal.exponent.saturating_add(shift);
    // 20 digits, `e`, sign and 10 digits always fit; a failure would leave no number to parse.
    let written = write!(rest, "{}e{power}", decimal.mantissa).is_ok();
    let left = rest.len();
    let used = text.len() - left;
    let value = text
        .get(..used)
        .and_then(|t| std::str::from_utf8(t).ok()?.parse::<f64>().ok());
    let value = value.filter(|_| written).unwrap_or(f64::NAN);
    if decimal.negative { -value } else { value }
}

#[cfg(test)]
#[path = "number_tests.rs"]
mod tests;
