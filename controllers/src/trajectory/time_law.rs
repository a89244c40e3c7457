//! How fast to run along a curve: as fast as speed limits along it and one acceleration allow, from rest to rest, then
//! smoothed so that the acceleration does not jump.

/// Instants at which the smoothed law is kept.
const INSTANTS: usize = 2000;
/// Length of the smoothing window, as a share of the time that the top speed takes to be reached.
const SMOOTHING: f64 = 0.5;

/// A monotone parameter u(t) with u' ≥ 0, piecewise cubic with continuous u''.
#[derive(Debug, Clone)]
pub(super) struct TimeLaw {
    step: f64,
    u: Vec<f64>,
    u_dot: Vec<f64>,
    u_ddot: Vec<f64>,
}

/// The curve at equally spaced values of its parameter.
pub(super) struct Course<'a> {
    /// Distance between neighbouring values of the parameter.
    pub(super) spacing: f64,
    /// Arc length per parameter at each.
    pub(super) stretch: &'a [f64],
    /// Largest speed at each \[m/s\].
    pub(super) speed: &'a [f64],
    /// Largest change of speed \[m/s²\].
    pub(super) acceleration: f64,
}

impl TimeLaw {
    /// The law of a course.
    pub(super) fn along(course: &Course<'_>) -> Self {
        let time = times(course);
        let end = course.spacing * (time.len() - 1) as f64;
        let duration = time[time.len() - 1];
        let fastest = course.speed.iter().copied().fold(0.0, f64::max);
        let window = (SMOOTHING * fastest / course.acceleration).min(0.25 * duration);
        let step = (duration + window) / INSTANTS as f64;
        // A mean over the window of a law that waits at both ends: the derivative of the parameter, smoothed.
        let waiting = |t: f64| interpolate(&time, course.spacing, t);
        let u_dot = |k: usize| {
            let t = step * k as f64;
            (waiting(t) - waiting(t - window)) / window
        };
        let mean: Vec<f64> = (0..=INSTANTS).map(u_dot).collect();
        let at = |k: i64| usize::try_from(k).ok().and_then(|k| mean.get(k)).copied().unwrap_or(0.0);
        let mut u_ddot: Vec<f64> = (0..=INSTANTS as i64).map(|k| (at(k + 1) - at(k - 1)) / (2.0 * step)).collect();
        (u_ddot[0], u_ddot[INSTANTS]) = (0.0, 0.0);
        Self::integrate(step, u_ddot, end)
    }

    /// u and u' from u'', which is linear between instants; all scaled so that u ends at `end`.
    fn integrate(step: f64, mut u_ddot: Vec<f64>, end: f64) -> Self {
        let (mut u, mut u_dot) = (vec![0.0], vec![0.0]);
        for k in 0..u_ddot.len() - 1 {
            u.push(u[k] + step * u_dot[k] + step * step * (2.0 * u_ddot[k] + u_ddot[k + 1]) / 6.0);
            u_dot.push(u_dot[k] + 0.5 * step * (u_ddot[k] + u_ddot[k + 1]));
        }
        let factor = end / u[u.len() - 1];
        [&mut u, &mut u_dot, &mut u_ddot].into_iter().flatten().for_each(|x| *x *= factor);
        Self { step, u, u_dot, u_ddot }
    }

    /// Time at which the end is reached \[s\].
    pub(super) fn duration(&self) -> f64 {
        self.step * (self.u.len() - 1) as f64
    }

    /// u, u' and u'' at a time; at rest before and after.
    pub(super) fn at(&self, t: f64) -> [f64; 3] {
        let last = self.u.len() - 1;
        if t <= 0.0 {
            return [0.0; 3];
        }
        if t >= self.duration() {
            return [self.u[last], 0.0, 0.0];
        }
        let k = ((t / self.step) as usize).min(last - 1);
        let s = t - self.step * k as f64;
        let (a, jerk) = (self.u_ddot[k], (self.u_ddot[k + 1] - self.u_ddot[k]) / self.step);
        [self.u[k] + s * (self.u_dot[k] + s * (0.5 * a + s * jerk / 6.0)), self.u_dot[k] + s * (a + 0.5 * s * jerk), a + s * jerk]
    }
}

/// When each value of the parameter is passed, from rest to rest: v² may grow by 2aΔs either way.
fn times(course: &Course<'_>) -> Vec<f64> {
    let n = course.speed.len();
    let piece = |i: usize| 0.5 * (course.stretch[i] + course.stretch[i + 1]) * course.spacing;
    let reach = |v: f64, i: usize| (v * v + 2.0 * course.acceleration * piece(i)).sqrt();
    let mut speed = course.speed.to_vec();
    (speed[0], speed[n - 1]) = (0.0, 0.0);
    for i in 0..n - 1 {
        speed[i + 1] = speed[i + 1].min(reach(speed[i], i));
    }
    for i in (0..n - 1).rev() {
        speed[i] = speed[i].min(reach(speed[i + 1], i));
    }
    let mut time = vec![0.0];
    for i in 0..n - 1 {
        time.push(time[i] + 2.0 * piece(i) / (speed[i] + speed[i + 1]));
    }
    time
}

/// The parameter at a time, linear between the instants at which its values are passed.
fn interpolate(time: &[f64], spacing: f64, t: f64) -> f64 {
    let last = time.len() - 1;
    let after = time.partition_point(|passed| *passed <= t);
    match after {
        0 => 0.0,
        i if i > last => spacing * last as f64,
        i => spacing * ((i - 1) as f64 + (t - time[i - 1]) / (time[i] - time[i - 1])),
    }
}
