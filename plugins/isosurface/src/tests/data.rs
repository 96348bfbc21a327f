//! Clouds of other programs, of which the surface is known.

use super::{Columns, defects, run};
use crate::extract::Settings;
use crate::score::{Triangles, from_mesh, quantile};
use puncta_sdk::run::Serial;
use std::path::{Path, PathBuf};

/// A folder of the data, if it is there.
fn folder(name: &str) -> Option<PathBuf> {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    Some(data.join(name)).filter(|folder| folder.is_dir())
}

fn text(path: PathBuf) -> String {
    std::fs::read_to_string(path).expect("a text file")
}

fn columns(text: &str, separator: char, header: usize) -> Columns {
    let mut columns = Columns::default();
    for line in text.lines().skip(header) {
        for (column, number) in columns.iter_mut().zip(line.split(separator)) {
            column.push(number.trim().parse().expect("a number"));
        }
    }
    columns
}

/// The mesh of a PLY file of text.
fn ply(text: &str) -> Triangles {
    let vertices = text
        .lines()
        .find_map(|line| line.strip_prefix("element vertex "));
    let vertices: usize = vertices.and_then(|n| n.parse().ok()).expect("a number");
    let body = text
        .lines()
        .skip_while(|line| *line != "end_header")
        .skip(1);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (row, line) in body.filter(|line| !line.is_empty()).enumerate() {
        let words = line.split_whitespace();
        if row < vertices {
            let place: Vec<f64> = words.take(3).map(|x| x.parse().expect("x")).collect();
            positions.push([place[0], place[1], place[2]]);
        } else {
            let corners: Vec<u32> = words
                .skip(1)
                .map(|v| v.parse().expect("a vertex"))
                .collect();
            triangles.push([corners[0], corners[1], corners[2]]);
        }
    }
    Triangles::new(positions, triangles, &Serial).expect("a mesh")
}

/// The area of the mesh that the localisations were simulated on, as MeshLab gives it.
#[test]
fn the_bunny_has_its_area() {
    let Some(folder) = folder("smlmsurfacereconstruction") else {
        return;
    };
    let cloud = columns(&text(folder.join("ptsOut20200618.xyz")), '\t', 0);
    assert_eq!(cloud[0].len(), 78_350);
    let surface = run(&cloud, &Settings::default()).surface;
    assert_eq!(defects(&surface), [0; 5]);
    let area = surface.area() / 1.1236e8;
    assert!((area - 1.0).abs() < 0.05, "{area}");
}

/// Localisations with errors of 10 nm in the median.
#[test]
fn the_mitochondria_lie_where_they_were_simulated() {
    let Some(folder) = folder("pointgraphnet") else {
        return;
    };
    let cloud = columns(&text(folder.join("mito_0.csv")), ',', 1);
    let truth = ply(&text(folder.join("mito_0_gt.ply")));
    assert_eq!((cloud[0].len(), truth.triangles.len()), (7253, 28_838));
    let settings = Settings {
        most: 5,
        smoothing: 2,
        ..Settings::default()
    };
    let surface = run(&cloud, &settings).surface;
    assert_eq!(defects(&surface), [0; 5]);
    let area = surface.area() / 4.324_42e6;
    assert!((area - 1.0).abs() < 0.08, "{area}");
    let found = Triangles::new(surface.positions, surface.triangles, &Serial).expect("a mesh");
    for (of, from) in [(&found, &truth), (&truth, &found)] {
        let samples = of.samples(20.0, 1).expect("samples");
        let distances = from_mesh(&samples, from, &Serial).expect("distances");
        let [half, most] = [0.5, 0.95].map(|share| quantile(&distances, share));
        assert!(half < 7.0 && most < 25.0, "{half} {most}");
    }
}
