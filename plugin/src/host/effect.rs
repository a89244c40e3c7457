//! A library's effect as an [`Effect`].
//!
//! Its hooks are the innermost loop of a diagnosis, so they are called as they are: no thread, no deadline. `open` and `prepare`
//! run under one. A library suits an effect to a scene once; what it made is kept with the scene's sizes and used again.

#![allow(unsafe_code)]

use std::collections::BTreeSet;
use std::ffi::{CString, c_void};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock};

use serde::{Serialize, Serializer};
use toml::Table;
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Motion, Scales, Scene, Stage, Start};
use wheelwright_core::simulation::Readout;

use crate::abi;
use crate::deadline::within;
use crate::export::c_channels;
use crate::host::library::EffectTable;
use crate::host::offer::c_config;
use crate::host::read;
use crate::host::robot::outcome;
use crate::host::watch::Calls;
use crate::message::Buffer;
use crate::registry::settings;
use crate::status::Failure;

/// Bytes of a message or a sentence.
const MESSAGE: usize = 1024;
/// Most inputs, and most outputs, of a model on which a library's effect can act.
const CHANNELS: usize = 16;
/// Scenes for which what a library prepared is kept.
const SCENES: usize = 16;
/// Stages by their numbers.
const STAGES: [Stage; 14] = [
    Stage::Transport,
    Stage::Ramp,
    Stage::Threshold,
    Stage::Limit,
    Stage::Gain,
    Stage::Filter,
    Stage::Loop,
    Stage::Bearing,
    Stage::Load,
    Stage::Drive,
    Stage::Contact,
    Stage::Inertia,
    Stage::Reading,
    Stage::Sensor,
];

/// Number of a stage.
pub(crate) fn stage_number(stage: Stage) -> u32 {
    STAGES.iter().position(|s| *s == stage).unwrap_or_default() as u32
}

/// An effect inside the library; closed when it goes.
struct Handle {
    pointer: *mut c_void,
    table: EffectTable,
}

// SAFETY: the header promises that calls on one handle may come from several threads at once.
unsafe impl Send for Handle {}
// SAFETY: as above.
unsafe impl Sync for Handle {}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: the last call of this handle; what was prepared holds the handle, so it was released.
        unsafe { (self.table.close)(self.pointer) }
    }
}

/// An effect suited to a scene; released when it goes.
struct Prepared {
    pointer: *mut c_void,
    handle: Arc<Handle>,
    /// What the library may look at until `release`.
    _scene: Box<SceneForC>,
    key: Key,
    inapplicable: Option<String>,
    parameters: Vec<EffectParameter>,
    starts: Vec<Start>,
    states: usize,
}

// SAFETY: as for `Handle`.
unsafe impl Send for Prepared {}
// SAFETY: as for `Handle`.
unsafe impl Sync for Prepared {}

impl Drop for Prepared {
    fn drop(&mut self) {
        // SAFETY: the last call for what `prepare` made.
        unsafe { (self.handle.table.release)(self.pointer) }
    }
}

/// What makes two scenes the same to an effect.
#[derive(Debug, Clone, PartialEq)]
struct Key {
    frame: u32,
    /// As bits: a track that is not known equals itself.
    half_track: u64,
    wheel_radius: Option<f64>,
    scales: Scales,
}

impl Key {
    fn is(&self, scene: &Scene) -> bool {
        self.frame == frame_number(scene.frame)
            && self.half_track == scene.frame.half_track().to_bits()
            && self.wheel_radius == scene.wheel_radius
            && self.scales == scene.scales
    }
}

fn frame_number(frame: Frame) -> u32 {
    match frame {
        Frame::Body { .. } => 0,
        Frame::Sides { .. } => 1,
        Frame::Channels => 2,
    }
}

/// A scene as the header has it, with what it points to.
struct SceneForC {
    raw: abi::Scene,
    _texts: Vec<CString>,
    _channels: [Vec<abi::Channel>; 2],
    _sizes: [Vec<f64>; 3],
}

// SAFETY: the pointers lead to what it owns, which nobody changes.
unsafe impl Send for SceneForC {}
// SAFETY: as above.
unsafe impl Sync for SceneForC {}

impl SceneForC {
    fn new(scene: &Scene) -> Box<Self> {
        let mut texts = Vec::new();
        let channels = [c_channels(&scene.inputs, &mut texts), c_channels(&scene.outputs, &mut texts)];
        let sizes = [scene.scales.inputs.clone(), scene.scales.largest.clone(), scene.scales.outputs.clone()];
        let scales = &scene.scales;
        let raw = abi::Scene {
            inputs: channels[0].as_ptr(),
            outputs: channels[1].as_ptr(),
            input_rms: sizes[0].as_ptr(),
            input_largest: sizes[1].as_ptr(),
            output_rms: sizes[2].as_ptr(),
            n_inputs: scene.inputs.len(),
            n_outputs: scene.outputs.len(),
            half_track: scene.frame.half_track(),
            wheel_radius: scene.wheel_radius.unwrap_or(f64::NAN),
            speed: scales.speed,
            command: scales.command,
            largest_command: scales.largest_command,
            start: scales.time.0,
            end: scales.time.1,
            period: scales.period,
            frame: frame_number(scene.frame),
            reserved: 0,
        };
        Box::new(Self { raw, _texts: texts, _channels: channels, _sizes: sizes })
    }
}

/// A table that names a library's effect, and the effect.
pub(crate) struct LoadedEffect {
    handle: Arc<Handle>,
    table: Table,
    stage: Stage,
    family: &'static str,
    excitation: &'static str,
    confusions: &'static [Confusion],
    first: OnceLock<Prepared>,
    more: RwLock<Vec<Arc<Prepared>>>,
    calls: Arc<Calls>,
}

impl std::fmt::Debug for LoadedEffect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LoadedEffect").field("table", &self.table).finish_non_exhaustive()
    }
}

/// A text that lives as long as the program; equal ones are kept once.
fn forever(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut texts = TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    texts.get(text).copied().unwrap_or_else(|| {
        let text: &'static str = Box::leak(text.to_owned().into_boxed_str());
        texts.insert(text);
        text
    })
}

/// Confusions that live as long as the program; equal lists are kept once.
fn confusions_forever(list: Vec<Confusion>) -> &'static [Confusion] {
    static LISTS: Mutex<Vec<&'static [Confusion]>> = Mutex::new(Vec::new());
    let mut lists = LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    lists.iter().find(|known| ***known == *list).copied().unwrap_or_else(|| {
        let list: &'static [Confusion] = list.leak();
        lists.push(list);
        list
    })
}

/// Makes the effect of a table.
pub(crate) fn open(own: &EffectTable, table: Table) -> Result<LoadedEffect, Failure> {
    let (name, limit, config, library) = (own.offer.name, own.offer.limits.open, c_config(&table), own.clone());
    let call = move || {
        let mut buffer = Buffer::<MESSAGE>::new();
        let message = buffer.abi();
        let (family, excitation, confusions) = (std::ptr::null(), std::ptr::null(), std::ptr::null());
        let mut raw = abi::EffectInfo { family, excitation, confusions, n_confusions: 0, stage: 0, reserved: 0 };
        let mut pointer = std::ptr::null_mut();
        // SAFETY: a text with its NUL, and places to write that live until the call returns.
        let status = unsafe { (library.open)(config.as_ptr(), &raw mut raw, &raw mut pointer, &raw const message) };
        outcome(status, &buffer)?;
        let handle = Arc::new(Handle { pointer, table: library });
        // SAFETY: `open` succeeded, and the handle is open.
        let said = unsafe { describe(&raw, handle.table.offer.name) };
        said.map(|said| (handle, said)).map_err(|e| Failure::new(abi::DRIVER, format!("`open` broke its contract: {e}")))
    };
    let late = |late| Err(Failure::new(abi::DRIVER, own.offer.not_returned("opening it", late)));
    let (handle, (stage, family, excitation, confusions)) = within(name, limit, call).unwrap_or_else(late)?;
    let (first, more, calls) = (OnceLock::new(), RwLock::new(Vec::new()), Calls::new(name));
    Ok(LoadedEffect { handle, table, stage, family, excitation, confusions, first, more, calls })
}

type Description = (Stage, &'static str, &'static str, &'static [Confusion]);

/// # Safety
/// `raw` was written by a successful `open` whose handle is open.
unsafe fn describe(raw: &abi::EffectInfo, name: &'static str) -> Result<Description, String> {
    let stage = usize::try_from(raw.stage).ok().and_then(|i| STAGES.get(i).copied());
    let stage = stage.ok_or_else(|| format!("stage {} does not exist: there are 0 to {}", raw.stage, STAGES.len() - 1))?;
    // SAFETY: as the caller vouches.
    unsafe {
        let family = if raw.family.is_null() { name } else { forever(&read::name(raw.family, "family")?) };
        let excitation = forever(&read::name(raw.excitation, "excitation")?);
        let list = read::array(raw.confusions, raw.n_confusions, "confusions")?.into_iter();
        let confusion = |c: abi::Confusion| {
            let (with, because) = (read::name(c.with, "a confusion")?, read::name(c.because, "why it is confused")?);
            Ok(Confusion { with: forever(&with), because: forever(&because) })
        };
        let list = list.map(confusion).collect::<Result<Vec<_>, String>>()?;
        Ok((stage, family, excitation, confusions_forever(list)))
    }
}

/// Lets the library suit its effect to a scene. What fails makes the effect inapplicable, with the reason.
fn prepare(handle: &Arc<Handle>, scene: &Scene) -> Prepared {
    let key = Key {
        frame: frame_number(scene.frame),
        half_track: scene.frame.half_track().to_bits(),
        wheel_radius: scene.wheel_radius,
        scales: scene.scales.clone(),
    };
    let none = |reason: String| Prepared {
        pointer: std::ptr::null_mut(),
        // Nothing was prepared, so nothing may be released.
        handle: Arc::new(Handle {
            pointer: std::ptr::null_mut(),
            table: EffectTable { release: nothing, close: nothing, ..handle.table.clone() },
        }),
        _scene: SceneForC::new(scene),
        key: key.clone(),
        inapplicable: Some(format!("plugin effect `{}`: {reason}", handle.table.offer.name)),
        parameters: Vec::new(),
        starts: Vec::new(),
        states: 0,
    };
    if scene.inputs.len() > CHANNELS || scene.outputs.len() > CHANNELS {
        return none(format!("it acts on {CHANNELS} inputs and as many outputs at most"));
    }
    let (own, passed, with) = (handle.clone(), SceneForC::new(scene), key.clone());
    let call = move || {
        let mut buffer = Buffer::<MESSAGE>::new();
        let message = buffer.abi();
        let mut raw = abi::PreparedInfo {
            inapplicable: std::ptr::null(),
            parameters: std::ptr::null(),
            starts: std::ptr::null(),
            n_parameters: 0,
            n_starts: 0,
            n_states: 0,
        };
        let mut pointer = std::ptr::null_mut();
        // SAFETY: an open handle, a scene that lives until `release`, and places to write that live until the call returns.
        let status = unsafe { (own.table.prepare)(own.pointer, &raw const passed.raw, &raw mut raw, &raw mut pointer, &raw const message) };
        outcome(status, &buffer)?;
        let mut prepared = Prepared {
            pointer,
            handle: own,
            _scene: passed,
            key: with,
            inapplicable: None,
            parameters: Vec::new(),
            starts: Vec::new(),
            states: raw.n_states,
        };
        // SAFETY: `prepare` succeeded, and nothing was released.
        let read = unsafe { prepared.read(&raw) };
        read.map(|()| prepared).map_err(|e| Failure::new(abi::DRIVER, format!("`prepare` broke its contract: {e}")))
    };
    let late = |late| Err(Failure::new(abi::DRIVER, handle.table.offer.not_returned("suiting it to a recording", late)));
    let done = within(handle.table.offer.name, handle.table.offer.limits.open, call).unwrap_or_else(late);
    done.unwrap_or_else(|failure| none(failure.text))
}

/// Ends nothing.
unsafe extern "C" fn nothing(_: *mut c_void) {}

impl Prepared {
    /// Copies what a library says of its effect on this scene.
    ///
    /// # Safety
    /// `raw` was written by the `prepare` that made this.
    unsafe fn read(&mut self, raw: &abi::PreparedInfo) -> Result<(), String> {
        // SAFETY: as the caller vouches.
        unsafe {
            if !raw.inapplicable.is_null() {
                self.inapplicable = Some(read::name(raw.inapplicable, "inapplicable")?);
                self.states = 0;
                return Ok(());
            }
            if raw.n_parameters > 256 || raw.n_states > 4096 {
                return Err(format!("{} parameters and {} states cannot be meant", raw.n_parameters, raw.n_states));
            }
            for (i, p) in read::array(raw.parameters, raw.n_parameters, "parameters")?.into_iter().enumerate() {
                let (name, unit) =
                    (read::name(p.name, &format!("parameters[{i}].name"))?, read::name(p.unit, &format!("parameters[{i}].unit"))?);
                let mut parameter = EffectParameter::new(&name, &unit, (p.lower, p.upper), p.scale);
                parameter.neutral = (!p.neutral.is_nan()).then_some(p.neutral);
                if !p.label_kind.is_null() {
                    parameter.label = Some((forever(&read::name(p.label_kind, "label_kind")?), read::name(p.label, "label")?));
                }
                self.parameters.push(parameter);
            }
            let n = self.parameters.len();
            for start in read::array(raw.starts, raw.n_starts, "starts")? {
                let values = read::array(start.values, n, "the values of a start")?;
                let places = read::array(start.columns, n, "the columns of a start")?;
                let count = places.iter().copied().max().unwrap_or(-1).max(-1) + 1;
                if count as usize > n {
                    return Err(format!("a start has a column {} for {n} parameters", count - 1));
                }
                let of = |column: i32| (0..n).filter(|i| places[*i] == column).collect();
                self.starts.push(Start { values, columns: (0..count).map(of).collect(), linear: start.linear != 0 });
            }
        }
        Ok(())
    }
}

/// A simulation's past for a library's sensor.
struct PastOfHost<'a> {
    past: &'a dyn Fn(f64, &mut [f64]),
    outputs: usize,
}

unsafe extern "C" fn past(host: *const c_void, time: f64, outputs: *mut f64) {
    // SAFETY: the library gives back what `measure` handed it, during the call, and room for the outputs.
    unsafe {
        let host = &*host.cast::<PastOfHost<'_>>();
        (host.past)(time, std::slice::from_raw_parts_mut(outputs, host.outputs));
    }
}

impl LoadedEffect {
    /// What the library prepared for a scene.
    fn on<R>(&self, scene: &Scene, then: impl FnOnce(&Prepared) -> R) -> R {
        let first = self.first.get_or_init(|| prepare(&self.handle, scene));
        if first.key.is(scene) {
            return then(first);
        }
        let known = self.more.read().unwrap_or_else(PoisonError::into_inner).iter().find(|p| p.key.is(scene)).cloned();
        let prepared = known.unwrap_or_else(|| {
            let new = Arc::new(prepare(&self.handle, scene));
            let mut more = self.more.write().unwrap_or_else(PoisonError::into_inner);
            if more.len() >= SCENES {
                more.remove(0);
            }
            more.push(new.clone());
            new
        });
        then(&prepared)
    }

    /// Calls a hook with the instant as the header has it; `None` where the numbers given do not fit the effect.
    fn hook<R>(&self, p: &[f64], at: &Instant<'_>, states: usize, call: impl FnOnce(&Prepared, *const abi::Instant) -> R) -> Option<R> {
        self.on(at.scene, |prepared| {
            let stretch = at.stretch;
            let (n, m) = (stretch.inputs.len(), stretch.outputs.len());
            let fits = p.len() == prepared.parameters.len() && states == prepared.states && prepared.inapplicable.is_none();
            if !fits || n > CHANNELS || m > CHANNELS {
                return None;
            }
            let (mut inputs, mut outputs) = ([std::ptr::null(); CHANNELS], [std::ptr::null(); CHANNELS]);
            inputs.iter_mut().zip(&stretch.inputs).for_each(|(to, column)| *to = column.as_ptr());
            outputs.iter_mut().zip(&stretch.outputs).for_each(|(to, column)| *to = column.as_ptr());
            let track = |values: &Vec<f64>| if values.len() == stretch.len() { values.as_ptr() } else { std::ptr::null() };
            let course = abi::Stretch {
                time: stretch.time.as_ptr(),
                inputs: inputs.as_ptr(),
                outputs: outputs.as_ptr(),
                heading: track(&at.track.heading),
                distance_left: track(&at.track.distance[0]),
                distance_right: track(&at.track.distance[1]),
                rows: stretch.len(),
            };
            let now = abi::Instant {
                time: at.time,
                span: at.span,
                row: at.row,
                stretch: &raw const course,
                interval_mean: u32::from(at.readout == Readout::IntervalMean),
                reserved: 0,
            };
            Some(self.calls.count(|| call(prepared, &raw const now)))
        })
    }

    /// As [`hook`](Self::hook); what was to be changed says where the numbers do not fit.
    fn change(
        &self,
        p: &[f64],
        at: &Instant<'_>,
        states: usize,
        changed: &mut [f64],
        call: impl FnOnce(&Prepared, *const abi::Instant, *mut f64),
    ) {
        if self.hook(p, at, states, |prepared, now| call(prepared, now, changed.as_mut_ptr())).is_none() {
            changed.fill(f64::NAN);
        }
    }
}

impl Serialize for LoadedEffect {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        settings(&self.table, serializer)
    }
}

// Not by `#[typetag::serde]`: see the registry.
impl Effect for LoadedEffect {
    fn name(&self) -> &str {
        self.handle.table.offer.name
    }

    fn about(&self) -> String {
        self.handle.table.offer.about.clone()
    }

    fn stage(&self) -> Stage {
        self.stage
    }

    fn family(&self) -> &str {
        self.family
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        self.on(scene, |prepared| prepared.inapplicable.clone())
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        self.on(scene, |prepared| prepared.parameters.clone())
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        self.on(scene, |prepared| prepared.starts.clone())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let numbers = values.iter().map(|e| {
            let (lower, upper) = e.ci95.unwrap_or((f64::NAN, f64::NAN));
            abi::Estimate { value: e.value, lower, upper }
        });
        let numbers: Vec<abi::Estimate> = numbers.collect();
        self.on(scene, |prepared| {
            let mut buffer = Buffer::<MESSAGE>::new();
            let message = buffer.abi();
            if numbers.len() != prepared.parameters.len() || prepared.inapplicable.is_some() {
                return String::new();
            }
            // SAFETY: what `prepare` made, one estimate a parameter, and a buffer that lives until the call returns.
            let status =
                self.calls.count(|| unsafe { (self.handle.table.statement)(prepared.pointer, numbers.as_ptr(), &raw const message) });
            outcome(status, &buffer).map_or_else(|failure| failure.text, |()| buffer.text())
        })
    }

    fn excitation(&self) -> &'static str {
        self.excitation
    }

    fn confusions(&self) -> &'static [Confusion] {
        self.confusions
    }

    fn states(&self, scene: &Scene) -> usize {
        self.on(scene, |prepared| prepared.states)
    }

    fn begin(&self, p: &[f64], at: &Instant<'_>, inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        state.fill(0.0);
        let Some(begin) = self.handle.table.hooks.begin else { return };
        self.change(p, at, state.len(), state, |prepared, now, state| {
            // SAFETY: what `prepare` made, one value a parameter, channel and state, and an instant of this call; so below.
            unsafe { begin(prepared.pointer, p.as_ptr(), now, inputs.as_ptr(), outputs.as_ptr(), state) }
        });
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, state: &[f64]) -> f64 {
        let Some(next) = self.handle.table.hooks.next_switch else { return f64::INFINITY };
        // SAFETY: as in `begin`.
        let time = self.hook(p, at, state.len(), |prepared, now| unsafe { next(prepared.pointer, p.as_ptr(), now, state.as_ptr()) });
        time.unwrap_or(f64::NAN)
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        let Some(command) = self.handle.table.hooks.command else { return };
        self.change(p, at, state.len(), u, |prepared, now, u| {
            // SAFETY: as in `begin`.
            unsafe { command(prepared.pointer, p.as_ptr(), now, outputs.as_ptr(), state.as_mut_ptr(), u) }
        });
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], state: &[f64], load: &mut [f64]) {
        let Some(add) = self.handle.table.hooks.load else { return };
        self.change(p, at, state.len(), load, |prepared, now, load| {
            // SAFETY: as in `begin`.
            unsafe { add(prepared.pointer, p.as_ptr(), now, outputs.as_ptr(), state.as_ptr(), load) }
        });
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        let Some(change) = self.handle.table.hooks.drive else { return };
        self.change(p, at, state.len(), drive, |prepared, now, drive| {
            let motion = told(motion);
            // SAFETY: as in `begin`.
            unsafe { change(prepared.pointer, p.as_ptr(), now, &raw const motion, state.as_ptr(), drive) }
        });
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        let Some(advance) = self.handle.table.hooks.advance else { return };
        self.change(p, at, state.len(), state, |prepared, now, state| {
            let motion = told(motion);
            // SAFETY: as in `begin`.
            unsafe { advance(prepared.pointer, p.as_ptr(), now, &raw const motion, drive.as_ptr(), state) }
        });
    }

    fn measure(&self, p: &[f64], at: &Instant<'_>, earlier: &dyn Fn(f64, &mut [f64]), state: &mut [f64], outputs: &mut [f64]) {
        let Some(measure) = self.handle.table.hooks.measure else { return };
        let host = PastOfHost { past: earlier, outputs: outputs.len() };
        self.change(p, at, state.len(), outputs, |prepared, now, outputs| {
            // SAFETY: as in `begin`; the past lives until the call returns.
            unsafe { measure(prepared.pointer, p.as_ptr(), now, past, (&raw const host).cast(), state.as_mut_ptr(), outputs) }
        });
    }

    fn typetag_name(&self) -> &'static str {
        self.handle.table.offer.name
    }

    fn typetag_deserialize(&self) {}
}

/// A motion as a library is told of it.
fn told(motion: &Motion<'_>) -> abi::Motion {
    let Motion { u, outputs, inertia, drag, held } = motion;
    abi::Motion { u: u.as_ptr(), outputs: outputs.as_ptr(), inertia: inertia.as_ptr(), drag: drag.as_ptr(), held: held.as_ptr() }
}
