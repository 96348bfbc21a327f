//! The operation `puncta.frc.decorrelation/1`.

use super::images::{shape, spectrum_of, values_of};
use crate::decorrelation::{Amplitudes, Peak};
use crate::grid::VOXEL_BYTES;
use crate::window::Window;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Cancelled;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Figure, Series};
use puncta_shared_fourier::{RealFft, Rings, good_size};

/// Resolution of one image by decorrelation analysis.
#[derive(Params)]
pub struct Decorrelation {
    /// Pixels over which the image falls to its mean at each edge.
    #[param(default = 20, min = 0, max = 1000)]
    edge: u64,
}

impl Operation for Decorrelation {
    const ID: &'static str = "puncta.frc.decorrelation/1";

    fn info() -> Info {
        let render = Step {
            op: "puncta.render.gaussian/1".into(),
            parameters: json!({"pixel_size": 2})
                .as_object()
                .cloned()
                .unwrap_or_default(),
            inputs: [(
                "table".to_owned(),
                Step {
                    op: "puncta.synthetic.membrane/1".into(),
                    ..Step::default()
                },
            )]
            .into(),
            ..Step::default()
        };
        Info::operation("Decorrelation analysis")
            .description(
                "Estimates the resolution of one image from where its spectrum turns into noise. \
                 The spectrum is correlated with its own phase inside a growing disc, for the \
                 image and for high-passed copies of it; the outermost maximum is the cut-off \
                 frequency. Renderings of localisations must be blurred by their precision, since \
                 the noise of a histogram has no cut-off.",
            )
            .cite("Descloux, Grussmayer and Radenovic, Nature Methods 16, 918 (2019)")
            .input(Ports::image("image").description("A plane"))
            .output(Ports::table("curve").description(
                "A row for each ring: frequency, decorrelation of the image, and of the copy \
                 whose maximum lies farthest out",
            ))
            .output(Ports::table("filters").description(
                "A row for the image and for each copy: width of the blur that was taken away, \
                 frequency and height of the maximum, nan where there is none",
            ))
            .output(Ports::figure("figure").description("Both curves"))
            .output(Ports::report("report").description("Resolution; nan where not reached"))
            .example(json!({}))
            .example_step("image", render)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = Plan {
            interruptible: true,
            ..Plan::default()
        };
        if let Some(image) = request.inputs.first() {
            let ([depth, height, width], _) = shape(&image.header)?;
            let edge = usize::try_from(self.edge).unwrap_or(usize::MAX);
            if depth > 1 {
                let message = format!("{} is a volume of {depth} planes", image.header.name);
                return Err(Failure::bad_input(message).remedy("take one plane"));
            }
            if edge > width.min(height) / 2 {
                let message = format!("edges of {edge} pixels leave nothing of the image");
                return Err(Failure::bad_parameter("edge", message).remedy("lower edge"));
            }
            plan.memory = image.header.rows() * VOXEL_BYTES;
            plan.read.push(values_of(0));
        }
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let image = job.input("image")?;
        let (size, voxel) = shape(image.header())?;
        let edge = 2.0 * self.edge as f64;
        let mut window = Window::new(size, 0.0);
        for axis in &mut window.axes {
            *axis = crate::window::tukey(axis.len(), edge / axis.len() as f64);
        }
        if size[0] == 1 {
            window.axes[0] = vec![1.0];
        }
        let padded = size.map(|n| if n > 1 { good_size(n) } else { 1 });
        let rings = Rings::new(padded, voxel);
        let plan = RealFft::<f32>::new(padded);
        let spectrum = spectrum_of(job, &plan, &window, &image)?;
        job.progress(0.6, "correlating with the phase")?;
        let sums: Result<_, Cancelled> = rings.sum(job, &|i| {
            let power = f64::from(spectrum[i].re).powi(2) + f64::from(spectrum[i].im).powi(2);
            [power.sqrt(), power]
        });
        let (sums, count) = sums?;
        let amplitudes = Amplitudes {
            first: sums.iter().map(|s| s[0]).collect(),
            second: sums.iter().map(|s| s[1]).collect(),
            count,
            step: rings.step() * voxel[2],
        };
        let (peaks, best) = amplitudes.peaks();
        give(job, &amplitudes, rings.step(), &peaks, best)
    }
}

/// Tables, figure and report.
fn give(
    job: &Job,
    amplitudes: &Amplitudes,
    step: f64,
    peaks: &[Peak],
    best: Option<usize>,
) -> Result<(), Failure> {
    let found = best.and_then(|best| peaks.get(best));
    let curves = [
        amplitudes.curve(f64::INFINITY),
        amplitudes.curve(found.map_or(f64::INFINITY, |peak| peak.sigma)),
    ];
    let column = |name: &str, unit: &str, text: &str| {
        ColumnInfo::new(name, Element::F64, unit).description(text)
    };
    let columns = vec![
        column("frequency", "1/nm", "Spatial frequency"),
        column("image", "1", "Decorrelation of the image"),
        column(
            "filtered",
            "1",
            "Decorrelation of the copy that reaches farthest",
        ),
    ];
    let rows = curves[0].len() as u64;
    let mut out = job.begin("curve", Header::table("curve", rows, columns))?;
    let [frequency, image, filtered] = out.f64s_mut(["frequency", "image", "filtered"])?;
    for (i, to) in frequency.iter_mut().enumerate() {
        *to = i as f64 * step;
    }
    image.copy_from_slice(&curves[0]);
    filtered.copy_from_slice(&curves[1]);
    out.finish()?;
    let columns = vec![
        column(
            "sigma",
            "1",
            "Width of the blur taken away, pixels; inf for the image itself",
        ),
        column("frequency", "1/nm", "Frequency of the maximum"),
        column("height", "1", "Height of the maximum"),
    ];
    let mut out = job.begin(
        "filters",
        Header::table("filters", peaks.len() as u64, columns),
    )?;
    let [sigma, frequency, height] = out.f64s_mut(["sigma", "frequency", "height"])?;
    for (i, peak) in peaks.iter().enumerate() {
        (sigma[i], frequency[i], height[i]) = (peak.sigma, peak.ring * step, peak.height);
    }
    out.finish()?;
    documents(job, step, peaks, found)
}

fn documents(job: &Job, step: f64, peaks: &[Peak], found: Option<&Peak>) -> Result<(), Failure> {
    let resolution = found.map_or(f64::NAN, |peak| 1.0 / (peak.ring * step));
    let sentence = if resolution.is_finite() {
        format!("Resolution {resolution:.4} nm")
    } else {
        "Not reached: the spectrum has no part that stands out from noise".to_owned()
    };
    let mut figure = Figure::new(
        "figure",
        "Decorrelation analysis",
        ["Spatial frequency", "1/nm"],
        ["Decorrelation", "1"],
    )
    .with(Series::columns(
        "image",
        "line",
        "curve",
        "frequency",
        "image",
    ))
    .with(Series::columns(
        "high-passed",
        "line",
        "curve",
        "frequency",
        "filtered",
    ));
    if let Some(peak) = found {
        let q = peak.ring * step;
        let label = format!("{resolution:.4} nm");
        figure = figure.with(Series::numbers(
            &label,
            "line",
            &[q, q],
            &[0.0, peak.height],
        ));
    }
    figure.caption = format!("{} curves. {sentence}.", peaks.len());
    job.figure(&figure)?;
    let mut report = Report::new("report");
    report.number("resolution", resolution, "nm").description = Some(sentence.clone());
    let mut add = |name: &str, value: f64, unit: &str, text: &str| {
        report.number(name, value, unit).description = Some(text.into());
    };
    let image = peaks.first().copied().unwrap_or_default();
    add(
        "height",
        image.height,
        "1",
        "Maximum of the image's own curve: grows with its contrast",
    );
    let unfiltered = 1.0 / (image.ring * step);
    add("unfiltered", unfiltered, "nm", "Period of that maximum");
    if resolution.is_nan() {
        job.warn(&sentence);
    }
    job.report(&report)
}

puncta_sdk::register!(Decorrelation);

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, value};
    use super::*;
    use puncta_testkit::{Call, Object, Threads};

    const N: usize = 300;

    fn image(values: &[f32]) -> Object {
        let info = ImageInfo::plane(N as u64, N as u64, 10.0, 0.0, 0.0);
        Object::image("image", info, values)
    }

    fn noise(seed: u64) -> Vec<f64> {
        let mut random = Random(seed);
        (0..N * N).map(|_| random.normal()).collect()
    }

    /// Noise below a sharp cut-off of `share` of the Nyquist frequency, and weak white noise.
    fn band(share: f64, seed: u64) -> Vec<f32> {
        let plan = RealFft::<f64>::plane(N, N);
        let mut spectrum = plan.forward(&Threads(2), &noise(seed)).unwrap();
        for (i, value) in spectrum.iter_mut().enumerate() {
            let (kx, ky) = ((i / N) as f64, (i % N).min(N - i % N) as f64);
            if kx.hypot(ky) > share * (N / 2) as f64 {
                *value *= 0.0;
            }
        }
        let band = plan.inverse(&Threads(2), spectrum).unwrap();
        let pairs = band.iter().zip(noise(seed + 1));
        pairs.map(|(s, e)| (s + 0.03 * e) as f32).collect()
    }

    #[test]
    fn a_sharp_cut_off_is_found() {
        for share in [0.25, 0.5, 0.8] {
            let call = Call::of::<Decorrelation>().input("image", image(&band(share, 7)));
            let done = call.run().unwrap();
            let truth = 20.0 / share;
            let found = value(&done, "resolution");
            assert!((found / truth - 1.0).abs() < 0.04, "{found} {truth}");
            assert_eq!(
                done.output("filters").unwrap().f64("sigma").unwrap().len(),
                21
            );
        }
    }

    #[test]
    fn noise_is_not_reached_and_threads_do_not_change_a_bit() {
        let white: Vec<f32> = noise(3).iter().map(|v| *v as f32).collect();
        let call = || Call::of::<Decorrelation>().input("image", image(&white));
        let done = call().run().unwrap();
        assert!(value(&done, "resolution").is_nan());
        assert!(done.text().contains("Not reached"));
        let same = [1, 2, 3].map(|n| call().threads(n).run().unwrap().text());
        assert!(same[0] == same[1] && same[1] == same[2]);
        assert!(call().cancel_after(2).run().unwrap_err().is_cancelled());
        let zero = Call::of::<Decorrelation>().input("image", image(&vec![4.0; N * N]));
        assert!(value(&zero.run().unwrap(), "resolution").is_nan());
    }

    #[test]
    fn what_has_no_plane_is_refused() {
        let white: Vec<f32> = noise(3).iter().map(|v| *v as f32).collect();
        let wide = Call::of::<Decorrelation>()
            .input("image", image(&white))
            .set("edge", 200);
        assert_eq!(
            wide.prepare().unwrap_err().parameter.as_deref(),
            Some("edge")
        );
        let mut info = ImageInfo::plane(20, 20, 10.0, 0.0, 0.0);
        (info.size[2], info.voxel[0]) = (20, 10.0);
        let volume = Object::image("volume", info, &[0.0; 8000]);
        let error = Call::of::<Decorrelation>()
            .input("image", volume)
            .prepare()
            .unwrap_err();
        assert!(error.to_string().contains("take one plane"), "{error}");
    }
}
