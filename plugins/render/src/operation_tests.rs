//! Tests of the operations as calls: channels, units, bad input.
#![allow(clippy::unwrap_used)]

use crate::testing::{Random, sum};
use crate::{
    Gaussian, Gaussian3d, Histogram, Histogram3d, Quadtree, Triangulation, Triangulation3d,
};
use puncta_sdk::FailureCode;
use puncta_testkit::{Call, Done, Table};

fn table(name: &str, columns: [&[f64]; 3]) -> Table {
    let [x, y, z] = columns;
    Table::new(name)
        .f64("x", "nm", x)
        .f64("y", "nm", y)
        .f64("z", "nm", z)
}

fn random(name: &str, count: usize) -> Table {
    let mut random = Random::new(count as u64);
    let columns = [(); 3].map(|()| random.many(count, 0.0, 600.0));
    table(name, [&columns[0], &columns[1], &columns[2]])
}

fn image(done: &Done) -> Vec<f32> {
    done.output("image").unwrap().f32("value").unwrap()
}

fn calls() -> [(&'static str, Call); 7] {
    [
        ("histogram", Call::of::<Histogram>()),
        ("gaussian", Call::of::<Gaussian>().set("sigma", 10)),
        ("quadtree", Call::of::<Quadtree>()),
        (
            "triangulation",
            Call::of::<Triangulation>().set("samples", 2),
        ),
        ("histogram3d", Call::of::<Histogram3d>()),
        (
            "gaussian3d",
            Call::of::<Gaussian3d>()
                .set("sigma", 10)
                .set("depth_sigma", 20),
        ),
        (
            "triangulation3d",
            Call::of::<Triangulation3d>().set("samples", 2),
        ),
    ]
}

#[test]
fn each_table_is_a_channel_on_one_grid() {
    for (name, call) in calls() {
        // So wide that jitter moves nothing out.
        let call = call.set("margin", 900);
        let done = call
            .input("table", random("a", 300))
            .input("table", random("a", 100))
            .run()
            .unwrap();
        let header = &done.output("image").unwrap().header;
        let info = header.image.as_ref().unwrap();
        assert_eq!(
            (info.size[1], info.channels.join(",")),
            (2, "a,a 2".into()),
            "{name}"
        );
        let values = image(&done);
        let (one, two) = values.split_at(values.len() / 2);
        assert!(
            (sum(one) - 300.0).abs() < 2.0 && (sum(two) - 100.0).abs() < 2.0,
            "{name} {}",
            sum(one)
        );
        assert!(done.documents[0].to_string().contains("(a 2)"));
    }
}

#[test]
fn channels_are_chosen_by_probability() {
    let columns: [&[f64]; 3] = [&[5.0, 15.0, 25.0, 35.0], &[5.0; 4], &[5.0; 4]];
    let with = || {
        let table = table("t", columns).f64("p_red", "1", &[0.9, 0.05, 0.5, 0.0]);
        table.f64("p_green", "1", &[0.05, 0.9, 0.5, 0.0])
    };
    let call = Call::of::<Histogram>().set("channels", "probability");
    let done = call.input("table", with()).run().unwrap();
    // The third could be either, the fourth neither; the grid covers those that are shown.
    assert_eq!(image(&done), [1.0, 0.0, 0.0, 1.0]);
    let info = done.output("image").unwrap().header.image.clone().unwrap();
    assert_eq!(info.channels, ["red", "green"]);
    let both = Call::of::<Histogram>()
        .set("channels", "probability")
        .set("p_other", 0.6);
    assert_eq!(
        sum(&image(&both.input("table", with()).run().unwrap())),
        4.0
    );
    let none = Call::of::<Histogram>()
        .set("channels", "probability")
        .input("table", table("t", columns));
    assert_eq!(
        none.prepare().unwrap_err().parameter.as_deref(),
        Some("channels")
    );
}

#[test]
fn densities_say_their_unit() {
    for (call, unit, size) in [
        (Call::of::<Quadtree>(), "1/nm^2", 100.0),
        (Call::of::<Triangulation>(), "1/nm^2", 100.0),
        (
            Call::of::<Triangulation3d>().set("samples", 2),
            "1/nm^3",
            20_000.0,
        ),
    ] {
        let call = call
            .set("margin", 300)
            .set("unit", "nm")
            .input("table", random("t", 200));
        let done = call.run().unwrap();
        let header = &done.output("image").unwrap().header;
        assert_eq!(header.parts[0].columns[0].unit, unit);
        assert!((sum(&image(&done)) * size - 200.0).abs() < 2.0);
    }
}

#[test]
fn what_cannot_be_rendered_is_one_sentence_or_an_image() {
    let nan = f64::NAN;
    let bad: [[&[f64]; 3]; 5] = [
        [&[], &[], &[]],
        [&[1.0], &[2.0], &[3.0]],
        [&[7.0; 9], &[7.0; 9], &[7.0; 9]],
        [
            &[nan, 1.0, 50.0, 9.0],
            &[1.0, nan, 60.0, 3.0],
            &[1.0, 2.0, 70.0, nan],
        ],
        [
            &[0.0, 100.0, 200.0, 300.0],
            &[0.0, 100.0, 200.0, 300.0],
            &[5.0; 4],
        ],
    ];
    for (case, columns) in bad.into_iter().enumerate() {
        for (name, call) in calls() {
            let call = match name.starts_with("tri") {
                true => call.set("jitter_scale", 0),
                false => call,
            };
            match call.input("table", table("t", columns)).run() {
                Ok(done) => assert!(image(&done).iter().all(|v| v.is_finite()), "{name} {case}"),
                Err(failure) => {
                    assert!(
                        case == 0 || name.starts_with("tri"),
                        "{name} {case} {failure}"
                    );
                    assert_eq!(
                        failure.code,
                        FailureCode::BadInput,
                        "{name} {case} {failure}"
                    );
                    assert!(failure.remedy.is_some());
                }
            }
        }
    }
    let flat = table(
        "t",
        [
            &[0.0, 9.0, 0.0, 9.0, 4.0],
            &[0.0, 0.0, 9.0, 9.0, 4.0],
            &[5.0; 5],
        ],
    );
    let failure = Call::of::<Triangulation3d>()
        .input("table", flat)
        .run()
        .unwrap_err();
    assert!(failure.to_string().contains("same z"), "{failure}");
}

#[test]
fn too_large_a_volume_is_refused_with_sizes_that_fit() {
    let far: [&[f64]; 3] = [&[0.0, 1e6], &[0.0, 1e6], &[0.0, 1e5]];
    let call = Call::of::<Histogram3d>().input("table", table("t", far));
    let failure = call.run().unwrap_err();
    assert_eq!(failure.code, FailureCode::Resources);
    assert!(
        failure.to_string().contains("voxel size in z of"),
        "{failure}"
    );
}

#[test]
fn the_same_seed_gives_the_same_image_and_cancel_works() {
    let run = |seed: u32, threads: usize| {
        let call = Call::of::<Triangulation>()
            .set("seed", seed.to_string())
            .set("keep", 0.6);
        image(
            &call
                .threads(threads)
                .input("table", random("t", 400))
                .run()
                .unwrap(),
        )
    };
    assert!(run(1, 1) == run(1, 3) && run(1, 2) != run(2, 2));
    for (name, call) in calls() {
        let stopped = call.cancel_after(2).input("table", random("t", 2000)).run();
        assert!(stopped.unwrap_err().is_cancelled(), "{name}");
    }
}
