//! The wheels' radius where none is known: what returns with the way that a wheel rolls tells it, and with it the track width.
//!
//! A wheel that is not round leaves a line in what the base model leaves over, once it is taken over the wheel's way instead of over time:
//! at the wave number 1/r, if the way is the wheel's, which it is with the right track only. So over the wave numbers that samples can
//! show, and over track widths where none is known, the power of the innovations is taken, weighted with the wheel's speed as geometry is:
//! twice a log-likelihood ratio with two degrees of freedom for each output. Neighbouring wave numbers tell whether it is a line, or only
//! the slow structure of something else that is missing. Nor is it one if the drive has it too: on laps everything that is missing returns
//! with every lap.
//!
//! That a wheel has one line a turn is supposed: of an oval wheel half the radius would be found.

use std::f64::consts::TAU;

use rustfft::FftPlannerScalar;
use rustfft::num_complex::Complex;
use wheelwright_core::effect::{Frame, Scene};

use crate::diagnose::{DECISIVE, Surroundings, tried};
use crate::fit::search::Fit;
use crate::fit::setting::Setting;
use crate::question::Question;
use crate::select::Search;
use crate::track::{evidence, evidence_at_first};

/// Radii of wheels \[m\]: of a robot in a hand, of a tractor.
const RADII: (f64, f64) = (0.005, 1.0);
/// Half the track \[m\], likewise.
const HALF_TRACKS: (f64, f64) = (0.02, 1.0);
/// Radius of a wheel as a share of half its track: how near to the right one a track must be follows from it, roughly.
const SLENDER: f64 = 0.25;
/// Angle by which a wheel may seem to be off its own, at the ends of what was turned, between two tracks \[rad\].
const OFF: f64 = 1.0;
/// Most tracks that are tried.
const MOST: usize = 256;
/// Samples a turn from which on a line is sought.
const SEEN: f64 = 4.0;
/// Places in the shortest wave.
const FINE: f64 = 12.0;
/// Most places along a way.
const LONGEST: f64 = 1e6;
/// Wave numbers between two that tell different things.
const DENSE: f64 = 4.0;
/// Chance that noise shows a line.
const FALSE_ALARM: f64 = 1e-3;
/// A line stands out from its neighbourhood by this factor in what an explanation leaves, as where the wheels are known; and by twice that in what
/// the base model leaves, which has structure of its own.
const CONTRAST: f64 = 4.0;
const BESIDE_STRUCTURE: f64 = 2.0 * CONTRAST;
/// What counts as neighbourhood to either side, as a share of the wave number.
const NEIGHBOURHOOD: f64 = 0.25;
/// Turns within which a line cannot be told from a wander.
const WANDER: f64 = 6.0;

/// What is known of the wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wheels {
    /// Their radius \[m\], if it is.
    pub(crate) radius: Option<f64>,
    /// The track width \[m\].
    pub(crate) track_width: f64,
}

/// A peak of the power.
#[derive(Debug, Clone, Copy)]
struct Line {
    power: f64,
    /// Where among the wave numbers, and the wave number \[rad/m\].
    at: usize,
    wave_number: f64,
    half_track: f64,
}

/// What the recording tells of the wheels, if it does: by a line of which effects that go round with wheels of this radius explain decisively
/// more than all others do at the ordinary ones.
pub(crate) fn shown(question: &Question<'_>, start: &Surroundings<'_>, headings: Option<&[Vec<f64>]>) -> Option<Wheels> {
    let Search { setting, library, open, .. } = &start.search;
    let wheels = strongest(&start.search.setting, &start.base, question.track_width.is_none(), BESIDE_STRUCTURE)?;
    let scene = Scene::new(setting.data, question.model, wheels.track_width, wheels.radius, headings);
    let round: Vec<usize> = (0..library.len()).filter(|i| !open.contains(i) && tried(&*library[*i], &scene)).collect();
    let round = evidence(start, &scene, round);
    (round > DECISIVE && round > evidence_at_first(start) + DECISIVE).then_some(wheels)
}

/// The same of what an explanation leaves over, which may show a line that was lost in what it explains.
pub(crate) fn left_over(question: &Question<'_>, setting: &Setting<'_>, explained: &Fit) -> Option<Wheels> {
    let unknown = setting.scene.wheel_radius.is_none() && !setting.exhausted();
    if unknown { strongest(setting, explained, question.track_width.is_none(), CONTRAST) } else { None }
}

/// The wheels of the strongest line in what a fit leaves over, if there is one; `any_track` if the track may be another than the scene's.
fn strongest(setting: &Setting<'_>, fit: &Fit, any_track: bool, contrast: f64) -> Option<Wheels> {
    let course = Course::of(setting, fit)?;
    let half_tracks = if any_track { course.half_tracks() } else { vec![setting.scene.frame.half_track()] };
    let waves = Waves::of(&course)?;
    let looks = (2 * half_tracks.len()) as f64 * waves.independent();
    let mut planner = FftPlannerScalar::new();
    let mut best: Option<Line> = None;
    for half_track in half_tracks {
        for side in 0..2 {
            let power = course.power(&waves, side, half_track, &mut planner, |row| row.left);
            let Some(line) = waves.line(&power, half_track, looks, contrast) else { continue };
            if best.is_none_or(|b| line.power > b.power) {
                let driven = course.power(&waves, side, half_track, &mut planner, |row| row.gained);
                best = Some(line).filter(|line| !waves.stands_out(&driven, line.at, BESIDE_STRUCTURE)).or(best);
            }
        }
    }
    best.map(|line| Wheels { radius: Some(1.0 / line.wave_number), track_width: 2.0 * line.half_track })
}

/// What every row that counts has of the two outputs.
struct Course {
    rows: Vec<Row>,
    frame: Frame,
    /// Longest way of a wheel from one end to the other, and the same of turning \[rad\].
    reach: f64,
    swing: f64,
    /// Way between two samples at the typical speed.
    step: f64,
}

struct Row {
    /// Forward way and angle since the stretch began.
    way: [f64; 2],
    /// Simulated outputs.
    outputs: [f64; 2],
    /// Innovations of both outputs, of unit variance.
    left: Complex<f64>,
    /// What both simulated outputs gained since the row before.
    gained: Complex<f64>,
}

impl Course {
    fn of(setting: &Setting<'_>, fit: &Fit) -> Option<Self> {
        let (scene, layout) = (setting.scene, &setting.layout);
        if !scene.frame.has_wheels() {
            return None;
        }
        let roots: Vec<f64> = fit.weights(setting).iter().map(|w| w.sqrt()).collect();
        let mut rows = Vec::with_capacity(layout.counted());
        for (s, track) in scene.tracks.iter().enumerate() {
            let [first, second] = [0, 1].map(|c| layout.settled(c, s));
            for (k, (i, j)) in (layout.unsettled(s)..).zip(first.zip(second)) {
                let [left, right] = [track.distance[0][k], track.distance[1][k]];
                let gain = |c: usize, at: usize| (fit.simulated[at] - fit.simulated[at - usize::from(k > 0)]) / scene.scales.outputs[c];
                rows.push(Row {
                    way: [0.5 * (left + right), 0.5 * (right - left) / scene.frame.half_track()],
                    outputs: [fit.simulated[i], fit.simulated[j]],
                    left: Complex::new(roots[0] * fit.residual[i], roots[1] * fit.residual[j]),
                    gained: Complex::new(gain(0, i), gain(1, j)),
                });
            }
        }
        let span = |of: &dyn Fn(&Row) -> f64| {
            let (least, most) = rows.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            most - least
        };
        let (forward, swing) = (span(&|r| r.way[0]), span(&|r| r.way[1]));
        let step = scene.scales.speed * scene.scales.period;
        let reach = forward + HALF_TRACKS.1.min(2.0 * scene.frame.half_track()) * swing;
        (reach > WANDER * TAU * RADII.0).then_some(Self { rows, frame: scene.frame, reach, swing, step })
    }

    /// Half tracks so near to each other that one of them has the line.
    fn half_tracks(&self) -> Vec<f64> {
        let (least, most) = HALF_TRACKS;
        let step = (2.0 * OFF * SLENDER / self.swing).min(0.1);
        let count = (((most / least).ln() / step).ceil() as usize).min(MOST);
        (0..=count).map(|i| least * (most / least).powf(i as f64 / count as f64)).collect()
    }

    /// Power of a pair of series at each wave number, both together.
    fn power(
        &self,
        waves: &Waves,
        side: usize,
        half_track: f64,
        planner: &mut FftPlannerScalar<f64>,
        of: impl Fn(&Row) -> Complex<f64>,
    ) -> Vec<f64> {
        let frame = match self.frame {
            Frame::Body { .. } => Frame::Body { half_track },
            other => other,
        };
        let sign = [-1.0, 1.0][side];
        let mut places = vec![Complex::new(0.0, 0.0); waves.places];
        let mut norm = 0.0;
        for row in &self.rows {
            let Row { way, outputs, .. } = row;
            let speed = frame.wheels(outputs)[side];
            let place = ((way[0] + sign * half_track * way[1]) / waves.grid).round().rem_euclid(waves.places as f64);
            places[(place as usize).min(waves.places - 1)] += of(row) * speed;
            norm += 0.5 * speed * speed;
        }
        planner.plan_fft_forward(waves.places).process(&mut places);
        // One transform of two real series: what is of the one and what of the other are its even and its odd part.
        let power = |k: usize| 0.5 * (places[k].norm_sqr() + places[waves.places - k].norm_sqr()) / norm.max(f64::MIN_POSITIVE);
        (0..=waves.last).map(|k| if k < waves.first { 0.0 } else { power(k) }).collect()
    }
}

/// Wave numbers as multiples of the lowest.
struct Waves {
    /// Distance of two places \[m\], and how many there are.
    grid: f64,
    places: usize,
    first: usize,
    last: usize,
    lowest: f64,
}

impl Waves {
    /// None where samples are too far apart for any wheel, or the way is absurd.
    fn of(course: &Course) -> Option<Self> {
        let highest = (1.0 / RADII.0).min(TAU / (SEEN * course.step));
        let grid = TAU / (FINE * highest);
        let length = DENSE * course.reach / grid;
        if !(1.0..=LONGEST).contains(&length) {
            return None;
        }
        let places = (length as usize).next_power_of_two();
        let lowest = TAU / (grid * places as f64);
        let slowest = (1.0 / RADII.1).max(WANDER * TAU / course.reach);
        let last = ((highest / lowest) as usize).min(places / 2);
        let first = ((slowest / lowest).ceil() as usize).max(1);
        (first < last).then_some(Self { grid, places, first, last, lowest })
    }

    /// Wave numbers that tell different things.
    fn independent(&self) -> f64 {
        (self.last - self.first + 1) as f64
    }

    /// The strongest line.
    fn line(&self, power: &[f64], half_track: f64, looks: f64, contrast: f64) -> Option<Line> {
        let (at, &largest) = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        // Four degrees of freedom by chance: e^{−x/2} (1 + x/2) beyond x.
        if 0.5 * largest - (0.5 * largest).ln_1p() < (looks / FALSE_ALARM).ln() {
            return None;
        }
        let wave_number = at as f64 * self.lowest;
        self.stands_out(power, at, contrast).then_some(Line { power: largest, at, wave_number, half_track })
    }

    /// Whether the most power about a wave number stands out from that of its neighbourhood.
    fn stands_out(&self, power: &[f64], at: usize, contrast: f64) -> bool {
        let width = (2.0 * DENSE) as usize;
        let reach = ((NEIGHBOURHOOD * at as f64) as usize).max(4 * width);
        let around = at.saturating_sub(reach).max(self.first)..(at + reach + 1).min(power.len());
        let (own, mut near): (Vec<usize>, Vec<usize>) = around.partition(|k| k.abs_diff(at) <= width);
        near.sort_by(|a, b| power[*a].total_cmp(&power[*b]));
        let usual = near.get(near.len() * 9 / 10).map_or(0.0, |k| power[*k]);
        own.into_iter().any(|k| power[k] > contrast * usual)
    }
}

#[cfg(test)]
mod tests {
    use super::{Course, Frame, Waves};

    #[test]
    fn where_no_wheel_could_show_none_is_sought() {
        let of = |reach: f64, step: f64| Waves::of(&Course { rows: Vec::new(), frame: Frame::Channels, reach, swing: 0.0, step });
        assert!(of(50.0, 0.01).is_some_and(|waves| waves.first < waves.last && waves.last < waves.places));
        for (reach, step) in [(0.2, 10.0), (50.0, 30.0), (1e300, 0.01), (f64::INFINITY, 0.01), (f64::NAN, 0.01)] {
            assert!(of(reach, step).is_none(), "{reach} {step}");
        }
    }
}
