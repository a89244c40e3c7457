//! Sets of cases: which sorts go into them, and in which order they are named.

use super::recipe::{Recipe, Sort};
use crate::draw::stream;
use crate::error::Error;
use crate::referee::key::Origin;
use rand::seq::SliceRandom;

/// A set that can be made.
#[derive(Clone, Copy, Debug)]
pub struct Set {
    /// Its name.
    pub name: &'static str,
    /// What is in it.
    pub words: &'static str,
    sorts: &'static [Sort],
}

const MIXED: [Sort; 20] = {
    use Sort::{Nothing as N, OtherForm as F, Outside as O, Pair as P, Single as S};
    [N, S, S, P, S, O, N, S, F, S, P, N, S, O, S, F, P, N, S, O]
};

/// All sets.
pub const SETS: [Set; 7] = [
    Set { name: "nulls", words: "nothing hidden: all noises, drives, robots and rates", sorts: &[Sort::Nothing] },
    Set { name: "singles", words: "one effect of the contract each, strengths 0.1 to 1, all 29 in turn", sorts: &[Sort::Single] },
    Set { name: "pairs", words: "two effects each, strengths 0.2 to 1, of all that go together", sorts: &[Sort::Pair] },
    Set { name: "forms", words: "one effect each in another physical form than usual", sorts: &[Sort::OtherForm] },
    Set { name: "outside", words: "a cause each that no library holds", sorts: &[Sort::Outside] },
    Set { name: "strangers", words: "a control: the commands written are those of another drive of the robot", sorts: &[Sort::Stranger] },
    Set { name: "mixed", words: "20 % nothing, 40 % one effect, 15 % two, 10 % other forms, 15 % outside", sorts: &MIXED },
];

/// The set of a name.
pub fn set(name: &str) -> Result<&'static Set, Error> {
    SETS.iter().find(|s| s.name == name).ok_or_else(|| Error::UnknownSet { name: name.to_owned(), known: SETS.map(|s| s.name).join(", ") })
}

/// Recipes of a set with the names of their cases, in the order of the names; names say nothing of what is inside.
pub fn recipes(set: &Set, seed: u64, count: usize) -> Vec<(String, Recipe)> {
    let digits = count.to_string().len().max(4);
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(&mut stream(seed, &[0x5ea1]));
    order.into_iter().enumerate().map(|(k, index)| (format!("c{:0digits$}", k + 1), recipe(set, seed, index, count))).collect()
}

/// The recipe number `index` of a set.
pub fn recipe(set: &Set, seed: u64, index: usize, count: usize) -> Recipe {
    let sort = set.sorts[index % set.sorts.len()];
    // Within a mixture, each sort counts by itself, so that it too goes round through all it has.
    let before = set.sorts[..index % set.sorts.len()].iter().filter(|s| **s == sort).count();
    let each = set.sorts.iter().filter(|s| **s == sort).count();
    let turn = index / set.sorts.len() * each + before;
    Recipe::write(sort, turn, Origin { set: set.name.to_owned(), seed, index, count })
}
