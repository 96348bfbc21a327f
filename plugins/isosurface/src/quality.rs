//! `puncta.surface.quality/1`

use crate::score::{
    Triangles, each, from_mesh, from_samples, from_truth, mean_square, quantile, truth_samples,
};
use crate::truth::{Shape, Truth};
use puncta_sdk::Input;
use puncta_sdk::documents::{Read, manifest::Step};
use puncta_sdk::input::ColumnRef;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::{Value, json};
use puncta_shared_vector::Point;

/// Column of the mean curvature of a mesh's vertices.
const CURVATURE: &str = "curvature_mean";

/// Scores a surface against the true one.
#[derive(Params)]
pub struct Quality {
    /// The true surface.
    #[param(default = Shape::Mesh)]
    pub shape: Shape,
    /// Radius of the sphere, or of the torus's ring.
    #[param(default = 100.0, min = 1e-3, max = 1e6, unit = "nm")]
    pub radius: f64,
    /// Radius of the torus's tube.
    #[param(default = 30.0, min = 1e-3, max = 1e6, unit = "nm")]
    pub tube: f64,
    /// Distance between samples of the surfaces.
    #[param(default = 5.0, min = 0.1, max = 1e6, unit = "nm")]
    pub spacing: f64,
    /// Seed of the samples.
    #[param(default = 0)]
    pub seed: Seed,
}

impl Operation for Quality {
    const ID: &'static str = "puncta.surface.quality/1";

    fn info() -> Info {
        let mesh = |name: &str| {
            Ports::mesh(name)
                .column("x", "nm")
                .column("y", "nm")
                .column("z", "nm")
        };
        let sphere = json!({"shape": "sphere", "acceptance": 0.3, "background": 0.02,
                            "fwhm_x": 100, "fwhm_y": 100, "fwhm_z": 100});
        let points = Step {
            op: "puncta.synthetic.membrane/1".into(),
            parameters: object(sphere),
            ..Step::default()
        };
        let mut surface = Step {
            op: "puncta.isosurface.octree/1".into(),
            parameters: object(json!({"most": 20})),
            ..Step::default()
        };
        surface.inputs.insert("table".into(), points);
        Info::operation("Quality of a surface")
            .description(
                "Scores a surface against the true one, a mesh or a synthetic membrane: root mean \
                 square distance both ways Q = sqrt((Q1 + Q2) / 2), Hausdorff distance, genus, and \
                 the error of the mean curvature where the vertices have it.\nDistances are exact, \
                 to triangles and to the signed distance function; the values with sampled in their \
                 name use nearest samples instead, as the publication does, and cannot fall below \
                 the samples' spacing.",
            )
            .input(mesh("surface").description("The surface to score"))
            .input(mesh("truth").optional().description("The true surface, if it is a mesh"))
            .output(Ports::report("report"))
            .cite("10.1016/j.bpj.2023.10.010")
            .example(json!({"shape": "sphere"}))
            .example_step("surface", surface)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        for (place, input) in request.inputs.iter().enumerate() {
            plan.read.push(Read {
                input: place,
                part: 1,
                columns: ["a", "b", "c"].map(String::from).into(),
            });
            if input.port == "surface"
                && input.header.column(CURVATURE).is_some()
                && let Some(read) = plan
                    .read
                    .iter_mut()
                    .find(|r| r.input == place && r.part == 0)
            {
                read.columns.push(CURVATURE.into());
            }
        }
        let given = request.inputs.iter().any(|input| input.port == "truth");
        if given != (self.shape == Shape::Mesh) {
            let message = if given {
                "there is a true mesh, and a shape is given as the truth, too"
            } else {
                "there is no true surface"
            };
            return Err(Failure::bad_parameter("shape", message)
                .remedy("give a mesh on the port truth with shape mesh, or another shape alone"));
        }
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let input = job.input("surface")?;
        let surface = triangles(&input, job)?;
        let samples = surface.samples(self.spacing, self.seed.0)?;
        job.progress(0.2, "sampling the true surface")?;
        let seed = self.seed.0 ^ 0x5eed;
        let mut report = Report::new("report");
        let analytic = self.shape.analytic(self.radius, self.tube);
        let (truth_points, from_surface, truth_genus) = match &analytic {
            None => {
                let truth = triangles(&job.input("truth")?, job)?;
                let points = truth.samples(self.spacing, seed)?;
                let distances = from_mesh(&samples, &truth, job)?;
                (points, distances, genus(&truth))
            }
            Some(truth) => {
                let points = truth_samples(truth, self.spacing, seed, job)?;
                let distances = from_truth(&samples, truth, job)?;
                (points, distances, 1.0 - truth.euler() as f64 / 2.0)
            }
        };
        job.progress(0.6, "measuring distances")?;
        let to_surface = from_mesh(&truth_points, &surface, job)?;
        distances(&mut report, "", &to_surface, &from_surface);
        let near = from_samples(&truth_points, &samples, job)?;
        let far = from_samples(&samples, &truth_points, job)?;
        distances(&mut report, "sampled_", &near, &far);
        report.number("genus", genus(&surface), "1");
        report.number("genus_of_truth", truth_genus, "1");
        report.number("components", surface.components() as f64, "1");
        report.number("samples", samples.len() as f64, "1");
        report.number("samples_of_truth", truth_points.len() as f64, "1");
        if let Some(truth) = analytic
            && input.names(0).iter().any(|name| name == CURVATURE)
        {
            let values = input.f64(CURVATURE)?;
            curvature(&truth, &surface.positions, &values, &mut report, job)?;
        }
        job.report(&report)
    }
}

fn curvature(
    truth: &Truth,
    positions: &[Point],
    values: &[f64],
    report: &mut Report,
    job: &Job,
) -> Result<(), Failure> {
    let exact = each(positions, job, &|p| truth.mean_curvature(truth.project(p)))?;
    let pairs = values.iter().zip(&exact);
    let errors: Vec<f64> = pairs
        .map(|(a, b)| (a - b).abs())
        .filter(|e| e.is_finite())
        .collect();
    let mut add = |name: &str, value: f64| {
        report.number(name, value, "nm^-1");
    };
    add("curvature_mean_error_rms", mean_square(&errors).sqrt());
    add("curvature_mean_error_median", quantile(&errors, 0.5));
    Ok(())
}

fn genus(mesh: &Triangles) -> f64 {
    mesh.components() as f64 - mesh.euler() as f64 / 2.0
}

fn distances(report: &mut Report, prefix: &str, to: &[f64], from: &[f64]) {
    let (q1, q2) = (mean_square(to), mean_square(from));
    let mut add = |name: &str, value: f64, unit: &str| {
        report.number(&format!("{prefix}{name}"), value, unit);
    };
    add("q", ((q1 + q2) / 2.0).sqrt(), "nm");
    add("q1_truth_to_surface", q1, "nm^2");
    add("q2_surface_to_truth", q2, "nm^2");
    let both = |share| quantile(to, share).max(quantile(from, share));
    add("hausdorff_95", both(0.95), "nm");
    add("hausdorff", both(1.0), "nm");
}

fn triangles(input: &Input<'_>, job: &Job) -> Result<Triangles, Failure> {
    let (x, y, z) = (input.f64("x")?, input.f64("y")?, input.f64("z")?);
    let positions: Vec<Point> = x
        .iter()
        .zip(y.iter())
        .zip(z.iter())
        .map(|((x, y), z)| [*x, *y, *z])
        .collect();
    let corner = |name| match input.column(1, name)? {
        ColumnRef::U32(corners) => Ok(corners),
        _ => Err(Failure::bad_input(format!(
            "column {name} of the triangles is not u32"
        ))),
    };
    let (a, b, c) = (corner("a")?, corner("b")?, corner("c")?);
    let corners = a.iter().zip(b).zip(c).map(|((a, b), c)| [*a, *b, *c]);
    Triangles::new(positions, corners.collect(), job)
}

fn object(value: Value) -> Map {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

register!(Quality);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_sdk::run::Serial;
    use puncta_shared_mesh::shapes;
    use puncta_shared_simulation::shape::Shape as Known;
    use puncta_testkit::{Call, Done};

    /// A sphere of radius 100 nm whose vertices say that their mean curvature is `curvature`.
    #[derive(Params)]
    struct Curved {
        /// Mean curvature.
        #[param(unit = "nm^-1")]
        curvature: f64,
    }

    impl Operation for Curved {
        const ID: &'static str = "test.curved/1";

        fn info() -> Info {
            Info::operation("Curved").output(Ports::mesh("mesh"))
        }

        fn run(&self, job: &Job) -> Result<(), Failure> {
            let (positions, triangles) = shapes::sphere(100.0, 4);
            let mut columns = vec![
                ColumnInfo::new("x", Element::F64, "nm"),
                ColumnInfo::new("y", Element::F64, "nm"),
            ];
            columns.push(ColumnInfo::new("z", Element::F64, "nm"));
            columns.push(ColumnInfo::new(CURVATURE, Element::F64, "nm^-1"));
            let rows = [positions.len() as u64, triangles.len() as u64];
            let mut out = job.begin("mesh", Header::mesh("ball", columns, rows[0], rows[1]))?;
            let [x, y, z, curvature] = out.f64s_mut(["x", "y", "z", CURVATURE])?;
            for (axis, column) in [x, y, z].into_iter().enumerate() {
                for (to, from) in column.iter_mut().zip(&positions) {
                    *to = from[axis];
                }
            }
            curvature.fill(self.curvature);
            // The curvature of one vertex is not known.
            curvature[7] = f64::NAN;
            for (corner, column) in out.columns_mut(1)?.into_iter().enumerate() {
                if let puncta_sdk::ColumnMut::U32(column) = column {
                    for (to, from) in column.iter_mut().zip(&triangles) {
                        *to = from[corner];
                    }
                }
            }
            out.finish()
        }
    }

    fn scored(curvature: f64) -> Done {
        let ball = Call::of::<Curved>()
            .set("curvature", curvature)
            .run()
            .expect("a ball");
        let surface = ball.output("mesh").expect("the ball").clone();
        let call = Call::of::<Quality>()
            .set("shape", "sphere")
            .set("spacing", 10);
        call.input("surface", surface).run().expect("a score")
    }

    #[test]
    fn the_error_of_curvature_is_that_of_the_column() {
        for (curvature, error) in [(0.01, 0.0), (0.011, 0.001), (-0.01, 0.02)] {
            let report = scored(curvature);
            for name in ["curvature_mean_error_rms", "curvature_mean_error_median"] {
                let found = report.value(name).expect(name);
                assert!((found - error).abs() < 1e-6, "{name} {found} {error}");
            }
        }
        let report = scored(0.01);
        assert_eq!(report.value("genus"), Some(0.0));
        assert!(report.value("hausdorff").expect("a distance") < 0.5);
    }

    fn mesh((positions, triangles): shapes::Shape) -> Triangles {
        Triangles::new(positions, triangles, &Serial).expect("a mesh")
    }

    #[test]
    fn a_sphere_that_is_too_large_is_off_by_the_difference() {
        let truth = Truth::new(Known::Sphere { radius: 100.0 });
        let surface = mesh(shapes::sphere(103.0, 5));
        let points = truth_samples(&truth, 4.0, 1, &Serial).expect("samples");
        let expected = 4.0 * std::f64::consts::PI * 100.0f64.powi(2) / 16.0;
        assert!(
            (points.len() as f64 / expected - 1.0).abs() < 0.05,
            "{}",
            points.len()
        );
        let to = from_mesh(&points, &surface, &Serial).expect("distances");
        let samples = surface.samples(4.0, 2).expect("samples");
        let from = from_truth(&samples, &truth, &Serial).expect("distances");
        for distances in [&to, &from] {
            assert!((mean_square(distances).sqrt() - 3.0).abs() < 0.05);
            assert!((quantile(distances, 0.95) - 3.0).abs() < 0.05);
        }
        // Nearest samples lie further away than nearest places.
        let sampled = from_samples(&points, &samples, &Serial).expect("distances");
        assert!(mean_square(&sampled).sqrt() > 3.2);
        assert_eq!(genus(&surface), 0.0);
    }

    #[test]
    fn a_torus_has_a_handle_and_its_own_distance_is_small() {
        let (ring, tube) = (100.0, 30.0);
        let truth = Truth::new(Known::Torus { ring, tube });
        let surface = mesh(shapes::torus(100.0, 30.0, 200, 80));
        assert_eq!((genus(&surface), surface.components()), (1.0, 1));
        let samples = surface.samples(3.0, 2).expect("samples");
        let from = from_truth(&samples, &truth, &Serial).expect("distances");
        assert!(quantile(&from, 1.0) < 0.1);
        let points = truth_samples(&truth, 3.0, 1, &Serial).expect("samples");
        let to = from_mesh(&points, &surface, &Serial).expect("distances");
        assert!(quantile(&to, 1.0) < 0.1);
    }

    #[test]
    fn a_surface_without_triangles_and_too_fine_samples_are_refused() {
        assert!(Triangles::new(vec![], vec![], &Serial).is_err());
        assert!(Triangles::new(vec![[0.0; 3]], vec![[0, 0, 9]], &Serial).is_err());
        let flat = Triangles::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]], &Serial);
        assert!(flat.is_err() || flat.is_ok_and(|flat| flat.samples(1.0, 0).is_err()));
        assert!(mesh(shapes::sphere(1e6, 2)).samples(0.1, 0).is_err());
    }
}
