//! The operation `puncta.frc.images/1`.

use super::halves::Setup;
use super::result::{Summary, emit, outputs};
use crate::curve::Curve;
use crate::grid::VOXEL_BYTES;
use crate::window::Window;
use puncta_sdk::documents::call::Read;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::input::Input;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Cancelled;
use puncta_sdk::serde_json::json;
use puncta_shared_fourier::{Complex, RealFft};

/// Fourier ring or shell correlation of two images.
#[derive(Params)]
pub struct Images {
    /// Share of the field over which the window falls to zero, both ends together.
    #[param(default = 0.25, min = 0, max = 1)]
    taper: f64,
    /// Rings that are averaged for the crossing; a twentieth of them if left out, at least 5.
    #[param(min = 1, max = 100000, advanced)]
    smoothing: Option<u64>,
}

/// Fewest pixels along an axis.
const FEWEST: u64 = 16;

impl Operation for Images {
    const ID: &'static str = "puncta.frc.images/1";

    fn info() -> Info {
        let info = Info::operation("Fourier correlation of two images")
            .description(
                "Correlates the spectra of two images of the same field on rings, or of two \
                 volumes on shells, of equal spatial frequency. Their noise must be independent: \
                 two exposures, or renderings of two halves of a table without shared rows.",
            )
            .cite("van Heel and Schatz, Journal of Structural Biology 151, 250 (2005)")
            .input(Ports::image("first").description("A plane or a volume"))
            .input(Ports::image("second").description("Another one of the same size"));
        let limits = json!({"pixel_size": 10, "x_min": -900, "x_max": 900,
            "y_min": -900, "y_max": 900});
        let render = |seed: u64| Step {
            op: "puncta.render.histogram/1".into(),
            parameters: limits.as_object().cloned().unwrap_or_default(),
            inputs: [("table".to_owned(), source(seed))].into(),
            ..Step::default()
        };
        outputs(info)
            .example(json!({}))
            .example_step("first", render(1))
            .example_step("second", render(2))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = Plan {
            interruptible: true,
            ..Plan::default()
        };
        let mut voxels = 0;
        for (input, image) in request.inputs.iter().enumerate() {
            check(&image.header, &request.inputs[0].header)?;
            voxels = image.header.rows();
            plan.read.push(values_of(input));
        }
        plan.memory = voxels * VOXEL_BYTES;
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (first, second) = (job.input("first")?, job.input("second")?);
        let (size, voxel) = shape(first.header())?;
        let setup = Setup::new(size, voxel, self.taper);
        let a = spectrum_of(job, &setup.plan, &setup.window, &first)?;
        job.progress(0.4, "transforming the second image")?;
        let b = spectrum_of(job, &setup.plan, &setup.window, &second)?;
        let (sums, frequencies) = setup.sums(job, &a, &b)?;
        let span = self.smoothing.map(|span| span as usize);
        let curve = Curve::new(&setup.rings, frequencies, setup.independent, &[sums], span);
        let flat = size[0] == 1;
        let used = if flat { 2 } else { 3 };
        let sizes: Vec<String> = size.iter().rev().map(usize::to_string).collect();
        let sides: Vec<String> = voxel.iter().rev().map(|v| format!("{v}")).collect();
        let caption = format!(
            "{} pixels of {} nm, Tukey window {}.",
            sizes[..used].join(" x "),
            sides[..used].join(" x "),
            self.taper
        );
        let (title, name) = if flat {
            ("Fourier ring correlation", "frc")
        } else {
            ("Fourier shell correlation", "fsc")
        };
        let summary = Summary {
            title,
            name,
            caption,
            values: Vec::new(),
            corrected: None,
        };
        emit(job, &curve, &summary)
    }
}

/// A simulated table of the example.
fn source(seed: u64) -> Step {
    let mut parameters = Map::new();
    parameters.insert("seed".into(), seed.to_string().into());
    Step {
        op: "puncta.synthetic.membrane/1".into(),
        parameters,
        ..Step::default()
    }
}

/// The values of an image input.
pub(crate) fn values_of(input: usize) -> Read {
    Read {
        input,
        part: 0,
        columns: vec!["value".into()],
    }
}

/// Size and voxel of a plane or a volume, in the order z, y, x.
pub(crate) fn shape(header: &Header) -> Result<([usize; 3], [f64; 3]), Failure> {
    let name = &header.name;
    let info = header.image.as_ref();
    let info = info.ok_or_else(|| Failure::bad_input(format!("{name} is no image")))?;
    let [times, channels, depth, height, width] = info.size;
    let refuse = |message: String, remedy: &str| Err(Failure::bad_input(message).remedy(remedy));
    if times != 1 || channels != 1 {
        let message = format!("{name} has {times} frames and {channels} channels");
        return refuse(message, "take one of them");
    }
    let sizes = [depth, height, width];
    let mut voxel = info.voxel;
    for (axis, letter) in ["z", "y", "x"].iter().enumerate() {
        if sizes[axis] == 1 && axis == 0 {
            voxel[0] = 0.0;
        } else if !(voxel[axis] > 0.0 && voxel[axis].is_finite()) {
            let message = format!("{name} has no pixel size in {letter}");
            return refuse(message, "give the image its pixel size first");
        } else if sizes[axis] < FEWEST {
            let count = sizes[axis];
            let message =
                format!("{name} has {count} pixels in {letter}, and a curve needs {FEWEST}");
            return refuse(message, "use a larger image");
        }
    }
    Ok((sizes.map(|n| n as usize), voxel))
}

fn check(header: &Header, first: &Header) -> Result<(), Failure> {
    let (size, voxel) = shape(header)?;
    let (other, sides) = shape(first)?;
    if size != other {
        let text = |[z, y, x]: [usize; 3]| format!("{x} x {y} x {z}");
        let message = format!("the images have {} and {} pixels", text(other), text(size));
        return Err(Failure::bad_input(message).remedy("give two images of the same field"));
    }
    let far = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-6 * a.abs();
    if voxel.iter().zip(&sides).any(far) {
        let message =
            format!("the pixels of the images differ: {sides:?} and {voxel:?} nm (z, y, x)");
        return Err(Failure::bad_input(message).remedy("render both with one pixel size"));
    }
    Ok(())
}

/// The spectrum of an image: values less their weighted mean, under the window.
pub(crate) fn spectrum_of(
    run: &dyn Run,
    plan: &RealFft<f32>,
    window: &Window,
    image: &Input<'_>,
) -> Result<Vec<Complex<f32>>, Failure> {
    let values = image.f64("value")?;
    let [_, height, width] = window.axes.each_ref().map(Vec::len);
    if let Some(place) = values.iter().position(|value| !value.is_finite()) {
        let (x, y) = (place % width, place / width % height);
        let name = &image.header().name;
        let message = format!("pixel ({x}, {y}) of {name} is {}", values[place]);
        return Err(Failure::bad_input(message).remedy("replace what is no number first"));
    }
    let lines: Vec<&[f64]> = values.chunks(width).collect();
    let sums = puncta_sdk::run::map(run, lines.len(), &|line| {
        let across = lines[line].iter().zip(&window.axes[2]);
        window.line(line) * across.map(|(v, w)| v * w).sum::<f64>()
    });
    let mean = sums.into_iter().sum::<f64>() / window.power(1);
    let padded = plan.size()[1];
    let spectrum: Result<_, Cancelled> = plan.forward_rows(run, &|row, to| {
        let (z, y) = (row / padded, row % padded);
        let Some(from) = lines.get(z * height + y).filter(|_| y < height) else {
            return false;
        };
        let weight = window.line(z * height + y);
        for ((to, from), w) in to.iter_mut().zip(*from).zip(&window.axes[2]) {
            *to = ((from - mean) * weight * w) as f32;
        }
        true
    });
    Ok(spectrum?)
}

puncta_sdk::register!(Images);

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, value};
    use super::*;
    use puncta_testkit::{Call, Object};

    fn noise(width: usize, height: usize, seed: u64) -> Vec<f32> {
        let mut random = Random(seed);
        let all = 0..width * height;
        all.map(|_| 500.0 + random.normal() as f32).collect()
    }

    fn image(width: usize, height: usize, values: &[f32]) -> Object {
        let info = ImageInfo::plane(width as u64, height as u64, 10.0, 0.0, 0.0);
        Object::image("image", info, values)
    }

    fn call(a: Object, b: Object) -> Call {
        Call::of::<Images>().input("first", a).input("second", b)
    }

    #[test]
    fn noise_is_not_reached_and_equal_images_correlate_completely() {
        let (a, b) = (noise(200, 150, 1), noise(200, 150, 2));
        let done = call(image(200, 150, &a), image(200, 150, &b))
            .run()
            .unwrap();
        for name in [
            "resolution",
            "resolution_half_bit",
            "resolution_three_sigma",
        ] {
            assert!(value(&done, name).is_nan());
        }
        assert!(done.text().contains("no more than noise"));
        let done = call(image(200, 150, &a), image(200, 150, &a))
            .run()
            .unwrap();
        let curve = done.output("curve").unwrap().f64("frc").unwrap();
        assert!(curve[1..].iter().all(|c| *c == 1.0));
        assert!(
            done.text().contains("finest period of 20"),
            "{}",
            done.text()
        );
    }

    /// A common random image s under a Gaussian blur, with independent noise of n times its
    /// deviation: correlation 1 / (1 + n^2 exp(4 pi^2 sigma^2 q^2)), 1/7 at 6 = n^2 exp(..).
    #[test]
    fn a_known_blur_in_noise() {
        let n = 256;
        let (sigma, level) = (2.5, 0.02_f64);
        let plan = RealFft::<f64>::plane(n, n);
        let run = puncta_testkit::Threads(2);
        let common: Vec<f64> = noise(n, n, 3)
            .iter()
            .map(|v| f64::from(*v) - 500.0)
            .collect();
        let mut spectrum = plan.forward(&run, &common).unwrap();
        for (i, value) in spectrum.iter_mut().enumerate() {
            let (kx, ky) = ((i / n) as f64, ((i % n).min(n - i % n)) as f64);
            let q2 = (kx * kx + ky * ky) / (n * n) as f64;
            *value *= (-2.0 * std::f64::consts::PI.powi(2) * sigma * sigma * q2).exp();
        }
        let blurred = plan.inverse(&run, spectrum).unwrap();
        let with = |seed: u64| -> Vec<f32> {
            let noise = noise(n, n, seed);
            let pairs = blurred.iter().zip(&noise);
            pairs
                .map(|(s, e)| (s + level * (f64::from(*e) - 500.0)) as f32)
                .collect()
        };
        let done = call(image(n, n, &with(4)), image(n, n, &with(5)))
            .run()
            .unwrap();
        let truth = std::f64::consts::TAU * sigma * 10.0 / (6.0 / level.powi(2)).ln().sqrt();
        let found = value(&done, "resolution");
        assert!((found / truth - 1.0).abs() < 0.02, "{found} {truth}");
        // A quarter turn of both, and twice the contrast, change nothing.
        let turn = |v: &[f32]| -> Vec<f32> {
            (0..n * n)
                .map(|i| 2.0 * v[(i % n) * n + (n - 1 - i / n)])
                .collect()
        };
        let turned = call(image(n, n, &turn(&with(4))), image(n, n, &turn(&with(5))));
        let again = value(&turned.run().unwrap(), "resolution");
        assert!((found / again - 1.0).abs() < 1e-4, "{found} {again}");
    }

    #[test]
    fn images_that_do_not_fit_are_refused() {
        let plane = |w: usize, h: usize| image(w, h, &noise(w, h, 1));
        let refused = |a: Object, b: Object, words: &str| {
            let error = call(a, b).run().unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        refused(plane(32, 32), plane(32, 33), "same field");
        refused(plane(32, 8), plane(32, 8), "8 pixels in y");
        let mut coarse = plane(32, 32);
        coarse.header.image.as_mut().unwrap().voxel = [0.0, 20.0, 20.0];
        refused(plane(32, 32), coarse, "one pixel size");
        let mut bare = plane(32, 32);
        bare.header.image.as_mut().unwrap().voxel = [0.0; 3];
        refused(bare, plane(32, 32), "no pixel size in y");
        let mut broken = noise(32, 32, 1);
        broken[33] = f32::NAN;
        let broken = image(32, 32, &broken);
        refused(broken, plane(32, 32), "pixel (1, 1) of image is NaN");
        let zero = call(image(32, 32, &[0.0; 1024]), plane(32, 32))
            .run()
            .unwrap();
        assert!(value(&zero, "resolution").is_nan());
        let stopped = call(plane(32, 32), plane(32, 32)).cancel_after(2);
        assert!(stopped.run().unwrap_err().is_cancelled());
    }
}
