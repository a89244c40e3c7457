//! What goes into a case.

use crate::draw::excitation::{MANNERS, Manner};
use crate::draw::robot::Kind;
use crate::draw::{log_uniform, pick, stream};
use crate::firmware::control::Style;
use crate::hidden::forms::FORMS;
use crate::hidden::outside::OUTSIDE;
use crate::hidden::{EFFECTS, combine};
use crate::referee::key::Origin;
use crate::sensors::noise::Character;
use rand::Rng;
use rand::rngs::StdRng;

/// One effect of a recipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ingredient {
    /// Its name.
    pub name: &'static str,
    /// Number of another form in [`FORMS`].
    pub form: Option<usize>,
    /// How strong.
    pub strength: f64,
}

/// What kind of case it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sort {
    /// Nothing hidden.
    Nothing,
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// One effect in another physical form.
    OtherForm,
    /// A cause outside the library.
    Outside,
    /// The commands written are those of another drive.
    Stranger,
}

impl Sort {
    /// The word the key uses.
    pub fn word(self) -> &'static str {
        match self {
            Sort::Nothing => "none",
            Sort::Single => "single",
            Sort::Pair => "pair",
            Sort::OtherForm => "other_form",
            Sort::Outside | Sort::Stranger => "outside",
        }
    }
}

/// Everything about a case before it is built.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Where it comes from.
    pub origin: Origin,
    /// What kind of case.
    pub sort: Sort,
    /// What is hidden.
    pub effects: Vec<Ingredient>,
    /// Number of a cause in [`OUTSIDE`], and its strength.
    pub outside: Option<(usize, f64)>,
    /// Robot.
    pub kind: Kind,
    /// Control law, where the kind's own is overridden.
    pub style: Option<Style>,
    /// Driving while training and validating.
    pub manner: [Manner; 2],
    /// Rows a second.
    pub rate: f64,
    /// Lengths of the two recordings \[s\].
    pub length: [f64; 2],
    /// Share of rows that are lost.
    pub lost: f64,
    /// Noise.
    pub noise: Character,
    /// Its size per channel, over the signal's root mean square.
    pub level: [f64; 2],
    /// Whether pose is recorded, and wrapped.
    pub pose: (bool, bool),
    /// Whether wheel speeds are recorded.
    pub wheels: bool,
    /// Whether the robot's dimensions are given.
    pub profile: bool,
}

const STRENGTHS: [f64; 6] = [0.1, 0.2, 0.3, 0.5, 0.8, 1.0];

/// Effects that show only where wheel speeds are recorded beside the body's.
const NEED_WHEELS: [&str; 2] = ["track_width_error", "wheel_radius_mismatch"];

impl Recipe {
    /// Writes a recipe, the `turn`th of its sort in its set: what it holds goes round through all there is of that sort, beginning anywhere.
    pub fn write(sort: Sort, turn: usize, origin: Origin) -> Recipe {
        let mut rng = stream(origin.seed, &[word_number(&origin.set), origin.index as u64, 1]);
        let rng = &mut rng;
        let index = turn + (stream(origin.seed, &[word_number(&origin.set)]).random::<u32>() % 1000) as usize;
        let strength = *pick(rng, &STRENGTHS);
        let effects = match sort {
            Sort::Nothing | Sort::Outside | Sort::Stranger => Vec::new(),
            Sort::Single => vec![Ingredient { name: EFFECTS[index % EFFECTS.len()].name, form: None, strength }],
            Sort::Pair => pair(rng),
            Sort::OtherForm => {
                let form = index % FORMS.len();
                vec![Ingredient { name: FORMS[form].effect, form: Some(form), strength: strength.max(0.2) }]
            }
        };
        let outside = (sort == Sort::Outside).then(|| (index % OUTSIDE.len(), strength.max(0.2)));
        let manner = MANNERS[(index + index / EFFECTS.len()) % MANNERS.len()];
        let manner = [manner, manner.another(rng)];
        let kind = *pick(rng, &[Kind::Random, Kind::Random, Kind::Pioneer, Kind::Khepera]);
        let sagging = effects.iter().any(|e| e.name == "battery_sag");
        let style = (sagging && rng.random::<f64>() < 0.6).then_some(Style::Open);
        let coarse = effects.iter().any(|e| e.name == "encoder_quantisation");
        let noise = noise(rng, coarse);
        let level = log_uniform(rng, 0.005, 0.04);
        let effects_need_dimensions = effects.iter().any(|e| NEED_WHEELS.contains(&e.name));
        let wheels = effects_need_dimensions && rng.random::<f64>() < 0.85;
        Recipe {
            origin,
            sort,
            effects,
            outside,
            kind,
            style,
            manner,
            rate: *pick(rng, &[20.0, 25.0, 50.0]),
            length: [rng.random_range(60.0f64..150.0).round(), rng.random_range(60.0f64..100.0).round()],
            lost: if rng.random::<f64>() < 0.1 { 0.02 } else { 0.0 },
            noise,
            level: [level, (level * rng.random_range(0.8..1.25)).clamp(0.005, 0.04)],
            pose: (rng.random::<bool>(), rng.random::<bool>()),
            wheels: wheels || rng.random::<f64>() < 0.3,
            // Without dimensions nothing could be said of a wrong one.
            profile: rng.random::<f64>() < 0.85 || effects_need_dimensions,
        }
    }

    /// A stream of chance for one purpose of this case.
    pub fn chance(&self, purpose: u64) -> StdRng {
        stream(self.origin.seed, &[word_number(&self.origin.set), self.origin.index as u64, purpose])
    }
}

fn pair(rng: &mut StdRng) -> Vec<Ingredient> {
    loop {
        let (a, b) = (pick(rng, &EFFECTS), pick(rng, &EFFECTS));
        if a.name != b.name && combine(a, b) {
            let mut strength = || *pick(rng, &STRENGTHS[1..]);
            let (first, second) = (strength(), strength());
            return vec![
                Ingredient { name: a.name, form: None, strength: first },
                Ingredient { name: b.name, form: None, strength: second },
            ];
        }
    }
}

fn noise(rng: &mut StdRng, coarse: bool) -> Character {
    match rng.random_range(0..if coarse { 5 } else { 6 }) {
        0..3 => Character::White,
        3 => Character::Coloured(rng.random_range(0.5..0.8)),
        4 => Character::Heavy,
        _ => Character::Quantised,
    }
}

/// A number for a set's name.
fn word_number(word: &str) -> u64 {
    word.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}
