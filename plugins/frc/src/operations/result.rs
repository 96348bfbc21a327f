//! Curve, figure and report of a call.

use crate::crossing::Crossing;
use crate::curve::{Curve, Resolution, Threshold, mean_and_deviation};
use puncta_sdk::prelude::*;
use puncta_sdk::{Figure, Series};

/// What a call did, in words and numbers.
pub(crate) struct Summary {
    pub(crate) title: &'static str,
    /// Name of the columns: `frc` or `fsc`.
    pub(crate) name: &'static str,
    pub(crate) caption: String,
    /// Further values of the report: name, value, unit, description.
    pub(crate) values: Vec<(&'static str, f64, &'static str, String)>,
    pub(crate) corrected: Option<Corrected>,
}

/// The curve without the correlation by repeats of molecules.
pub(crate) struct Corrected {
    /// Repeats of a localisation, on average.
    pub(crate) q: f64,
    pub(crate) curve: Curve,
}

/// The outputs that all operations of this plugin share.
pub(crate) fn outputs(info: Info) -> Info {
    info.output(Ports::table("curve").description(
        "A row for each ring: frequency, correlation, its standard deviation between the splits, \
         the smoothed correlation with its band of 95 %, thresholds, numbers of frequencies, power",
    ))
    .output(Ports::figure("figure").description("The curve with its thresholds"))
    .output(Ports::report("report").description(
        "Resolution at the three thresholds; nan with a sentence where it is not reached",
    ))
}

/// Gives everything.
pub(crate) fn emit(job: &Job, curve: &Curve, summary: &Summary) -> Result<(), Failure> {
    table(job, curve, summary)?;
    let found = Threshold::ALL.map(|threshold| (threshold, curve.resolution(threshold)));
    figure(job, curve, summary, &found)?;
    report(job, curve, summary, &found)
}

fn table(job: &Job, curve: &Curve, summary: &Summary) -> Result<(), Failure> {
    let name = summary.name;
    let [low, high] = curve.band();
    let smooth = format!("{name}_smooth");
    let mut columns: Vec<(&str, &str, Vec<f64>, &str)> = vec![
        ("frequency", "1/nm", curve.frequency(), "Spatial frequency"),
        (
            name,
            "1",
            curve.mean.clone(),
            "Correlation, mean of the splits",
        ),
        (
            "sd",
            "1",
            curve.deviation.clone(),
            "Standard deviation between the splits",
        ),
        (
            &smooth,
            "1",
            curve.smooth.values.clone(),
            "Smoothed correlation",
        ),
        ("low", "1", low, "Lower end of its band of 95 %"),
        ("high", "1", high, "Upper end of its band of 95 %"),
        (
            "one_seventh",
            "1",
            curve.threshold(Threshold::OneSeventh),
            "Threshold 1/7",
        ),
        (
            "half_bit",
            "1",
            curve.threshold(Threshold::HalfBit),
            "Half-bit threshold",
        ),
        (
            "three_sigma",
            "1",
            curve.threshold(Threshold::ThreeSigma),
            "3-sigma threshold",
        ),
        (
            "count",
            "1",
            curve.frequencies.clone(),
            "Frequencies in the ring",
        ),
        (
            "power_1",
            "1",
            curve.power[0].clone(),
            "Mean power of the first half",
        ),
        (
            "power_2",
            "1",
            curve.power[1].clone(),
            "Mean power of the second half",
        ),
    ];
    if let Some(corrected) = &summary.corrected {
        let values = corrected.curve.smooth.values.clone();
        columns.push((
            "corrected",
            "1",
            values,
            "Smoothed, without repeats of molecules",
        ));
    }
    let infos = columns
        .iter()
        .map(|(name, unit, _, text)| ColumnInfo::new(*name, Element::F64, *unit).description(*text))
        .collect();
    let mut out = job.begin("curve", Header::table("curve", curve.rings() as u64, infos))?;
    for (name, _, values, _) in &columns {
        out.f64_mut(name)?.copy_from_slice(values);
    }
    out.finish()
}

fn figure(
    job: &Job,
    curve: &Curve,
    summary: &Summary,
    found: &[(Threshold, Resolution); 3],
) -> Result<(), Failure> {
    let name = summary.name;
    let smooth = format!("{name}_smooth");
    let of =
        |label: &str, style: &str, y: &str| Series::columns(label, style, "curve", "frequency", y);
    let mut figure = Figure::new(
        "figure",
        summary.title,
        ["Spatial frequency", "1/nm"],
        ["Correlation", "1"],
    )
    .with(of("95 %", "band", "low").up_to("high"))
    .with(of("correlation", "points", name))
    .with(of("smoothed", "line", &smooth))
    .with(of("1/7", "line", "one_seventh"))
    .with(of("half bit", "line", "half_bit"))
    .with(of("3 sigma", "line", "three_sigma"));
    if summary.corrected.is_some() {
        figure = figure.with(of("without repeats", "line", "corrected"));
    }
    let (_, at) = found[0];
    if at.value.is_finite() {
        let label = format!("{:.4} nm", at.value);
        let q = 1.0 / at.value;
        figure = figure.with(Series::numbers(&label, "line", &[q, q], &[0.0, 1.0]));
    }
    figure.caption = format!(
        "{} Smoothed over {} rings. {}.",
        summary.caption,
        curve.span,
        sentence(curve, at)
    );
    job.figure(&figure)
}

/// What was found, in words.
fn sentence(curve: &Curve, found: Resolution) -> String {
    match found.crossing {
        Crossing::At(_) => {
            let [fine, coarse] = found.interval;
            format!(
                "Resolution {:.4} nm, 95 % of the curve's error {fine:.4} to {coarse:.4} nm",
                found.value
            )
        }
        Crossing::Never => "Not reached: the halves correlate no more than noise does".into(),
        Crossing::Beyond => format!(
            "Not reached: the curve stays above the threshold up to the finest period of {:.4} nm; \
             use smaller pixels",
            curve.finest()
        ),
    }
}

fn report(
    job: &Job,
    curve: &Curve,
    summary: &Summary,
    found: &[(Threshold, Resolution); 3],
) -> Result<(), Failure> {
    let mut report = Report::new("report");
    for (threshold, found) in found {
        let (name, text) = match threshold {
            Threshold::OneSeventh => ("resolution".to_owned(), "threshold 1/7"),
            Threshold::HalfBit => (format!("resolution_{}", threshold.name()), "half bit"),
            Threshold::ThreeSigma => (format!("resolution_{}", threshold.name()), "3 sigma"),
        };
        let text = format!("{text}. {}", sentence(curve, *found));
        let value = report.number(&name, found.value, "nm");
        value.interval = Some(found.interval.map(puncta_sdk::documents::number::to_value));
        value.description = Some(text);
    }
    if let Some(Corrected { q, curve }) = &summary.corrected {
        let found = curve.resolution(Threshold::OneSeventh);
        let value = report.number("resolution_corrected", found.value, "nm");
        value.interval = Some(found.interval.map(puncta_sdk::documents::number::to_value));
        let text = format!("threshold 1/7, without repeats. {}", sentence(curve, found));
        value.description = Some(text);
        let text = "Q: how often a localisation's molecule is found again, on average";
        report.number("repeats", *q, "1").description = Some(text.into());
    }
    let mut add = |name: &str, value: f64, unit: &str, text: &str| {
        report.number(name, value, unit).description = Some(text.into());
    };
    let reached = curve.splits.iter().copied().filter(|r| r.is_finite());
    let (mean, deviation) = mean_and_deviation(reached.clone());
    let count = curve.splits.len();
    add("splits", count as f64, "1", "Splits into halves");
    let of = format!(
        "1/7, of the {} of {count} splits that reach it",
        reached.count()
    );
    add(
        "split_mean",
        mean,
        "nm",
        &format!("Mean resolution at {of}"),
    );
    add(
        "split_sd",
        deviation,
        "nm",
        &format!("Standard deviation of the resolution at {of}"),
    );
    add(
        "finest",
        curve.finest(),
        "nm",
        "Finest period that the pixels can show",
    );
    for (name, value, unit, text) in &summary.values {
        add(name, *value, unit, text);
    }
    let (_, at) = found[0];
    if at.value.is_nan() {
        job.warn(&sentence(curve, at));
    }
    job.report(&report)
}
