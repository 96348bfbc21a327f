//! The kinds of text table: how each is recognised, and what its columns mean.

mod recognise;

pub use recognise::recognise;

use puncta_sdk::prelude::*;
use puncta_shared_import::names::{self, split_unit};
use puncta_shared_import::{Named, Unit, units};

/// Who writes files of a kind.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flavour {
    /// Found out from the file; a table of no known program has named columns, or none.
    Auto,
    /// ThunderSTORM: names with units, frames from 1.
    Thunderstorm,
    /// PYME: names in a `#` line, nm, frames from 0.
    Pyme,
    /// vLUME: `#LUME VERSION` above the header.
    Vlume,
    /// Zeiss ELYRA: tabs, frames from 1, image settings behind the table.
    Elyra,
    /// Ground truth of the SMLM challenge: frames from 1.
    Challenge,
    /// SMAP's csv: `xnm`, frames from 1.
    Smap,
    /// rapidSTORM: an XML header in the first line, also with nested tracks.
    Rapidstorm,
    /// Nikon N-STORM: tabs, frames from 1.
    Nstorm,
    /// ONI Nanoimager.
    Oni,
    /// Vutara SRX: lengths without a unit.
    Vutara,
    /// VISP: no header, columns by the suffix .2d, .3d, .2dlp or .3dlp.
    Visp,
    /// MALK of LAMA: x y frame intensity.
    Malk,
    /// DECODE csv: three `#` lines with JSON above the header.
    Decode,
    /// Micro-Manager's tagged spots: `name: value` in every field.
    Micromanager,
    /// LEB (B-Store): ThunderSTORM's names, frames from 0.
    Leb,
    /// MOSAIC ParticleTracker: camera pixels.
    Mosaic,
    /// TrackMate's table of spots.
    Trackmate,
    /// evalSPT: no header, x y frame track, um, frames from 1.
    Evalspt,
    /// trxyt: no header, track x y time, um and s.
    Trxyt,
    /// Spot-On csv: um and s.
    Spoton,
    /// saspt and quot: camera pixels.
    Saspt,
    /// pyMINFLUX csv: nm and s.
    Pyminflux,
    /// Our own file with a line of column types.
    Typed,
}

/// What a kind of file says of its columns.
struct Facts {
    label: &'static str,
    frame_base: u8,
    tracks: bool,
    /// Name in the file (lower case, without its unit), name and unit of the host. A unit `-`
    /// leaves the file's. A `+` in front of `error_x` makes `error_y` its twin.
    words: &'static [(&'static str, &'static str, &'static str)],
}

const fn facts(label: &'static str, frame_base: u8) -> Facts {
    Facts {
        label,
        frame_base,
        tracks: false,
        words: &[],
    }
}

const NSTORM: Facts = Facts {
    words: &[
        ("xc", "x", "nm"),
        ("yc", "y", "nm"),
        ("zc", "z", "nm"),
        ("x", "x_raw", "nm"),
        ("y", "y_raw", "nm"),
        ("z", "z_raw", "nm"),
        ("xw", "x_warped", "nm"),
        ("yw", "y_warped", "nm"),
        ("zw", "z_warped", "nm"),
        ("xwc", "x_warped_corrected", "nm"),
        ("ywc", "y_warped_corrected", "nm"),
        ("zwc", "z_warped_corrected", "nm"),
        ("height", "height", "ADU"),
        ("area", "A", "ADU"),
        ("bg", "background", "ADU"),
        ("i", "intensity", "ADU"),
        ("width", "width", "nm"),
        ("phi", "phi", "deg"),
        ("ax", "ax", "1"),
        ("length", "length", "frame"),
        ("photons", "nPhotons", "photon"),
        ("lateral localization accuracy", "+error_x", "nm"),
    ],
    ..facts("N-STORM", 1)
};
const ELYRA: Facts = Facts {
    words: &[
        ("first frame", "t", "frame"),
        ("precision", "+error_x", "-"),
        ("channel", "probe", "1"),
    ],
    ..facts("Zeiss ELYRA", 1)
};
const ONI: Facts = Facts {
    words: &[
        ("channel", "probe", "1"),
        ("background", "background", "photon"),
    ],
    ..facts("ONI Nanoimager", 0)
};
const VUTARA: Facts = Facts {
    words: &[
        ("photon-count", "nPhotons", "photon"),
        ("precisionx", "error_x", "-"),
        ("precisiony", "error_y", "-"),
        ("precisionz", "error_z", "-"),
        ("vis-probe", "probe", "1"),
        ("probe", "probe", "1"),
    ],
    ..facts("Vutara", 0)
};
const RAPIDSTORM: Facts = Facts {
    words: &[
        ("position-0-0", "x", "-"),
        ("position-1-0", "y", "-"),
        ("position-2-0", "z", "-"),
        ("position-0-0-uncertainty", "error_x", "-"),
        ("position-1-0-uncertainty", "error_y", "-"),
        ("position-2-0-uncertainty", "error_z", "-"),
        ("imagenumber-0-0", "t", "-"),
        ("amplitude-0-0", "A", "-"),
        ("psfwidth-0-0", "fwhm_x", "-"),
        ("psfwidth-1-0", "fwhm_y", "-"),
        ("fitresidues-0-0", "fit_residues", "-"),
        ("localbackground-0-0", "background", "-"),
        ("twokernelimprovement-0-0", "two_kernel_improvement", "-"),
        ("track", "track", "1"),
        ("track-position-0-0", "track_x", "-"),
        ("track-position-1-0", "track_y", "-"),
        ("track-position-2-0", "track_z", "-"),
        ("track-imagenumber-0-0", "track_frame", "-"),
        ("track-amplitude-0-0", "track_A", "-"),
    ],
    ..facts("rapidSTORM", 0)
};
const DECODE: Facts = Facts {
    words: &[
        ("frame_ix", "t", "frame"),
        ("x_sig", "error_x", "-"),
        ("y_sig", "error_y", "-"),
        ("z_sig", "error_z", "-"),
        ("bg", "background", "photon"),
        ("prob", "probability", "1"),
        ("phot_sig", "error_nPhotons", "photon"),
    ],
    ..facts("DECODE csv", 0)
};
const MICROMANAGER: Facts = Facts {
    words: &[
        ("molecule", "molecule", "1"),
        ("channel", "probe", "1"),
        ("intensity", "nPhotons", "-"),
        ("x_precision", "error_x", "-"),
        ("y_precision", "error_y", "-"),
        ("z_precision", "error_z", "-"),
        ("width", "fwhm", "-"),
    ],
    ..facts("Micro-Manager spots", 1)
};
const MOSAIC: Facts = Facts {
    tracks: true,
    words: &[
        ("trajectory", "track", "1"),
        ("x", "x", "px"),
        ("y", "y", "px"),
        ("z", "z", "px"),
    ],
    ..facts("MOSAIC", 0)
};
const TRACKMATE: Facts = Facts {
    tracks: true,
    words: &[
        ("track_id", "track", "1"),
        ("position_x", "x", "-"),
        ("position_y", "y", "-"),
        ("position_z", "z", "-"),
        ("position_t", "time", "-"),
    ],
    ..facts("TrackMate csv", 0)
};
const SPOTON: Facts = Facts {
    tracks: true,
    words: &[
        ("t", "time", "s"),
        ("trajectory", "track", "1"),
        ("x", "x", "um"),
        ("y", "y", "um"),
        ("z", "z", "um"),
    ],
    ..facts("Spot-On", 0)
};
const SASPT: Facts = Facts {
    tracks: true,
    words: &[
        ("trajectory", "track", "1"),
        ("x", "x", "px"),
        ("y", "y", "px"),
        ("x_err", "error_x", "px"),
        ("y_err", "error_y", "px"),
        ("x_detect", "x_detect", "px"),
        ("y_detect", "y_detect", "px"),
        ("i0", "nPhotons", "-"),
        ("bg", "background", "-"),
    ],
    ..facts("saspt", 0)
};
const PYMINFLUX: Facts = Facts {
    words: &[
        ("tid", "clumpIndex", "1"),
        ("tim", "time", "s"),
        ("x", "x", "nm"),
        ("y", "y", "nm"),
        ("z", "z", "nm"),
        ("fluo", "probe", "1"),
        ("dwell", "dwell", "ms"),
        ("eco", "nPhotons", "photon"),
    ],
    ..facts("pyMINFLUX", 0)
};
const EVALSPT: Facts = Facts {
    tracks: true,
    ..facts("evalSPT", 1)
};
const TRXYT: Facts = Facts {
    tracks: true,
    ..facts("trxyt", 0)
};

impl Flavour {
    fn facts(self) -> Facts {
        match self {
            Flavour::Auto => facts("named columns", 0),
            Flavour::Thunderstorm => facts("ThunderSTORM", 1),
            Flavour::Pyme => facts("PYME", 0),
            Flavour::Vlume => facts("vLUME", 0),
            Flavour::Elyra => ELYRA,
            Flavour::Challenge => facts("SMLM challenge", 1),
            Flavour::Smap => facts("SMAP", 1),
            Flavour::Rapidstorm => RAPIDSTORM,
            Flavour::Nstorm => NSTORM,
            Flavour::Oni => ONI,
            Flavour::Vutara => VUTARA,
            Flavour::Visp => facts("VISP", 0),
            Flavour::Malk => facts("MALK", 0),
            Flavour::Decode => DECODE,
            Flavour::Micromanager => MICROMANAGER,
            Flavour::Leb => facts("LEB", 0),
            Flavour::Mosaic => MOSAIC,
            Flavour::Trackmate => TRACKMATE,
            Flavour::Evalspt => EVALSPT,
            Flavour::Trxyt => TRXYT,
            Flavour::Spoton => SPOTON,
            Flavour::Saspt => SASPT,
            Flavour::Pyminflux => PYMINFLUX,
            Flavour::Typed => facts("Puncta", 0),
        }
    }

    /// The number of the first frame.
    pub fn frame_base(self) -> u8 {
        self.facts().frame_base
    }

    /// A name for the person.
    pub fn label(self) -> &'static str {
        self.facts().label
    }

    /// Whether rows belong to tracks.
    pub fn tracks(self) -> bool {
        self.facts().tracks
    }

    /// The columns of a kind without a header, for this number of columns and file name.
    pub fn positions(
        self,
        count: usize,
        file: &str,
    ) -> Option<&'static [(&'static str, &'static str)]> {
        let lower = file.to_lowercase();
        let suffixes = [(".2d", 4), (".3d", 5), (".2dlp", 6), (".3dlp", 8)];
        let of_suffix = suffixes.iter().find(|(suffix, _)| lower.ends_with(suffix));
        let visp = of_suffix.map_or(count, |(_, columns)| *columns);
        let found: &[(&str, &str)] = match self {
            Flavour::Evalspt => &[("x", "um"), ("y", "um"), ("t", "frame"), ("track", "1")],
            Flavour::Trxyt if count == 4 => {
                &[("track", "1"), ("x", "um"), ("y", "um"), ("time", "s")]
            }
            Flavour::Trxyt => &[
                ("index", "1"),
                ("track", "1"),
                ("x", "um"),
                ("y", "um"),
                ("time", "s"),
            ],
            Flavour::Malk => &[("x", "nm"), ("y", "nm"), ("t", "frame"), ("A", "ADU")],
            Flavour::Visp if visp == 4 => &[("x", "nm"), ("y", "nm"), ("A", ""), ("t", "frame")],
            Flavour::Visp if visp == 5 => &[
                ("x", "nm"),
                ("y", "nm"),
                ("z", "nm"),
                ("A", ""),
                ("t", "frame"),
            ],
            Flavour::Visp if visp == 6 => &[
                ("x", "nm"),
                ("y", "nm"),
                ("error_x", "nm"),
                ("error_y", "nm"),
                ("A", ""),
                ("t", "frame"),
            ],
            Flavour::Visp => &[
                ("x", "nm"),
                ("y", "nm"),
                ("z", "nm"),
                ("error_x", "nm"),
                ("error_y", "nm"),
                ("error_z", "nm"),
                ("A", ""),
                ("t", "frame"),
            ],
            _ => return None,
        };
        let fits = match self {
            Flavour::Evalspt => count >= found.len(),
            _ => count == found.len(),
        };
        fits.then_some(found)
    }

    /// The host's name for a column with a name; `None` for one without letters.
    pub fn named(self, source: &str) -> Option<Named> {
        match self {
            Flavour::Typed => return verbatim(source),
            Flavour::Pyme => {
                return names::exact(source).map(|mut named| {
                    named.unit = named.unit.or_else(|| names::pyme_unit(&named.name));
                    named
                });
            }
            _ => {}
        }
        let (stem, unit) = split_unit(source);
        let lower = stem.to_lowercase();
        let facts = self.facts();
        let Some((_, name, said)) = facts.words.iter().find(|(word, ..)| *word == lower) else {
            return names::named(source);
        };
        let twin = name.starts_with('+').then_some("error_y");
        let said = match *said {
            "-" => None,
            said => units::known(said),
        };
        Some(Named {
            name: name.trim_start_matches('+').to_owned(),
            unit: unit.or(said),
            twin,
        })
    }
}

/// A name of our own file: nothing in it is changed.
fn verbatim(source: &str) -> Option<Named> {
    let (name, unit) = split_unit(source);
    (!name.is_empty()).then(|| Named {
        name: name.to_owned(),
        unit,
        twin: None,
    })
}

/// The name of a column of a kind without a header.
pub fn positional(positions: &[(&str, &str)], field: usize, without_units: bool) -> Option<Named> {
    let (name, unit) = positions.get(field)?;
    let counts = matches!(*unit, "frame" | "1");
    let unit = (!unit.is_empty() && (counts || !without_units)).then(|| units::unit(unit));
    Some(Named {
        name: (*name).to_owned(),
        unit,
        twin: None,
    })
}

/// The unit of a camera pixel of known size.
pub fn pixels(size: f64) -> Unit {
    Unit {
        name: "nm".into(),
        shift: 0,
        factor: size,
    }
}
