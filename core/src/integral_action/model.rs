//! A model whose drive also integrates its error: one more state an axis.

use crate::channel::Channel;
use crate::dataset::{Dataset, Stretch};
use crate::model::{ModelError, Parameter, ParameterMap, RegressorModel, Sample};

/// The axes of a model: places i where input i is the response of equation i and output i has its unit. None where inputs,
/// outputs and equations differ in number.
pub(super) fn axes(model: &dyn RegressorModel) -> Vec<usize> {
    let (inputs, outputs, equations) = (model.inputs(), model.outputs(), model.equations());
    if inputs.len() != outputs.len() || equations != outputs.len() {
        return Vec::new();
    }
    let zeros = vec![0.0; outputs.len()];
    let at = |inputs: &[f64]| {
        let (mut phi, mut y) = (vec![0.0; equations * model.parameters().len()], vec![0.0; equations]);
        model.regressor(Sample { inputs, outputs: &zeros, accelerations: &zeros }, &mut phi, &mut y);
        (phi, y)
    };
    let (still, rest) = at(&zeros);
    let responds = |i: usize| {
        let mut one = zeros.clone();
        one[i] = 1.0;
        let (phi, y) = at(&one);
        phi == still && y.iter().zip(&rest).enumerate().all(|(e, (a, b))| a - b == f64::from(u8::from(e == i)))
    };
    (0..inputs.len()).filter(|&i| inputs[i].unit == outputs[i].unit && responds(i)).collect()
}

/// The model with λ ∫(x − u) dt added to the terms of the equation of every axis, and, for a regression, a constant beside it.
///
/// Its further outputs are those integrals, q. They are not measured: a free run starts them as it starts the others.
#[derive(Debug)]
pub(super) struct Integrating<'a> {
    base: &'a dyn RegressorModel,
    axes: Vec<usize>,
    outputs: Vec<Channel>,
    parameters: Vec<Parameter>,
    constants: bool,
}

impl<'a> Integrating<'a> {
    pub(super) fn new(base: &'a dyn RegressorModel, axes: &[usize], constants: bool) -> Self {
        let (mut outputs, mut parameters) = (base.outputs().to_vec(), base.parameters().to_vec());
        for &axis in axes {
            let name = &base.outputs()[axis].name;
            outputs.push(Channel::owned(format!("integral of the error of {name}"), String::new()));
            parameters.push(Parameter::new(&format!("lambda_{name}"), "1/s", "", ""));
        }
        for &axis in axes.iter().filter(|_| constants) {
            parameters.push(Parameter::new(&format!("c_{}", base.outputs()[axis].name), "", "", ""));
        }
        Self { base, axes: axes.to_vec(), outputs, parameters, constants }
    }

    /// The base model's map with the further parameters free.
    pub(super) fn extend(&self, map: &ParameterMap) -> ParameterMap {
        let (known, all) = (map.offset.len(), self.parameters.len());
        let (free, more) = (map.free.len(), all - known);
        let mut matrix = vec![0.0; all * (free + more)];
        for i in 0..known {
            matrix[i * (free + more)..i * (free + more) + free].copy_from_slice(&map.matrix[i * free..(i + 1) * free]);
        }
        (0..more).for_each(|k| matrix[(known + k) * (free + more) + free + k] = 1.0);
        let names = self.parameters[known..].iter().map(|p| p.name.clone());
        ParameterMap {
            free: map.free.iter().cloned().chain(names).collect(),
            matrix,
            offset: map.offset.iter().copied().chain(std::iter::repeat_n(0.0, more)).collect(),
        }
    }

    /// The data with the integrals as measured outputs give them. Each stretch's has no mean: what the integral began with is then
    /// nearly the same constant for all, because the equation is nearly right in the mean without it.
    pub(super) fn with_integrals(&self, data: &Dataset) -> Dataset {
        let mut data = data.clone();
        for stretch in &mut data.stretches {
            for &axis in &self.axes {
                let mut q = integral(stretch, axis);
                let mean = q.iter().sum::<f64>() / q.len() as f64;
                q.iter_mut().for_each(|q| *q -= mean);
                stretch.outputs.push(q);
            }
        }
        data.outputs.clone_from(&self.outputs);
        data
    }
}

/// ∫(x − u) dt from the first sample on, for the output and the held input of one place.
pub(super) fn integral(stretch: &Stretch, place: usize) -> Vec<f64> {
    let (x, u) = (&stretch.outputs[place], &stretch.inputs[place]);
    let mut sum = 0.0;
    let mut values = Vec::with_capacity(x.len());
    values.push(sum);
    for k in 1..x.len() {
        sum += (stretch.time[k] - stretch.time[k - 1]) * (0.5 * (x[k] + x[k - 1]) - u[k - 1]);
        values.push(sum);
    }
    values
}

impl RegressorModel for Integrating<'_> {
    fn name(&self) -> &str {
        self.base.name()
    }

    fn inputs(&self) -> &[Channel] {
        self.base.inputs()
    }

    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        let (n, known, all) = (self.base.outputs().len(), self.base.parameters().len(), self.parameters.len());
        let (outputs, integrals) = sample.outputs.split_at(n);
        let (accelerations, rates) = sample.accelerations.split_at(n);
        // A free run asks for accelerations and never comes here, so that a buffer costs nothing that matters.
        let mut rows = vec![0.0; n * known];
        self.base.regressor(Sample { inputs: sample.inputs, outputs, accelerations }, &mut rows, &mut y[..n]);
        phi.fill(0.0);
        for (row, own) in phi.chunks_exact_mut(all).zip(rows.chunks_exact(known)) {
            row[..known].copy_from_slice(own);
        }
        for (k, &axis) in self.axes.iter().enumerate() {
            phi[axis * all + known + k] = integrals[k];
            if self.constants {
                phi[axis * all + known + self.axes.len() + k] = 1.0;
            }
            // No parameter in it: the rate of the integral is the error itself.
            y[n + k] = outputs[axis] - sample.inputs[axis] - rates[k];
        }
    }

    /// The base model's accelerations under inputs less λ q, which is where an equation's response stands.
    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        let (n, known) = (self.base.outputs().len(), self.base.parameters().len());
        let (outputs, integrals) = outputs.split_at(n);
        let (accelerations, rates) = accelerations.split_at_mut(n);
        let (mut stack, mut heap) = ([0.0; 8], Vec::new());
        let less = match stack.get_mut(..n) {
            Some(less) => less,
            None => {
                heap.resize(n, 0.0);
                heap.as_mut_slice()
            }
        };
        less.copy_from_slice(inputs);
        for (k, &axis) in self.axes.iter().enumerate() {
            less[axis] -= theta[known + k] * integrals[k];
            rates[k] = outputs[axis] - inputs[axis];
        }
        self.base.accelerations(&theta[..known], less, outputs, accelerations)
    }
}
