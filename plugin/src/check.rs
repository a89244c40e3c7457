//! What `wheelwright plugins check PATH` says: every robot and model of a library, opened and put through the conformance
//! checks that built-in ones pass.
//!
//! A robot is connected and commanded to stand still; hardware that is switched on gets zero commands and a stop.

use std::fmt;

use toml::Table;
use wheelwright_core::conformance::{Violation, check_effect, check_model, check_robot};
use wheelwright_core::model::ModelError;
use wheelwright_core::robot::{Live, RobotError};

use crate::alone;
use crate::deadline::within;
use crate::error::PluginError;
use crate::host::library::{EffectTable, Library, ModelTable, RobotTable};
use crate::registry::{Kind, Registry, is_type};

/// How one robot, model or effect did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// Every promise was kept.
    Kept,
    /// It does not open without settings, or not with these: the reason. Nothing more is known of it.
    NeedsSettings(String),
    /// Promises that were broken.
    Broken(Vec<String>),
}

/// One of what a library offers, with its outcome.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checked {
    /// What it is.
    pub kind: Kind,
    /// What `type = "..."` says.
    pub name: String,
    /// What it is for.
    pub about: String,
    /// How it did.
    pub outcome: Outcome,
}

/// A library with all it offers; its `Display` is what a user reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// Name and version, as the library says.
    pub library: String,
    /// Each robot, then each model, then each effect.
    pub checked: Vec<Checked>,
}

impl Report {
    /// True if nothing was found broken.
    pub fn passed(&self) -> bool {
        !self.checked.iter().any(|c| matches!(c.outcome, Outcome::Broken(_)))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.library)?;
        for Checked { kind, name, about, outcome } in &self.checked {
            write!(f, "  {} \"{name}\" ({about}): ", kind.word())?;
            match outcome {
                Outcome::Kept => writeln!(f, "ok")?,
                Outcome::NeedsSettings(reason) => writeln!(f, "not checked, it needs settings: {reason}")?,
                Outcome::Broken(reasons) => {
                    writeln!(f, "{} found", reasons.len())?;
                    reasons.iter().try_for_each(|reason| writeln!(f, "    {reason}"))?;
                }
            }
        }
        Ok(())
    }
}

/// Checks a library. `settings` are tables with a `type`, as in a configuration, for those that do not open without.
///
/// # Errors
/// [`PluginError::Taken`] if one of its names clashes with a built-in.
pub fn check(library: Library, settings: &[Table]) -> Result<Report, PluginError> {
    let mut registry = Registry::new();
    registry.add(library)?;
    let library = &registry.libraries()[0];
    let table = |name: &str| settings.iter().find(|table| is_type(table, name)).cloned().unwrap_or_else(|| alone::table(name));
    let robots = library.robots.iter().map(|RobotTable { offer, .. }| Checked {
        kind: Kind::Robot,
        name: offer.name.to_owned(),
        about: offer.about.clone(),
        outcome: robot(&registry, table(offer.name)),
    });
    let models = library.models.iter().map(|own @ ModelTable { offer, .. }| Checked {
        kind: Kind::Model,
        name: offer.name.to_owned(),
        about: offer.about.clone(),
        outcome: model(&registry, table(offer.name), own),
    });
    let effects = library.effects.iter().map(|own @ EffectTable { offer, .. }| Checked {
        kind: Kind::Effect,
        name: offer.name.to_owned(),
        about: offer.about.clone(),
        outcome: effect(&registry, table(offer.name), own),
    });
    let checked = robots.chain(models).chain(effects).collect();
    Ok(Report { library: format!("{} {} ({})", library.name(), library.version(), library.path().display()), checked })
}

fn robot(registry: &Registry, table: Table) -> Outcome {
    let config = match registry.robot(table) {
        Ok(config) => config,
        Err(error) => return Outcome::NeedsSettings(error.to_string()),
    };
    match config.connect(0) {
        Ok(robot) => found(check_robot(&mut *Live::new(robot))),
        Err(error @ (RobotError::Config { .. } | RobotError::Connection(_))) => Outcome::NeedsSettings(error.to_string()),
        Err(error) => Outcome::Broken(vec![error.to_string()]),
    }
}

fn model(registry: &Registry, table: Table, own: &ModelTable) -> Outcome {
    let config = match registry.model(table) {
        Ok(config) => config,
        Err(error) => return Outcome::NeedsSettings(error.to_string()),
    };
    let model = match config.build() {
        Ok(model) => model,
        Err(error @ ModelError::Config { .. }) => return Outcome::NeedsSettings(error.to_string()),
        Err(error) => return Outcome::Broken(vec![error.to_string()]),
    };
    let call = move || {
        let checked = check_model(&*model);
        // A model that failed says why; the checks only saw NaN.
        model.failure().map_or_else(|| found(checked), |failure| Outcome::Broken(vec![failure.to_string()]))
    };
    let limit = own.offer.limits.open;
    within(own.offer.name, limit, call).unwrap_or_else(|late| Outcome::Broken(vec![own.offer.not_returned("evaluating it", late)]))
}

fn effect(registry: &Registry, table: Table, own: &EffectTable) -> Outcome {
    let effect = match registry.effect(table) {
        Ok(effect) => effect,
        Err(error) => return Outcome::NeedsSettings(error.to_string()),
    };
    let limit = own.offer.limits.open;
    let call = move || found(check_effect(&*effect));
    within(own.offer.name, limit, call).unwrap_or_else(|late| Outcome::Broken(vec![own.offer.not_returned("simulating with it", late)]))
}

fn found(result: Result<(), Vec<Violation>>) -> Outcome {
    result.map_or_else(|violations| Outcome::Broken(violations.iter().map(Violation::to_string).collect()), |()| Outcome::Kept)
}
