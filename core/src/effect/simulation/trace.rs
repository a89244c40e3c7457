//! The past of a run, for what looks back.

/// Outputs and their slopes at the sub-steps of a run.
#[derive(Debug, Default)]
pub(super) struct Trace {
    time: Vec<f64>,
    outputs: Vec<f64>,
    slopes: Vec<f64>,
}

impl Trace {
    /// Outputs at an earlier time, by the parabola through a sub-step's ends with the slope at its start.
    pub(super) fn at(&self, time: f64, out: &mut [f64]) {
        let n = out.len();
        // Sensors look back a few steps of many.
        let k = self.time.iter().rposition(|t| *t <= time).unwrap_or(0);
        let row = |values: &[f64], k: usize, i: usize| values[k * n + i];
        for (i, out) in out.iter_mut().enumerate() {
            let x = row(&self.outputs, k, i);
            let since = (time - self.time[k]).max(0.0);
            *out = match self.time.get(k + 1) {
                Some(end) if *end > self.time[k] => {
                    let (h, slope) = (end - self.time[k], row(&self.slopes, k, i));
                    x + slope * since + (row(&self.outputs, k + 1, i) - x - slope * h) * (since / h) * (since / h)
                }
                _ => x,
            };
        }
    }

    /// Appends a sub-step's start, or replaces the last one at the same time.
    pub(super) fn push(&mut self, time: f64, outputs: &[f64], slopes: Option<&[f64]>) {
        if self.time.last().is_some_and(|last| *last >= time) {
            self.truncate(self.time.len() - 1, outputs.len());
        }
        self.time.push(time);
        self.outputs.extend_from_slice(outputs);
        match slopes {
            Some(slopes) => self.slopes.extend_from_slice(slopes),
            None => self.slopes.extend(outputs.iter().map(|_| 0.0)),
        }
    }

    /// Sub-steps so far.
    pub(super) fn len(&self) -> usize {
        self.time.len()
    }

    /// Forgets all but the first sub-steps.
    pub(super) fn truncate(&mut self, length: usize, outputs: usize) {
        self.time.truncate(length);
        self.outputs.truncate(length * outputs);
        self.slopes.truncate(length * outputs);
    }
}

/// What sensors add to the outputs, sample by sample.
#[derive(Debug, Default)]
pub(super) struct Added {
    time: Vec<f64>,
    values: Vec<f64>,
}

impl Added {
    /// Forgets all samples.
    pub(super) fn clear(&mut self) {
        self.time.clear();
        self.values.clear();
    }

    /// Begins a sample: `outputs` are those before any sensor.
    pub(super) fn begin(&mut self, time: f64, outputs: &[f64]) {
        self.time.push(time);
        self.values.extend(outputs.iter().map(|x| -x));
    }

    /// Ends it: `seen` is what the sensors have made of them.
    pub(super) fn end(&mut self, seen: &[f64]) {
        let first = self.values.len() - seen.len();
        self.values[first..].iter_mut().zip(seen).for_each(|(added, seen)| *added += seen);
    }

    /// Adds to outputs of an earlier time what was added to them then: between samples on the straight line.
    pub(super) fn add(&self, time: f64, outputs: &mut [f64]) {
        let n = outputs.len();
        let k = self.time.iter().rposition(|t| *t <= time).unwrap_or(0);
        let part = match self.time.get(k + 1) {
            Some(end) => ((time - self.time[k]) / (end - self.time[k])).clamp(0.0, 1.0),
            None => 0.0,
        };
        for (i, out) in outputs.iter_mut().enumerate() {
            let from = self.values[k * n + i];
            let to = self.values.get((k + 1) * n + i).map_or(from, |to| *to);
            *out += from + part * (to - from);
        }
    }
}
