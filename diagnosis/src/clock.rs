//! Whether commands are late or the record is: on the model's channels it is the same, and what is recorded beside them tells the time as well.
//!
//! The wheels' own rates, or a heading, show the robot's motion once more. Where the recorded velocities are behind them by all of the delay
//! that was found, or by more, of which the model's own lag took up a part, it is the record that is late; where they are in time with the wheels as
//! another sensor tells them, it is the commands, for two sensors would have to be late by the same. A heading that is in time may be their own integral,
//! and says nothing. Where the wheels' radii differ, recorded turning is mixed with forward motion, and may be as it will.

use nalgebra::{Matrix3, Vector3};
use wheelwright_core::Stretch;
use wheelwright_core::effect::Frame;

use crate::diagnose::DECISIVE;
use crate::question::Question;
use crate::select::{Search, Selected};
use crate::spans::{FEWEST, Span, spans, unwrapped};

/// The effects that are one but for the clock.
const LATE_COMMANDS: &str = "command_delay";
const LATE_RECORD: &str = "sensor_delay";
/// Shares of the delay that was found by which the record is tried to be behind: none of it first, all of it fifth.
const SHARES: [f64; 7] = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5];
const NONE: usize = 0;
const ALL: usize = 4;
/// What other sensors differ by at the least, as a share of the motion: less is the same numbers once more, which say nothing of their time.
const SAME: f64 = 1e-4;

/// What is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Late {
    Commands,
    Record,
}

/// What was told by the clock.
pub(crate) struct Told {
    late: Late,
    by: &'static str,
}

impl Told {
    /// What a person is told of it.
    pub(crate) fn remark(&self) -> String {
        match self.late {
            Late::Record => format!(
                "the recorded velocities are behind {} by the delay that was found: it is the record that is late, not the commands",
                self.by
            ),
            Late::Commands => format!(
                "the recorded velocities are in time with {}: it is the commands that are late, unless both records are late by the same",
                self.by
            ),
        }
    }

    /// Strikes off the rivals what the clock rules out.
    pub(crate) fn exclude(&self, search: &Search<'_>, selected: &mut Selected) {
        if self.late == Late::Record {
            selected.rivals.iter_mut().for_each(|rivals| rivals.retain(|r| search.effect(r.effect).name() != LATE_COMMANDS));
        }
    }
}

/// Gives what is late the name that the clock tells, if it does.
pub(crate) fn named(question: &Question<'_>, search: &Search<'_>, selected: &mut Selected) -> Option<Told> {
    let name = |member: usize| search.effect(selected.state.effects[member]).name();
    let late = |member: &usize| [LATE_COMMANDS, LATE_RECORD].contains(&name(*member));
    let member = (search.fixed(selected)..selected.state.effects.len()).find(late)?;
    let delays = search.values(&selected.state).swap_remove(member);
    let told = clocks(question).into_iter().find_map(|clock| Some(Told { late: clock.tells(question, &delays)?, by: clock.by }))?;
    let right = match told.late {
        Late::Commands => LATE_COMMANDS,
        Late::Record => LATE_RECORD,
    };
    if name(member) != right {
        *selected = search.renamed(selected, member, right)?;
    }
    Some(told)
}

/// Motion as something beside the model's outputs tells it.
struct Clock {
    by: &'static str,
    /// The outputs that it tells.
    outputs: &'static [usize],
    /// Whether it comes from another sensor, where it is not the same numbers.
    independent: bool,
    /// By stretch: one or two coordinates that what they tell, summed up, is made of.
    ways: Vec<Vec<Vec<f64>>>,
    /// Another output, which what is recorded may be mixed with where that has one coordinate only.
    mixed: Option<usize>,
}

/// The clocks of a recording. The wheels' last: their rates may be what the velocities were made of, and late with them.
fn clocks(question: &Question<'_>) -> Vec<Clock> {
    if !matches!(Frame::of(question.model, 1.0), Frame::Body { .. }) {
        return Vec::new();
    }
    let stretches = &question.training.stretches;
    let by_wheels = |rates: &Vec<[Vec<f64>; 2]>| {
        let ways = stretches.iter().zip(rates).map(|(stretch, rates)| rates.iter().map(|rate| stretch.integral(rate)).collect());
        Clock { by: "the wheels' own rates", outputs: &[0, 1], independent: true, ways: ways.collect(), mixed: None }
    };
    let by_heading = |headings: &Vec<Vec<f64>>| Clock {
        by: "the measured heading",
        outputs: &[1],
        independent: false,
        ways: headings.iter().map(|heading| vec![unwrapped(heading)]).collect(),
        mixed: Some(0),
    };
    let wheels = question.training_wheel_rates.as_ref().map(by_wheels);
    let all = question.training_headings.as_ref().map(by_heading).into_iter().chain(wheels);
    let whole = |clock: &Clock| {
        let fits = |(stretch, ways): (&Stretch, &Vec<Vec<f64>>)| ways.iter().all(|way| way.len() == stretch.len());
        clock.ways.len() == stretches.len() && stretches.iter().zip(&clock.ways).all(fits)
    };
    all.filter(whole).collect()
}

/// What an output and the one that it may be mixed with say that was covered in a span.
struct Recorded {
    moved: f64,
    mixed: f64,
    span: Span,
}

impl Clock {
    /// What is late, by the outputs that tell of it, which must not differ. `delays` is one for all outputs or one each \[s\].
    fn tells(&self, question: &Question<'_>, delays: &[f64]) -> Option<Late> {
        let of = |c: &usize| delays.get(*c).or(delays.first()).and_then(|delay| self.of_output(question, *c, *delay));
        let mut all = self.outputs.iter().filter_map(of);
        let first = all.next()?;
        all.all(|other| other == first).then_some(first)?
    }

    /// What is late by one output: nothing where it cannot tell all of the delay from none; `Some(None)` where neither is the case.
    fn of_output(&self, question: &Question<'_>, output: usize, delay: f64) -> Option<Option<Late>> {
        let stretches = &question.training.stretches;
        let moved = |output: usize| stretches.iter().map(|s| s.integral(&s.outputs[output])).collect::<Vec<_>>();
        let (own, mixed) = (moved(output), self.mixed.map(moved));
        let covered = |moved: &Vec<Vec<f64>>, span: &Span| span.covered(&stretches[span.stretch], &moved[span.stretch], 0.0);
        let recorded =
            |span: Span| Recorded { moved: covered(&own, &span), mixed: mixed.as_ref().map_or(0.0, |m| covered(m, &span)), span };
        let spans: Vec<Recorded> = spans(question.training, SHARES[SHARES.len() - 1] * delay, 0.0).into_iter().map(recorded).collect();
        let (all, left): (Vec<f64>, Vec<f64>) =
            SHARES.map(|share| self.left(question, &spans, share * delay)).into_iter().collect::<Option<Vec<_>>>()?.into_iter().unzip();
        let likelihood = |k: usize| -(spans.len() as f64) * left[k].ln();
        let differ = |a: usize, b: usize| likelihood(a) > likelihood(b) + DECISIVE;
        if !differ(NONE, ALL) && !differ(ALL, NONE) {
            return None;
        }
        let best = (0..SHARES.len()).min_by(|a, b| left[*a].total_cmp(&left[*b]))?;
        Some(match best {
            NONE if self.independent && left[NONE] > SAME * SAME * all[NONE] => Some(Late::Commands),
            ALL.. => Some(Late::Record),
            _ => None,
        })
    }

    /// Sums of squares of an output's motion over spans, and of what of it this clock, so much earlier, does not tell.
    fn left(&self, question: &Question<'_>, spans: &[Recorded], by: f64) -> Option<(f64, f64)> {
        if spans.len() < FEWEST {
            return None;
        }
        let row = |Recorded { moved, mixed, span }: &Recorded| {
            let told = |way: &Vec<f64>| span.covered(&question.training.stretches[span.stretch], way, by);
            let ways = &self.ways[span.stretch];
            (Vector3::new(ways.first().map_or(0.0, told), ways.get(1).map_or(*mixed, told), span.end - span.start), *moved)
        };
        let rows: Vec<(Vector3<f64>, f64)> = spans.iter().map(row).collect();
        let (square, right) = rows.iter().fold((Matrix3::zeros(), Vector3::zeros()), |(a, b), (x, y)| (a + x * x.transpose(), b + x * *y));
        let found = square.pseudo_inverse(f64::EPSILON * square.norm()).ok()? * right;
        let left: f64 = rows.iter().map(|(x, y)| (y - x.dot(&found)).powi(2)).sum();
        Some((rows.iter().map(|(_, y)| y * y).sum(), left.max(f64::MIN_POSITIVE)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

    use rand::SeedableRng;
    use rand::rngs::StdRng;
    use wheelwright_core::ModelConfig;
    use wheelwright_core::effect::Effect;
    use wheelwright_models::VwPdConfig;

    use super::*;
    use crate::comparison::wrapped;
    use crate::effects::{CommandDelay, QuadraticDrag, SensorDelay};
    use crate::fixture::{Case, NOISE, RADIUS, TRACK, normal, with_selected};

    /// What is late by two samples.
    const DELAY: f64 = 0.1;

    /// A robot whose velocities are recorded two samples late.
    fn late() -> Case {
        let mut case = Case::clean(6);
        case.data.stretches.iter_mut().for_each(|stretch| stretch.outputs.iter_mut().for_each(|y| y.rotate_right(2)));
        case
    }

    /// Rates of the wheels that show the recorded velocities some samples earlier, with noise of their own.
    fn rates(case: &Case, earlier: usize, noise: f64) -> Vec<[Vec<f64>; 2]> {
        let mut random = StdRng::seed_from_u64(3);
        let mut of = |y: &[Vec<f64>], side: f64| -> Vec<f64> {
            let rate = |k: usize| (y[0][k] + side * 0.5 * TRACK * y[1][k] + noise * normal(&mut random)) / RADIUS;
            (0..y[0].len()).map(|k| (k + earlier) % y[0].len()).map(rate).collect()
        };
        case.data.stretches.iter().map(|stretch| [of(&stretch.outputs, -1.0), of(&stretch.outputs, 1.0)]).collect()
    }

    fn told(case: &Case, ask: impl FnOnce(&mut Question<'_>)) -> Option<Late> {
        let model = VwPdConfig::default().build().unwrap();
        let mut question = Question::new(&*model, &case.data, &[]);
        ask(&mut question);
        clocks(&question).first()?.tells(&question, &[DELAY])
    }

    #[test]
    fn rates_that_are_ahead_by_the_delay_tell_a_late_record_and_those_in_time_late_commands() {
        let case = late();
        let by_rates =
            |earlier: usize, noise: f64| told(&case, |question| question.training_wheel_rates = Some(rates(&case, earlier, noise)));
        assert_eq!(by_rates(2, NOISE[0]), Some(Late::Record));
        assert_eq!(by_rates(0, NOISE[0]), Some(Late::Commands));
        assert_eq!(by_rates(1, NOISE[0]), None, "half of it is neither");
        assert_eq!(by_rates(0, 0.0), None, "the same numbers once more");
        assert_eq!(told(&case, |_| ()), None);
    }

    /// A heading that shows the recorded turning some samples earlier.
    fn headings(case: &Case, earlier: usize) -> Vec<Vec<f64>> {
        let of = |stretch: &Stretch| {
            let turned = stretch.integral(&stretch.outputs[1]);
            (0..turned.len()).map(|k| wrapped(turned[(k + earlier).min(turned.len() - 1)] + 3.0)).collect()
        };
        case.data.stretches.iter().map(of).collect()
    }

    #[test]
    fn a_heading_that_is_ahead_tells_a_late_record() {
        let case = late();
        let by_heading = |earlier: usize| told(&case, |question| question.training_headings = Some(headings(&case, earlier)));
        assert_eq!([by_heading(2), by_heading(0)], [Some(Late::Record), None]);
    }

    /// A part of the lateness may be the model's own: what is late by more than was found is late by all of it.
    #[test]
    fn what_is_later_than_was_found_is_late() {
        let case = late();
        let by_heading = |earlier: usize| told(&case, |question| question.training_headings = Some(headings(&case, earlier)));
        assert_eq!([by_heading(3), by_heading(1)], [Some(Late::Record), None]);
    }

    /// Recorded turning of wheels whose radii differ holds a part of the forward motion.
    #[test]
    fn a_heading_tells_a_late_record_of_wheels_whose_radii_differ() {
        let mut case = late();
        let headings = headings(&case, 2);
        for stretch in &mut case.data.stretches {
            let (v, w) = stretch.outputs.split_at_mut(1);
            w[0].iter_mut().zip(&v[0]).for_each(|(w, v)| *w += 0.3 / TRACK * v);
        }
        assert_eq!(told(&case, |question| question.training_headings = Some(headings.clone())), Some(Late::Record));
    }

    /// Velocities that are made of the wheels' rates are late with them.
    #[test]
    fn a_heading_that_is_ahead_counts_for_more_than_rates_in_time() {
        let case = late();
        let by_both = told(&case, |question| {
            question.training_headings = Some(headings(&case, 2));
            question.training_wheel_rates = Some(rates(&case, 0, NOISE[0]));
        });
        assert_eq!(by_both, Some(Late::Record));
    }

    #[test]
    fn what_is_late_gets_the_name_that_the_clock_tells() {
        let case = late();
        let library: Vec<Box<dyn Effect>> =
            vec![Box::new(CommandDelay::default()), Box::new(SensorDelay::default()), Box::new(QuadraticDrag::default())];
        let model = VwPdConfig::default().build().unwrap();
        let named_by = |earlier: usize| {
            let mut question = Question::new(&*model, &case.data, &library);
            question.training_wheel_rates = Some(rates(&case, earlier, NOISE[0]));
            let mut names = None;
            with_selected(&case, &library, 1, |search, selected| {
                let (mut selected, _) = search.settled(selected);
                let told = named(&question, search, &mut selected).unwrap();
                let rests = search.rests(&selected);
                search.twinned(&mut selected, &rests);
                told.exclude(search, &mut selected);
                let name = |i: usize| search.effect(i).name().to_owned();
                let rivals: Vec<String> = selected.rivals[0].iter().map(|r| name(r.effect)).collect();
                names = Some((name(selected.state.effects[0]), rivals));
            });
            names.unwrap()
        };
        assert_eq!(named_by(2), ("sensor_delay".to_owned(), vec![]));
        assert_eq!(named_by(0), ("command_delay".to_owned(), vec!["sensor_delay".to_owned()]));
    }
}
