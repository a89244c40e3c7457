//! Wheels, axes and channels of a command as parts on which one law acts, part by part.

use serde::{Deserialize, Serialize};
use wheelwright_core::effect::{EffectParameter, Frame, Scene, Start};

use super::force::Wheel;

/// One axis of a body's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// Forward.
    V,
    /// Turning.
    Omega,
}

impl Axis {
    /// 0 forward, 1 turning.
    pub(super) fn index(self) -> usize {
        self as usize
    }

    /// `v` or `omega`.
    pub(super) fn name(self) -> &'static str {
        ["v", "omega"][self.index()]
    }

    /// In a sentence.
    pub(super) fn word(self) -> &'static str {
        ["forward", "turning"][self.index()]
    }
}

/// How a command is cut into parts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cut {
    /// Left and right with one parameter for both.
    Wheels(Frame),
    /// Forward and turning, each with a parameter of its own.
    Axes(Frame),
    /// Channel by channel, each with a parameter of its own.
    Channels,
}

/// The parts of a command that an effect acts on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Parts {
    cut: Cut,
    only: Option<usize>,
}

/// One parameter's part: what it is called and how large its commands are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    /// Unit of its command.
    pub(super) unit: String,
    /// Root mean square of its command.
    pub(super) typical: f64,
    /// Largest magnitude of its command.
    pub(super) largest: f64,
    label: Option<(&'static str, String)>,
    /// `a wheel's`, `the left wheel's`, `the forward`, `the throttle`: before the word "command".
    pub(super) whose: String,
}

impl Part {
    /// A parameter of this part.
    pub(super) fn parameter(&self, name: &str, unit: &str, bounds: (f64, f64), scale: f64) -> EffectParameter {
        EffectParameter { label: self.label.clone(), ..EffectParameter::new(name, unit, bounds, scale) }
    }
}

impl Parts {
    /// The wheels, or one of them, or one axis; where wheels are not known, all channels.
    pub(super) fn of(frame: Frame, wheel: Option<Wheel>, axis: Option<Axis>) -> Self {
        match (frame, wheel, axis) {
            (Frame::Channels, ..) => Self { cut: Cut::Channels, only: None },
            (_, None, Some(axis)) => Self { cut: Cut::Axes(frame), only: Some(axis.index()) },
            (_, wheel, _) => Self { cut: Cut::Wheels(frame), only: wheel.map(Wheel::index) },
        }
    }

    /// Both axes, or one of them; where commands are not those of axes, all channels.
    pub(super) fn axes(frame: Frame, axis: Option<Axis>) -> Self {
        match frame {
            Frame::Body { .. } => Self { cut: Cut::Axes(frame), only: axis.map(Axis::index) },
            _ => Self { cut: Cut::Channels, only: None },
        }
    }

    /// Why these settings cannot be had on a frame.
    pub(super) fn refuse(frame: Frame, wheel: Option<Wheel>, axis: Option<Axis>) -> Option<String> {
        if wheel.is_some() && axis.is_some() {
            return Some("it is set to a wheel and to an axis: it acts on one of them".to_owned());
        }
        if wheel.is_some() && !frame.has_wheels() {
            return Some("the model's channels do not tell the wheels' commands".to_owned());
        }
        (axis.is_some() && !matches!(frame, Frame::Body { .. }))
            .then(|| "the model is not commanded by forward and angular velocity".to_owned())
    }

    /// Numbers of parts, of which each may have states, in a scene.
    pub(super) fn count(scene: &Scene) -> usize {
        scene.inputs.len()
    }

    /// Left and right, or forward and turning, of a pair of commands.
    #[inline]
    fn pair(self, u: &[f64]) -> Option<[f64; 2]> {
        match self.cut {
            Cut::Channels => None,
            Cut::Wheels(frame) => Some(frame.wheels(u)),
            Cut::Axes(frame) => Some(frame.body(u)),
        }
    }

    /// The number of a part's parameter, if the effect acts on the part.
    #[inline]
    pub(super) fn parameter_of(self, part: usize) -> Option<usize> {
        match (self.cut, self.only) {
            (Cut::Channels, _) | (Cut::Axes(_), None) => Some(part),
            (Cut::Wheels(_), None) => Some(0),
            (_, Some(only)) => (only == part).then_some(0),
        }
    }

    /// Looks at each part of a command: its number and value.
    pub(super) fn look(self, u: &[f64], look: impl FnMut((usize, f64))) {
        match self.pair(u) {
            None => u.iter().copied().enumerate().for_each(look),
            Some(pair) => pair.into_iter().enumerate().filter(|(i, _)| self.parameter_of(*i).is_some()).for_each(look),
        }
    }

    /// Replaces each part of a command: `change` gets the number of the part, the number of its parameter and its value.
    #[inline]
    pub(super) fn change(self, u: &mut [f64], mut change: impl FnMut(usize, usize, f64) -> f64) {
        let Some(pair) = self.pair(u) else {
            u.iter_mut().enumerate().for_each(|(i, u)| *u = change(i, i, *u));
            return;
        };
        // By the difference, so that what does nothing changes nothing.
        let mut difference = [0.0; 2];
        for (i, (difference, command)) in difference.iter_mut().zip(pair).enumerate() {
            *difference = self.parameter_of(i).map_or(0.0, |p| change(i, p, command) - command);
        }
        let difference = match self.cut {
            Cut::Wheels(frame) => frame.from_wheels(difference),
            Cut::Axes(frame) => frame.from_body(difference),
            Cut::Channels => difference,
        };
        u.iter_mut().zip(difference).for_each(|(u, d)| *u += d);
    }

    /// The parts that have a parameter, in its order.
    pub(super) fn list(self, scene: &Scene) -> Vec<Part> {
        let sizes = &scene.scales;
        let channel = |i: usize, label: (&'static str, String), whose: String| Part {
            unit: scene.inputs[i].unit.to_string(),
            typical: sizes.inputs[i],
            largest: sizes.largest[i],
            label: Some(label),
            whose,
        };
        match self.cut {
            Cut::Channels => (0..scene.inputs.len())
                .map(|i| channel(i, ("input", scene.inputs[i].name.to_string()), format!("the `{}`", scene.inputs[i].name)))
                .collect(),
            Cut::Axes(_) => [Axis::V, Axis::Omega]
                .into_iter()
                .filter(|a| self.only.is_none_or(|only| only == a.index()))
                .map(|a| channel(a.index(), ("axis", a.name().to_owned()), format!("the {}", a.word())))
                .collect(),
            Cut::Wheels(_) => {
                let side = self.only.map(|i| [Wheel::Left, Wheel::Right][i].word());
                vec![Part {
                    unit: scene.inputs[0].unit.to_string(),
                    typical: sizes.command,
                    largest: sizes.largest_command,
                    label: side.map(|s| ("wheel", s.to_owned())),
                    whose: side.map_or("a wheel's".to_owned(), |s| format!("the {s} wheel's")),
                }]
            }
        }
    }
}

/// Starts at which every parameter is the same share of its own size.
pub(super) fn shares(sizes: &[f64], shares: &[f64]) -> Vec<Start> {
    let at = |share: &f64| Start {
        values: sizes.iter().map(|size| share * size).collect(),
        columns: (0..sizes.len()).map(|i| vec![i]).collect(),
        linear: false,
    };
    shares.iter().map(at).collect()
}

/// Starts on the grid of all pairs of shares of two parameters' sizes: the axes of a robot have nothing to do with each other.
pub(super) fn pairs(sizes: [f64; 2], shares: &[f64]) -> Vec<Start> {
    let at = |a: f64, b: f64| Start { values: vec![a * sizes[0], b * sizes[1]], columns: vec![vec![0], vec![1]], linear: false };
    shares.iter().flat_map(|a| shares.iter().map(move |b| at(*a, *b))).collect()
}

/// Starts for one parameter a part: along a fine grid for one, over the pairs of a coarse grid for two, together for more.
pub(super) fn part_by_part(sizes: &[f64], fine: &[f64], coarse: &[f64]) -> Vec<Start> {
    match *sizes {
        [a, b] => pairs([a, b], coarse),
        _ => shares(sizes, fine),
    }
}
