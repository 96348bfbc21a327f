//! The operation `puncta.ripley.k/1`.

use crate::bins::Bins;
use crate::envelope::{Envelope, Simulation, check, envelope, simulated};
use crate::place::{Place, Study, region, tables};
use crate::ripley::{Curves, Edges, Sets, rings};
use crate::simulate::{self, Null};
use crate::study::{Members, Region, bins, say, table};
use crate::window::Window;
use puncta_sdk::documents::{Figure, Series};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// The curve of the figure.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plot {
    /// K.
    K,
    /// L.
    L,
    /// H = L - r.
    H,
    /// dL / dr.
    Dl,
    /// dH / dr.
    Dh,
    /// Pair correlation g.
    G,
}

/// Ripley's K of localisations and what follows from it.
#[derive(Params)]
pub struct Ripley {
    /// Step of the radius.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    step: f64,
    /// Largest radius, rounded up to a whole step.
    #[param(default = 500, min = 1e-6, max = 1e9, unit = "nm")]
    r_max: f64,
    /// Correction for what lies beyond the boundary.
    #[param(default = Edges::Isotropic)]
    edges: Edges,
    /// Where.
    #[param(flatten)]
    place: Place,
    /// Number of simulated patterns for envelopes and p-values; none if 0.
    #[param(default = 0, min = 0, max = 100000)]
    simulations: usize,
    /// Share of patterns without structure that may leave an envelope.
    #[param(default = 0.05, min = 1e-4, max = 0.5)]
    significance: f64,
    /// What the simulated patterns are.
    #[param(default = Null::Uniform)]
    null: Null,
    /// Seed of the simulations.
    #[param(default = 1)]
    seed: Seed,
    /// Curve of the figure.
    #[param(default = Plot::H)]
    plot: Plot,
}

impl Ripley {
    /// Refuses or warns of radii that the region is too small for.
    fn reaches<const D: usize>(
        &self,
        job: &Job,
        window: &dyn Window<D>,
        bins: &Bins,
    ) -> Result<(), Failure> {
        let [low, high] = window.bounds();
        let shortest = (0..D)
            .map(|a| high[a] - low[a])
            .fold(f64::INFINITY, f64::min);
        if self.edges == Edges::Translation && bins.radius() >= shortest {
            let message = format!(
                "r_max {} nm reaches across the region, whose shortest side is {shortest} nm",
                bins.radius()
            );
            return Err(Failure::bad_parameter("r_max", message).remedy("take a smaller r_max"));
        }
        if bins.radius() > shortest / 2.0 {
            job.warn(&format!(
                "radii above half the shortest side of the region ({} nm) say little",
                shortest / 2.0
            ));
        }
        Ok(())
    }

    fn caption<const D: usize>(
        &self,
        window: &dyn Window<D>,
        origin: &str,
        one: usize,
        two: Option<usize>,
    ) -> String {
        let points = match two {
            Some(two) => format!("From {one} to {two} localisations"),
            None => format!("{one} localisations"),
        };
        let mut caption = format!(
            "{points} in a {} ({origin}), {}, steps of {} nm",
            window.describe(),
            self.edges.describe(),
            self.step
        );
        if self.simulations > 0 {
            caption.push_str(&format!(
                "; {} simulations ({:?}, seed {}), bands of {} %: for each radius, and for all \
                 together",
                self.simulations,
                self.null,
                self.seed.0,
                100.0 * (1.0 - self.significance)
            ));
        }
        caption
    }

    fn figure<const D: usize>(&self, bands: bool, caption: String) -> Figure {
        let power = if D == 2 { "nm^2" } else { "nm^3" };
        let (column, label, unit) = match self.plot {
            Plot::K => ("k", "K", power),
            Plot::L => ("l", "L", "nm"),
            Plot::H => ("h", "L - r", "nm"),
            Plot::Dl => ("dl", "dL/dr", "1"),
            Plot::Dh => ("dh", "d(L - r)/dr", "1"),
            Plot::G => ("g", "g", "1"),
        };
        let title = format!("Ripley's {label}");
        let mut figure = Figure::new("figure", &title, ["r", "nm"], [label, unit]);
        if bands && self.plot == Plot::H {
            let band = |label: &str, low: &str, high: &str| {
                Series::columns(label, "band", "curve", "r", low).up_to(high)
            };
            figure = figure
                .with(band(
                    "no structure, all radii",
                    "h_global_low",
                    "h_global_high",
                ))
                .with(band("no structure, each radius", "h_low", "h_high"));
        }
        figure.caption = caption;
        figure.with(Series::columns(label, "line", "curve", "r", column))
    }
}

fn write_table<const D: usize>(
    job: &Job,
    curves: &Curves,
    around: Option<&Envelope>,
) -> Result<(), Failure> {
    let power = if D == 2 { "nm^2" } else { "nm^3" };
    let mut columns: Vec<(&str, &str, &str, &[f64])> = vec![
        ("r", "nm", "Radius", &curves.r),
        ("k", power, "Ripley's K", &curves.k),
        ("l", "nm", "L", &curves.l),
        ("h", "nm", "L - r", &curves.h),
        ("dl", "1", "Slope of L", &curves.dl),
        ("dh", "1", "Slope of L - r", &curves.dh),
        (
            "g",
            "1",
            "Pair correlation, mean over the step that ends at r",
            &curves.g,
        ),
    ];
    if let Some(around) = around {
        columns.extend([
            (
                "h_low",
                "nm",
                "Low end of the band for each radius",
                &around.low[..],
            ),
            (
                "h_high",
                "nm",
                "High end of the band for each radius",
                &around.high[..],
            ),
            (
                "h_global_low",
                "nm",
                "Low end of the band for all radii",
                &around.global_low[..],
            ),
            (
                "h_global_high",
                "nm",
                "High end of the band for all radii",
                &around.global_high[..],
            ),
        ]);
    }
    table(job, "curve", &columns)
}

fn report<const D: usize>(
    job: &Job,
    window: &dyn Window<D>,
    curves: &Curves,
    around: Option<&Envelope>,
    one: usize,
    two: Option<usize>,
    [missing, outside]: [usize; 2],
) -> Result<(), Failure> {
    let mut report = Report::new("report");
    say(
        &mut report,
        "localisations",
        one as f64,
        "1",
        "Localisations in the region",
    );
    if let Some(two) = two {
        say(
            &mut report,
            "others",
            two as f64,
            "1",
            "Localisations of the other table in it",
        );
    }
    say(
        &mut report,
        "missing",
        missing as f64,
        "1",
        "Rows without a finite position, left out",
    );
    say(
        &mut report,
        "outside",
        outside as f64,
        "1",
        "Rows outside the region, left out",
    );
    let (name, unit) = if D == 2 {
        ("area", "nm^2")
    } else {
        ("volume", "nm^3")
    };
    say(
        &mut report,
        name,
        window.volume(),
        unit,
        "Size of the region",
    );
    let most = (0..curves.h.len()).max_by(|a, b| curves.h[*a].total_cmp(&curves.h[*b]));
    if let Some(most) = most {
        say(&mut report, "h_max", curves.h[most], "nm", "Largest L - r");
        say(
            &mut report,
            "r_h_max",
            curves.r[most],
            "nm",
            "Radius of the largest L - r",
        );
    }
    if let Some(around) = around {
        let text = "p-value of the largest deviation of L - r (MAD test)";
        say(&mut report, "p_largest", around.p_largest, "1", text);
        let text = "p-value of the summed squared deviation of L - r (DCLF test)";
        say(&mut report, "p_summed", around.p_summed, "1", text);
    }
    job.report(&report)
}

impl Study for Ripley {
    fn place(&self) -> &Place {
        &self.place
    }

    fn study<const D: usize>(
        &self,
        job: &Job,
        region: &Region<impl Window<D>>,
    ) -> Result<(), Failure> {
        let window: &dyn Window<D> = &region.window;
        let bins = bins(self.step, self.r_max, Bins::up_to)?;
        let (one, two) = self.place.both(job, window)?;
        let sets = Sets {
            one: one.axes(),
            two: two.as_ref().map(Members::axes),
        };
        if sets.pairs() <= 0.0 {
            let message = format!("there is no pair of localisations in the {}", region.origin);
            return Err(Failure::bad_input(message).remedy("give two localisations or more"));
        }
        self.reaches(job, window, &bins)?;
        if self.simulations > 0 {
            simulate::check(self.null, two.is_some(), window)?;
        }
        job.progress(0.0, "counting pairs")?;
        let curves = Curves::new(&rings(&sets, window, self.edges, &bins, job)?, &bins, D);
        let around = if self.simulations > 0 {
            let simulation = Simulation {
                null: self.null,
                count: self.simulations,
                significance: self.significance,
                seed: self.seed.0,
            };
            let others = simulated(&sets, window, self.edges, &bins, &simulation, job)?;
            Some(envelope(&curves.h, &others, self.significance)?)
        } else {
            None
        };
        write_table::<D>(job, &curves, around.as_ref())?;
        let seconds = two.as_ref().map(Members::len);
        let caption = self.caption(window, region.origin, one.len(), seconds);
        job.figure(&self.figure::<D>(around.is_some(), caption))?;
        let outside = [one.missing, one.outside];
        report(
            job,
            window,
            &curves,
            around.as_ref(),
            one.len(),
            seconds,
            outside,
        )
    }
}

impl Operation for Ripley {
    const ID: &'static str = "puncta.ripley.k/1";

    fn info() -> Info {
        let info = Info::operation("Ripley's K, L and pair correlation")
            .description(
                "K, L, L - r, their slopes and the pair correlation g of the localisations of one \
                 table, or from those of one to those of another. The region is an outline, a mask, \
                 given bounds or the bounding box of the localisations, which is a little smaller \
                 than the field. Simulated patterns give envelopes and p-values.",
            );
        region(tables(info, "Second set, such as another channel"))
            .output(Ports::table("curve").description("The curves at each radius"))
            .output(
                Ports::figure("figure").description("The chosen curve, with envelopes of L - r"),
            )
            .output(Ports::report("report").description("Region, largest L - r, p-values"))
            .example(json!({"r_max": 300, "simulations": 39}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
            .cite("Ripley, J. R. Stat. Soc. B 39, 172 (1977)")
            .cite("10.1890/13-2042.1")
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        bins(self.step, self.r_max, Bins::up_to)?;
        if self.simulations > 0 {
            check(self.simulations, self.significance)?;
        }
        self.place.plan::<Self>(request, 100)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.run_in_region(job)
    }
}

puncta_sdk::register!(Ripley);

#[cfg(test)]
mod tests;
