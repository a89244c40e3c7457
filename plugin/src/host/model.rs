//! A library's model as a [`RegressorModel`], guarded.
//!
//! `regressor` is the innermost loop of everything, so it is called as it is: no thread, no deadline. `open` and a first
//! evaluation run under one. A call that fails, or answers ordinary input with a value that is not finite, writes NaN and is
//! remembered: [`RegressorModel::failure`] tells it, and simulations end with it.

#![allow(unsafe_code)]

use std::ffi::{CString, c_void};
use std::sync::{Arc, OnceLock};

use wheelwright_core::channel::Channel;
use wheelwright_core::model::{ModelError, Parameter, ParameterMap, RegressorModel, Sample, solve_accelerations};

use crate::abi;
use crate::deadline::within;
use crate::host::library::ModelTable;
use crate::host::read;
use crate::host::robot::{guarded, outcome, unguarded};
use crate::host::watch::Calls;
use crate::message::Buffer;
use crate::status::Failure;

/// Bytes of a message of `open`.
const MESSAGE: usize = 1024;
/// Bytes of a message in the innermost loop.
const SHORT_MESSAGE: usize = 256;
/// No robot reaches this value of any channel in SI units; beyond it, in a simulation that diverges, an answer that is not
/// finite is not the model's fault.
const ORDINARY: f64 = 1e12;
/// Where the first evaluation is made: a value without special meaning, where every model must be defined.
const PROBE: f64 = 0.37;

/// An open model inside the library; closed when it goes.
struct Handle {
    pointer: *mut c_void,
    table: ModelTable,
}

// SAFETY: the header promises that calls on one handle may come from several threads at once and only read it.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Drop for Handle {
    fn drop(&mut self) {
        struct Closing(*mut c_void, abi::Close);
        // SAFETY: the last call of this handle may come from any thread.
        unsafe impl Send for Closing {}
        let closing = Closing(self.pointer, self.table.close);
        let close = move || {
            let closing = closing;
            // SAFETY: the last call of this handle.
            unsafe { (closing.1)(closing.0) }
        };
        // A model that hangs in `close` is left behind; there is nobody to tell.
        let _ = within(self.table.offer.name, self.table.offer.limits.open, close);
    }
}

/// A library's model behind the trait that built-in ones have.
pub(crate) struct PluginModel {
    handle: Handle,
    inputs: Vec<Channel>,
    outputs: Vec<Channel>,
    parameters: Vec<Parameter>,
    map: ParameterMap,
    equations: usize,
    failure: OnceLock<ModelError>,
    calls: Arc<Calls>,
}

impl std::fmt::Debug for PluginModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PluginModel").field("name", &self.handle.table.offer.name).finish_non_exhaustive()
    }
}

/// Opens a library's model with a configuration text and evaluates it once.
pub(crate) fn build(table: &ModelTable, config: CString) -> Result<PluginModel, ModelError> {
    let (name, limit, own) = (table.offer.name, table.offer.limits.open, table.clone());
    let opening = move || {
        let model = open(own, &config)?;
        model.probe()?;
        Ok(model)
    };
    let late = |late| Err(Failure::new(abi::DRIVER, table.offer.not_returned("opening it", late)));
    within(name, limit, opening).unwrap_or_else(late).map_err(|failure| failure.into_model_error(name))
}

fn open(table: ModelTable, config: &CString) -> Result<PluginModel, Failure> {
    let mut buffer = Buffer::<MESSAGE>::new();
    let message = buffer.abi();
    let mut raw = abi::ModelInfo {
        inputs: std::ptr::null(),
        outputs: std::ptr::null(),
        parameters: std::ptr::null(),
        free_names: std::ptr::null(),
        map_matrix: std::ptr::null(),
        map_offset: std::ptr::null(),
        n_inputs: 0,
        n_outputs: 0,
        n_parameters: 0,
        n_equations: 0,
        n_free: 0,
    };
    let mut pointer = std::ptr::null_mut();
    // SAFETY: a text with its NUL, and places to write that live until the call returns.
    let status = unsafe { (table.open)(config.as_ptr(), &raw mut raw, &raw mut pointer, &raw const message) };
    outcome(status, &buffer)?;
    let handle = Handle { pointer, table };
    // SAFETY: `open` succeeded, and the handle is open.
    unsafe { describe(handle, &raw) }.map_err(|e| Failure::new(abi::DRIVER, format!("`open` broke its contract: {e}")))
}

/// Copies and checks what `open` says of a model.
///
/// # Safety
/// `raw` was written by a successful `open` of `handle`.
unsafe fn describe(handle: Handle, raw: &abi::ModelInfo) -> Result<PluginModel, String> {
    // SAFETY: as the caller vouches.
    let (inputs, outputs, parameters) = unsafe {
        (
            read::channels(raw.inputs, raw.n_inputs, "inputs")?,
            read::channels(raw.outputs, raw.n_outputs, "outputs")?,
            parameters(raw.parameters, raw.n_parameters)?,
        )
    };
    for (what, count) in [("outputs", outputs.len()), ("parameters", parameters.len()), ("equations", raw.n_equations)] {
        if !(1..=256).contains(&count) {
            return Err(format!("it has {count} {what}; there must be 1 to 256"));
        }
    }
    // SAFETY: as the caller vouches.
    let map = unsafe { map(raw, &parameters) }?;
    let calls = Calls::new(handle.table.offer.name);
    Ok(PluginModel { handle, inputs, outputs, parameters, map, equations: raw.n_equations, failure: OnceLock::new(), calls })
}

/// # Safety
/// As [`describe`].
unsafe fn parameters(pointer: *const abi::Parameter, count: usize) -> Result<Vec<Parameter>, String> {
    let mut parameters = Vec::new();
    // SAFETY: as the caller vouches.
    for (i, raw) in unsafe { read::array(pointer, count, "parameters") }?.into_iter().enumerate() {
        // SAFETY: as the caller vouches.
        let (name, unit, meaning, excitation) = unsafe {
            (
                read::name(raw.name, &format!("parameters[{i}].name"))?,
                read::text(raw.unit, &format!("parameters[{i}].unit"))?,
                read::text(raw.meaning, &format!("parameters[{i}].meaning"))?,
                read::text(raw.excitation, &format!("parameters[{i}].excitation"))?,
            )
        };
        let parameter = Parameter::new(&name, &unit, &meaning, &excitation);
        parameters.push(match (raw.lower, raw.upper) {
            (lower, upper) if lower == 0.0 && upper == 0.0 => parameter,
            (lower, upper) if lower <= upper => parameter.within(lower, upper),
            (lower, upper) => return Err(format!("parameter `{name}`: its bounds are {lower} and {upper}")),
        });
    }
    read::distinct(parameters.iter().map(|p| p.name.as_str()), "parameters")?;
    Ok(parameters)
}

/// # Safety
/// As [`describe`].
unsafe fn map(raw: &abi::ModelInfo, parameters: &[Parameter]) -> Result<ParameterMap, String> {
    if raw.n_free == 0 && raw.free_names.is_null() && raw.map_matrix.is_null() && raw.map_offset.is_null() {
        return Ok(ParameterMap::identity(parameters));
    }
    let n = parameters.len();
    if raw.n_free > n {
        return Err(format!("{} free parameters of {n}", raw.n_free));
    }
    // SAFETY: as the caller vouches.
    let (names, matrix, offset) = unsafe {
        (
            read::array(raw.free_names, raw.n_free, "free_names")?,
            read::array(raw.map_matrix, n * raw.n_free, "map_matrix")?,
            read::array(raw.map_offset, n, "map_offset")?,
        )
    };
    if matrix.iter().chain(&offset).any(|x| !x.is_finite()) {
        return Err("the map of its parameters holds a value that is not finite".to_owned());
    }
    // SAFETY: as the caller vouches.
    let free = names.into_iter().map(|name| unsafe { read::name(name, "a free name") }).collect::<Result<Vec<_>, _>>()?;
    read::distinct(free.iter().map(String::as_str), "free_names")?;
    Ok(ParameterMap { free, matrix, offset })
}

impl PluginModel {
    /// First evaluation: it must return, succeed, write every value and none beyond.
    fn probe(&self) -> Result<(), Failure> {
        let (n, p) = (self.equations, self.parameters.len());
        let (inputs, outputs) = (vec![PROBE; self.inputs.len()], vec![PROBE; self.outputs.len()]);
        let (mut phi, mut y) = (guarded(n * p), guarded(n));
        self.call(Sample { inputs: &inputs, outputs: &outputs, accelerations: &outputs }, &mut phi, &mut y)?;
        let (phi, y) = (unguarded(phi, "phi")?, unguarded(y, "y")?);
        self.blame(&phi, &y).map_or(Ok(()), |reason| {
            let text = format!("{reason} with every channel at {PROBE} (not written by the plugin?)");
            Err(Failure::new(abi::DRIVER, text))
        })
    }

    fn call(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) -> Result<(), Failure> {
        let mut buffer = Buffer::<SHORT_MESSAGE>::new();
        let message = buffer.abi();
        // SAFETY: an open handle, one value a channel and room for phi and y, which callers hold to the model's dimensions.
        let status = self.calls.count(|| unsafe {
            (self.handle.table.regressor)(
                self.handle.pointer,
                sample.inputs.as_ptr(),
                sample.outputs.as_ptr(),
                sample.accelerations.as_ptr(),
                phi.as_mut_ptr(),
                y.as_mut_ptr(),
                &raw const message,
            )
        });
        outcome(status, &buffer)
    }

    /// Names the first value that is not finite.
    fn blame(&self, phi: &[f64], y: &[f64]) -> Option<String> {
        let p = self.parameters.len();
        let column = phi.iter().position(|x| !x.is_finite());
        let column = column.map(|i| format!("equation {}: the coefficient of `{}` is {}", i / p + 1, self.parameters[i % p].name, phi[i]));
        column.or_else(|| y.iter().position(|x| !x.is_finite()).map(|i| format!("equation {}: y is {}", i + 1, y[i])))
    }

    /// What a call with wrong dimensions, a failure or a value that is not finite comes to.
    fn evaluate(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) -> Result<(), Failure> {
        let (n, p) = (self.equations, self.parameters.len());
        let given = [sample.inputs.len(), sample.outputs.len(), sample.accelerations.len(), phi.len(), y.len()];
        if given != [self.inputs.len(), self.outputs.len(), self.outputs.len(), n * p, n] {
            return Err(Failure::new(abi::DRIVER, format!("called with arrays of {given:?} values")));
        }
        phi.fill(f64::NAN);
        y.fill(f64::NAN);
        self.call(sample, phi, y)?;
        let ordinary = || sample.inputs.iter().chain(sample.outputs).chain(sample.accelerations).all(|x| x.abs() < ORDINARY);
        match self.blame(phi, y) {
            Some(reason) if ordinary() => {
                let Sample { inputs, outputs, accelerations } = sample;
                let at = format!("at inputs {inputs:?}, outputs {outputs:?}, accelerations {accelerations:?}");
                Err(Failure::new(abi::DRIVER, format!("{reason} {at}")))
            }
            _ => Ok(()),
        }
    }

    fn failed(&self) -> Result<(), ModelError> {
        self.failure.get().map_or(Ok(()), |failure| Err(failure.clone()))
    }
}

impl RegressorModel for PluginModel {
    fn name(&self) -> &str {
        self.handle.table.offer.name
    }

    fn inputs(&self) -> &[Channel] {
        &self.inputs
    }

    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn equations(&self) -> usize {
        self.equations
    }

    fn regressor(&self, sample: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        if let Err(failure) = self.evaluate(sample, phi, y) {
            phi.fill(f64::NAN);
            y.fill(f64::NAN);
            // The first failure is the one to report.
            let _ = self.failure.set(ModelError::Plugin { model: self.name().to_owned(), reason: failure.text });
        }
    }

    fn map(&self) -> ParameterMap {
        self.map.clone()
    }

    fn failure(&self) -> Option<ModelError> {
        self.failure.get().cloned()
    }

    fn accelerations(&self, theta: &[f64], inputs: &[f64], outputs: &[f64], accelerations: &mut [f64]) -> Result<(), ModelError> {
        let Some(solve) = self.handle.table.accelerations else {
            let solved = solve_accelerations(self, theta, inputs, outputs, accelerations);
            return self.failed().and(solved);
        };
        let given = [theta.len(), inputs.len(), outputs.len(), accelerations.len()];
        if given != [self.parameters.len(), self.inputs.len(), self.outputs.len(), self.outputs.len()] {
            let reason = format!("`accelerations` called with arrays of {given:?} values");
            return Err(ModelError::Plugin { model: self.name().to_owned(), reason });
        }
        let mut buffer = Buffer::<SHORT_MESSAGE>::new();
        let message = buffer.abi();
        accelerations.fill(f64::NAN);
        // SAFETY: an open handle, one value a parameter and a channel, and room for the accelerations.
        let status = self.calls.count(|| unsafe {
            solve(self.handle.pointer, theta.as_ptr(), inputs.as_ptr(), outputs.as_ptr(), accelerations.as_mut_ptr(), &raw const message)
        });
        outcome(status, &buffer).map_err(|failure| failure.into_model_error(self.name()))?;
        if accelerations.iter().all(|a| a.is_finite()) {
            return Ok(());
        }
        Err(ModelError::Singular { model: self.name().to_owned() })
    }
}
