//! Models and simple tracks, real files, and damaged ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::ReadTrackMate;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done, damage};
use std::path::{Path, PathBuf};

const SIMPLE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Tracks nTracks="2" spaceUnits="micron" frameInterval="0.02" timeUnits="sec">
  <particle nSpots="2">
    <detection t="3" x="1.5" y="0.5" z="0.0" />
    <detection t="4" x="1.75" y="0.25" z="0.0" />
  </particle>
  <particle nSpots="1"><detection t="9" x="2" y="3" z="1" quality="x" /></particle>
</Tracks>"#;

const MODEL: &str = r#"<TrackMate version="7"><Log>a &amp; b</Log>
<Model spatialunits="pixel" timeunits="sec"><FeatureDeclarations><SpotFeatures>
<Feature feature="RADIUS" name="Radius" dimension="LENGTH" isint="false" />
<Feature feature="VISIBILITY" name="Visibility" dimension="NONE" isint="true" />
</SpotFeatures><EdgeFeatures><Feature feature="FRAME" dimension="LENGTH" isint="false" /></EdgeFeatures></FeatureDeclarations>
<AllSpots nspots="3"><SpotsInFrame frame="0">
<Spot ID="7" name="ID7" FRAME="0" POSITION_T="0.0" POSITION_X="1.0" POSITION_Y="2.0" POSITION_Z="0" RADIUS="2.5" VISIBILITY="1">1 2 3</Spot>
<Spot ID="8" name="ID8" FRAME="1" POSITION_T="0.1" POSITION_X="2.0" POSITION_Y="2.0" POSITION_Z="0" RADIUS="2.5" VISIBILITY="1" EXTRA="4"/>
<Spot ID="9" name="ID9" FRAME="1" POSITION_T="0.1" POSITION_X="9.0" POSITION_Y="2.0" POSITION_Z="0" RADIUS="2.5" VISIBILITY="0"/>
</SpotsInFrame></AllSpots>
<AllTracks><Track name="Track_0" TRACK_ID="5"><Edge SPOT_SOURCE_ID="7" SPOT_TARGET_ID="8"/></Track></AllTracks>
</Model></TrackMate>"#;

fn call(text: &[u8]) -> (tempfile::TempDir, Call) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    std::fs::write(&path, text).unwrap();
    let call = Call::of::<ReadTrackMate>().file(&path);
    (folder, call)
}

fn open(text: &[u8]) -> Result<Done, Failure> {
    let (_folder, call) = call(text);
    call.run()
}

fn real(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(3)?;
    let path = root.join("shared/data").join(name);
    path.exists().then_some(path)
}

#[test]
fn simple_tracks_have_their_units() {
    let done = open(SIMPLE.as_bytes()).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [1500.0, 1750.0, 2000.0]);
    assert_eq!(out.i64("t").unwrap(), [3, 4, 9]);
    assert_eq!(out.i64("track").unwrap(), [0, 0, 1]);
    assert_eq!(out.header.column("x").unwrap().unit, "nm");
    assert_eq!(out.header.shape.as_deref(), Some("tracks"));
    assert!(
        done.messages
            .iter()
            .any(|(_, text)| text.starts_with("1 values are no numbers"))
    );
}

#[test]
fn models_have_spots_features_and_links() {
    let (_folder, call) = call(MODEL.as_bytes());
    let notes = call.prepare().unwrap().notes.join(" ");
    assert!(notes.contains("pixel_size"), "{notes}");
    let done = call.run().unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [1.0, 2.0, 9.0]);
    assert_eq!(out.header.column("x").unwrap().unit, "unknown");
    assert_eq!(out.header.column("time").unwrap().unit, "s");
    assert_eq!(out.i64("track").unwrap(), [5, 5, -1]);
    assert_eq!(out.i64("visibility").unwrap(), [1, 1, 0]);
    let extra = out.f64("extra").unwrap();
    assert!(extra[0].is_nan() && extra[1] == 4.0 && extra[2].is_nan());
    let (_folder, call) = self::call(MODEL.as_bytes());
    let done = call.set("pixel_size", 100.0).run().unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [100.0, 200.0, 900.0]);
    assert_eq!(out.f64("radius").unwrap()[0], 250.0);
}

#[test]
fn entities_and_other_files_are_refused() {
    let bomb = "<!DOCTYPE Tracks [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>\n<Tracks>\
                <particle><detection t=\"&b;\"/></particle></Tracks>";
    let failure = open(bomb.as_bytes()).unwrap_err();
    assert_eq!(failure.code, FailureCode::Unsupported, "{failure}");
    for text in [
        "x,y\n1,2\n",
        "<svg></svg>",
        "<a",
        "<?xml version=\"1.0\"?><OME/>",
        "<!-- -->",
    ] {
        let failure = open(text.as_bytes()).unwrap_err();
        assert_eq!(failure.code, FailureCode::NotMine, "{text}: {failure}");
    }
    let deep = format!("<Tracks>{}", "<particle>".repeat(100_000));
    assert_eq!(
        open(deep.as_bytes()).unwrap_err().code,
        FailureCode::BadFile
    );
}

#[test]
fn damaged_files_are_refused_or_read() {
    for whole in [SIMPLE.as_bytes(), MODEL.as_bytes()] {
        for cut in damage::cuts(whole) {
            assert!(open(cut).is_err(), "{} bytes", cut.len());
        }
        for (_, changed) in damage::flips(whole, whole.len()) {
            let _ = open(&changed);
        }
    }
}

#[test]
fn real_files_have_their_rows() {
    for (name, rows, tracks) in [
        ("pytrackmate/FakeTracks.xml", 68, 2),
        ("spot-on/TrackMate.xml", 0, 22),
    ] {
        let Some(path) = real(name) else { continue };
        let text = std::fs::read_to_string(&path).unwrap();
        let done = Call::of::<ReadTrackMate>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        let rows = if rows == 0 {
            text.matches("<detection").count()
        } else {
            rows
        };
        assert_eq!(out.header.rows(), rows as u64, "{name}");
        let mut all = out.i64("track").unwrap();
        all.retain(|track| *track >= 0);
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), tracks, "{name}");
    }
}
