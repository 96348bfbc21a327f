//! Small tables as the field's programs write them, and what they become.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use puncta_plugin_text::reader::ReadText;
use puncta_testkit::{Call, Done, Object};
use serde_json::{Value, json};

fn read_as(name: &str, bytes: &[u8], options: &Value) -> (Done, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let call = || {
        let options = options.as_object().into_iter().flatten();
        let call = Call::of::<ReadText>().file(&path);
        options.fold(call, |call, (name, value)| call.set(name, value.clone()))
    };
    let notes = call().prepare().unwrap().notes;
    (
        call().run().unwrap_or_else(|e| panic!("{name}: {e}")),
        notes,
    )
}

fn read(name: &str, text: &str) -> (Done, Vec<String>) {
    read_as(name, text.as_bytes(), &json!({}))
}

/// Name, unit and first value of each column.
fn columns(done: &Done) -> Vec<(String, String, String)> {
    let table = done.output("localisations").unwrap();
    let infos = table.header.parts[0].columns.iter();
    infos
        .map(|info| {
            (
                info.name.clone(),
                info.unit.clone(),
                first(table, &info.name),
            )
        })
        .collect()
}

fn first(table: &Object, name: &str) -> String {
    let number = || -> Option<String> {
        if let Ok(values) = table.f64(name) {
            return values.first().map(f64::to_string);
        }
        if let Ok(values) = table.i32(name) {
            return values.first().map(i32::to_string);
        }
        None
    };
    number()
        .or_else(|| table.texts(name).ok()?.first().cloned())
        .unwrap_or_default()
}

/// The columns as `name unit value` words.
fn shown(done: &Done) -> String {
    let words = columns(done);
    let words = words.into_iter().map(|(n, u, v)| format!("{n} {u} {v}"));
    words.collect::<Vec<_>>().join(", ")
}

fn format(done: &Done) -> String {
    let table = done.output("localisations").unwrap();
    table.header.metadata["format"].as_str().unwrap().to_owned()
}

#[test]
fn programs_with_named_columns() {
    let cases = [
        (
            "SMAP text",
            "xnm,ynm,znm,phot,locprecnm,locprecznm,frame\n10.5,20,-30,900,8,25,1\n",
            "x nm 10.5, y nm 20, z nm -30, nPhotons photon 900, error_x nm 8, error_y nm 8, \
             error_z nm 25, t frame 0",
        ),
        (
            "ONI Nanoimager text",
            "Channel,Frame,X (nm),Y (nm),Z (nm),X precision (nm),Y precision (nm),Photons,Background\n\
             1,12,100.5,200.25,0.0,5,6,140.5,0.85\n",
            "probe 1 1, t frame 12, x nm 100.5, y nm 200.25, z nm 0, error_x nm 5, error_y nm 6, \
             nPhotons photon 140.5, background photon 0.85",
        ),
        (
            "Vutara text",
            "image-ID,x,y,z,photon-count,precisionx,precisionz,llr,accuracy,vis-probe\n\
             3,1.5,2.5,0.5,800,0.01,0.03,1.2,0.9,2\n",
            "image_id 1 3, x unknown 1.5, y unknown 2.5, z unknown 0.5, nPhotons photon 800, \
             error_x unknown 0.01, error_z unknown 0.03, llr unknown 1.2, accuracy unknown 0.9, \
             probe 1 2",
        ),
        (
            "SMLM challenge text",
            "Ground-truth,frame,xnano,ynano,znano,intensity \n1, 2, 25.5, 26.5, -3, 1655.5\n",
            "ground_truth 1 1, t frame 1, x nm 25.5, y nm 26.5, z nm -3, intensity unknown 1655.5",
        ),
        (
            "LEB text",
            "x [nm],y [nm],frame,uncertainty [nm],intensity [photon],offset [photon],loglikelihood\n\
             5425.5,2754.25,0,4.5,4755,93.5,866\n",
            "x nm 5425.5, y nm 2754.25, t frame 0, error_x nm 4.5, error_y nm 4.5, \
             nPhotons photon 4755, background photon 93.5, loglikelihood unknown 866",
        ),
        (
            "MOSAIC text",
            " ,Trajectory,Frame,x,y,z,m0,m1,NPscore\n1,1,0,69.5,32.25,0,1.5,1.25,3.4e38\n",
            "index 1 1, track 1 1, t frame 0, x unknown 69.5, y unknown 32.25, z unknown 0, \
             m0 unknown 1.5, m1 unknown 1.25, NPscore unknown 340000000000000000000000000000000000000",
        ),
        (
            "Spot-On text",
            ",frame,t,trajectory,x,y\n0,4,0.018,7,3.25,5.5\n",
            "index 1 0, t frame 4, time s 0.018, track 1 7, x nm 3250, y nm 5500",
        ),
        (
            "saspt text",
            "trajectory,frame,y,x\n6325,0,482.5,288.25\n",
            "track 1 6325, t frame 0, y unknown 482.5, x unknown 288.25",
        ),
        (
            "pyMINFLUX text",
            ",tid,tim,x,y,z,efo,cfr,eco,dcr,dwell,fluo\n\
             0,10,0.5,22870.5,-2566.25,0,35008.75,0.5,175,0.25,5,1\n",
            "index 1 0, clumpIndex 1 10, time s 0.5, x nm 22870.5, y nm -2566.25, z nm 0, \
             efo unknown 35008.75, cfr unknown 0.5, nPhotons photon 175, dcr unknown 0.25, \
             dwell s 0.005, probe 1 1",
        ),
    ];
    for (name, text, wanted) in cases {
        let (done, _) = read("f.csv", text);
        assert_eq!(format(&done), name);
        assert_eq!(shown(&done), wanted, "{name}");
    }
}

#[test]
fn tracks_say_that_they_are_tracks() {
    let (done, notes) = read("f.csv", "trajectory,frame,y,x\n6325,0,482.5,288.25\n");
    let header = &done.output("localisations").unwrap().header;
    assert_eq!(header.shape.as_deref(), Some("tracks"));
    assert!(
        notes.iter().any(|n| n.contains("--pixel_size")),
        "{notes:?}"
    );
    let options = json!({"pixel_size": 160, "frame_base": "one"});
    let (done, _) = read_as("f.csv", b"trajectory,frame,y,x\n5,1,2,3\n", &options);
    assert_eq!(shown(&done), "track 1 5, t frame 0, y nm 320, x nm 480");
}

#[test]
fn n_storm_with_tabs_and_utf16() {
    let text = "Channel Name\tX\tY\tXc\tYc\tHeight\tArea\tWidth\tPhi\tAx\tBG\tI\tFrame\tLength\t\
                Link\tValid\tZ\tZc\tPhotons\tLateral Localization Accuracy\tXw\tYw\tXwc\tYwc\r\n\
                647\t10.5\t20.5\t11\t21\t300\t4000\t310\t0\t1.5\t120\t5000\t1\t2\t-1\t1\t-30\t-31\t\
                900\t7.5\t10\t20\t11\t21\r\n";
    let wanted = "channel_name 1 647, x_raw nm 10.5, y_raw nm 20.5, x nm 11, y nm 21, \
                  height ADU 300, A ADU 4000, width nm 310, phi rad 0, ax 1 1.5, background ADU 120, \
                  intensity ADU 5000, t frame 0, length frame 2, Link 1 -1, Valid 1 1, \
                  z_raw nm -30, z nm -31, nPhotons photon 900, error_x nm 7.5, error_y nm 7.5, \
                  x_warped nm 10, y_warped nm 20, x_warped_corrected nm 11, y_warped_corrected nm 21";
    let (done, _) = read("f.txt", text);
    let plain = |text: String| text.replace("channel_name unknown", "channel_name 1");
    let got = plain(shown(&done))
        .replace("Link unknown", "Link 1")
        .replace("Valid unknown", "Valid 1");
    assert_eq!(got, wanted);
    assert_eq!(format(&done), "N-STORM text");
    for mark in [true, false] {
        let marked = format!("{}{text}", if mark { "\u{feff}" } else { "" });
        for big in [false, true] {
            let bytes: Vec<u8> = marked
                .encode_utf16()
                .flat_map(|u| {
                    if big {
                        u.to_be_bytes()
                    } else {
                        u.to_le_bytes()
                    }
                })
                .collect();
            let (wide, _) = read_as("f.txt", &bytes, &json!({}));
            assert_eq!(shown(&wide), shown(&done), "mark {mark}, big endian {big}");
        }
    }
}

#[test]
fn elyra_ends_before_its_settings() {
    let table = "Index\tFirst Frame\tPosition X [nm]\tPosition Y [nm]\tPrecision [nm]\tNumber Photons\t\
                 Channel\r\n1\t1\t15850.5\t23502.25\t8.5\t472\t2\r\n2\t3\t1\t2\t3\t4\t2\r\n";
    let settings = "VoxelSizeX : 0.097\r\nSizeX : 3200\r\n\r\nROI List : \r\n";
    for between in ["\0\r\n", "\r\n", ""] {
        let (done, _) = read("f.txt", &format!("{table}{between}{settings}"));
        assert_eq!(
            shown(&done),
            "Index 1 1, t frame 0, x nm 15850.5, y nm 23502.25, error_x nm 8.5, error_y nm 8.5, \
             nPhotons photon 472, probe 1 2"
        );
        let header = &done.output("localisations").unwrap().header;
        assert_eq!(header.rows(), 2);
        assert_eq!(header.metadata["settings"]["VoxelSizeX"], "0.097");
    }
}

#[test]
fn rapidstorm_plain_and_with_tracks() {
    let field = |id: &str, unit: &str| {
        format!(
            "<field identifier=\"{id}\" syntax=\"floating point\" unit=\"{unit}\" min=\"0 m\" />"
        )
    };
    let place = field("Position-0-0", "nanometer") + &field("Position-1-0", "nanometer");
    let frame = field("ImageNumber-0-0", "frame");
    let plain = format!(
        "# <localizations insequence=\"true\" repetitions=\"variable\">{place}{frame}{}{}{}</localizations>\n\
         9657.5 24533.5 0 33290 1.5e6 767.5\n",
        field("Amplitude-0-0", "A/D count"),
        field("FitResidues-0-0", "dimensionless"),
        field("PSFWidth-0-0", "nanometer"),
    );
    let (done, _) = read("f.txt", &plain);
    assert_eq!(
        shown(&done),
        "x nm 9657.5, y nm 24533.5, t frame 0, A ADU 33290, fit_residues unknown 1500000, \
         fwhm_x nm 767.5"
    );
    let inner = format!(
        "<localizations insequence=\"true\">{}{}{frame}</localizations>",
        field("Position-0-0", "nanometer"),
        field("Position-0-0-uncertainty", "nanometer")
    );
    let nested = format!(
        "# <localizations insequence=\"true\">{place}{frame}{inner}</localizations>\n\
         5417.5 8439.5 1 2 5421.5 25 0 5414.5 26 1\n2800 2678 9 1 2811 25 8\n"
    );
    let (done, _) = read("f.txt", &nested);
    assert_eq!(
        shown(&done),
        "track 1 0, track_x nm 5417.5, track_y nm 8439.5, track_frame frame 1, x nm 5421.5, \
         error_x nm 25, t frame 0"
    );
    let table = done.output("localisations").unwrap();
    assert_eq!(table.i32("track").unwrap(), [0, 0, 1]);
    assert_eq!(table.f64("x").unwrap(), [5421.5, 5414.5, 2811.0]);
}

#[test]
fn decode_takes_unit_and_pixel_from_its_comments() {
    let file = |unit: &str| {
        format!(
            "# DECODE EmitterSet\n# {{\"version\": \"0.10.0\"}}\n\
             # {{\"xy_unit\": \"{unit}\", \"px_size\": [127.0, 117.0]}}\n\
             x,y,z,frame_ix,id,prob,bg,phot,x_sig,y_sig,z_sig\n2,3,-50,0,0,0.9,10,900,0.1,0.2,30\n"
        )
    };
    let (done, _) = read("f.csv", &file("px"));
    assert_eq!(
        shown(&done),
        "x nm 254, y nm 351, z nm -50, t frame 0, id 1 0, probability 1 0.9, \
         background photon 10, nPhotons photon 900, error_x nm 12.700000000000001, \
         error_y nm 23.400000000000002, error_z nm 30"
    );
    let (done, _) = read_as(
        "f.csv",
        file("px").as_bytes(),
        &json!({"pixel_size": 100, "swap_xy": true}),
    );
    let got = columns(&done);
    assert_eq!(got[0], ("y".into(), "nm".into(), "200".into()));
    assert_eq!(got[1], ("x".into(), "nm".into(), "300".into()));
    let (done, _) = read("f.csv", &file("nm"));
    assert_eq!(columns(&done)[0], ("x".into(), "nm".into(), "2".into()));
}

#[test]
fn micro_manager_tags() {
    let text = "application_id: 1\tname: a\tpixel_size: 100.0\tlocation_units: NM\t\
                intensity_units: PHOTONS\nmolecule: 1\tchannel: 2\tframe: 1\tx: 10.5\ty: 20.5\t\
                intensity: 300\tx_precision: 4\nmolecule: 2\tchannel: 2\tframe: 2\tx: 1\ty: 2\t\
                intensity: 3\tx_precision: 5\n";
    let (done, _) = read("f.txt", text);
    assert_eq!(
        shown(&done),
        "molecule 1 1, probe 1 2, t frame 0, x nm 10.5, y nm 20.5, nPhotons unknown 300, error_x nm 4"
    );
}

#[test]
fn trackmate_with_lines_of_units() {
    let plain = "Label,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_T,FRAME\n";
    let units =
        "Label,Spot ID,Track ID,Quality,X,Y,T,Frame\n,,,(quality),(micron),(micron),(sec),\n";
    let row = "ID1,1,None,0,2.5,1.5,0.5,3\nID2,2,4,0,2.5,1.5,0.5,4\n";
    let (done, _) = read("f.csv", &format!("{plain}{row}"));
    let got = shown(&done);
    assert!(
        got.contains("x unknown 2.5") && got.contains("t frame 3"),
        "{got}"
    );
    let (done, _) = read("f.csv", &format!("{plain}{units}{row}"));
    let got = shown(&done);
    assert!(
        got.contains("x nm 2500") && got.contains("time s 0.5"),
        "{got}"
    );
}

#[test]
fn suffixes_name_columns_that_have_no_header() {
    let cases = [
        (
            "a.2d",
            "1.5\t2.5\t900\t3\n",
            "x nm 1.5, y nm 2.5, A unknown 900, t frame 3",
        ),
        (
            "a.3d",
            "1.5\t2.5\t-5\t900\t3\n",
            "x nm 1.5, y nm 2.5, z nm -5, A unknown 900, t frame 3",
        ),
        (
            "a.2dlp",
            "1.5\t2.5\t8\t9\t900\t3\n",
            "x nm 1.5, y nm 2.5, error_x nm 8, error_y nm 9, A unknown 900, t frame 3",
        ),
        (
            "a.3dlp",
            "1.5\t2.5\t-5\t8\t9\t20\t900\t3\n",
            "x nm 1.5, y nm 2.5, z nm -5, error_x nm 8, error_y nm 9, error_z nm 20, \
             A unknown 900, t frame 3",
        ),
        (
            "a.trxyt",
            "7 0.5 0.25 0.05\n",
            "track 1 7, x nm 500, y nm 250, time s 0.05",
        ),
        (
            "a.malk",
            "10.5 20.5 3 900\n",
            "x nm 10.5, y nm 20.5, t frame 3, A ADU 900",
        ),
        (
            "a.txt",
            "# localization file (Malk format)\n# x[nm] y[nm] t[frame] I[a.d. counts]\n10.5 20.5 3 900\n",
            "x nm 10.5, y nm 20.5, t frame 3, A ADU 900",
        ),
    ];
    for (name, text, wanted) in cases {
        assert_eq!(shown(&read(name, text).0), wanted, "{name}");
    }
}

#[test]
fn what_only_the_values_say_has_no_unit_until_the_person_agrees() {
    let rows: String = (0..12)
        .map(|i| {
            format!(
                "8.25\t30.5\t{}\t{}\t3513.5\t1\t2\t3\n",
                i % 4 + 1,
                i / 4 + 1
            )
        })
        .collect();
    let (done, notes) = read("tracks.txt", &rows);
    let got = shown(&done);
    assert!(
        got.starts_with("x unknown 8.25, y unknown 30.5, t frame 0, track 1 1,"),
        "{got}"
    );
    assert!(notes[0].contains("--dialect evalspt"), "{notes:?}");
    let (done, _) = read_as(
        "tracks.txt",
        rows.as_bytes(),
        &json!({"dialect": "evalspt"}),
    );
    assert!(shown(&done).starts_with("x nm 8250, y nm 30500, t frame 0, track 1 1,"));
    let (done, notes) = read("points.txt", "1.5 2.5\n3 4\n");
    assert_eq!(shown(&done), "column_1 unknown 1.5, column_2 unknown 2.5");
    assert!(notes[0].contains("--columns \"x,y\""), "{notes:?}");
    let table = done.output("localisations").unwrap();
    let remedy = table.header.parts[0].columns[0].rest["remedy"]
        .as_str()
        .unwrap();
    assert!(remedy.contains("--in-units column_1=nm"), "{remedy}");
    let options = json!({"columns": "x,y", "units": "px", "pixel_size": 100});
    let (done, _) = read_as("points.txt", b"1.5 2.5\n3 4\n", &options);
    assert_eq!(shown(&done), "x nm 150, y nm 250");
}

/// Every kind, cut short at 64 places and with 200 bytes changed: a table or a sentence.
#[test]
fn damaged_files_of_every_kind() {
    let nested = "# <localizations><field identifier=\"Position-0-0\" unit=\"nanometer\" />\
                  <localizations><field identifier=\"Position-0-0\" unit=\"nanometer\" />\
                  </localizations></localizations>\n5 2 6 7\n8 1 9\n";
    let files = [
        ("a.txt", nested),
        (
            "b.txt",
            "a: 1\tb: 2\tc: 3\nx: 1\ty: 2\tz: 3\nx: 4\ty: 5\tz: 6\n",
        ),
        (
            "c.txt",
            "Index\tFirst Frame\tPosition X [nm]\n1\t1\t2\n\0\r\nA : 1\n",
        ),
        (
            "d.csv",
            "# {\"xy_unit\": \"px\", \"px_size\": [1, 2]}\nx,y,frame_ix,phot\n1,2,3,4\n",
        ),
        ("e.2d", "1\t2\t3\t4\n5\t6\t7\t8\n"),
    ];
    let folder = tempfile::tempdir().unwrap();
    let check = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        if let Err(failure) = Call::of::<ReadText>().file(&path).threads(1).run() {
            assert!(
                !failure.to_string().contains("internal"),
                "{name}: {failure}"
            );
        }
    };
    let mut state = 7_u64;
    let mut random = move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 33) as usize
    };
    for (name, text) in files {
        for cut in 0..64 {
            check(name, &text.as_bytes()[..text.len() * cut / 64]);
        }
        for _ in 0..200 {
            let mut bytes = text.as_bytes().to_vec();
            let at = random() % bytes.len();
            bytes[at] = random() as u8;
            check(name, &bytes);
        }
    }
}
