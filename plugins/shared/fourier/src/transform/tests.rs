use super::*;
use puncta_testkit::{Stopped, Threads};
use std::f64::consts::TAU;

/// Numbers without structure in -0.5 to 0.5.
fn values(count: usize) -> Vec<f64> {
    (0..count as u64)
        .map(|i| {
            let mixed = (i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            ((mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 11) as f64
                / (1_u64 << 53) as f64
                - 0.5
        })
        .collect()
}

/// The transform by its definition, `[kx][ky][kz]`.
fn by_definition(size: [usize; 3], values: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let [depth, height, width] = size;
    let mut out = Vec::new();
    for (kx, ky, kz) in
        (0..width * height * depth).map(|i| (i / (height * depth), i / depth % height, i % depth))
    {
        let term = |(i, value): (usize, &Complex<f64>)| {
            let (z, y, x) = (i / (width * height), i / width % height, i % width);
            let part = |k: usize, at: usize, n: usize| (k * at % n) as f64 / n as f64;
            let turns = part(kx, x, width) + part(ky, y, height) + part(kz, z, depth);
            value * Complex::from_polar(1.0, -TAU * turns)
        };
        out.push(values.iter().enumerate().map(term).sum());
    }
    out
}

const SIZES: [[usize; 3]; 9] = [
    [1, 1, 1],
    [1, 1, 8],
    [1, 7, 1],
    [1, 6, 5],
    [1, 9, 12],
    [1, 40, 34],
    [4, 3, 7],
    [5, 1, 6],
    [2, 18, 20],
];

fn far(a: &[Complex<f64>], b: &[Complex<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .fold(0.0, |far, (a, b)| far.max((a - b).norm()))
}

#[test]
fn as_by_definition() {
    for size in SIZES {
        let real = values(size.iter().product());
        let complex: Vec<Complex<f64>> = real
            .iter()
            .zip(values(2 * real.len()).iter().rev())
            .map(|(re, im)| Complex::new(*re, *im))
            .collect();
        let plan = ComplexFft::new(size);
        let spectrum = plan.forward(&Threads(2), complex.clone()).unwrap();
        assert!(
            far(&spectrum, &by_definition(size, &complex)) < 1e-11,
            "{size:?}"
        );
        let back = plan.inverse(&Threads(2), spectrum).unwrap();
        assert!(far(&back, &complex) < 1e-14, "{size:?}");

        let lifted: Vec<Complex<f64>> = real.iter().map(|v| Complex::new(*v, 0.0)).collect();
        let plan = RealFft::new(size);
        let spectrum = plan.forward(&Threads(2), &real).unwrap();
        let expected = by_definition(size, &lifted);
        assert_eq!(spectrum.len(), plan.spectrum_len());
        assert!(
            far(&spectrum, &expected[..spectrum.len()]) < 1e-11,
            "{size:?}"
        );
        let back = plan.inverse(&Threads(2), spectrum).unwrap();
        let most = back
            .iter()
            .zip(&real)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(most < 1e-14 && back.len() == real.len(), "{size:?} {most}");
    }
}

#[test]
fn single_precision_is_near() {
    let size = [3, 10, 14];
    let real = values(420);
    let narrow: Vec<f32> = real.iter().map(|v| *v as f32).collect();
    let wide = RealFft::new(size).forward(&Threads(1), &real).unwrap();
    let plan = RealFft::<f32>::new(size);
    let spectrum = plan.forward(&Threads(1), &narrow).unwrap();
    for (a, b) in spectrum.iter().zip(&wide) {
        assert!((f64::from(a.re) - b.re).abs() < 1e-5 && (f64::from(a.im) - b.im).abs() < 1e-5);
    }
    let back = plan.inverse(&Threads(1), spectrum).unwrap();
    assert!(back.iter().zip(&narrow).all(|(a, b)| (a - b).abs() < 1e-6));
}

/// Parseval: the sum of squares is that of the spectrum over the number of samples.
#[test]
fn energy_is_kept() {
    for size in [[1, 150, 128], [6, 21, 33]] {
        let real = values(size.iter().product());
        let plan = RealFft::new(size);
        let spectrum = plan.forward(&Threads(2), &real).unwrap();
        let line = size[0] * size[1];
        let energy: f64 = spectrum
            .iter()
            .enumerate()
            .map(|(i, value)| {
                let kx = i / line;
                let alone = kx == 0 || 2 * kx == size[2];
                value.norm_sqr() * if alone { 1.0 } else { 2.0 }
            })
            .sum();
        let direct: f64 = real.iter().map(|v| v * v).sum::<f64>() * real.len() as f64;
        assert!((energy / direct - 1.0).abs() < 1e-13, "{energy} {direct}");
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    for size in [[1, 200, 126], [9, 20, 50]] {
        let real: Vec<f32> = values(size.iter().product())
            .iter()
            .map(|v| *v as f32)
            .collect();
        let plan = RealFft::<f32>::new(size);
        let spectra: Vec<_> = [1, 2, 3]
            .map(|n| plan.forward(&Threads(n), &real).unwrap())
            .into();
        assert!(spectra.iter().all(|one| *one == spectra[0]));
        let images: Vec<_> = [1, 2, 3]
            .map(|n| plan.inverse(&Threads(n), spectra[0].clone()).unwrap())
            .into();
        assert!(images.iter().all(|one| *one == images[0]));
    }
}

#[test]
fn rows_of_zeros_are_skipped_and_short_input_ends_in_zeros() {
    let plan = RealFft::<f64>::plane(6, 10);
    let real = values(24);
    let short = plan.forward(&Threads(2), &real).unwrap();
    let mut whole = real.clone();
    whole.resize(60, 0.0);
    assert_eq!(short, plan.forward(&Threads(2), &whole).unwrap());
    let none = plan.forward_rows(&Threads(2), &|_, row| {
        row.fill(f64::NAN);
        false
    });
    assert!(none.unwrap().iter().all(|value| value.norm_sqr() == 0.0));
    assert_eq!(
        plan.inverse(&Threads(2), Vec::new()).unwrap(),
        vec![0.0; 60]
    );
}

#[test]
fn a_stopped_call_stops() {
    let plan = RealFft::<f64>::plane(64, 64);
    assert!(plan.forward(&Stopped, &values(4096)).is_err());
    assert!(plan.inverse(&Stopped, Vec::new()).is_err());
    let plan = ComplexFft::<f64>::new([4, 4, 4]);
    assert!(plan.forward(&Stopped, Vec::new()).is_err());
    assert!(plan.inverse(&Stopped, Vec::new()).is_err());
}
