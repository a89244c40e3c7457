//! A Rust effect behind the C table.
//!
//! An effect looks at whole stretches, as built-in ones do. The library copies a stretch when a run over it begins, or finds the copy of
//! an earlier run, and keeps its number in one more state.

use std::collections::VecDeque;
use std::ffi::{CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, PoisonError, RwLock};

use wheelwright_core::Effect;
use wheelwright_core::dataset::Stretch;
use wheelwright_core::effect::{Estimate, Frame, Instant, Motion, Scales, Scene, Track};
use wheelwright_core::simulation::Readout;

use crate::abi;
use crate::export::{configured, guard, keep, slice, slice_mut};
use crate::host::effect::stage_number;
use crate::host::read;
use crate::message;
use crate::status::Failure;

/// Stretches that are kept.
const STRETCHES: usize = 256;

pub(super) fn table(name: *const c_char, about: *const c_char) -> abi::Effect {
    abi::Effect {
        name,
        about,
        keys: std::ptr::null(),
        check: Some(check),
        open: Some(open),
        prepare: Some(prepare),
        statement: Some(statement),
        begin: Some(begin),
        next_switch: Some(next_switch),
        command: Some(command),
        load: Some(load),
        drive: Some(drive),
        advance: Some(advance),
        measure: Some(measure),
        release: Some(release),
        close: Some(close),
    }
}

/// An effect with what its info points to.
struct Handle {
    effect: Arc<dyn Effect>,
    confusions: Vec<abi::Confusion>,
    _texts: Vec<CString>,
}

/// An effect on a scene, with what its info points to.
struct Prepared {
    effect: Arc<dyn Effect>,
    scene: Scene,
    inapplicable: *const c_char,
    parameters: Vec<abi::EffectParameter>,
    starts: Vec<abi::Start>,
    /// Of the effect itself.
    states: usize,
    held: RwLock<Held>,
    _texts: Vec<CString>,
    _numbers: Vec<(Vec<f64>, Vec<i32>)>,
}

/// Copies of stretches, numbered from the first that is still kept.
#[derive(Default)]
struct Held {
    first: usize,
    courses: VecDeque<Arc<(Stretch, Track)>>,
}

impl Prepared {
    fn new(effect: Arc<dyn Effect>, scene: Scene) -> Self {
        let mut texts = Vec::new();
        let inapplicable = effect.inapplicable(&scene).map_or(std::ptr::null(), |reason| keep(&reason, &mut texts));
        let (mut parameters, mut numbers, mut states) = (Vec::new(), Vec::new(), 0);
        let mut linear = Vec::new();
        if inapplicable.is_null() {
            states = effect.states(&scene);
            for p in effect.parameters(&scene) {
                let (kind, label) = p
                    .label
                    .map_or((std::ptr::null(), std::ptr::null()), |(kind, label)| (keep(kind, &mut texts), keep(&label, &mut texts)));
                parameters.push(abi::EffectParameter {
                    name: keep(&p.name, &mut texts),
                    unit: keep(&p.unit, &mut texts),
                    label_kind: kind,
                    label,
                    lower: p.bounds.0,
                    upper: p.bounds.1,
                    scale: p.scale,
                    neutral: p.neutral.unwrap_or(f64::NAN),
                });
            }
            for start in effect.starts(&scene) {
                let column = |i: usize| start.columns.iter().position(|c| c.contains(&i)).map_or(-1, |c| c as i32);
                linear.push(start.linear);
                numbers.push(((0..start.values.len()).map(column).collect::<Vec<i32>>(), start.values));
            }
        }
        let numbers: Vec<(Vec<f64>, Vec<i32>)> = numbers.into_iter().map(|(columns, values)| (values, columns)).collect();
        let start = |((values, columns), linear): (&(Vec<f64>, Vec<i32>), bool)| abi::Start {
            values: values.as_ptr(),
            columns: columns.as_ptr(),
            linear: u32::from(linear),
            reserved: 0,
        };
        let starts = numbers.iter().zip(linear).map(start).collect();
        let held = RwLock::default();
        Self { effect, scene, inapplicable, parameters, starts, states, held, _texts: texts, _numbers: numbers }
    }

    fn info(&self) -> abi::PreparedInfo {
        abi::PreparedInfo {
            inapplicable: self.inapplicable,
            parameters: self.parameters.as_ptr(),
            starts: self.starts.as_ptr(),
            n_parameters: self.parameters.len(),
            n_starts: self.starts.len(),
            // One more for the number of the stretch.
            n_states: self.states + 1,
        }
    }

    /// The number of a stretch, copied if it is a new one.
    ///
    /// # Safety
    /// `stretch` is as the header says, for the scene's channels.
    unsafe fn hold(&self, stretch: &abi::Stretch) -> usize {
        // SAFETY: as the caller vouches.
        let course = unsafe { Course::new(stretch, &self.scene) };
        let mut held = self.held.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = held.courses.iter().position(|c| course.is(c)) {
            return held.first + known;
        }
        if held.courses.len() >= STRETCHES {
            held.courses.pop_front();
            held.first += 1;
        }
        held.courses.push_back(Arc::new(course.copy(&self.scene)));
        held.first + held.courses.len() - 1
    }

    fn course(&self, number: f64) -> Option<Arc<(Stretch, Track)>> {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        (number as usize).checked_sub(held.first).and_then(|i| held.courses.get(i).cloned())
    }
}

/// The host's columns of a stretch.
struct Course<'a> {
    time: &'a [f64],
    inputs: Vec<&'a [f64]>,
    outputs: Vec<&'a [f64]>,
    track: [&'a [f64]; 3],
}

impl<'a> Course<'a> {
    /// # Safety
    /// As [`Prepared::hold`].
    unsafe fn new(raw: &'a abi::Stretch, scene: &Scene) -> Self {
        // SAFETY: as the caller vouches; what is null is empty.
        unsafe {
            let column = |columns: *const *const f64, i: usize| slice(columns.add(i).read(), raw.rows);
            Self {
                time: slice(raw.time, raw.rows),
                inputs: (0..scene.inputs.len()).map(|i| column(raw.inputs, i)).collect(),
                outputs: (0..scene.outputs.len()).map(|i| column(raw.outputs, i)).collect(),
                track: [raw.heading, raw.distance_left, raw.distance_right].map(|values| slice(values, raw.rows)),
            }
        }
    }

    fn is(&self, (stretch, track): &(Stretch, Track)) -> bool {
        let [heading, left, right] = self.track;
        self.time == stretch.time
            && self.inputs == stretch.inputs
            && self.outputs == stretch.outputs
            && heading == track.heading
            && left == track.distance[0]
            && right == track.distance[1]
    }

    fn copy(&self, scene: &Scene) -> (Stretch, Track) {
        let own = |columns: &[&[f64]]| columns.iter().map(|c| c.to_vec()).collect();
        let [heading, left, right] = self.track.map(<[f64]>::to_vec);
        let stretch = Stretch { label: String::new(), time: self.time.to_vec(), inputs: own(&self.inputs), outputs: own(&self.outputs) };
        let from_rest = scene.from_rest(&stretch);
        (stretch, Track { heading, headed: false, distance: [left, right], from_rest, ..Track::default() })
    }
}

/// The host's scene; its tracks come with the stretches.
///
/// # Safety
/// `raw` is as the header says.
unsafe fn scene(raw: &abi::Scene) -> Result<Scene, Failure> {
    let half_track = raw.half_track;
    let frame = match raw.frame {
        0 => Frame::Body { half_track },
        1 => Frame::Sides { half_track },
        _ => Frame::Channels,
    };
    let refuse = |reason: String| Failure::new(abi::DRIVER, reason);
    // SAFETY: as the caller vouches.
    unsafe {
        Ok(Scene {
            frame,
            inputs: read::channels(raw.inputs, raw.n_inputs, "inputs").map_err(refuse)?,
            outputs: read::channels(raw.outputs, raw.n_outputs, "outputs").map_err(refuse)?,
            wheel_radius: Some(raw.wheel_radius).filter(|r| !r.is_nan()),
            scales: Scales {
                inputs: slice(raw.input_rms, raw.n_inputs).to_vec(),
                largest: slice(raw.input_largest, raw.n_inputs).to_vec(),
                outputs: slice(raw.output_rms, raw.n_outputs).to_vec(),
                speed: raw.speed,
                command: raw.command,
                largest_command: raw.largest_command,
                time: (raw.start, raw.end),
                period: raw.period,
            },
            tracks: Vec::new(),
        })
    }
}

unsafe extern "C" fn check(config: *const c_char, message: *const abi::Message) -> abi::Status {
    // SAFETY: the host's pointers are as the header says; so below.
    unsafe { super::check::<Box<dyn Effect>>(config, message) }
}

unsafe extern "C" fn open(
    config: *const c_char,
    info: *mut abi::EffectInfo,
    handle: *mut *mut c_void,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: as above.
        let effect: Arc<dyn Effect> = unsafe { configured::<Box<dyn Effect>>(config) }?.into();
        let mut texts = Vec::new();
        let (family, excitation) = (keep(effect.family(), &mut texts), keep(effect.excitation(), &mut texts));
        let confusion = |c: &wheelwright_core::effect::Confusion| abi::Confusion {
            with: keep(c.with, &mut texts),
            because: keep(c.because, &mut texts),
        };
        let confusions: Vec<abi::Confusion> = effect.confusions().iter().map(confusion).collect();
        let stage = stage_number(effect.stage());
        let opened = Box::new(Handle { effect, confusions, _texts: texts });
        let (confusions, n_confusions) = (opened.confusions.as_ptr(), opened.confusions.len());
        // SAFETY: as above.
        unsafe {
            info.write(abi::EffectInfo { family, excitation, confusions, n_confusions, stage, reserved: 0 });
            handle.write(Box::into_raw(opened).cast());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn prepare(
    handle: *const c_void,
    raw: *const abi::Scene,
    info: *mut abi::PreparedInfo,
    prepared: *mut *mut c_void,
    message: *const abi::Message,
) -> abi::Status {
    let call = || {
        // SAFETY: as above.
        unsafe {
            let handle = &*handle.cast::<Handle>();
            let made = Box::new(Prepared::new(handle.effect.clone(), scene(&*raw)?));
            info.write(made.info());
            prepared.write(Box::into_raw(made).cast());
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { guard(message, call) }
}

unsafe extern "C" fn statement(prepared: *const c_void, values: *const abi::Estimate, text: *const abi::Message) -> abi::Status {
    let call = || {
        // SAFETY: as above.
        unsafe {
            let prepared = &*prepared.cast::<Prepared>();
            let values = std::slice::from_raw_parts(values, prepared.parameters.len());
            let estimate = |e: &abi::Estimate| Estimate { value: e.value, ci95: (!e.lower.is_nan()).then_some((e.lower, e.upper)) };
            let said = prepared.effect.statement(&values.iter().map(estimate).collect::<Vec<_>>(), &prepared.scene);
            message::write(text, &said);
        }
        Ok(())
    };
    // SAFETY: as above.
    unsafe { guard(text, call) }
}

/// The arguments that all hooks share.
struct Call<'a> {
    prepared: &'a Prepared,
    p: &'a [f64],
    course: Arc<(Stretch, Track)>,
    at: abi::Instant,
}

impl Call<'_> {
    /// `None` if the stretch is not known any more: then the hook writes what is not a number.
    ///
    /// # Safety
    /// The host's pointers are as the header says; `state` is the host's too.
    unsafe fn new<'a>(prepared: *const c_void, p: *const f64, at: *const abi::Instant, state: *const f64) -> Option<Call<'a>> {
        // SAFETY: as the caller vouches.
        unsafe {
            let prepared = &*prepared.cast::<Prepared>();
            let course = prepared.course(state.add(prepared.states).read())?;
            Some(Call { prepared, p: slice(p, prepared.parameters.len()), course, at: at.read() })
        }
    }

    fn at(&self) -> Instant<'_> {
        let (stretch, track) = &*self.course;
        let readout = if self.at.interval_mean == 1 { Readout::IntervalMean } else { Readout::Instantaneous };
        let step = if self.at.span > 0.0 { 2.0 * self.at.span } else { self.prepared.scene.scales.period };
        Instant { time: self.at.time, span: self.at.span, step, row: self.at.row, stretch, track, scene: &self.prepared.scene, readout }
    }

    fn sizes(&self) -> (usize, usize, usize) {
        (self.prepared.scene.inputs.len(), self.prepared.scene.outputs.len(), self.prepared.states)
    }
}

/// Runs a hook; one that panics, or knows its stretch no more, leaves what is not a number.
fn hook(changed: &mut [f64], call: impl FnOnce(&mut [f64]) -> Option<()>) {
    let done = catch_unwind(AssertUnwindSafe(|| call(changed)));
    match done {
        Ok(Some(())) => {}
        Ok(None) => changed.fill(f64::NAN),
        Err(payload) => {
            // Dropping a payload may panic in turn.
            std::mem::forget(payload);
            changed.fill(f64::NAN);
        }
    }
}

/// Numbers of inputs, outputs and own states.
///
/// # Safety
/// `prepared` was made by `prepare`.
unsafe fn sizes(prepared: *const c_void) -> (usize, usize, usize) {
    // SAFETY: as the caller vouches.
    let prepared = unsafe { &*prepared.cast::<Prepared>() };
    (prepared.scene.inputs.len(), prepared.scene.outputs.len(), prepared.states)
}

unsafe extern "C" fn begin(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    inputs: *const f64,
    outputs: *const f64,
    state: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (n, m, own) = sizes(prepared);
        hook(slice_mut(state, own + 1), |state| {
            state[own] = (*prepared.cast::<Prepared>()).hold(&*(*at).stretch) as f64;
            let call = Call::new(prepared, p, at, state.as_ptr())?;
            call.prepared.effect.begin(call.p, &call.at(), slice(inputs, n), slice(outputs, m), &mut state[..own]);
            Some(())
        });
    }
}

unsafe extern "C" fn next_switch(prepared: *const c_void, p: *const f64, at: *const abi::Instant, state: *const f64) -> f64 {
    let mut time = [f64::NAN];
    // SAFETY: as above.
    unsafe {
        hook(&mut time, |time| {
            let call = Call::new(prepared, p, at, state)?;
            time[0] = call.prepared.effect.next_switch(call.p, &call.at(), slice(state, call.sizes().2));
            Some(())
        });
    }
    time[0]
}

unsafe extern "C" fn command(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    outputs: *const f64,
    state: *mut f64,
    u: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (n, m, own) = sizes(prepared);
        hook(slice_mut(u, n), |u| {
            let call = Call::new(prepared, p, at, state)?;
            call.prepared.effect.command(call.p, &call.at(), slice(outputs, m), slice_mut(state, own), u);
            Some(())
        });
    }
}

unsafe extern "C" fn load(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    outputs: *const f64,
    state: *const f64,
    load: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (n, m, own) = sizes(prepared);
        hook(slice_mut(load, n), |load| {
            let call = Call::new(prepared, p, at, state)?;
            call.prepared.effect.load(call.p, &call.at(), slice(outputs, m), slice(state, own), load);
            Some(())
        });
    }
}

/// The motion that the host tells, of n inputs and m outputs.
///
/// # Safety
/// `motion` is null or valid, with arrays of these lengths, as long as the call lasts.
unsafe fn seen<'a>(motion: *const abi::Motion, n: usize, m: usize) -> Option<Motion<'a>> {
    // SAFETY: as the caller promises.
    unsafe {
        let abi::Motion { u, outputs, inertia, drag, held } = *motion.as_ref()?;
        let (inertia, drag, held) = (slice(inertia, n * m), slice(drag, n * m), slice(held, n));
        Some(Motion { u: slice(u, n), outputs: slice(outputs, m), inertia, drag, held })
    }
}

unsafe extern "C" fn drive(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    motion: *const abi::Motion,
    state: *const f64,
    drive: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (n, m, own) = sizes(prepared);
        hook(slice_mut(drive, n), |drive| {
            let call = Call::new(prepared, p, at, state)?;
            call.prepared.effect.drive(call.p, &call.at(), &seen(motion, n, m)?, slice(state, own), drive);
            Some(())
        });
    }
}

unsafe extern "C" fn advance(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    motion: *const abi::Motion,
    drive: *const f64,
    state: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (n, m, own) = sizes(prepared);
        hook(slice_mut(state, own), |changed| {
            let call = Call::new(prepared, p, at, state)?;
            call.prepared.effect.advance(call.p, &call.at(), &seen(motion, n, m)?, slice(drive, n), changed);
            Some(())
        });
    }
}

unsafe extern "C" fn measure(
    prepared: *const c_void,
    p: *const f64,
    at: *const abi::Instant,
    past: abi::Past,
    host: *const c_void,
    state: *mut f64,
    outputs: *mut f64,
) {
    // SAFETY: as above.
    unsafe {
        let (_, m, own) = sizes(prepared);
        hook(slice_mut(outputs, m), |outputs| {
            let call = Call::new(prepared, p, at, state)?;
            let earlier = |time: f64, out: &mut [f64]| past(host, time, out.as_mut_ptr());
            call.prepared.effect.measure(call.p, &call.at(), &earlier, slice_mut(state, own), outputs);
            Some(())
        });
    }
}

unsafe extern "C" fn release(prepared: *mut c_void) {
    // SAFETY: it comes from `Box::into_raw` in `prepare`, and this is its last call.
    super::end(|| drop(unsafe { Box::from_raw(prepared.cast::<Prepared>()) }));
}

unsafe extern "C" fn close(handle: *mut c_void) {
    // SAFETY: the handle comes from `Box::into_raw` in `open`, and this is its last call.
    super::end(|| drop(unsafe { Box::from_raw(handle.cast::<Handle>()) }));
}
