//! Sets of cases: nulls hide nothing, every name shows, the seed decides every byte.

use wheelwright_concealed::hidden::EFFECTS;
use wheelwright_concealed::make::case::{Case, make};
use wheelwright_concealed::make::plan::{recipe, recipes, set};
use wheelwright_concealed::make::recipe::Recipe;
use wheelwright_concealed::referee::key::Origin;

fn cases(name: &str, seed: u64, count: usize) -> Vec<(Recipe, Case)> {
    recipes(set(name).unwrap(), seed, count).into_iter().map(|(name, recipe)| (recipe.clone(), make(&name, &recipe))).collect()
}

#[test]
fn nulls_reduce_to_six_lumped_numbers_far_below_the_noise() {
    for (recipe, case) in cases("nulls", 11, 16) {
        let rows = 2.0 * recipe.length[0] * recipe.rate;
        let entry = &case.entry;
        let ratio = entry.detectability.unwrap();
        // Root mean square of what the best refit leaves, over the noise.
        assert!((ratio / rows).sqrt() < 0.05, "{}: {ratio} over {rows} rows, {entry:?}", entry.case);
        assert!(ratio < 5.0, "{}: {ratio}", entry.case);
        assert!(entry.truth.is_empty() && entry.outside.is_none());
    }
}

#[test]
fn the_seed_decides_every_byte() {
    let text = |case: &Case| (case.files.clone(), serde_json::to_string(&case.entry).unwrap());
    let (a, b, c) = (cases("mixed", 3, 6), cases("mixed", 3, 6), cases("mixed", 4, 6));
    for ((x, y), z) in a.iter().zip(&b).zip(&c) {
        assert_eq!(text(&x.1), text(&y.1));
        assert_ne!(x.1.files, z.1.files);
    }
}

#[test]
fn every_name_can_be_hidden_and_shows_where_it_is_strong() {
    let single = set("singles").unwrap();
    for effect in &EFFECTS {
        // One of several recordings must show it clearly: not every drive excites everything.
        let wanted = if effect.name == "track_width_error" { 20.0 } else { 100.0 };
        let shows = (0..29 * 40)
            .map(|index| recipe(single, 5, index, 29 * 40))
            .filter(|r| r.effects[0].name == effect.name && r.effects[0].strength >= 0.5 && r.wheels)
            .take(5)
            .any(|r| make("c1", &r).entry.detectability.unwrap() > wanted);
        assert!(shows, "{} shows nowhere", effect.name);
    }
}

#[test]
fn the_key_tells_nothing_of_the_order() {
    let sorts: Vec<String> = recipes(set("mixed").unwrap(), 9, 60).iter().map(|(_, r)| r.sort.word().to_owned()).collect();
    assert_eq!(sorts.iter().filter(|s| *s == "none").count(), 12);
    assert_eq!(sorts.iter().filter(|s| *s == "single").count(), 24);
    assert_eq!(sorts.iter().filter(|s| *s == "pair").count(), 9);
    assert_eq!(sorts.iter().filter(|s| *s == "other_form").count(), 6);
    assert_eq!(sorts.iter().filter(|s| *s == "outside").count(), 9);
    let next: Vec<String> = recipes(set("mixed").unwrap(), 10, 60).iter().map(|(_, r)| r.sort.word().to_owned()).collect();
    assert_ne!(sorts, next);
}

#[test]
fn origins_make_the_same_recipe_again() {
    for (_, r) in recipes(set("pairs").unwrap(), 2, 10) {
        let Origin { set: name, seed, index, count } = r.origin.clone();
        assert_eq!(recipe(set(&name).unwrap(), seed, index, count), r);
    }
}

#[test]
fn no_robot_runs_away() {
    for (recipe, case) in cases("singles", 8, 29) {
        let (_, train) = &case.files[0];
        let rows: Vec<Vec<f64>> = train.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect();
        for (asked, got) in [(1, 3), (2, 4)] {
            let most = |k: usize| rows.iter().map(|r| r[k].abs()).fold(0.0, f64::max);
            assert!(most(got) < 2.5 * most(asked), "{:?}: {} of {}", recipe.effects, most(got), most(asked));
        }
    }
}
