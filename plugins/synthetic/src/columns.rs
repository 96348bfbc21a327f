//! The table of a simulation: its columns, and how they are filled from the localisations.

use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::{ColumnMut, OutputObject};

use puncta_shared_simulation::simulate::{Cloud, FWHM, Localisation};

/// Rows that one task writes.
const CHUNK: usize = 1 << 15;

/// The columns, in the order in which [`write`] fills them.
pub fn header(rows: u64) -> Header {
    let nm = |name: &str| ColumnInfo::new(name, Element::F64, "nm");
    let mut columns = vec![];
    for name in ["x", "y", "z"] {
        columns.push(nm(name).role("position"));
    }
    for name in ["error_x", "error_y", "error_z"] {
        columns.push(
            nm(name)
                .role("error")
                .description("Standard deviation of the position"),
        );
    }
    columns.push(ColumnInfo::new("t", Element::I32, "frame").role("time"));
    columns.push(ColumnInfo::new("nPhotons", Element::F32, "photon"));
    let sig = ColumnInfo::new("sig", Element::F32, "nm");
    columns.push(sig.description("Standard deviation of the spot in x and y"));
    let inside = ColumnInfo::new("inside", Element::Bool, "1");
    columns.push(inside.description("Truth: whether it belongs to the membrane"));
    let site = ColumnInfo::new("site", Element::U32, "1").role("group");
    columns.push(site.description("Truth: number of the site, from 0"));
    let copy = ColumnInfo::new("copy", Element::U32, "1").role("group");
    columns.push(copy.description("Truth: number of the copy, from 1; 0 in the background"));
    for name in ["true_x", "true_y", "true_z"] {
        columns.push(nm(name).description("Truth: position of the site"));
    }
    let normal = ColumnInfo::new("normal", Element::F32, "1")
        .width(3)
        .role("vector");
    columns.push(normal.description("Truth: outward normal of the membrane at the site"));
    Header::table("localisations", rows, columns)
}

/// Fills the columns of [`header`].
///
/// # Errors
/// When cancelled, or when the output has another column.
pub fn write(out: &mut OutputObject<'_>, cloud: &Cloud, run: &dyn Run) -> Result<(), Failure> {
    let names: Vec<String> = out
        .header()
        .parts
        .iter()
        .flat_map(|part| &part.columns)
        .map(|c| c.name.clone())
        .collect();
    let sig = ((cloud.fwhm[0] * cloud.fwhm[1]).sqrt() / FWHM) as f32;
    let count = names.len() as f64;
    for (place, (name, column)) in names.iter().zip(out.columns_mut(0)?).enumerate() {
        run.progress(0.9 + 0.1 * place as f64 / count, "Writing columns")?;
        let each = Each { cloud, run };
        let axis = name
            .bytes()
            .last()
            .map_or(0, |letter| letter.wrapping_sub(b'x')) as usize
            % 3;
        match (name.as_str(), column) {
            ("x" | "y" | "z", ColumnMut::F64(to)) => each.one(to, &|l| l.position[axis]),
            ("t", ColumnMut::I32(to)) => each.one(to, &|l| l.frame as i32),
            ("nPhotons", ColumnMut::F32(to)) => each.one(to, &|l| l.photons),
            ("sig", ColumnMut::F32(to)) => each.one(to, &|_| sig),
            ("inside", ColumnMut::Bool(to)) => each.one(to, &|l| cloud.is_membrane(l).into()),
            ("site", ColumnMut::U32(to)) => each.one(to, &|l| l.site),
            ("copy", ColumnMut::U32(to)) => each.one(to, &|l| cloud.site(l).copy),
            ("normal", ColumnMut::F32(to)) => each.many(to, &|l| cloud.site(l).normal),
            (name, ColumnMut::F64(to)) if name.starts_with("error_") => {
                each.one(to, &|l| cloud.errors(l)[axis]);
            }
            (name, ColumnMut::F64(to)) if name.starts_with("true_") => {
                each.one(to, &|l| cloud.site(l).position[axis]);
            }
            (name, _) => return Err(Failure::internal(format!("column {name} is not filled"))),
        }
    }
    if run.cancelled() {
        Err(Failure::cancelled())
    } else {
        Ok(())
    }
}

/// Fills a column from the localisations, in parallel.
struct Each<'a> {
    cloud: &'a Cloud,
    run: &'a dyn Run,
}

impl Each<'_> {
    /// One number a row.
    fn one<T: Send>(&self, to: &mut [T], value: &(dyn Fn(&Localisation) -> T + Sync)) {
        chunks_mut(self.run, to, CHUNK, &|i, to| {
            for (to, localisation) in to.iter_mut().zip(self.rows(i)) {
                *to = value(localisation);
            }
        });
    }

    /// `N` numbers a row.
    fn many<T: Send, const N: usize>(
        &self,
        to: &mut [T],
        value: &(dyn Fn(&Localisation) -> [T; N] + Sync),
    ) {
        chunks_mut(self.run, to, CHUNK * N, &|i, to| {
            let (to, _) = to.as_chunks_mut::<N>();
            for (to, localisation) in to.iter_mut().zip(self.rows(i)) {
                *to = value(localisation);
            }
        });
    }

    fn rows(&self, chunk: usize) -> &[Localisation] {
        if self.run.cancelled() {
            return &[];
        }
        self.cloud
            .localisations
            .get(chunk * CHUNK..)
            .unwrap_or_default()
    }
}
