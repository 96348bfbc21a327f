//! Bins of time, of about equal numbers of localisations.

use crate::cloud::Cloud;

/// Consecutive bins of a cloud's times. Every bin holds a localisation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bins {
    /// Bin of each distinct time.
    pub of_frame: Vec<u32>,
    /// Mean time of the localisations of each bin, increasing.
    pub centre: Vec<f64>,
    /// Number of localisations of each bin.
    pub count: Vec<f64>,
}

impl Bins {
    /// Bins of about `target` localisations each, at least one frame long. A bin never spans a gap
    /// that is longer than its own usual length, unless it would be nearly empty otherwise.
    pub fn by_count(cloud: &Cloud, target: f64) -> Self {
        let frames = cloud.times.len();
        if cloud.is_empty() {
            return Self::default();
        }
        let per_frame = cloud.len() as f64 / frames as f64;
        let span = (target / per_frame).ceil().max(1.0);
        Self::by_span(cloud, span * median_gap(&cloud.times), target / 4.0)
    }

    /// Bins that last `span` each, longer where they would hold fewer than `least` localisations.
    pub fn by_span(cloud: &Cloud, span: f64, least: f64) -> Self {
        let in_frame = cloud.per_frame();
        let mut bins = Self::default();
        let mut begin = f64::NEG_INFINITY;
        let mut last = f64::NEG_INFINITY;
        for (&t, &count) in cloud.times.iter().zip(&in_frame) {
            let held = bins.count.last().copied().unwrap_or(f64::INFINITY);
            let over = t - begin >= span && held >= least;
            if over || t - last > 10.0 * span || bins.count.is_empty() {
                bins.count.push(0.0);
                bins.centre.push(0.0);
                begin = t;
            }
            last = t;
            let bin = bins.count.len() - 1;
            bins.of_frame.push(bin as u32);
            bins.count[bin] += count;
            // Relative to the begin, so that large times lose nothing.
            bins.centre[bin] += count * (t - begin);
        }
        bins.finish(cloud)
    }

    /// So many bins with equal numbers of frames' localisations, as near as whole frames allow.
    pub fn equal(cloud: &Cloud, bins: usize) -> Self {
        let in_frame = cloud.per_frame();
        let target = cloud.len() as f64 / bins.max(1) as f64;
        let mut out = Self::default();
        let (mut total, mut begin) = (0.0, 0.0);
        for (&t, &count) in cloud.times.iter().zip(&in_frame) {
            if total >= target * out.count.len() as f64 {
                out.count.push(0.0);
                out.centre.push(0.0);
                begin = t;
            }
            total += count;
            let bin = out.count.len() - 1;
            out.of_frame.push(bin as u32);
            out.count[bin] += count;
            out.centre[bin] += count * (t - begin);
        }
        out.finish(cloud)
    }

    /// The same bins, cut where a step lies within one. A part that would hold less than a quarter of
    /// a usual bin goes to its neighbour on the same side of the step.
    pub fn cut(self, cloud: &Cloud, breaks: &[f64]) -> Self {
        if breaks.is_empty() || self.is_empty() {
            return self;
        }
        let in_frame = cloud.per_frame();
        let piece: Vec<usize> = cloud
            .times
            .iter()
            .map(|t| breaks.partition_point(|end| end <= t))
            .collect();
        // Parts: the bin and the piece they lie in, their end among the frames, localisations.
        let mut parts: Vec<(u32, usize, usize, f64)> = Vec::new();
        for (frame, (bin, piece)) in self.of_frame.iter().zip(&piece).enumerate() {
            match parts.last_mut() {
                Some(part) if part.0 == *bin && part.1 == *piece => {
                    (part.2, part.3) = (frame + 1, part.3 + in_frame[frame]);
                }
                _ => parts.push((*bin, *piece, frame + 1, in_frame[frame])),
            }
        }
        let least = cloud.len() as f64 / self.len() as f64 / 4.0;
        let mut whole: Vec<(u32, usize, usize, f64)> = Vec::new();
        for part in parts {
            match whole.last_mut() {
                Some(last) if last.1 == part.1 && last.3.min(part.3) < least => {
                    (last.2, last.3) = (part.2, last.3 + part.3);
                }
                _ => whole.push(part),
            }
        }
        let mut out = Self::default();
        let mut frame = 0;
        for (bin, (_, _, end, count)) in whole.into_iter().enumerate() {
            let begin = cloud.times[frame];
            out.count.push(count);
            out.centre.push(0.0);
            let frames = cloud.times.iter().zip(&in_frame);
            for (time, count) in frames.skip(frame).take(end - frame) {
                out.of_frame.push(bin as u32);
                out.centre[bin] += count * (time - begin);
            }
            frame = end;
        }
        out.finish(cloud)
    }

    fn finish(mut self, cloud: &Cloud) -> Self {
        let mut begin = vec![f64::NAN; self.count.len()];
        for (bin, t) in self.of_frame.iter().zip(&cloud.times) {
            let begin = &mut begin[*bin as usize];
            if begin.is_nan() {
                *begin = *t;
            }
        }
        for ((centre, count), begin) in self.centre.iter_mut().zip(&self.count).zip(begin) {
            *centre = begin + *centre / count.max(1.0);
        }
        self
    }

    /// Number of bins.
    pub fn len(&self) -> usize {
        self.count.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count.is_empty()
    }

    /// The bin of each localisation.
    pub fn of(&self, cloud: &Cloud) -> Vec<u32> {
        let bin = |frame: &u32| self.of_frame[*frame as usize];
        cloud.frame.iter().map(bin).collect()
    }
}

impl Cloud {
    /// Number of localisations at each distinct time.
    pub fn per_frame(&self) -> Vec<f64> {
        let mut counts = vec![0.0; self.times.len()];
        for frame in &self.frame {
            counts[*frame as usize] += 1.0;
        }
        counts
    }
}

/// The middle of the gaps between consecutive times; 1 with fewer than two.
fn median_gap(times: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = gaps.len() / 2;
    if gaps.is_empty() {
        return 1.0;
    }
    *gaps.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(times: &[f64], each: usize) -> Cloud {
        Cloud {
            times: times.to_vec(),
            frame: (0..times.len() * each).map(|i| (i / each) as u32).collect(),
            ..Cloud::default()
        }
    }

    #[test]
    fn bins_hold_about_the_number_asked_for() {
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let bins = Bins::by_count(&cloud(&times, 5), 50.0);
        assert_eq!(bins.count, [50.0; 10]);
        assert_eq!(bins.centre[1], 14.5);
        let equal = Bins::equal(&cloud(&times, 5), 4);
        assert_eq!(equal.count, [125.0; 4]);
        assert_eq!(Bins::equal(&cloud(&times[..3], 5), 10).len(), 3);
    }

    #[test]
    fn a_step_ends_a_bin() {
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let cloud = cloud(&times, 5);
        let bins = || Bins::by_count(&cloud, 50.0);
        let cut = bins().cut(&cloud, &[34.5]);
        assert_eq!(cut.len(), 11);
        assert_eq!(cut.count[3..5], [25.0, 25.0]);
        assert_eq!(cut.centre[3..5], [32.0, 37.0]);
        // Two frames before the step are too few for a bin of their own.
        let cut = bins().cut(&cloud, &[32.0]);
        assert_eq!((cut.len(), cut.count[2], cut.count[3]), (10, 60.0, 40.0));
        assert_eq!(cut.centre[2], 25.5);
        assert_eq!(bins().cut(&cloud, &[30.0]), bins());
        assert_eq!(bins().cut(&cloud, &[-5.0, 1e9]), bins());
    }

    #[test]
    fn a_gap_of_a_million_frames_ends_a_bin_and_costs_nothing() {
        let times: Vec<f64> = (0..15).chain(1_000_000..1_000_015).map(f64::from).collect();
        let bins = Bins::by_count(&cloud(&times, 4), 40.0);
        assert_eq!(bins.count, [40.0, 20.0, 40.0, 20.0]);
        assert_eq!(bins.centre, [4.5, 12.0, 1_000_004.5, 1_000_012.0]);
        // A table in which every time is far from the next is binned by the usual distance.
        let far: Vec<f64> = (0..100).map(|i| f64::from(i) * 1e6).collect();
        assert_eq!(Bins::by_count(&cloud(&far, 1), 25.0).len(), 4);
        assert!(Bins::by_count(&Cloud::default(), 10.0).is_empty());
    }
}
