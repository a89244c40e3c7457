//! A data set: the rows of recordings that a model reads, per segment, with nothing else.

use crate::channel::Channel;
use crate::model::RegressorModel;
use crate::recording::{Recording, RecordingError, segment_label};

/// Inputs and outputs of a model over one unbroken stretch of time.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// The recording's label of the segment.
    pub label: String,
    /// Times \[s\], strictly increasing.
    pub time: Vec<f64>,
    /// One vector an input channel: the value held from each time to the next.
    pub inputs: Vec<Vec<f64>>,
    /// One vector an output channel: the value measured at each time.
    pub outputs: Vec<Vec<f64>>,
}

impl Stretch {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// True without samples.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Whether this goes on with the segment that another one is the part before of: nothing but time passed between them.
    pub fn continues(&self, before: &Self) -> bool {
        let (last, first) = (before.time.last(), self.time.first());
        segment_label(&self.label) == segment_label(&before.label) && last.zip(first).is_some_and(|(last, first)| last < first)
    }

    /// The integral of a rate that has one value a sample, by trapezoids: at each sample, from zero at the first.
    pub fn integral(&self, rate: &[f64]) -> Vec<f64> {
        let steps = self.time.windows(2).zip(rate.windows(2));
        let sums = steps.scan(0.0, |sum, (t, r)| {
            *sum += 0.5 * (r[0] + r[1]) * (t[1] - t[0]);
            Some(*sum)
        });
        self.time.first().map(|_| 0.0).into_iter().chain(sums).collect()
    }

    /// The samples of a range.
    #[must_use]
    pub fn slice(&self, rows: std::ops::Range<usize>) -> Self {
        let cut = |columns: &[Vec<f64>]| columns.iter().map(|c| c[rows.clone()].to_vec()).collect();
        Self { label: self.label.clone(), time: self.time[rows.clone()].to_vec(), inputs: cut(&self.inputs), outputs: cut(&self.outputs) }
    }
}

/// What a solver fits and a validation compares with: stretches of one model's channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Input channels.
    pub inputs: Vec<Channel>,
    /// Output channels.
    pub outputs: Vec<Channel>,
    /// Stretches of at least two samples.
    pub stretches: Vec<Stretch>,
}

impl Dataset {
    /// Picks a model's channels out of a recording. Segments of a single row are dropped: nothing can be simulated on them.
    ///
    /// # Errors
    /// [`RecordingError::MissingColumn`], or [`RecordingError::NoMotion`] if no output ever changes.
    pub fn new(recording: &Recording, model: &dyn RegressorModel) -> Result<Self, RecordingError> {
        let data = Self::select(recording, model.inputs(), model.outputs())?;
        let names: Vec<&str> = model.outputs().iter().map(|c| c.name.as_ref()).collect();
        recording.require_motion(&names)?;
        Ok(data)
    }

    /// Picks channels out of a recording, moving or not.
    ///
    /// # Errors
    /// [`RecordingError::MissingColumn`].
    pub fn select(recording: &Recording, inputs: &[Channel], outputs: &[Channel]) -> Result<Self, RecordingError> {
        let columns = |channels: &[Channel]| channels.iter().map(|c| recording.column(&c.name)).collect::<Result<Vec<_>, _>>();
        let (u, y) = (columns(inputs)?, columns(outputs)?);
        let stretches = recording.segments().iter().filter(|s| s.rows.len() >= 2).map(|s| Stretch {
            label: s.label.clone(),
            time: recording.time()[s.rows.clone()].to_vec(),
            inputs: u.iter().map(|c| c[s.rows.clone()].to_vec()).collect(),
            outputs: y.iter().map(|c| c[s.rows.clone()].to_vec()).collect(),
        });
        Ok(Self { inputs: inputs.to_vec(), outputs: outputs.to_vec(), stretches: stretches.collect() })
    }

    /// Samples of all stretches.
    pub fn samples(&self) -> usize {
        self.stretches.iter().map(Stretch::len).sum()
    }

    /// Time covered by the stretches \[s\].
    pub fn duration(&self) -> f64 {
        self.stretches.iter().map(|s| s.time[s.len() - 1] - s.time[0]).sum()
    }

    /// Median step between samples \[s\].
    pub fn period(&self) -> f64 {
        let mut steps: Vec<f64> = self.stretches.iter().flat_map(|s| s.time.windows(2).map(|w| w[1] - w[0])).collect();
        crate::recording::median(&mut steps)
    }

    /// Stretches of another data set of the same channels, appended.
    pub fn extend(&mut self, other: Self) {
        self.stretches.extend(other.stretches);
    }

    /// Every stretch cut at its end in the same proportion, so that about `most` samples are left; unchanged if it has no more.
    #[must_use]
    pub fn shortened(&self, most: usize) -> Self {
        let share = (most as f64 / self.samples().max(1) as f64).min(1.0);
        let cut = |s: &Stretch| s.slice(0..((share * s.len() as f64) as usize).clamp(2, s.len()));
        Self { stretches: self.stretches.iter().map(cut).collect(), ..self.clone() }
    }

    /// Splits off a share of the samples that no estimate is to see: (kept, held out).
    ///
    /// With eight stretches or more, whole stretches spread evenly over the recording are held out, so that both parts
    /// see all of it; with fewer, the end of each stretch is, so that no kind of run is missing from either part.
    #[must_use]
    pub fn hold_out(&self, share: f64) -> (Self, Self) {
        let empty = Self { stretches: Vec::new(), ..self.clone() };
        let (mut kept, mut held) = (empty.clone(), empty);
        let whole = self.stretches.len() >= 8;
        // Samples owed to the held-out part: a stretch goes there once it pays off more than half of itself.
        let mut owed = 0.0;
        for stretch in &self.stretches {
            let n = stretch.len();
            owed += share * n as f64;
            if whole && owed >= n as f64 * 0.5 && share > 0.0 {
                owed -= n as f64;
                held.stretches.push(stretch.clone());
            } else if whole {
                kept.stretches.push(stretch.clone());
            } else {
                let cut = n - (share * n as f64).round() as usize;
                if cut >= 2 {
                    kept.stretches.push(stretch.slice(0..cut));
                }
                if n - cut >= 2 {
                    held.stretches.push(stretch.slice(cut..n));
                }
            }
        }
        (kept, held)
    }
}
