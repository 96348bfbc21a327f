//! Tests of the simulation against what the definitions say.

use super::*;
use crate::arrangement::Turn;
use crate::sample::tests::first_order_distance;
use crate::shape::{Shape, tests::shared};
use puncta_shared_vector::{norm, sub};
use puncta_testkit::{Stopped, Threads};

fn cloud(parameters: &Parameters) -> Cloud {
    simulate(parameters, &Threads(2)).expect("valid parameters")
}

fn dense(shape: Shape) -> Parameters {
    Parameters {
        shape,
        acceptance: 0.04,
        ..Parameters::default()
    }
}

#[test]
fn the_number_of_sites_follows_from_the_area() {
    for shape in [Shape::Tori, Shape::Junction, Shape::Er] {
        let parameters = dense(shape);
        let sites = cloud(&parameters).membrane_sites as f64;
        let expected = 2.0 * shape.area() * parameters.dx * 0.04 / parameters.dx.powi(3);
        assert!(
            (sites - expected).abs() < 5.0 * expected.sqrt(),
            "{shape:?}: {sites}, {expected}"
        );
        assert!(parameters.row_bound() as f64 > sites / 0.9);
    }
}

#[test]
fn the_background_share_is_exact() {
    for background in [0.0, 0.01, 0.1, 0.5, 0.9] {
        let cloud = cloud(&Parameters {
            background,
            ..Parameters::default()
        });
        let total = cloud.localisations.len();
        let membrane = cloud
            .localisations
            .iter()
            .filter(|l| cloud.is_membrane(l))
            .count();
        assert_eq!(membrane, cloud.membrane_sites);
        let expected = (background * membrane as f64 / (1.0 - background)).round() as usize;
        assert_eq!(total - membrane, expected);
        assert_eq!(cloud.sites.len(), total);
    }
}

#[test]
fn noise_free_sites_lie_on_the_membrane_and_normals_point_outwards() {
    let parameters = dense(Shape::Er);
    let solid = parameters.shape.solid();
    let cloud = cloud(&parameters);
    let (membrane, background) = cloud.sites.split_at(cloud.membrane_sites);
    for site in membrane {
        assert!(first_order_distance(&solid, site.position).abs() < parameters.dx);
        let normal = site.normal.map(f64::from);
        assert!((norm(normal) - 1.0).abs() < 1e-6);
        let out = [0, 1, 2].map(|i| site.position[i] + 3.0 * normal[i]);
        assert!(solid.value(out) > solid.value(site.position));
        assert_eq!(site.copy, 1);
    }
    assert!(
        background
            .iter()
            .all(|site| site.copy == 0 && site.normal[0].is_nan())
    );
}

#[test]
fn errors_and_photons_have_the_stated_moments() {
    let parameters = Parameters {
        fwhm: [250.0, 300.0, 840.0],
        ..dense(Shape::Er)
    };
    let cloud = cloud(&parameters);
    let count = cloud.localisations.len() as f64;
    let mut squares = [0.0; 3];
    let (mut fourth, mut photons) = (0.0, 0.0);
    for localisation in &cloud.localisations {
        let sigma = cloud.errors(localisation);
        let site = &cloud.sites[localisation.site as usize];
        for i in 0..3 {
            let z = (localisation.position[i] - site.position[i]) / sigma[i];
            squares[i] += z * z;
            fourth += z.powi(4);
        }
        let expected = parameters.fwhm[2] / 2.355 / f64::from(localisation.photons).sqrt();
        assert!((sigma[2] / expected - 1.0).abs() < 1e-12);
        assert!(localisation.photons >= 20.0);
        photons += f64::from(localisation.photons);
    }
    // Chi-squared with `count` degrees of freedom along each axis; kurtosis 3.
    for square in squares {
        assert!(
            (square - count).abs() < 5.0 * (2.0 * count).sqrt(),
            "{square} {count}"
        );
    }
    assert!((fourth / (3.0 * count) - 3.0).abs() < 5.0 * (96.0 / (3.0 * count)).sqrt());
    // 20 + Exp(100): mean 120, standard deviation 100.
    assert!((photons / count - 120.0).abs() < 5.0 * 100.0 / count.sqrt());
    // The exponential's median is 100 ln 2.
    let median = 20.0 + 100.0 * 2f32.ln();
    let above = cloud
        .localisations
        .iter()
        .filter(|l| l.photons > median)
        .count() as f64;
    assert!((above / count - 0.5).abs() < 2.5 / count.sqrt());
}

#[test]
fn sites_are_seen_as_often_as_a_draw_without_replacement_says() {
    let parameters = dense(Shape::Er);
    let cloud = cloud(&parameters);
    let mut seen = vec![0u32; cloud.sites.len()];
    for localisation in &cloud.localisations {
        seen[localisation.site as usize] += 1;
    }
    let sites = cloud.membrane_sites as f64;
    assert_eq!(
        seen.iter().map(|&n| n as usize).sum::<usize>(),
        cloud.localisations.len()
    );
    // Ten samples of which a tenth is drawn: binomial to the order of 1 / sites.
    let probability = [0.348_678, 0.387_420, 0.193_710, 0.057_396, 0.011_160];
    let mut statistic = 0.0;
    for (times, p) in (0u32..).zip(probability) {
        let number = seen[..cloud.membrane_sites]
            .iter()
            .filter(|n| **n == times)
            .count() as f64;
        statistic += (number - sites * p).powi(2) / (sites * p);
    }
    // 4 degrees of freedom: 0.999 quantile.
    assert!(statistic < 18.5, "{statistic}");
    assert!(seen.iter().all(|n| *n <= parameters.blinks));
    let single = self::cloud(&Parameters {
        blinks: 1,
        ..dense(Shape::Tori)
    });
    let mut once: Vec<u32> = single.localisations.iter().map(|l| l.site).collect();
    once.sort_unstable();
    assert!(once.into_iter().eq(0..single.sites.len() as u32));
}

#[test]
fn the_background_fills_its_box() {
    let parameters = Parameters {
        background: 0.8,
        ..dense(Shape::Tori)
    };
    let cloud = cloud(&parameters);
    let membrane: Vec<Localisation> = cloud
        .localisations
        .iter()
        .filter(|l| cloud.is_membrane(l))
        .copied()
        .collect();
    let [low, side] = background_box(&membrane);
    let background = &cloud.sites[cloud.membrane_sites..];
    for axis in 0..3 {
        let mut bins = [0f64; 12];
        for site in background {
            let u = (site.position[axis] - low[axis]) / side[axis];
            assert!((0.0..=1.0).contains(&u));
            bins[((u * 12.0) as usize).min(11)] += 1.0;
        }
        let mean = background.len() as f64 / 12.0;
        let statistic: f64 = bins.iter().map(|n| (n - mean).powi(2) / mean).sum();
        assert!(statistic < 31.3, "{bins:?}");
    }
    let widest = membrane.iter().fold(0f64, |w, l| w.max(l.position[0]));
    assert!((low[0] + side[0] - widest - side[0] / 12.0).abs() < 1e-9);
}

#[test]
fn rows_are_sorted_and_a_site_is_seen_once_a_frame() {
    let parameters = Parameters {
        frames: 40,
        ..dense(Shape::Junction)
    };
    let rows = cloud(&parameters).localisations;
    assert!(
        rows.windows(2)
            .all(|w| (w[0].frame, w[0].site) < (w[1].frame, w[1].site))
    );
    assert!(rows.iter().all(|row| row.frame < 40));
    assert_eq!(rows.last().map(|row| row.frame), Some(39));
}

#[test]
fn results_depend_on_the_seed_and_not_on_the_threads() {
    let parameters = Parameters {
        copies: 5,
        turn: Turn::Any,
        ..dense(Shape::Junction)
    };
    let one = simulate(&parameters, &Threads(1)).expect("valid");
    let two = simulate(&parameters, &Threads(2)).expect("valid");
    let bits = |cloud: &Cloud| format!("{:?} {:?}", cloud.sites, cloud.localisations);
    assert_eq!(bits(&one), bits(&two));
    let other = cloud(&Parameters {
        seed: 1,
        ..parameters
    });
    assert_ne!(
        one.localisations[0].position,
        other.localisations[0].position
    );
}

#[test]
fn one_parameter_leaves_the_draws_of_the_others_alone() {
    let base = cloud(&Parameters::default());
    let finer = cloud(&Parameters {
        fwhm: [140.0; 3],
        ..Parameters::default()
    });
    let membrane = base.membrane_sites;
    assert_eq!(base.sites[..membrane], finer.sites[..membrane]);
    for (a, b) in base.localisations.iter().zip(&finer.localisations) {
        assert_eq!((a.frame, a.site, a.photons), (b.frame, b.site, b.photons));
        if base.is_membrane(a) {
            // Half the resolution, half the error.
            let truth = base.sites[a.site as usize].position;
            let (a, b) = (sub(a.position, truth), sub(b.position, truth));
            assert!(norm(sub(a, b.map(|c| 2.0 * c))) < 1e-9);
        }
    }
}

#[test]
fn copies_keep_the_membrane() {
    let parameters = Parameters {
        copies: 9,
        turn: Turn::Any,
        gap: 60.0,
        background: 0.0,
        ..Parameters::default()
    };
    let cloud = cloud(&parameters);
    let places = arrange(
        parameters.shape.bounds(),
        9,
        Turn::Any,
        60.0,
        parameters.seed,
    );
    let solid = parameters.shape.solid();
    let mut sizes = [0; 9];
    for site in &cloud.sites {
        let copy = site.copy as usize - 1;
        sizes[copy] += 1;
        // Back to the frame of the shape: the transpose of the rotation.
        let q = sub(site.position, places[copy].to);
        let back = [0, 1, 2].map(|i| (0..3).map(|j| places[copy].rotation.0[j][i] * q[j]).sum());
        let p = puncta_shared_vector::add(back, places[copy].centre);
        assert!(first_order_distance(&solid, p).abs() < parameters.dx + 1e-9);
    }
    let expected = parameters.expected_candidates() * parameters.acceptance;
    assert!(
        sizes
            .iter()
            .all(|n| (f64::from(*n) - expected).abs() < 5.0 * expected.sqrt())
    );
}

/// Mean |f| / |grad f| of the membrane's localisations against clouds of another program.
#[test]
fn distances_from_the_membrane_are_those_of_the_reference_clouds() {
    let solid = Shape::Tori.solid();
    let distance = |p: Point| first_order_distance(&solid, p).abs();
    let mean = |distances: &[f64]| distances.iter().sum::<f64>() / distances.len() as f64;
    let mut reference = vec![];
    let files = ["p0.005_n0.1", "p0.04_n0.1", "p0.01_n0.01", "p0.01_n0.5"];
    for (number, file) in files.into_iter().enumerate() {
        let Some(rows) = shared(&format!("tori_{file}_z280_s0.csv")) else {
            return;
        };
        let inside = rows.iter().filter(|row| row[6] == 1.0);
        reference.extend(inside.map(|row| distance([row[0], row[1], row[2]])));
        if number == 0 {
            // The file of the published setting alone.
            assert!((mean(&reference) / 12.0 - 1.0).abs() < 0.25);
        }
    }
    let cloud = cloud(&dense(Shape::Tori));
    let membrane = cloud.localisations.iter().filter(|l| cloud.is_membrane(l));
    let ours: Vec<f64> = membrane.map(|l| distance(l.position)).collect();
    let ratio = mean(&ours) / mean(&reference);
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    let squares = |d: &[f64]| d.iter().map(|d| d * d).sum::<f64>() / d.len() as f64;
    let ratio = squares(&ours) / squares(&reference);
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
}

#[test]
fn no_site_and_cancel_are_errors() {
    let none = Parameters {
        acceptance: 1e-12,
        ..Parameters::default()
    };
    let refused = simulate(&none, &Threads(1)).expect_err("nothing to keep");
    assert_eq!(
        refused.to_string(),
        "no site was kept at acceptance 0.000000000001; raise it"
    );
    assert_eq!(
        simulate(&Parameters::default(), &Stopped),
        Err(Failure::cancelled())
    );
    let bad = Parameters {
        acceptance: 0.0,
        ..Parameters::default()
    };
    assert!(simulate(&bad, &Threads(1)).is_err_and(|failure| !failure.is_cancelled()));
}
