//! `docs/effects.md` says what the code says: everything below its mark is made here, from the effects and their sources.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::PathBuf;

use wheelwright_core::effect::{Effect, EffectParameter, Frame, Place, Scales, Scene, Track};
use wheelwright_core::{Channel, channel};
use wheelwright_diagnosis::effects::library;

/// Below this line the page is made.
const MARK: &str = "<!-- Made from the code. To make it again: WHEELWRIGHT_WRITE_DOCS=1 cargo test -p wheelwright-diagnosis --test suite documentation -->";

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A robot of 0.34 m track that drives about 0.4 m/s for 100 s at 20 Hz.
fn scene(frame: Frame, inputs: [Channel; 2], outputs: [Channel; 2], sizes: [f64; 2], command: f64) -> Scene {
    let scales = Scales {
        inputs: sizes.into(),
        largest: sizes.map(|x| 2.0 * x).into(),
        outputs: vec![0.4, 1.0],
        command,
        largest_command: 2.0 * command,
        speed: 0.4,
        time: (0.0, 100.0),
        period: 0.05,
    };
    let track = Track { heading: vec![0.0, 0.1], headed: false, distance: [vec![0.0, 0.01], vec![0.0, 0.01]], ..Track::default() };
    Scene { frame, inputs: inputs.into(), outputs: outputs.into(), wheel_radius: Some(0.1), scales, tracks: vec![track] }
}

fn velocities() -> Scene {
    let frame = Frame::Body { half_track: 0.17 };
    scene(frame, [channel::V_REF, channel::OMEGA_REF], [channel::V, channel::OMEGA], [0.4, 1.0], 0.4)
}

fn voltages() -> Scene {
    let frame = Frame::Sides { half_track: 0.17 };
    scene(frame, [channel::U_LEFT, channel::U_RIGHT], [channel::VEL_LEFT, channel::VEL_RIGHT], [2.0, 2.0], 2.0)
}

/// The sentences at the head of an effect's source.
fn head(name: &str) -> String {
    let source = std::fs::read_to_string(root().join("src/effects").join(format!("{name}.rs"))).unwrap();
    let lines = source.lines().map_while(|l| l.strip_prefix("//!"));
    lines.map(|l| l.strip_prefix(' ').unwrap_or(l)).collect::<Vec<_>>().join("\n")
}

/// `type = "slew_limit", axis = "v"`.
fn settings(effect: &dyn Effect) -> String {
    let json = serde_json::to_value(effect).unwrap();
    let mut all = vec![format!("type = \"{}\"", effect.name())];
    let inner = json.get(effect.name()).and_then(|v| v.as_object()).cloned().unwrap_or_default();
    all.extend(inner.iter().map(|(key, value)| format!("{key} = {value}")));
    all.join(", ")
}

fn number(x: f64) -> String {
    match x {
        x if x == f64::INFINITY => "∞".to_owned(),
        x if x == f64::NEG_INFINITY => "−∞".to_owned(),
        x => format!("{}", (x * 1e6).round() / 1e6).replace('-', "−"),
    }
}

fn row(p: &EffectParameter, other: Option<&EffectParameter>) -> String {
    let label = p.label.as_ref().map_or(String::new(), |(kind, which)| format!(" ({kind}: {which})"));
    let unit = match other {
        Some(other) if other.unit != p.unit => format!("{} ({})", p.unit, other.unit),
        _ => p.unit.clone(),
    };
    let neutral = p.neutral.map_or("–".to_owned(), number);
    format!("| `{}`{label} | {unit} | {} … {} | {neutral} | {} |\n", p.name, number(p.bounds.0), number(p.bounds.1), number(p.scale))
}

fn place(effect: &dyn Effect) -> &'static str {
    match effect.stage().place() {
        Place::Command => "command",
        Place::Dynamics => "dynamics",
        Place::Measurement => "measurement",
    }
}

/// In their order, each once.
fn distinct<T: Ord + Clone>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = BTreeSet::new();
    all.filter(|x| seen.insert(x.clone())).collect()
}

fn section(variants: &[&dyn Effect]) -> String {
    let first = variants[0];
    let mut out = format!("\n### `{}`\n\n{}\n\n", first.name(), head(first.name()));
    writeln!(out, "Place: {}. Family: {}.\n", place(first), whole(first)).unwrap();
    if variants.len() > 1 {
        for variant in variants {
            writeln!(out, "- `{}`: {}", settings(*variant), variant.about()).unwrap();
        }
        out.push('\n');
    }
    let (body, sides) = (velocities(), voltages());
    let rows = distinct(variants.iter().flat_map(|effect| {
        let other = if effect.inapplicable(&sides).is_none() { effect.parameters(&sides) } else { Vec::new() };
        let rows: Vec<String> =
            effect.parameters(&body).iter().map(|p| row(p, other.iter().find(|o| o.name == p.name && o.label == p.label))).collect();
        rows
    }));
    out.push_str("| parameter | unit | bounds | neutral | scale |\n|---|---|---|---|---|\n");
    out.extend(rows);
    let motion = distinct(variants.iter().map(|v| v.excitation()));
    writeln!(out, "\nShown by {}.\n", motion.join("; or by ")).unwrap();
    let confusions = distinct(variants.iter().flat_map(|v| v.confusions().iter().map(|c| (c.with, c.because))));
    if !confusions.is_empty() {
        out.push_str("Confused with:\n\n");
        for (with, because) in confusions {
            writeln!(out, "- `{with}`: {because}.").unwrap();
        }
    }
    out
}

/// Everything below the mark.
/// The family of which an effect's side or axis is a part.
fn whole(effect: &dyn Effect) -> &str {
    effect.family().split('/').next().unwrap_or_default()
}

fn made() -> String {
    let all = library();
    let names = distinct(all.iter().map(|e| e.name().to_owned()));
    let variants = |name: &str| all.iter().filter(|e| e.name() == name).map(|e| &**e).collect::<Vec<_>>();
    let mut out = format!("{MARK}\n\n| effect | place | family | in one line |\n|---|---|---|---|\n");
    for name in &names {
        let first = variants(name)[0];
        writeln!(out, "| [`{name}`](#{name}) | {} | {} | {} |", place(first), whole(first), first.about()).unwrap();
    }
    names.iter().for_each(|name| out.push_str(&section(&variants(name))));
    out
}

#[test]
fn the_page_says_what_the_code_says() {
    let path = root().join("../docs/effects.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (written, below) = page.split_once(MARK).expect("docs/effects.md has the mark");
    let made = made();
    if std::env::var_os("WHEELWRIGHT_WRITE_DOCS").is_some() {
        std::fs::write(&path, format!("{written}{made}")).unwrap();
        return;
    }
    let differs = format!("{MARK}{below}").lines().zip(made.lines()).find(|(a, b)| a != b).map(|(a, b)| format!("\n{a}\nfor\n{b}"));
    assert!(format!("{MARK}{below}") == made, "docs/effects.md is not what the code says; its mark tells how to make it again{differs:?}");
}

#[test]
fn the_library_table_names_every_effect_once() {
    let source = std::fs::read_to_string(root().join("src/effects/mod.rs")).unwrap();
    let names: BTreeSet<String> = library().iter().map(|e| e.name().to_owned()).collect();
    for name in names {
        assert_eq!(source.matches(&format!("//! | `{name}` |")).count(), 1, "{name} in the table of diagnosis/src/effects/mod.rs");
    }
}
