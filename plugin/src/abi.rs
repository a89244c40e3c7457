//! The binary interface, mirrored from `include/wheelwright_plugin.h`.
//!
//! Meanings and rules are in the header; both files assert the same sizes and offsets, so neither can drift alone. Function
//! pointers are `Option`s because a library may well hold a null.

use std::ffi::{c_char, c_void};
use std::mem::{offset_of, size_of};

/// Version of the interface; a library of another version is refused.
pub const ABI_VERSION: u32 = 5;

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
    /// Not 0 where time passes only in `step`.
    pub simulated: u32,
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

/// Another effect that looks alike.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Confusion {
    /// Its name.
    pub with: *const c_char,
    /// Why.
    pub because: *const c_char,
}

/// An effect with its settings.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct EffectInfo {
    /// Family, or null.
    pub family: *const c_char,
    /// The motion that shows it.
    pub excitation: *const c_char,
    /// What it is confused with.
    pub confusions: *const Confusion,
    /// Number of confusions.
    pub n_confusions: usize,
    /// Stage by its number.
    pub stage: u32,
    /// Zero.
    pub reserved: u32,
}

/// What an effect may know of a recording.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Scene {
    /// Inputs.
    pub inputs: *const Channel,
    /// Outputs.
    pub outputs: *const Channel,
    /// Root mean square of each input.
    pub input_rms: *const f64,
    /// Largest magnitude of each input.
    pub input_largest: *const f64,
    /// Root mean square of each output.
    pub output_rms: *const f64,
    /// Number of inputs.
    pub n_inputs: usize,
    /// Number of outputs.
    pub n_outputs: usize,
    /// Half the track width \[m\].
    pub half_track: f64,
    /// Radius of the wheels \[m\].
    pub wheel_radius: f64,
    /// Root mean square of the wheels' ground speeds \[m/s\].
    pub speed: f64,
    /// Root mean square of the wheels' commands.
    pub command: f64,
    /// Largest magnitude of a wheel's command.
    pub largest_command: f64,
    /// First time \[s\].
    pub start: f64,
    /// Last time \[s\].
    pub end: f64,
    /// Median step between samples \[s\].
    pub period: f64,
    /// Frame by its number.
    pub frame: u32,
    /// Zero.
    pub reserved: u32,
}

/// A parameter of an effect.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct EffectParameter {
    /// Name.
    pub name: *const c_char,
    /// SI unit.
    pub unit: *const c_char,
    /// Kind of its label, or null.
    pub label_kind: *const c_char,
    /// Its label, or null.
    pub label: *const c_char,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Plausible size.
    pub scale: f64,
    /// Neutral value, or not a number.
    pub neutral: f64,
}

/// A point from which an effect is tried.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Start {
    /// One value a parameter.
    pub values: *const f64,
    /// Number of the column of each parameter, or −1.
    pub columns: *const i32,
    /// Whether the response is proportional.
    pub linear: u32,
    /// Zero.
    pub reserved: u32,
}

/// An effect on a scene.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct PreparedInfo {
    /// Why it cannot act, or null.
    pub inapplicable: *const c_char,
    /// Parameters.
    pub parameters: *const EffectParameter,
    /// Starts.
    pub starts: *const Start,
    /// Number of parameters.
    pub n_parameters: usize,
    /// Number of starts.
    pub n_starts: usize,
    /// Numbers of state.
    pub n_states: usize,
}

/// What was recorded.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Stretch {
    /// Times.
    pub time: *const f64,
    /// Columns of the inputs.
    pub inputs: *const *const f64,
    /// Columns of the outputs.
    pub outputs: *const *const f64,
    /// Measured heading, or null.
    pub heading: *const f64,
    /// Distance of the left wheel, or null.
    pub distance_left: *const f64,
    /// Distance of the right wheel, or null.
    pub distance_right: *const f64,
    /// Number of rows.
    pub rows: usize,
}

/// One instant of a simulation.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Instant {
    /// Time \[s\].
    pub time: f64,
    /// Time that passes up to now \[s\].
    pub span: f64,
    /// Row whose command is held.
    pub row: usize,
    /// The stretch.
    pub stretch: *const Stretch,
    /// 1 where outputs are recorded as means.
    pub interval_mean: u32,
    /// Zero.
    pub reserved: u32,
}

/// What a drive effect sees of the motion.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Motion {
    /// Command behind the command effects, one for each input.
    pub u: *const f64,
    /// Outputs.
    pub outputs: *const f64,
    /// Inputs for a unit of each acceleration, row-major, inputs × outputs.
    pub inertia: *const f64,
    /// Inputs for a unit of each output, row-major, inputs × outputs.
    pub drag: *const f64,
    /// Inputs that the ground has to give besides those that accelerate the robot, one for each input.
    pub held: *const f64,
}

/// A value with its interval.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Lower end, or not a number.
    pub lower: f64,
    /// Upper end, or not a number.
    pub upper: f64,
}

/// Writes the true outputs at an earlier time.
pub type Past = unsafe extern "C" fn(host: *const c_void, time: f64, outputs: *mut f64);
/// Makes an effect.
pub type OpenEffect =
    unsafe extern "C" fn(config: *const c_char, info: *mut EffectInfo, handle: *mut *mut c_void, message: *const Message) -> Status;
/// Suits an effect to a scene.
pub type Prepare = unsafe extern "C" fn(
    handle: *const c_void,
    scene: *const Scene,
    info: *mut PreparedInfo,
    prepared: *mut *mut c_void,
    message: *const Message,
) -> Status;
/// Writes the sentence.
pub type Statement = unsafe extern "C" fn(prepared: *const c_void, values: *const Estimate, text: *const Message) -> Status;
/// Sets the state.
pub type Begin = unsafe extern "C" fn(
    prepared: *const c_void,
    p: *const f64,
    at: *const Instant,
    inputs: *const f64,
    outputs: *const f64,
    state: *mut f64,
);
/// The next time at which it switches.
pub type NextSwitch = unsafe extern "C" fn(prepared: *const c_void, p: *const f64, at: *const Instant, state: *const f64) -> f64;
/// Changes a command.
pub type Command =
    unsafe extern "C" fn(prepared: *const c_void, p: *const f64, at: *const Instant, outputs: *const f64, state: *mut f64, u: *mut f64);
/// Adds a load.
pub type Load = unsafe extern "C" fn(
    prepared: *const c_void,
    p: *const f64,
    at: *const Instant,
    outputs: *const f64,
    state: *const f64,
    load: *mut f64,
);
/// Changes what is left to accelerate.
pub type Drive = unsafe extern "C" fn(
    prepared: *const c_void,
    p: *const f64,
    at: *const Instant,
    motion: *const Motion,
    state: *const f64,
    drive: *mut f64,
);
/// Lets time pass.
pub type Advance = unsafe extern "C" fn(
    prepared: *const c_void,
    p: *const f64,
    at: *const Instant,
    motion: *const Motion,
    drive: *const f64,
    state: *mut f64,
);
/// Changes what is recorded.
pub type Observe = unsafe extern "C" fn(
    prepared: *const c_void,
    p: *const f64,
    at: *const Instant,
    past: Past,
    host: *const c_void,
    state: *mut f64,
    outputs: *mut f64,
);

/// An effect's table.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Effect {
    /// What `type = "..."` says.
    pub name: *const c_char,
    /// One line on what it is.
    pub about: *const c_char,
    /// NULL-terminated list of keys, or null.
    pub keys: *const *const c_char,
    /// Optional.
    pub check: Option<Check>,
    /// Required.
    pub open: Option<OpenEffect>,
    /// Required.
    pub prepare: Option<Prepare>,
    /// Required.
    pub statement: Option<Statement>,
    /// Optional, as those below up to `measure`.
    pub begin: Option<Begin>,
    /// Switches.
    pub next_switch: Option<NextSwitch>,
    /// Commands.
    pub command: Option<Command>,
    /// Loads.
    pub load: Option<Load>,
    /// Drive.
    pub drive: Option<Drive>,
    /// Time.
    pub advance: Option<Advance>,
    /// Measurement.
    pub measure: Option<Observe>,
    /// Required.
    pub release: Option<Close>,
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
    /// Bytes of [`Effect`].
    pub size_effect: u32,
    /// Bytes of [`EffectInfo`].
    pub size_effect_info: u32,
    /// Bytes of [`Scene`].
    pub size_scene: u32,
    /// Bytes of [`EffectParameter`].
    pub size_effect_parameter: u32,
    /// Bytes of [`PreparedInfo`].
    pub size_prepared_info: u32,
    /// Bytes of [`Instant`].
    pub size_instant: u32,
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
        size_effect: size_of::<Effect>() as u32,
        size_effect_info: size_of::<EffectInfo>() as u32,
        size_scene: size_of::<Scene>() as u32,
        size_effect_parameter: size_of::<EffectParameter>() as u32,
        size_prepared_info: size_of::<PreparedInfo>() as u32,
        size_instant: size_of::<Instant>() as u32,
    };

    /// Sizes by the structure's name in the header file.
    pub fn sizes(&self) -> [(&'static str, u32); 13] {
        [
            ("ww_plugin", self.size_plugin),
            ("ww_robot", self.size_robot),
            ("ww_robot_info", self.size_robot_info),
            ("ww_model", self.size_model),
            ("ww_model_info", self.size_model_info),
            ("ww_channel", self.size_channel),
            ("ww_parameter", self.size_parameter),
            ("ww_effect", self.size_effect),
            ("ww_effect_info", self.size_effect_info),
            ("ww_scene", self.size_scene),
            ("ww_effect_parameter", self.size_effect_parameter),
            ("ww_prepared_info", self.size_prepared_info),
            ("ww_instant", self.size_instant),
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
    /// NULL-terminated list, or null.
    pub effects: *const *const Effect,
}

#[cfg(target_pointer_width = "64")]
const _: () = {
    assert!(size_of::<Message>() == 16 && offset_of!(Message, capacity) == 8);
    assert!(size_of::<Channel>() == 16 && offset_of!(Channel, unit) == 8);
    assert!(size_of::<RobotInfo>() == 48 && offset_of!(RobotInfo, n_inputs) == 16 && offset_of!(RobotInfo, simulated) == 40);
    assert!(size_of::<Robot>() == 72 && offset_of!(Robot, check) == 24 && offset_of!(Robot, step) == 48 && offset_of!(Robot, close) == 64);
    assert!(size_of::<Parameter>() == 48 && offset_of!(Parameter, excitation) == 24 && offset_of!(Parameter, lower) == 32);
    assert!(size_of::<ModelInfo>() == 88 && offset_of!(ModelInfo, free_names) == 24);
    assert!(offset_of!(ModelInfo, n_inputs) == 48 && offset_of!(ModelInfo, n_free) == 80);
    assert!(size_of::<Model>() == 64 && offset_of!(Model, check) == 24 && offset_of!(Model, regressor) == 40);
    assert!(offset_of!(Model, close) == 56);
    assert!(size_of::<Header>() == 56 && offset_of!(Header, size_parameter) == 28 && offset_of!(Header, size_instant) == 52);
    assert!(size_of::<Plugin>() == 104 && offset_of!(Plugin, name) == 56 && offset_of!(Plugin, robots) == 72);
    assert!(offset_of!(Plugin, effects) == 96);
    assert!(size_of::<EffectInfo>() == 40 && offset_of!(EffectInfo, stage) == 32);
    assert!(size_of::<Scene>() == 128 && offset_of!(Scene, n_inputs) == 40 && offset_of!(Scene, frame) == 120);
    assert!(size_of::<EffectParameter>() == 64 && offset_of!(EffectParameter, neutral) == 56);
    assert!(size_of::<Start>() == 24 && size_of::<PreparedInfo>() == 48 && offset_of!(PreparedInfo, n_states) == 40);
    assert!(size_of::<Motion>() == 40 && offset_of!(Motion, held) == 32);
    assert!(size_of::<Stretch>() == 56 && size_of::<Instant>() == 40 && offset_of!(Instant, stretch) == 24);
    assert!(size_of::<Estimate>() == 24 && size_of::<Effect>() == 128 && offset_of!(Effect, command) == 72);
    assert!(offset_of!(Effect, close) == 120);
};
