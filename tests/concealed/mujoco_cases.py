"""Concealed cases from a physics engine that nobody here wrote: MuJoCo.

    python tests/concealed/mujoco_cases.py make --out DIR --key KEY.json --seed S \
        --set nulls|singles|pairs|other_forms|outside|mixed --count N [--jobs 1] [--engine mujoco|bullet]

    python tests/concealed/mujoco_cases.py drive --key KEY.json --case c0042 --commands next.csv --out answer.csv

`make` writes N case folders (train.csv, validate.csv, robot.toml) into DIR and the key outside it. The same seed gives the same bytes.
Needs numpy and mujoco (`pip install numpy mujoco`); it is not part of the project's own tests. See MUJOCO.md beside this file.

This is the referee's side: it shares no code with the diagnosis and must never be read by it.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import importlib.metadata
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from mujoco_lab import drives, effects, sensing, theta, world  # noqa: E402
from mujoco_lab.hidden import Hidden  # noqa: E402
from mujoco_lab.robots import draw_robot  # noqa: E402

FAINT = 15.0  # a case with an effect below this log-likelihood ratio is drawn again, stronger, at most twice
KINDS = {"nulls": "none", "singles": "single", "pairs": "pair", "other_forms": "other_form", "outside": "outside"}
MIXED = (("nulls", 0.20), ("singles", 0.45), ("pairs", 0.13), ("other_forms", 0.08), ("outside", 0.14))


def engine(name: str):
    """(simulate, version, recipes it can hide) of an engine."""
    if name == "mujoco":
        return world.simulate, f"mujoco {mujoco.__version__}", lambda r: True
    from mujoco_lab import bullet

    return bullet.simulate, f"pybullet {importlib.metadata.version('pybullet')}", lambda r: r.apply.__name__ in bullet.CAN


def plan(which: str, count: int, seed: int, can) -> list[tuple[str, list[effects.Recipe]]]:
    """What each case hides, stratified over the catalogue, in shuffled order."""
    rng = np.random.default_rng([seed, 1])
    sets = [which] * count
    if which == "mixed":
        sets = [name for name, share in MIXED for _ in range(round(share * count))]
        sets = (sets + ["singles"] * count)[:count]
    pools = {"singles": effects.RECIPES, "other_forms": effects.OTHER_FORMS, "outside": effects.OUTSIDE}
    pools = {name: [r for r in recipes if can(r)] for name, recipes in pools.items()}
    queues: dict[str, list] = {name: [] for name in pools}
    out = []
    for name in sets:
        if name == "nulls":
            out.append((name, []))
            continue
        if name == "pairs":
            out.append((name, _pair(rng, pools["singles"])))
            continue
        name = name if pools[name] else "singles"
        if not queues[name]:
            queues[name] = [pools[name][i] for i in rng.permutation(len(pools[name]))]
        out.append((name, [queues[name].pop()]))
    return [out[i] for i in rng.permutation(len(out))]


def _pair(rng, recipes) -> list[effects.Recipe]:
    """Two effects of different families that one robot can carry."""
    while True:
        a, b = (recipes[i] for i in rng.integers(len(recipes), size=2))
        if a.family == b.family or {a.family, b.family} == {"sensing", "timing"} or {a.family, b.family} == {"limit", "slip"}:
            continue
        if (a.castor and b.four_wheels) or (b.castor and a.four_wheels) or {a.channels, b.channels} == {"body", "odometry"}:
            continue
        return [a, b]


def _draw(name: str, recipes: list[effects.Recipe], rng, strength_floor: float) -> dict:
    """Everything of a case but its simulation."""
    level = next((r.level for r in recipes if r.level), None)
    robot = draw_robot(rng, level=level, four_wheels=any(r.four_wheels for r in recipes))
    castor = next((r.castor for r in recipes if r.castor), None)
    if castor:
        robot.castor = castor
    rate = float(rng.choice([20.0, 25.0, 50.0]))
    train_kind, validate_kind = (drives.KINDS[i] for i in rng.permutation(4)[:2])
    seconds = rng.uniform(60.0, 150.0)
    channels = next((r.channels for r in recipes if r.channels), None) or str(rng.choice(["odometry", "body"]))
    extras = {e for r in recipes for e in r.extras}
    train = drives.drive(train_kind, rng, seconds, rate, robot)
    hidden = Hidden(carpet_tile=3.0 * robot.v_max)
    strengths = [max(rng.uniform(0.15, 1.0), strength_floor) for _ in recipes]
    seeds = [int(x) for x in rng.integers(2**32, size=len(recipes))]
    parameters = _apply(hidden, recipes, robot, strengths, seeds, train, rate)
    seconds_b = max(rng.uniform(60.0, 120.0), hidden.payload_time + 20.0)
    validate = drives.drive(validate_kind, rng, seconds_b, rate, robot)
    alone = [Hidden(carpet_tile=hidden.carpet_tile) for _ in recipes]
    for i, one in enumerate(alone):
        _apply(one, recipes[i : i + 1], robot, strengths[i:], seeds[i:], train, rate)
    again = replace(hidden, pushes=[], dropouts=[])
    for r, s in zip(recipes, strengths):
        if r.apply in (effects.push, effects.dropout):
            r.apply(again, robot, s, rng, validate, rate)
    setup = sensing.Setup(
        rate_hz=rate, channels=channels, pose="pose" in extras or rng.random() < 0.4, wheels="wheels" in extras or rng.random() < 0.3,
        noise=str(rng.choice(sensing.NOISES)), level=(rng.uniform(0.005, 0.03),) * 2,
    )
    return {
        "robot": robot, "hidden": hidden, "again": again, "train": train, "validate": validate, "setup": setup, "strengths": strengths,
        "clock": int(rng.integers(2**32)), "alone": alone, "parameters": parameters, "train_kind": train_kind, "validate_kind": validate_kind,
    }


def _apply(hidden: Hidden, recipes, robot, strengths, seeds, commands, rate) -> list[dict]:
    """Hide each effect, with random numbers of its own, so that the same effect can be hidden alone too."""
    return [r.apply(hidden, robot, s, np.random.default_rng(x), commands, rate) for r, s, x in zip(recipes, strengths, seeds)]


def _clock(case: dict, file: int):
    """The random numbers of a recording's sampling instants."""
    return np.random.default_rng([case["clock"], file])


def _each(case: dict, truth: sensing.Truth) -> list[float]:
    """Of a pair: what each effect changes that neither the other nor the plain parameters explain (linearised)."""
    setup, robot = case["setup"], case["robot"]
    pole = sensing.COLOURED_POLE if setup.noise == "coloured" else 0.0
    dt, sigma, out = 1.0 / setup.rate_hz, np.array(setup.level), []
    for other in reversed(case["alone"]):
        run = case["simulate"](robot, other, case["train"], setup.rate_hz)
        without = sensing.observe(run, robot, other, setup, _clock(case, 0))
        y = _rounded(without, case | {"hidden": other})
        plain = theta.fit(y, case["train"], dt, _start(robot), sigma, pole)[0]
        out.append(theta.beyond(_rounded(truth, case) - y, case["train"], dt, plain, y[0], sigma, pole))
    return out


def _start(robot) -> np.ndarray:
    return np.array([robot.theta1, robot.theta2, 0.0, 1.1, 0.0, 1.1])


def _misfit(y: np.ndarray, case: dict) -> float:
    """Twice the log-likelihood ratio by which the plain model, refitted, misses the noise-free signals `y`."""
    robot, setup = case["robot"], case["setup"]
    pole = sensing.COLOURED_POLE if setup.noise == "coloured" else 0.0
    guesses = [_start(robot), _start(robot) * np.array([1.6, 1.6, 1, 1, 1, 1])]
    return min(theta.fit(y, case["train"], 1.0 / setup.rate_hz, g, np.array(setup.level), pole)[1] for g in guesses)


def _geometry_misfit(truth: sensing.Truth, case: dict) -> float:
    """How far the heading by odometry is from the body's, in units of the pose's noise (for causes that only this comparison shows)."""
    turned = np.cumsum(sensing.odometry(truth.wheels, case["robot"])[:-1, 1]) / case["setup"].rate_hz
    return float(np.sum(((turned - truth.pose[1:, 2]) / sensing.HEADING_NOISE) ** 2) / 2.0)


def _with_levels(case: dict, truth: sensing.Truth) -> None:
    """Noise as a share of each channel's rms; with coarse counts the counts decide."""
    hidden, setup, robot = case["hidden"], case["setup"], case["robot"]
    rms = np.sqrt(np.mean(truth.y**2, axis=0))
    level = setup.level[0] * np.maximum(rms, [0.05 * robot.v_max, 0.05 * robot.w_max])
    if hidden.counts > 0:
        step = 0.25 * hidden.counts * setup.rate_hz
        level = np.array([step / np.sqrt(2.0), step * np.sqrt(2.0) / robot.track])
        setup.noise = "white"
    setup.level = (float(level[0]), float(level[1]))
    case["relative_noise"] = level / rms


def _rounded(truth: sensing.Truth, case: dict) -> np.ndarray:
    """The noise-free signal as the encoder rounds it."""
    hidden, setup, robot = case["hidden"], case["setup"], case["robot"]
    if hidden.counts <= 0:
        return truth.y
    step = hidden.counts * setup.rate_hz / robot.radius
    return sensing.odometry(np.round(truth.wheels / step) * step, robot)


def _ceiling(truth: sensing.Truth, columns: dict) -> dict:
    """Free-run fit in percent of the true noise-free response."""
    out = {}
    for i, name in enumerate(("v", "omega")):
        y = columns[name]
        out[name] = round(100.0 * (1.0 - float(np.linalg.norm(y - truth.y[:, i]) / np.linalg.norm(y - y.mean()))), 3)
    return out


def _attempt(name: str, recipes, seed: int, index: int, attempt: int, strength_floor: float, engine_name: str = "mujoco") -> dict:
    rng = np.random.default_rng([seed, 2, index, attempt])
    case = _draw(name, recipes, rng, strength_floor) | {"floor": strength_floor}
    robot, setup = case["robot"], case["setup"]
    case["simulate"] = engine(engine_name)[0]
    runs = [case["simulate"](robot, case[h], case[u], setup.rate_hz) for h, u in (("hidden", "train"), ("again", "validate"))]
    truths = [sensing.observe(run, robot, case["hidden"], setup, _clock(case, i)) for i, run in enumerate(runs)]
    _with_levels(case, truths[0])
    case["detectability"] = _misfit(_rounded(truths[0], case), case)
    if any(r.family == "geometry" and r.extras for r in recipes):
        case["detectability"] = max(case["detectability"], _geometry_misfit(truths[0], case))
    case["each"] = _each(case, truths[0]) if len(recipes) > 1 else None
    case["columns"] = [
        sensing.record(truth, case[u], robot, case["hidden"], setup, rng) for truth, u in zip(truths, ("train", "validate"))
    ]
    case["ceiling"] = _ceiling(truths[1], case["columns"][1])
    rim = np.column_stack([runs[0].wheel_speed[:, 0], runs[0].wheel_speed[:, 1]])
    case["reverses"] = bool(rim.min() < -0.02 * rim.max())
    # A tape measure's error.
    case["measured"] = [robot.track * (1 + rng.uniform(-0.02, 0.02)), robot.radius * (1 + rng.uniform(-0.02, 0.02))]
    case["measured"].append(robot.total_mass * (1 + rng.uniform(-0.05, 0.05)))
    return case


def make_case(job: tuple) -> dict:
    """Simulate, record and write one case; returns its entry in the key."""
    index, name, recipes, origin, out = job
    case, taken = None, 0
    for attempt in range(6):
        try:
            case = _attempt(name, recipes, origin["seed"], index, attempt, 0.0 if case is None else 0.6, origin["engine"])
        except (ArithmeticError, np.linalg.LinAlgError):
            continue
        taken = attempt
        weakest = min([case["detectability"], *(case["each"] or [])])
        if not recipes or weakest >= FAINT or attempt >= 2:
            break
    if case is None:
        raise RuntimeError(f"case {index}: the engine diverged six times")
    folder = Path(out) / f"c{index + 1:04d}"
    folder.mkdir(parents=True, exist_ok=True)
    for file, columns in zip(("train.csv", "validate.csv"), case["columns"]):
        _write_csv(folder / file, columns)
    robot = case["robot"]
    track, radius, mass = case["measured"]
    (folder / "robot.toml").write_text(
        f'name = "robot-{index + 1}"\nmodel = "{"wheel-pd" if robot.level == "wheel" else "vw-pd"}"\n'
        f"track_width = {track:.4g}\nwheel_radius = {radius:.4g}\nmass = {mass:.3g}\n"
    )
    return _entry(folder.name, name, recipes, case, origin | {"index": index, "attempt": taken, "floor": case["floor"]})


def drive_again(entry: dict, commands: Path, out: Path) -> None:
    """Drive the robot of a case through other commands (t, v_ref, omega_ref at the case's rate): same hidden physics, new noise."""
    origin = entry["origin"]
    simulate, _, can = engine(origin["engine"])
    name, recipes = plan(origin["set"], origin["count"], origin["seed"], can)[origin["index"]]
    case = _attempt(name, recipes, origin["seed"], origin["index"], origin["attempt"], origin["floor"], origin["engine"])
    with commands.open(newline="") as f:
        rows = list(csv.DictReader(f))
    stamps = np.array([float(r["t"]) for r in rows])
    if len(stamps) < 2 or np.max(np.abs(np.diff(stamps) * case["setup"].rate_hz - 1.0)) > 0.05:
        raise SystemExit(f"{commands}: the case's robot takes commands at {case['setup'].rate_hz} Hz; give one row a sample")
    driven = np.array([[float(r["v_ref"]), float(r["omega_ref"])] for r in rows])
    run = simulate(case["robot"], case["again"], driven, case["setup"].rate_hz)
    truth = sensing.observe(run, case["robot"], case["hidden"], case["setup"], _clock(case, 2))
    rng = np.random.default_rng([origin["seed"], 3, origin["index"], len(driven)])
    _write_csv(out, sensing.record(truth, driven, case["robot"], case["hidden"], case["setup"], rng))


def _write_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    with path.open("w", newline="") as f:
        rows = csv.writer(f, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows([format(x, ".7g") for x in row] for row in zip(*columns.values()))


def _entry(case_name: str, name: str, recipes, case: dict, origin: dict) -> dict:
    setup, robot, hidden = case["setup"], case["robot"], case["hidden"]
    named = [(r, p) for r, p in zip(recipes, case["parameters"]) if r.effect]
    alike = [effects.equivalents(r.effect, p, case["reverses"], case["train_kind"], setup.channels, setup.wheels) for r, p in named]
    acceptable = _combine([[[r.effect]] + a for (r, _), a in zip(named, alike)])
    if any(r.effect == "encoder_quantisation" and not hidden.counts_instant for r in recipes):
        acceptable += [s + [d] for s in _combine([[[r.effect]] + a for (r, _), a in zip(named, alike)], True) for d in ("sensor_delay", "command_delay")]
    if setup.noise == "quantised" and name != "outside":  # the values are rounded to a lattice: to say so is right, not to say so is right too
        acceptable += [s + ["encoder_quantisation"] for s in [[r.effect for r, _ in named]] + acceptable]
    forms = [r.form if "form" not in p else str(p["form"]) for r, p in zip(recipes, case["parameters"]) if r.form != "engine" or "form" in p]
    end = float(len(case["train"]) / setup.rate_hz)
    times = [[a, min(b, end)] for a, b in hidden.dropouts] + [[p[0], min(p[1], end)] for p in hidden.pushes]
    if hidden.payload_mass > 0:
        times.append([hidden.payload_time, end])
    if hidden.sag > 0:
        times.append([0.0, end])
    return {
        "case": case_name,
        "kind": KINDS[name],
        "truth": [{"effect": r.effect, "parameters": _plain(p)} for r, p in named],
        "acceptable": acceptable,
        "outside": next((r.outside for r in recipes if r.outside), None),
        "form": "; ".join(forms) or None,
        "robot": robot.family if robot.family in ("pioneer", "khepera") else "random",
        "excitation": case["train_kind"],
        "validate_excitation": case["validate_kind"],
        "noise": setup.noise,
        "noise_level": dict(zip(("v", "omega"), (round(float(x), 6) for x in case["relative_noise"]))),
        "rate_hz": setup.rate_hz,
        "strength": round(float(min(case["strengths"])), 3) if case["strengths"] else None,
        "strengths": [round(float(s), 3) for s in case["strengths"]],
        "detectability": round(case["detectability"], 3),
        "detectability_each": case["each"] and [round(x, 3) for x in case["each"]],
        "times": sorted([round(a, 3), round(b, 3)] for a, b in times) or None,
        "regions": [{"of": "v", "from": -hidden.dead, "to": hidden.dead}] if hidden.dead > 0 else None,
        "noise_ceiling": case["ceiling"],
        "origin": origin,
        "engine": {
            "name": origin["engine"], "channels": setup.channels, "servo": robot.level, "family": robot.family, "castor": robot.castor,
            "cause": [r.family for r in recipes], "wheels_reverse": case["reverses"],
        },
    }


def _combine(choices: list[list[list[str]]], truth_too: bool = False) -> list[list[str]]:
    """All ways of taking one name for each effect; the first, the truth itself, only when asked for."""
    sets: list[list[str]] = [[]]
    for names in choices:
        sets = [s + n for s in sets for n in names]
    return sets if truth_too else sets[1:]


def _plain(parameters: dict) -> dict:
    return {k: v if isinstance(v, str) else round(float(v), 8) for k, v in parameters.items()}


def _make(args, parser) -> None:
    if args.key.resolve().is_relative_to(args.out.resolve()):
        parser.error("the key must lie outside the folder of the cases")
    _, version, can = engine(args.engine)
    origin = {"engine": args.engine, "set": args.set, "seed": args.seed, "count": args.count}
    cases = plan(args.set, args.count, args.seed, can)
    jobs = [(i, name, recipes, origin, str(args.out)) for i, (name, recipes) in enumerate(cases)]
    if args.jobs > 1:
        with ProcessPoolExecutor(args.jobs) as pool:
            entries = list(pool.map(make_case, jobs))
    else:
        entries = [make_case(job) for job in jobs]
    args.key.parent.mkdir(parents=True, exist_ok=True)
    key = {"schema": "wheelwright.key/1", "generator": {"engine": version, "seed": args.seed, "set": args.set}, "cases": entries}
    text = json.dumps(key, indent=1) + "\n"
    args.key.write_text(text)
    print(f"{len(entries)} cases in {args.out}; key sealed by SHA-256 {hashlib.sha256(text.encode()).hexdigest()}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("make", help="write case folders and their key")
    make.add_argument("--out", required=True, type=Path)
    make.add_argument("--key", required=True, type=Path)
    make.add_argument("--seed", type=int, default=1)
    make.add_argument("--set", choices=[*KINDS, "mixed"], default="mixed")
    make.add_argument("--count", type=int, default=60)
    make.add_argument("--jobs", type=int, default=1)
    make.add_argument("--engine", choices=["mujoco", "bullet"], default="mujoco")
    again = commands.add_parser("drive", help="drive the robot of a case through given commands")
    again.add_argument("--key", required=True, type=Path)
    again.add_argument("--case", required=True)
    again.add_argument("--commands", required=True, type=Path, help="CSV with t, v_ref, omega_ref")
    again.add_argument("--out", required=True, type=Path)
    args = parser.parse_args()
    if args.command == "make":
        _make(args, parser)
        return 0
    entry = next((c for c in json.loads(args.key.read_text())["cases"] if c["case"] == args.case), None)
    if entry is None:
        parser.error(f"{args.key} has no case {args.case}")
    drive_again(entry, args.commands, args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
