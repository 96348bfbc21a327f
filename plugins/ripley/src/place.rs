//! What the operations on localisations of a region share: parameters, inputs, and how they begin.

use crate::study::{
    Bounds, Members, Region, cuboid, extent, flat, members, others, plan_region, points, solid,
    tell,
};
use crate::window::Window;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;

/// Where the localisations are looked at.
#[derive(Params)]
pub struct Place {
    /// Column with the third coordinate, such as z; in the plane if left out.
    z: Option<Column>,
    /// Low end of the region in x; from the localisations if left out.
    #[param(unit = "nm")]
    x_min: Option<f64>,
    /// High end of the region in x; from the localisations if left out.
    #[param(unit = "nm")]
    x_max: Option<f64>,
    /// Low end of the region in y; from the localisations if left out.
    #[param(unit = "nm")]
    y_min: Option<f64>,
    /// High end of the region in y; from the localisations if left out.
    #[param(unit = "nm")]
    y_max: Option<f64>,
    /// Low end of the region in z; from the localisations if left out.
    #[param(unit = "nm")]
    z_min: Option<f64>,
    /// High end of the region in z; from the localisations if left out.
    #[param(unit = "nm")]
    z_max: Option<f64>,
}

/// The points of both tables that lie in a region.
type Both<'a, const D: usize> = (Members<'a, D>, Option<Members<'a, D>>);

impl Place {
    fn bounds(&self) -> Bounds {
        Bounds {
            ends: [
                [self.x_min, self.x_max],
                [self.y_min, self.y_max],
                [self.z_min, self.z_max],
            ],
        }
    }

    /// Plans `O` with columns and region, at so many bytes a row.
    ///
    /// # Errors
    /// When the region cannot be.
    pub fn plan<O: Operation>(&self, request: &Request, row_bytes: u64) -> Result<Plan, Failure> {
        let mut plan = default_plan::<O>(request);
        plan_region(&mut plan, request, &self.bounds(), self.z.is_some())?;
        plan.memory = request.rows() * row_bytes + (64 << 20);
        Ok(plan)
    }

    /// The points of the region in both tables; the person is told of the rows that are none.
    ///
    /// # Errors
    /// When the plan does not name a column, or when cancelled.
    pub fn both<'a, const D: usize>(
        &self,
        job: &'a Job,
        window: &dyn Window<D>,
    ) -> Result<Both<'a, D>, Failure> {
        let one = members(points::<D>(job, "table", self.z.as_ref())?, window, job)?;
        let two = others::<D>(job, self.z.as_ref())?;
        let two = two.map(|two| members(two, window, job)).transpose()?;
        tell(job, "table", one.missing, one.outside);
        if let Some(two) = &two {
            tell(job, "other", two.missing, two.outside);
        }
        Ok((one, two))
    }
}

/// What is done in a region of the plane or of space.
pub trait Study {
    /// Where.
    fn place(&self) -> &Place;

    /// Does it.
    ///
    /// # Errors
    /// What the operation refuses.
    fn study<const D: usize>(
        &self,
        job: &Job,
        region: &Region<impl Window<D>>,
    ) -> Result<(), Failure>;

    /// Finds the region and does it there.
    ///
    /// # Errors
    /// When there is no region, and those of [`Study::study`].
    fn run_in_region(&self, job: &Job) -> Result<(), Failure> {
        let place = self.place();
        if place.z.is_some() {
            if let Some(region) = solid(job)? {
                return self.study::<3>(job, &region);
            }
            let data = points::<3>(job, "table", place.z.as_ref())?;
            let region = cuboid(&place.bounds(), || extent(&data, job))?;
            self.study::<3>(job, &region)
        } else {
            let data = points::<2>(job, "table", None)?;
            let region = flat(job, &place.bounds(), || extent(&data, job))?;
            self.study::<2>(job, &region)
        }
    }
}

/// Adds the inputs with localisations; `meaning` says what those of the second table are.
pub fn tables(info: Info, meaning: &str) -> Info {
    let positions = |name: &str| {
        let table = Ports::table(name);
        table.column("x", "nm").column("y", "nm").column("$z", "nm")
    };
    info.input(positions("table"))
        .input(positions("other").optional().description(meaning))
}

/// Adds the inputs that give the region.
pub fn region(info: Info) -> Info {
    let corners = Ports::table("outline").column("x", "nm").column("y", "nm");
    let corners = corners.optional();
    let mask = Ports::image("mask").optional();
    info.input(corners.description("Corners of the region in order"))
        .input(mask.description("Pixels (with z: voxels) above 0.5 are the region"))
}
