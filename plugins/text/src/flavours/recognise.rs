//! How each kind of text table is recognised.

use super::Flavour;

/// The kind of file by its names and comments; [`Flavour::Auto`] for none of those known.
pub fn recognise(names: &[String], comments: &[String], from_hash: bool) -> Flavour {
    let has = |name: &str| names.iter().any(|n| n == name);
    let any = |some: &[&str]| some.iter().any(|n| has(n));
    let all = |some: &[&str]| some.iter().all(|n| has(n));
    let starts = |start: &str| names.iter().any(|n| n.starts_with(start));
    let comment = |start: &str| comments.iter().any(|c| c.starts_with(start));
    let pyme = ["y", "t", "sig", "error_x", "tIndex", "A"];
    if comment("LUME VERSION") {
        Flavour::Vlume
    } else if comment("localization file (Malk") {
        Flavour::Malk
    } else if comment("application_id:") {
        Flavour::Micromanager
    } else if has("frame_ix") && all(&["x", "y", "phot"]) {
        Flavour::Decode
    } else if from_hash && has("x") && any(&pyme) {
        Flavour::Pyme
    } else if starts("x [") && starts("y [") && has("loglikelihood") && !has("id") {
        Flavour::Leb
    } else if has("frame") && (starts("x [") || starts("x_[")) {
        Flavour::Thunderstorm
    } else if has("First Frame") && starts("Position X") {
        Flavour::Elyra
    } else if has("Ground-truth") && has("xnano") {
        Flavour::Challenge
    } else if all(&["xnm", "locprecnm"]) {
        Flavour::Smap
    } else if all(&["Channel Name", "X", "Y"]) {
        Flavour::Nstorm
    } else if all(&["Channel", "Frame", "X (nm)", "Y (nm)", "Photons"]) {
        Flavour::Oni
    } else if has("image-ID") && any(&["photon-count", "precisionx", "vis-probe"]) {
        Flavour::Vutara
    } else if all(&["Trajectory", "Frame", "x", "y", "m0", "m1"]) {
        Flavour::Mosaic
    } else if all(&["TRACK_ID", "POSITION_X", "POSITION_Y"]) {
        Flavour::Trackmate
    } else if all(&["frame", "t", "trajectory", "x", "y"]) {
        Flavour::Spoton
    } else if all(&["trajectory", "frame", "x", "y"]) && !has("t") {
        Flavour::Saspt
    } else if all(&["tid", "tim", "x", "y"]) {
        Flavour::Pyminflux
    } else {
        Flavour::Auto
    }
}
