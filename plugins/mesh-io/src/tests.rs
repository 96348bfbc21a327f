//! Round trips, real files and damaged ones.

use crate::ply::Encoding;
use crate::reader::{ReadObj, ReadOff, ReadPly, ReadStl};
use crate::sheet::{Column, Sheet, Values};
use crate::writer::{WriteGlb, WriteObj, WriteOff, WritePly, WriteStl, WriteVtp};
use crate::{obj, off, ply, stl};
use puncta_sdk::Failure;
use puncta_sdk::run::{Run, Serial};
use puncta_sdk::serde_json::{Value, from_slice};
use puncta_shared_mesh::shapes;
use puncta_testkit::{Call, Object};
use std::path::{Path, PathBuf};

type Read = fn(&[u8], &dyn Run) -> Result<Sheet, Failure>;

fn sample() -> Sheet {
    let (positions, triangles) = shapes::torus(100.0, 30.25, 12, 7);
    let count = positions.len() as u32;
    let column = |name: &str, unit: &str, values| Column {
        name: name.into(),
        unit: unit.into(),
        values,
    };
    Sheet {
        columns: vec![
            column(
                "red",
                "1",
                Values::U8((0..count).map(|i| i as u8).collect()),
            ),
            column(
                "step",
                "1",
                Values::I16((0..count).map(|i| -(i as i16)).collect()),
            ),
            column(
                "id",
                "1",
                Values::U32((0..count).map(|i| i * 40_000_000).collect()),
            ),
            column(
                "curvature_mean",
                "nm^-1",
                Values::F64((0..count).map(|i| 1.0 / f64::from(i + 3)).collect()),
            ),
            column(
                "nx",
                "unknown",
                Values::F32((0..count).map(|i| 1.0 / (i + 7) as f32).collect()),
            ),
        ],
        positions,
        triangles,
        ..Sheet::default()
    }
}

fn all() -> Vec<(&'static str, Vec<u8>, Read)> {
    let sheet = sample();
    let made = |write: &dyn Fn(&mut Vec<u8>) -> std::io::Result<()>| {
        let mut bytes = Vec::new();
        write(&mut bytes).unwrap();
        bytes
    };
    let ply = |encoding| made(&|out| ply::write(out, &sheet, "nm", encoding, &Serial));
    vec![
        (
            "stl",
            made(&|out| stl::write(out, &sheet, "nm", &Serial)),
            stl::read,
        ),
        (
            "stl text",
            made(&|out| stl::write_text(out, &sheet, "nm", &Serial)),
            stl::read,
        ),
        ("ply", ply(Encoding::Little), ply::read),
        ("ply big", ply(Encoding::Big), ply::read),
        ("ply text", ply(Encoding::Text), ply::read),
        (
            "obj",
            made(&|out| obj::write(out, &sheet, "nm", &Serial)),
            obj::read,
        ),
        (
            "off",
            made(&|out| off::write(out, &sheet, "nm", &Serial)),
            off::read,
        ),
    ]
}

/// Triangles as places, from f32 where the format has that.
fn places(sheet: &Sheet) -> Vec<[f64; 3]> {
    let corners = sheet.triangles.as_flattened();
    corners
        .iter()
        .map(|&v| sheet.positions[v as usize].map(|x| f64::from(x as f32)))
        .collect()
}

#[test]
fn what_is_written_is_read_again() {
    let sheet = sample();
    for (name, bytes, read) in all() {
        let again = read(&bytes, &Serial).unwrap();
        assert_eq!(places(&again), places(&sheet), "{name}");
        assert_eq!(again.positions.len(), sheet.positions.len(), "{name}");
        assert_eq!(again.unit.as_deref(), Some("nm"), "{name}");
        if name.starts_with("ply") {
            assert_eq!(again.columns, sheet.columns, "{name}");
            assert_eq!(again.positions, sheet.positions, "{name}");
        }
    }
}

#[test]
fn truncated_files_are_refused() {
    for (name, bytes, read) in all() {
        // All but the last line: a number that is cut off there is a number as well.
        let end = match name {
            "stl" | "ply" | "ply big" => bytes.len(),
            _ => {
                bytes[..bytes.len() - 1]
                    .iter()
                    .rposition(|b| *b == b'\n')
                    .unwrap()
                    + 1
            }
        };
        for i in 0..64 {
            let cut = end * i / 64;
            let result = read(&bytes[..cut], &Serial);
            // OBJ has no count and no end: a part is a smaller mesh, or ends within a line.
            if name != "obj" {
                let text = result.unwrap_err().to_string();
                assert!(text.len() > 10, "{name} {cut} {text}");
            }
        }
    }
}

#[test]
fn flipped_bytes_never_panic_and_never_give_wild_triangles() {
    for (name, bytes, read) in all() {
        for i in 0..200 {
            let mut bad = bytes.clone();
            let place = i * 7919
                % if i % 2 == 0 {
                    bad.len()
                } else {
                    400.min(bad.len())
                };
            bad[place] ^= 1 << (i % 8);
            if let Ok(sheet) = read(&bad, &Serial) {
                let count = sheet.positions.len();
                let inside = |v: &u32| (*v as usize) < count;
                assert!(
                    sheet.triangles.as_flattened().iter().all(inside),
                    "{name} {i}"
                );
            }
        }
    }
}

fn refused(read: Read, bytes: &[u8], word: &str) {
    let text = read(bytes, &Serial).unwrap_err().to_string();
    assert!(text.contains(word), "{text}");
}

#[test]
fn lying_headers_are_refused_before_memory_is_taken() {
    let mut stl = vec![b' '; 80];
    stl.extend(4_000_000_000_u32.to_le_bytes());
    stl.extend([0; 50]);
    refused(stl::read, &stl, "4000000000 triangles");
    stl[80..84].copy_from_slice(&0_u32.to_le_bytes());
    refused(stl::read, &stl, "50 bytes follow");
    let head = "ply\nformat FORMAT 1.0\nelement vertex 99999999999\nproperty float x\nproperty \
                float y\nproperty float z\nend_header\n0 0 0\n";
    for format in ["ascii", "binary_little_endian"] {
        let text = head.replace("FORMAT", format);
        refused(ply::read, text.as_bytes(), "99999999999 rows of vertex");
    }
    refused(
        off::read,
        b"OFF\n9999999999 1 0\n0 0 0\n",
        "9999999999 vertices",
    );
    refused(
        off::read,
        b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
        "vertex 3",
    );
    refused(
        off::read,
        b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "follows",
    );
    refused(
        off::read,
        b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n999999999 0 1 2\n",
        "face 0",
    );
    refused(obj::read, b"v 0 0 0\nf 1 2 3\n", "vertex 1");
    refused(obj::read, b"v 0 zero 0\n", "zero");
    refused(obj::read, b"v 0 0 0\nf 0 1 1\n", "corner");
}

#[test]
fn odd_but_sound_files() {
    let strips = "ply\r\nformat ascii 1.0\r\ncomment hand made\r\nelement vertex 4\r\nproperty \
        double x\r\nproperty double y\r\nproperty double z\r\nproperty list uchar uchar tags\r\n\
        element tristrips 1\r\nproperty list int int vertex_indices\r\nend_header\r\n0 0 0 0\r\n1 0 \
        0 2 7 8\r\n0 1 0 0\r\n1 1 0 0\r\n9 0 1 2 3 -1 3 2 1 1\r\n";
    let sheet = ply::read(strips.as_bytes(), &Serial).unwrap();
    assert_eq!(sheet.triangles, [[0, 1, 2], [2, 1, 3], [3, 2, 1]]);
    assert_eq!(sheet.comments, ["hand made"]);
    let polygon = b"OFF # square\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n";
    let sheet = off::read(polygon, &Serial).unwrap();
    assert_eq!(sheet.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(sheet.notes.len(), 1);
    let relative = b"v 0 0 0\nv 1 0 0\nvn 0 0 1\nv 0 1 0\nf -3//1 -2//1 -1//1\n";
    assert_eq!(obj::read(relative, &Serial).unwrap().triangles, [[0, 1, 2]]);
    let none = stl::read(b"solid nothing\nendsolid\n", &Serial).unwrap();
    assert!(none.triangles.is_empty());
    refused(
        stl::read,
        b"solid x\nfacet\nvertex 0 0 0\nendfacet\nendsolid",
        "no 3 corners",
    );
}

fn data() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    root.is_dir().then_some(root)
}

fn mesh(call: Call, path: &Path) -> Object {
    call.file(path)
        .run()
        .unwrap()
        .output("mesh")
        .unwrap()
        .clone()
}

#[test]
fn real_files_have_the_vertices_and_triangles_that_others_count() {
    let Some(data) = data() else { return };
    // Vertices and faces as the files' own headers say; of STL, triangles of the header.
    for (call, file, vertices, triangles) in [
        (Call::of::<ReadPly>(), "trimesh/bunny.ply", 8171, 16301),
        (Call::of::<ReadPly>(), "trimesh/fuze_ascii.ply", 502, 1000),
        (Call::of::<ReadPly>(), "trimesh/ply_points_bin.ply", 8, 0),
        (
            Call::of::<ReadPly>(),
            "pointgraphnet/mito_0_gt.ply",
            14423,
            28838,
        ),
        (Call::of::<ReadObj>(), "trimesh/fandisk.obj", 2877, 5750),
        (Call::of::<ReadOff>(), "trimesh/ballA.off", 1900, 3796),
        (Call::of::<ReadStl>(), "trimesh/featuretype.STL", 0, 3476),
        (
            Call::of::<ReadStl>(),
            "smlmsurfacereconstruction/parametricSurface.stl",
            0,
            19602,
        ),
    ] {
        let mesh = mesh(call.set("unit", "um"), &data.join(file));
        assert_eq!(mesh.header.parts[1].rows, triangles, "{file}");
        assert!(
            vertices == 0 || mesh.header.parts[0].rows == vertices,
            "{file}"
        );
        assert_eq!(mesh.header.column("x").unwrap().unit, "nm");
    }
    let bunny = mesh(Call::of::<ReadPly>(), &data.join("trimesh/bunny.ply"));
    assert_eq!(bunny.header.column("x").unwrap().unit, "unknown");
    assert_eq!(bunny.f32("confidence").unwrap()[0], 0.850855);
}

#[test]
fn other_files_are_left_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    std::fs::write(&path, "x,y\n1,2\n").unwrap();
    for call in [
        Call::of::<ReadStl>(),
        Call::of::<ReadPly>(),
        Call::of::<ReadObj>(),
        Call::of::<ReadOff>(),
    ] {
        let failure = call.file(&path).prepare().unwrap_err();
        assert_eq!(failure.code, puncta_sdk::FailureCode::NotMine);
    }
}

#[test]
fn operations_carry_units_and_columns_from_file_to_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut bytes = Vec::new();
    ply::write(&mut bytes, &sample(), "um", Encoding::Big, &Serial).unwrap();
    std::fs::write(at("a.ply"), bytes).unwrap();
    let first = mesh(Call::of::<ReadPly>(), &at("a.ply"));
    let x = first.f64("x").unwrap();
    assert_eq!(x[0], (100.0 + 30.25) * 1000.0);
    assert_eq!(first.header.column("curvature_mean").unwrap().unit, "nm^-1");
    let write = |call: Call, name: &str| {
        let path = at(name);
        call.input("mesh", first.clone()).file(&path).run().unwrap();
        path
    };
    let again = mesh(
        Call::of::<ReadPly>(),
        &write(Call::of::<WritePly>(), "b.ply"),
    );
    assert_eq!(
        (again.f64("x").unwrap(), again.f32("nx").unwrap()),
        (x.clone(), first.f32("nx").unwrap())
    );
    let again = mesh(
        Call::of::<ReadStl>(),
        &write(Call::of::<WriteStl>(), "b.stl"),
    );
    assert_eq!(again.header.column("x").unwrap().unit, "nm");
    let again = mesh(
        Call::of::<ReadObj>(),
        &write(Call::of::<WriteObj>(), "b.obj"),
    );
    assert_eq!(again.f64("x").unwrap(), x);
    let again = mesh(
        Call::of::<ReadOff>(),
        &write(Call::of::<WriteOff>(), "b.off"),
    );
    assert_eq!(again.f64("x").unwrap(), x);
    glb(&std::fs::read(write(Call::of::<WriteGlb>(), "b.glb")).unwrap());
    vtp(&std::fs::read(write(Call::of::<WriteVtp>(), "b.vtp")).unwrap());
    let stopped = Call::of::<WriteObj>().input("mesh", first).cancel_after(2);
    assert!(stopped.file(&at("c.obj")).run().unwrap_err().is_cancelled());
}

fn glb(bytes: &[u8]) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(
        (&bytes[..4], word(4), word(8)),
        (&b"glTF"[..], 2, bytes.len())
    );
    let text = word(12);
    let json: Value = from_slice(&bytes[20..20 + text]).unwrap();
    let binary = &bytes[28 + text..];
    assert_eq!(
        (word(20 + text), &bytes[24 + text..28 + text]),
        (binary.len(), &b"BIN\0"[..])
    );
    assert_eq!(json["buffers"][0]["byteLength"], binary.len());
    let primitive = &json["meshes"][0]["primitives"][0];
    let accessor = |i: &Value| json["accessors"][i.as_u64().unwrap() as usize].clone();
    assert_eq!(accessor(&primitive["indices"])["count"], 12 * 7 * 6);
    assert_eq!(accessor(&primitive["attributes"]["POSITION"])["count"], 84);
    assert!(primitive["attributes"]["_CURVATURE_MEAN"].is_u64());
    for view in json["bufferViews"].as_array().unwrap() {
        let end = view["byteOffset"].as_u64().unwrap() + view["byteLength"].as_u64().unwrap();
        assert!(end as usize <= binary.len() && view["byteOffset"].as_u64().unwrap() % 4 == 0);
    }
}

fn vtp(bytes: &[u8]) {
    let start = bytes
        .windows(12)
        .position(|w| w == b"ding=\"raw\">\n")
        .unwrap()
        + 13;
    let head = String::from_utf8_lossy(&bytes[..start]).into_owned();
    assert!(head.contains("NumberOfPoints=\"84\"") && head.contains("Name=\"curvature_mean\""));
    let length = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    // Each array begins where the one before it ends.
    let mut at = start;
    for piece in head.split("offset=\"").skip(1) {
        let offset: usize = piece.split('"').next().unwrap().parse().unwrap();
        assert_eq!(start + offset, at);
        at += 8 + length(at);
    }
    assert!(bytes[at..].starts_with(b"\n</AppendedData>"));
}
