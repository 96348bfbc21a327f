//! `puncta.synthetic.membrane/1`

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use crate::columns::{header, write};
use puncta_shared_simulation::arrangement::Turn;
use puncta_shared_simulation::parameters::Parameters;
use puncta_shared_simulation::sample::Candidate;
use puncta_shared_simulation::shape::Shape;
use puncta_shared_simulation::simulate::{Cloud, Localisation, Site, simulate};

/// The test structures.
#[derive(Choice, Clone, Copy, Debug)]
pub enum Structure {
    /// Two touching tori, rings in the x z plane (genus 2)
    Tori,
    /// Two touching tori, rings in the x y plane (genus 2)
    ToriFlat,
    /// A three-way junction of tubules (genus 0)
    Junction,
    /// A piece of endoplasmic reticulum: a plate with two holes, and tubules (genus 3)
    Er,
    /// A sphere (genus 0)
    Sphere,
}

/// How copies are turned.
#[derive(Choice, Clone, Copy, Debug)]
pub enum Turning {
    /// Not at all
    None,
    /// By a random angle about the z axis
    AboutZ,
    /// By a random rotation
    Any,
}

/// Simulates localisations of a membrane.
#[derive(Params)]
pub struct Membrane {
    /// The membrane.
    #[param(default = Structure::Tori)]
    pub shape: Structure,
    /// Radius of the sphere.
    #[param(default = 100.0, min = 2.0, max = 1e6, unit = "nm")]
    pub radius: f64,
    /// Probability p that a candidate site is kept, above 0; about 2 p / dx^2 localisations per area.
    #[param(default = 0.005, min = 0.0, max = 1.0)]
    pub acceptance: f64,
    /// Share n of localisations that are background, below 1.
    #[param(default = 0.1, min = 0.0, max = 1.0)]
    pub background: f64,
    /// Resolution (full width at half maximum) along x.
    #[param(default = 280.0, min = 0.1, max = 1e5, unit = "nm")]
    pub fwhm_x: f64,
    /// Resolution along y.
    #[param(default = 280.0, min = 0.1, max = 1e5, unit = "nm")]
    pub fwhm_y: f64,
    /// Resolution along z.
    #[param(default = 280.0, min = 0.1, max = 1e5, unit = "nm")]
    pub fwhm_z: f64,
    /// Mean of the exponential distribution of photon numbers, before it is clipped.
    #[param(default = 100.0, min = 1e-3, max = 1e9, unit = "photon")]
    pub photons: f64,
    /// Photon number above which the distribution is clipped, as the noise floor.
    #[param(default = 20.0, min = 1.0, max = 1e9, unit = "photon")]
    pub background_photons: f64,
    /// Samples of each site, among which the localisations are drawn.
    #[param(default = 10, min = 1, max = 1000)]
    pub blinks: u32,
    /// Number of frames, at least twice the samples of a site.
    #[param(default = 10_000, min = 2, max = 1e7, unit = "frame")]
    pub frames: u32,
    /// Mean length of a burst of consecutive frames in which a site is seen.
    #[param(default = 2.5, min = 1.0, max = 1e9, unit = "frame")]
    pub mean_on: f64,
    /// Copies of the membrane, on a square grid in x and y.
    #[param(default = 1, min = 1, max = 1e6)]
    pub copies: u32,
    /// How copies are turned.
    #[param(default = Turning::None)]
    pub turn: Turning,
    /// Mean gap between copies.
    #[param(default = 100.0, min = 0.0, max = 1e6, unit = "nm")]
    pub gap: f64,
    /// Sampling rate: side of the smallest boxes of the octree.
    #[param(default = 1.66, min = 0.5, max = 10.0, unit = "nm", advanced)]
    pub dx: f64,
    /// Seed of the random numbers.
    #[param(default = 0)]
    pub seed: Seed,
}

impl Membrane {
    fn parameters(&self) -> Parameters {
        Parameters {
            shape: match self.shape {
                Structure::Tori => Shape::Tori,
                Structure::ToriFlat => Shape::ToriFlat,
                Structure::Junction => Shape::Junction,
                Structure::Er => Shape::Er,
                Structure::Sphere => Shape::Sphere {
                    radius: self.radius,
                },
            },
            acceptance: self.acceptance,
            dx: self.dx,
            background: self.background,
            fwhm: [self.fwhm_x, self.fwhm_y, self.fwhm_z],
            photons: self.photons,
            background_photons: self.background_photons,
            blinks: self.blinks,
            frames: self.frames,
            mean_on: self.mean_on,
            copies: self.copies,
            turn: match self.turn {
                Turning::None => Turn::None,
                Turning::AboutZ => Turn::AboutZ,
                Turning::Any => Turn::Any,
            },
            gap: self.gap,
            seed: self.seed.0,
        }
    }
}

impl Operation for Membrane {
    const ID: &'static str = "puncta.synthetic.membrane/1";

    fn info() -> Info {
        Info::operation("Simulate a membrane")
            .description(
                "Simulates localisations of a membrane whose surface is known, with the truth \
                 beside them.\nSites are sampled on an octree along the surface and kept with a \
                 probability; of up to ten samples of each site as many as there are sites are \
                 drawn. Each localisation has its own photon number N and the error \
                 fwhm / (2.355 sqrt(N)) along each axis. Background is uniform in the bounding \
                 box, 1.2 times as large.\nThe columns true_x, true_y, true_z give the site, \
                 normal the outward normal of the membrane there (NaN in the background), inside \
                 whether the localisation belongs to the membrane, site and copy the numbers of \
                 its site and of its copy (0 in the background).",
            )
            .output(Ports::table("localisations").description("Sorted by frame, then by site"))
            .example(json!({ "acceptance": 0.002 }))
            .cite(
                "Z. R. Connerty-Marin, Quantifying Membrane Topology at the Nanoscale, PhD thesis, \
                 Yale University, 2022, appendix C, Point cloud simulation",
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let _ = request;
        let parameters = self.parameters();
        parameters.check()?;
        let rows = parameters.row_bound();
        let candidates = parameters.expected_candidates() * size_of::<Candidate>() as f64;
        let row = 2 * size_of::<Localisation>() + size_of::<Site>() + size_of::<u16>();
        let frames = 4 * u64::from(parameters.frames);
        Ok(Plan {
            outputs: vec![Output {
                output: "localisations".into(),
                form: OutputForm::Object,
                of: None,
                header: header(rows),
            }],
            memory: rows * row as u64 + 2 * candidates as u64 + frames,
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let parameters = self.parameters();
        let cloud = simulate(&parameters, job)?;
        let rows = cloud.localisations.len() as u64;
        let mut out = job.begin("localisations", header(rows))?;
        out.commit(0, rows)?;
        write(&mut out, &cloud, job)?;
        out.header_mut()
            .metadata
            .insert("simulation".into(), truth(&parameters, &cloud));
        out.finish()
    }
}

puncta_sdk::register!(Membrane);

/// What is known about the surface.
fn truth(parameters: &Parameters, cloud: &Cloud) -> puncta_sdk::serde_json::Value {
    let shape = parameters.shape;
    json!({
        "shape": shape.name(),
        "euler_characteristic": shape.euler(),
        "area_nm2": shape.area(),
        "copies": parameters.copies,
        "membrane_sites": cloud.membrane_sites,
        "background_localisations": cloud.localisations.len() - cloud.membrane_sites,
        "frames": parameters.frames,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Done};

    fn done(call: Call) -> Done {
        call.run().unwrap()
    }

    #[test]
    fn the_table_holds_the_simulation() {
        let call = Call::of::<Membrane>()
            .set("shape", "er")
            .set("seed", "7")
            .set("copies", 2);
        let call = call.set("turn", "about_z").set("fwhm_z", "0.84 um");
        let table = done(call).output("localisations").unwrap().clone();
        let parameters = Parameters {
            shape: Shape::Er,
            seed: 7,
            copies: 2,
            turn: Turn::AboutZ,
            fwhm: [280.0, 280.0, 840.0],
            ..Parameters::default()
        };
        let cloud = simulate(&parameters, &puncta_sdk::run::Serial).unwrap();
        let rows = &cloud.localisations;
        assert_eq!(table.header.rows(), rows.len() as u64);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            let read = |name: String| table.f64(&name).unwrap();
            let (at, error) = (read(name.into()), read(format!("error_{name}")));
            let site = read(format!("true_{name}"));
            for (i, row) in rows.iter().enumerate() {
                assert_eq!(at[i], row.position[axis]);
                assert_eq!(error[i], cloud.errors(row)[axis]);
                assert_eq!(site[i], cloud.site(row).position[axis]);
            }
        }
        let photons: Vec<f32> = rows.iter().map(|row| row.photons).collect();
        assert_eq!(table.f32("nPhotons").unwrap(), photons);
        assert!(
            table
                .i32("t")
                .unwrap()
                .iter()
                .zip(rows)
                .all(|(t, row)| *t == row.frame as i32)
        );
        assert!(
            table
                .u32("site")
                .unwrap()
                .iter()
                .zip(rows)
                .all(|(s, row)| *s == row.site)
        );
        let inside = table.bytes("inside").unwrap();
        assert!(
            inside
                .iter()
                .zip(rows)
                .all(|(i, row)| (*i == 1) == cloud.is_membrane(row))
        );
        let copy = table.u32("copy").unwrap();
        assert!(
            copy.iter()
                .zip(&inside)
                .all(|(copy, inside)| (*copy > 0) == (*inside == 1))
        );
        let normal = table.f32("normal").unwrap();
        let normals = normal.chunks(3).zip(rows);
        let expected = |row| cloud.site(row).normal.map(f32::to_bits);
        assert!(
            normals
                .into_iter()
                .all(|(n, row)| n.iter().map(|c| c.to_bits()).eq(expected(row)))
        );
        assert_eq!(
            table.header.metadata["simulation"]["euler_characteristic"],
            -4
        );
        assert!(
            table
                .f32("sig")
                .unwrap()
                .iter()
                .all(|sig| (sig - 118.896).abs() < 0.001)
        );
    }

    #[test]
    fn defaults_are_those_of_the_simulation() {
        let defaults = puncta_sdk::documents::schema::canonical(&Membrane::schema(), &Map::new());
        let membrane = Membrane::from_values(&defaults.unwrap()).unwrap();
        assert_eq!(membrane.parameters(), Parameters::default());
    }

    #[test]
    fn threads_change_no_bit_and_the_plan_bounds_the_rows() {
        let call = || {
            Call::of::<Membrane>()
                .set("shape", "junction")
                .set("copies", 3)
        };
        let plan = call().prepare().unwrap();
        let (one, two) = (done(call().threads(1)), done(call().threads(2)));
        let (one, two) = (
            one.output("localisations").unwrap(),
            two.output("localisations").unwrap(),
        );
        for name in ["x", "y", "z", "error_x", "true_z"] {
            assert_eq!(one.f64(name).unwrap(), two.f64(name).unwrap());
        }
        assert!(plan.outputs[0].header.rows() >= one.header.rows());
        let (planned, given) = (&plan.outputs[0].header.parts[0], &one.header.parts[0]);
        assert_eq!(planned.columns, given.columns);
    }

    #[test]
    fn bad_parameters_are_refused_before_the_run_and_cancel_ends_it() {
        let refused = |name, value: f64| {
            Call::of::<Membrane>()
                .set(name, value)
                .prepare()
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            refused("acceptance", 0.0),
            "acceptance is 0; give one above 0 and up to 1"
        );
        assert_eq!(
            refused("background", 1.0),
            "background is 1; give one from 0 to below 1"
        );
        assert_eq!(
            refused("frames", 12.0),
            "12 frames are too few for 10 samples of a site; give at least 20"
        );
        assert!(refused("dx", 0.1).contains("dx"));
        assert!(
            Call::of::<Membrane>()
                .set("shape", "cube")
                .prepare()
                .is_err()
        );
        for polls in [1, 5, 20] {
            let call = Call::of::<Membrane>()
                .set("shape", "er")
                .cancel_after(polls);
            assert!(call.run().unwrap_err().is_cancelled());
        }
    }
}
