//! A Rust model behind the C table.

use std::ffi::{CString, c_char, c_void};

use wheelwright_core::model::{ModelConfig, RegressorModel, Sample};

use crate::abi;
use crate::export::{c_channels, configured, guard, keep, slice, slice_mut};
use crate::status::Failure;

pub(super) fn table(name: *const c_char, about: *const c_char) -> abi::Model {
    abi::Model {
        name,
        about,
        keys: std::ptr::null(),
        check: Some(check),
        open: Some(open),
        regressor: Some(regressor),
        accelerations: Some(accelerations),
        close: Some(close),
    }
}

/// A model with what its info points to.
struct Handle {
    model: Box<dyn RegressorModel>,
    equations: usize,
    inputs: Vec<abi::Channel>,
    outputs: Vec<abi::Channel>,
    parameters: Vec<abi::Parameter>,
    free: Vec<*const c_char>,
    matrix: Vec<f64>,
    offset: Vec<f64>,
    _texts: Vec<CString>,
}

impl Handle {
    fn new(model: Box<dyn RegressorModel>) -> Self {
        let mut texts = Vec::new();
        let inputs = c_channels(model.inputs(), &mut texts);
        let outputs = c_channels(model.outputs(), &mut texts);
        let parameters = model.parameters().iter().map(|p| abi::Parameter {
            name: keep(&p.name, &mut texts),
            unit: keep(&p.unit, &mut texts),
            meaning: keep(&p.meaning, &mut texts),
            excitation: keep(&p.excitation, &mut texts),
            lower: p.bounds.0,
            upper: p.bounds.1,
        });
        let parameters = parameters.collect();
        let map = model.map();
        let free = map.free.iter().map(|name| keep(name, &mut texts)).collect();
        let equations = model.equations();
        Self { model, equations, inputs, outputs, parameters, free, matrix: map.matrix, offset: map.offset, _texts: texts }
    }

    fn info(&self) -> abi::ModelInfo {
        abi::ModelInfo {
            inputs: self.inputs.as_ptr(),
            outputs: self.outputs.as_ptr(),
            parameters: self.parameters.as_ptr(),
            free_names: self.free.as_ptr(),
            map_matrix: self.matrix.as_ptr(),
            map_offset: self.offset.as_ptr(),
            n_inputs: self.inputs.len(),
            n_outputs: self.outputs.len(),
            n_parameters: self.parameters.len(),
            n_equations: self.equations,
            n_free: self.free.len(),
        }
    }
}

unsafe extern "C" fn check(config: *const c_char, message: *const abi::Message) -> abi::Status {
    // SAFETY: the host's pointers are as the header says.
    unsafe { super::check::<Box<dyn ModelConfig>>(config, message) }
}

unsafe extern "C" fn open(
    config: *const c_char,
    info: *mut abi::ModelInfo,
    handle: *mut *mut c_void,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: the host's pointers are as the header says.
        let opened = Box::new(Handle::new(unsafe { configured::<Box<dyn ModelConfig>>(config) }?.build()?));
        // SAFETY: as above.
        unsafe {
            info.write(opened.info());
            handle.write(Box::into_raw(opened).cast());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn regressor(
    handle: *const c_void,
    inputs: *const f64,
    outputs: *const f64,
    accelerations: *const f64,
    phi: *mut f64,
    y: *mut f64,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: the host gives back the handle of `open`, one value a channel, and room for phi and y.
        unsafe {
            let handle = &*handle.cast::<Handle>();
            let sample = Sample {
                inputs: slice(inputs, handle.inputs.len()),
                outputs: slice(outputs, handle.outputs.len()),
                accelerations: slice(accelerations, handle.outputs.len()),
            };
            let (phi, y) = (slice_mut(phi, handle.equations * handle.parameters.len()), slice_mut(y, handle.equations));
            handle.model.regressor(sample, phi, y);
            handle.model.failure().map_or(Ok(()), |failure| Err(Failure::from(failure)))
        }
    };
    // SAFETY: the host's message is as the header says.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn accelerations(
    handle: *const c_void,
    theta: *const f64,
    inputs: *const f64,
    outputs: *const f64,
    accelerations: *mut f64,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: the host gives back the handle of `open`, one value a parameter and a channel, and room for the result.
        unsafe {
            let handle = &*handle.cast::<Handle>();
            let n = handle.outputs.len();
            let (theta, inputs) = (slice(theta, handle.parameters.len()), slice(inputs, handle.inputs.len()));
            Ok(handle.model.accelerations(theta, inputs, slice(outputs, n), slice_mut(accelerations, n))?)
        }
    };
    // SAFETY: the host's message is as the header says.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn close(handle: *mut c_void) {
    // SAFETY: the handle comes from `Box::into_raw` in `open`, and this is its last call.
    super::end(|| drop(unsafe { Box::from_raw(handle.cast::<Handle>()) }));
}
