//! What goes round, and what is left somewhere: where it stood when a recording began is a matter of that recording, as its first sample is.

use nalgebra::{DMatrix, DVector};
use wheelwright_core::effect::{Effect, Scene};

use crate::holdout::{Explanation, Ground, Proof};
use crate::residuals::Series;

/// Places within its bounds where what was left somewhere is looked for, and halvings of the way between them about the best.
const PLACES: usize = 9;
const HALVINGS: i32 = 5;

/// A part of an effect that goes round, or the whole of one that goes by the heading.
pub(crate) struct Part {
    /// Which of an explanation's effects, and where its values begin.
    effect: usize,
    at: usize,
    /// Which of its parts; none where it is the heading.
    part: Option<usize>,
}

impl Part {
    /// The effect's values with this part elsewhere by an angle.
    fn elsewhere(&self, effect: &dyn Effect, values: &[f64], angle: f64) -> Option<Vec<f64>> {
        match self.part {
            Some(part) => effect.turned(values, part, angle),
            None => effect.heading_elsewhere(values, angle),
        }
    }
}

impl Explanation<'_> {
    /// What goes round, and what goes by a heading that nobody measured.
    pub(crate) fn parts(&self, scene: &Scene) -> Vec<Part> {
        let (mut parts, mut at) = (Vec::new(), 0);
        let headed = scene.tracks.iter().any(|track| track.headed);
        for (effect, own) in self.effects.iter().enumerate() {
            let count = own.parameters(scene).len();
            let values = &self.values[at..at + count];
            let round = (0..).map(|part| Part { effect, at, part: Some(part) });
            parts.extend(round.take_while(|part| part.elsewhere(*own, values, 0.0).is_some()));
            let heading = Part { effect, at, part: None };
            parts.extend(Some(heading).filter(|part| !headed && part.elsewhere(*own, values, 0.0).is_some()));
            at += count;
        }
        parts
    }

    /// The same with a part that stood further when the recording began.
    fn turned(&self, scene: &Scene, part: &Part, angle: f64) -> Option<Self> {
        let effect = self.effects[part.effect];
        let range = part.at..part.at + effect.parameters(scene).len();
        let turned = part.elsewhere(effect, &self.values[range.clone()], angle)?;
        let mut values = self.values.clone();
        values.splice(range, turned);
        Some(Self { values, ..self.clone() })
    }
}

impl Ground<'_> {
    /// An explanation with what was left somewhere where these data show it best, and its proof.
    pub(crate) fn left_at<'a>(&self, mut explanation: Explanation<'a>, mut proof: Proof) -> (Explanation<'a>, Proof) {
        let parameters: Vec<_> = explanation.effects.iter().flat_map(|effect| effect.parameters(self.scene)).collect();
        for (at, parameter) in parameters.iter().enumerate().filter(|(_, p)| p.initial) {
            let (from, to) = parameter.bounds;
            let apart = (to - from) / (PLACES - 1) as f64;
            let mut try_at = |place: f64| {
                let mut other = explanation.clone();
                other.values[at] = place.clamp(from, to);
                let there = self.run(&other);
                if self.size(&there) < self.size(&proof) {
                    (explanation, proof) = (other, there);
                }
                explanation.values[at]
            };
            let mut best = (0..PLACES).map(|place| try_at(from + apart * place as f64)).last().unwrap_or(from);
            for halving in 1..=HALVINGS {
                let step = apart * 0.5_f64.powi(halving);
                best = [best - step, best + step].map(&mut try_at)[1];
            }
        }
        (explanation, proof)
    }

    /// Mean squared errors in units of the outputs' own size.
    fn size(&self, proof: &Proof) -> f64 {
        proof.error.iter().zip(&self.scene.scales.outputs).map(|(error, unit)| error / (unit * unit)).sum()
    }

    /// An explanation with what goes round as these data show it: the ripple of every part and the same a quarter of a turn on are fitted to
    /// what is left without them, and only their angle is kept. `None` where they cannot tell it.
    pub(crate) fn begun<'a>(&self, explanation: &Explanation<'a>, parts: &[Part], given: &Proof) -> Option<Explanation<'a>> {
        let flat = |series: &Series| DVector::from_vec(series.iter().flatten().flatten().copied().collect());
        let given = flat(&given.simulated);
        let run = |part: &Part, angle: f64| Some(flat(&self.run(&explanation.turned(self.scene, part, angle)?).simulated));
        let mut left = DVector::from_vec(self.data.stretches.iter().flat_map(|s| s.outputs.iter().flatten().copied()).collect()) - &given;
        let mut ripples = DMatrix::zeros(left.len(), 2 * parts.len());
        for (i, part) in parts.iter().enumerate() {
            let (half, quarter) = (run(part, std::f64::consts::PI)?, run(part, std::f64::consts::FRAC_PI_2)?);
            let (mean, ripple) = ((&given + &half) / 2.0, (&given - &half) / 2.0);
            left += &ripple;
            ripples.set_column(2 * i, &ripple);
            ripples.set_column(2 * i + 1, &(quarter - mean));
        }
        // Outputs count by their size, as in the fit.
        let weights = self.weights();
        left.component_mul_assign(&weights);
        ripples.column_iter_mut().for_each(|mut c| c.component_mul_assign(&weights));
        let shares = ripples.tr_mul(&ripples).cholesky()?.solve(&ripples.tr_mul(&left));
        let mut begun = explanation.clone();
        for (i, part) in parts.iter().enumerate() {
            begun = begun.turned(self.scene, part, shares[2 * i + 1].atan2(shares[2 * i]))?;
        }
        Some(begun)
    }

    /// One over the root mean square of each value's output.
    fn weights(&self) -> DVector<f64> {
        let of = |c: usize| 1.0 / self.scene.scales.outputs[c];
        let rows = self.data.stretches.iter().flat_map(|s| s.outputs.iter().enumerate());
        DVector::from_vec(rows.flat_map(|(c, series)| std::iter::repeat_n(of(c), series.len())).collect())
    }
}
