//! The past of a run, for sensors that look back.

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
