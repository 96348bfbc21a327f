use super::*;

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }
    fn digits(&mut self, n: u64) -> String {
        (0..n)
            .map(|_| char::from(b'0' + self.below(10) as u8))
            .collect()
    }
}

fn read(text: &str, shift: i32) -> Option<f64> {
    general(text.as_bytes(), b'.', shift).map(|n| match n {
        Number::Decimal(d) => value(d, shift),
        Number::Long(v) | Number::Special(v) => v,
    })
}

fn read_short(text: &str) -> Option<f64> {
    let mut padded = text.as_bytes().to_vec();
    padded.extend_from_slice(&[b','; WINDOW]);
    let (decimal, end) = short(padded.first_chunk()?, b'.')?;
    (end == text.len()).then(|| value(decimal, 0))
}

fn same(text: &str) {
    let truth: f64 = text.parse().unwrap();
    let ours = read(text, 0).unwrap_or_else(|| panic!("{text} refused"));
    assert_eq!(
        ours.to_bits(),
        truth.to_bits(),
        "{text}: {ours} is not {truth}"
    );
    if let Some(ours) = read_short(text) {
        assert_eq!(
            ours.to_bits(),
            truth.to_bits(),
            "{text}: short path gives {ours}"
        );
    }
}

fn random_decimal(r: &mut Random) -> String {
    let mut text = String::from(["", "-", "+", ""][r.below(4) as usize]);
    match r.below(6) {
        0 => {
            text += &f64::from_bits(r.next() & !(0x7ff << 52) | (r.below(0x7ff) << 52))
                .abs()
                .to_string()
        }
        1 => text += &format!("{:e}", f64::from_bits(r.next() >> 12).abs()),
        2 => {
            let n = 1 + r.below(40);
            text += &r.digits(n);
        }
        _ => {
            let (a, b) = (r.below(12), 1 + r.below(22));
            text += &r.digits(a);
            text.push('.');
            text += &r.digits(b);
        }
    }
    if r.below(3) == 0 && !text.contains('e') {
        let (sign, power) = (["", "-", "+"][r.below(3) as usize], r.below(330));
        text += &format!("{}{sign}{power}", ["e", "E"][r.below(2) as usize]);
    }
    text
}

#[test]
fn a_million_random_decimals_equal_the_standard_library() {
    let mut r = Random(20_261_122);
    for _ in 0..1_000_000 {
        same(&random_decimal(&mut r));
    }
}

#[test]
fn short_decimals_take_the_short_path_and_are_right() {
    let mut r = Random(7);
    let mut taken = 0;
    for _ in 0..300_000 {
        let (a, b) = (1 + r.below(8), r.below(9));
        let mut text = format!("{}{}", ["", "-"][r.below(2) as usize], r.digits(a));
        let b = if r.below(2) == 0 { b } else { 8 + r.below(12) };
        if b > 0 && a + b <= 19 {
            text += ".";
            text += &r.digits(b);
        }
        same(&text);
        taken += usize::from(read_short(&text).is_some());
    }
    assert_eq!(taken, 300_000);
}

#[test]
fn hard_cases() {
    for text in [
        "0",
        "-0",
        "0.0",
        "-0.0",
        "1.",
        ".5",
        "-.5e1",
        "5e-324",
        "2.4703282292062328e-324",
        "2.4703282292062327e-324",
        "2.2250738585072011e-308",
        "2.2250738585072014e-308",
        "1.7976931348623157e308",
        "1.7976931348623159e308",
        "9007199254740993",
        "9007199254740992.5",
        "9007199254740993.00000000000000000000000000001",
        "0.1e-400",
        "1e400",
        "1e-400",
        "123456789012345678901234567890",
        "0.000000000000000000000000000000000001",
        "179769313486231580793728971405301e276",
        "8.442911973260991817129021e-309",
        "00000000000000000000000000000001.5",
        "1e23",
        "9.5367431640625e-7",
        "1e+0005",
        "18446744073709551615",
        "18446744073709551616",
        "9999999999999999999e-19",
    ] {
        same(text);
        same(&format!("-{}", text.trim_start_matches('-')));
    }
    let long = format!("1.{}1e10", "0".repeat(800));
    same(&long);
}

#[test]
fn shifting_equals_moving_the_point() {
    let mut r = Random(3);
    for _ in 0..100_000 {
        let (a, b) = (1 + r.below(4), 1 + r.below(18));
        let text = format!("{}.{}", r.digits(a), r.digits(b));
        for shift in [3, 9, -3] {
            let truth: f64 = format!("{text}e{shift}").parse().unwrap();
            assert_eq!(
                read(&text, shift).unwrap().to_bits(),
                truth.to_bits(),
                "{text} e{shift}"
            );
        }
    }
}

#[test]
fn words_for_infinity_and_missing() {
    for text in ["inf", "Inf", "INF", "+inf", "Infinity", "1.#INF"] {
        assert_eq!(read(text, 0), Some(f64::INFINITY), "{text}");
    }
    assert_eq!(read("-inf", 3), Some(f64::NEG_INFINITY));
    for text in [
        "", "nan", "NaN", "-nan", "NA", "N/A", "#N/A", "null", "None", "-1.#IND",
    ] {
        assert!(read(text, 0).is_some_and(f64::is_nan), "{text}");
    }
}

#[test]
fn what_is_no_number_is_refused() {
    for text in [
        "-", "+", ".", "e5", "1e", "1e+", "1.2.3", "1 2", "0x10", "abc", "12a", "--1", "+-1",
        "1,5", "1_000", "-NA", "infx", "1e5.5", "\u{0}", "1\u{0}",
    ] {
        assert_eq!(general(text.as_bytes(), b'.', 0), None, "{text}");
    }
}

#[test]
fn whole_numbers_are_found_in_any_spelling() {
    let whole = |text: &str| match general(text.as_bytes(), b'.', 0) {
        Some(Number::Decimal(d)) => d.whole(),
        _ => None,
    };
    assert_eq!(whole("1.0"), Some(1));
    assert_eq!(whole("1.000000e+03"), Some(1000));
    assert_eq!(whole("-12.50"), None);
    assert_eq!(whole("-9223372036854775808"), Some(i64::MIN));
    assert_eq!(whole("9223372036854775808"), None);
    assert_eq!(whole("0.000"), Some(0));
    assert_eq!(whole("1e30"), None);
}

#[test]
fn a_decimal_comma() {
    let Some(Number::Decimal(d)) = general(b"-12,25", b',', 0) else {
        panic!("refused")
    };
    assert_eq!(value(d, 0), -12.25);
    let long = general(b"1,00000000000000000000000001", b',', 0);
    assert_eq!(long, Some(Number::Long(1.0)));
}
