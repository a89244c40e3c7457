//! The binary interface, mirrored from `include/wheelwright_plugin.h`.
//!
//! Meanings and rules are in the header; both files assert the same sizes and offsets, so neither can drift alone. Function
//! pointers are `Option`s because a library may well hold a null.

use std::ffi::{c_char, c_void};
use std::mem::{offset_of, size_of};

/// Version of the interface; a library of another version is refused.
pub const ABI_VERSION: u32 = 1;

/// Name of the one exported symbol.
pub const SYMBOL: &str = "wheelwright_plugin";

/// Type of the one exported symbol.
pub type Entry = unsafe extern "C" fn() -> *const Plugin;

/// What a call returns.
pub type Status = i32;

/// Done.
pub const OK: Status = 0;
/// A configuration value is impossible.
pub const CONFIG: Status = 1;
/// No connection, or it was lost.
pub const CONNECTION: Status = 2;
/// No answer in time.
pub const TIMEOUT: Status = 3;
/// The robot reports a fault.
pub const FAULT: Status = 4;
/// The library itself failed.
pub const DRIVER: Status = 5;
/// A model's equations leave the accelerations undetermined.
pub const SINGULAR: Status = 6;

/// The host's buffer for a message.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Message {
    /// Where to write.
    pub text: *mut c_char,
    /// Bytes there, the closing NUL included.
    pub capacity: usize,
}

/// A signal by name and unit.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Channel {
    /// Name.
    pub name: *const c_char,
    /// SI unit.
    pub unit: *const c_char,
}

/// A connected robot.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct RobotInfo {
    /// Commands.
    pub inputs: *const Channel,
    /// Measurements.
    pub outputs: *const Channel,
    /// Number of commands.
    pub n_inputs: usize,
    /// Number of measurements.
    pub n_outputs: usize,
    /// Control period \[s\].
    pub period: f64,
}

/// Checks a configuration.
pub type Check = unsafe extern "C" fn(config: *const c_char, message: *const Message) -> Status;
/// Connects a robot.
pub type OpenRobot = unsafe extern "C" fn(
    config: *const c_char,
    seed: u64,
    info: *mut RobotInfo,
    handle: *mut *mut c_void,
    message: *const Message,
) -> Status;
/// Measures without commanding.
pub type Measure = unsafe extern "C" fn(handle: *mut c_void, time: *mut f64, measured: *mut f64, message: *const Message) -> Status;
/// Holds a command for one period, then measures.
pub type Step =
    unsafe extern "C" fn(handle: *mut c_void, command: *const f64, time: *mut f64, measured: *mut f64, message: *const Message) -> Status;
/// Stops a robot.
pub type Stop = unsafe extern "C" fn(handle: *mut c_void, message: *const Message) -> Status;
/// Ends a handle.
pub type Close = unsafe extern "C" fn(handle: *mut c_void);

/// A robot.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Robot {
    /// What `type = "..."` says.
    pub name: *const c_char,
    /// One line on what it is.
    pub about: *const c_char,
    /// NULL-terminated list of keys, or null.
    pub keys: *const *const c_char,
    /// Optional.
    pub check: Option<Check>,
    /// Required, as all below.
    pub open: Option<OpenRobot>,
    /// Measures.
    pub measure: Option<Measure>,
    /// Steps.
    pub step: Option<Step>,
    /// Stops.
    pub stop: Option<Stop>,
    /// Closes.
    pub close: Option<Close>,
}

/// A parameter of a model.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Parameter {
    /// Name.
    pub name: *const c_char,
    /// SI unit.
    pub unit: *const c_char,
    /// What it does.
    pub meaning: *const c_char,
    /// The motion that shows it.
    pub excitation: *const c_char,
    /// Lower bound; no bounds if both are zero.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
}

/// A model.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct ModelInfo {
    /// Inputs.
    pub inputs: *const Channel,
    /// Outputs.
    pub outputs: *const Channel,
    /// Parameters.
    pub parameters: *const Parameter,
    /// Names of the free parameters, or null.
    pub free_names: *const *const c_char,
    /// T of θ = T z + c, row-major, parameters × free.
    pub map_matrix: *const f64,
    /// c.
    pub map_offset: *const f64,
    /// Number of inputs.
    pub n_inputs: usize,
    /// Number of outputs.
    pub n_outputs: usize,
    /// Number of parameters.
    pub n_parameters: usize,
    /// Number of equations.
    pub n_equations: usize,
    /// Number of free parameters.
    pub n_free: usize,
}

/// Builds a model.
pub type OpenModel =
    unsafe extern "C" fn(config: *const c_char, info: *mut ModelInfo, handle: *mut *mut c_void, message: *const Message) -> Status;
/// Writes Φ and y.
pub type Regressor = unsafe extern "C" fn(
    handle: *const c_void,
    inputs: *const f64,
    outputs: *const f64,
    accelerations: *const f64,
    phi: *mut f64,
    y: *mut f64,
    message: *const Message,
) -> Status;
/// Solves for the accelerations.
pub type Accelerations = unsafe extern "C" fn(
    handle: *const c_void,
    theta: *const f64,
    inputs: *const f64,
    outputs: *const f64,
    accelerations: *mut f64,
    message: *const Message,
) -> Status;

/// A model's table.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Model {
    /// What `type = "..."` says.
    pub name: *const c_char,
    /// One line on what it is.
    pub about: *const c_char,
    /// NULL-terminated list of keys, or null.
    pub keys: *const *const c_char,
    /// Optional.
    pub check: Option<Check>,
    /// Required.
    pub open: Option<OpenModel>,
    /// Required.
    pub regressor: Option<Regressor>,
    /// Optional.
    pub accelerations: Option<Accelerations>,
    /// Required.
    pub close: Option<Close>,
}

/// Version and sizes as the library was compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Header {
    /// Version of the interface.
    pub abi_version: u32,
    /// Bytes of [`Plugin`].
    pub size_plugin: u32,
    /// Bytes of [`Robot`].
    pub size_robot: u32,
    /// Bytes of [`RobotInfo`].
    pub size_robot_info: u32,
    /// Bytes of [`Model`].
    pub size_model: u32,
    /// Bytes of [`ModelInfo`].
    pub size_model_info: u32,
    /// Bytes of [`Channel`].
    pub size_channel: u32,
    /// Bytes of [`Parameter`].
    pub size_parameter: u32,
}

impl Header {
    /// Of this build.
    pub const OWN: Self = Self {
        abi_version: ABI_VERSION,
        size_plugin: size_of::<Plugin>() as u32,
        size_robot: size_of::<Robot>() as u32,
        size_robot_info: size_of::<RobotInfo>() as u32,
        size_model: size_of::<Model>() as u32,
        size_model_info: size_of::<ModelInfo>() as u32,
        size_channel: size_of::<Channel>() as u32,
        size_parameter: size_of::<Parameter>() as u32,
    };

    /// Sizes by the structure's name in the header file.
    pub fn sizes(&self) -> [(&'static str, u32); 7] {
        [
            ("ww_plugin", self.size_plugin),
            ("ww_robot", self.size_robot),
            ("ww_robot_info", self.size_robot_info),
            ("ww_model", self.size_model),
            ("ww_model_info", self.size_model_info),
            ("ww_channel", self.size_channel),
            ("ww_parameter", self.size_parameter),
        ]
    }
}

/// What a library offers.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Plugin {
    /// Version and sizes, first for ever.
    pub header: Header,
    /// Name of the library.
    pub name: *const c_char,
    /// Its version.
    pub version: *const c_char,
    /// NULL-terminated list, or null.
    pub robots: *const *const Robot,
    /// NULL-terminated list, or null.
    pub models: *const *const Model,
    /// Reserved: null.
    pub solvers: *const *const c_void,
    /// Reserved: null.
    pub effects: *const *const c_void,
}

#[cfg(target_pointer_width = "64")]
const _: () = {
    assert!(size_of::<Message>() == 16 && offset_of!(Message, capacity) == 8);
    assert!(size_of::<Channel>() == 16 && offset_of!(Channel, unit) == 8);
    assert!(size_of::<RobotInfo>() == 40 && offset_of!(RobotInfo, n_inputs) == 16 && offset_of!(RobotInfo, period) == 32);
    assert!(size_of::<Robot>() == 72 && offset_of!(Robot, check) == 24 && offset_of!(Robot, step) == 48 && offset_of!(Robot, close) == 64);
    assert!(size_of::<Parameter>() == 48 && offset_of!(Parameter, excitation) == 24 && offset_of!(Parameter, lower) == 32);
    assert!(size_of::<ModelInfo>() == 88 && offset_of!(ModelInfo, free_names) == 24);
    assert!(offset_of!(ModelInfo, n_inputs) == 48 && offset_of!(ModelInfo, n_free) == 80);
    assert!(size_of::<Model>() == 64 && offset_of!(Model, check) == 24 && offset_of!(Model, regressor) == 40);
    assert!(offset_of!(Model, close) == 56);
    assert!(size_of::<Header>() == 32 && offset_of!(Header, size_parameter) == 28);
    assert!(size_of::<Plugin>() == 80 && offset_of!(Plugin, name) == 32 && offset_of!(Plugin, robots) == 48);
    assert!(offset_of!(Plugin, effects) == 72);
};
