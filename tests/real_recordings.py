#!/usr/bin/env python3
"""Diagnoses the hardware recordings and prints the table of docs/diagnosis.md.

    cargo build --release
    python3 tests/real_recordings.py [--out DIR] [NAME ...]

The recordings are not part of the project: they are looked for in $WHEELWRIGHT_SHARED, by default beside the project. The program is
$WHEELWRIGHT, by default target/release/wheelwright. With --out each report is kept under DIR/NAME; NAME picks rows.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
SHARED = pathlib.Path(os.environ.get("WHEELWRIGHT_SHARED", ROOT.parent / "shared")) / "recordings"
PROGRAM = os.environ.get("WHEELWRIGHT", str(ROOT / "target/release/wheelwright"))

PROFILES = {
    "warthog": {"model": "wheel-pd", "track_width": 1.08, "wheel_radius": 0.30, "mass": 470.0},
    "husky": {"model": "wheel-pd", "track_width": 0.55, "wheel_radius": 0.165, "mass": 50.0},
}

# A car that is commanded a throttle: one lag, one gain. Whatever else it does is for the diagnosis.
CAR = """
[model]
type = "expression"
name = "throttle-to-speed"
inputs = { throttle = "1" }
outputs = { v = "m/s" }
equations = ["throttle = inertia*der(v) + friction*v"]

[model.parameters]
inertia = { unit = "s2/m", min = 0.0, meaning = "throttle for one unit of acceleration", excitation = "steps of the throttle" }
friction = { unit = "s/m", meaning = "throttle for one unit of speed", excitation = "several speeds" }
"""

ROWS = [
    ("warthog-asphalt", "warthog/asphalt.csv", {"profile": "warthog"}),
    ("warthog-sand", "warthog/sand.csv", {"profile": "warthog"}),
    ("warthog-ice", "warthog/ice.csv", {"profile": "warthog"}),
    ("warthog-sand-against-asphalt", "warthog/sand.csv", {"profile": "warthog", "sim": "warthog/asphalt.csv"}),
    ("warthog-ice-against-asphalt", "warthog/ice.csv", {"profile": "warthog", "sim": "warthog/asphalt.csv"}),
    ("husky", "husky/steps.csv", {"profile": "husky"}),
    ("frc-carter", "frc5024/carter.csv", {}),
    ("frc-piperservant", "frc5024/piperservant.csv", {}),
    ("frc-minibot", "frc5024/minibot.csv", {}),
    ("frc-minibot-carpet", "frc5024/minibot_carpet.csv", {}),
    ("dart", "dart/throttle_steps.csv", {"config": CAR}),
    ("ucar", "ucar/steps.csv", {"config": CAR}),
]


def ask(name, file, how, folder, out):
    """One diagnosis: its result as a document, or the reason why there is none."""
    command = [PROGRAM, "diagnose", str(SHARED / file), "--json", "--quiet"]
    if "profile" in how:
        profile = folder / f"{how['profile']}.toml"
        values = {"name": how["profile"], **PROFILES[how["profile"]]}
        profile.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items()))
        command += ["--robot", str(profile)]
    if "config" in how:
        config = folder / f"{name}.toml"
        config.write_text(how["config"])
        command += ["--config", str(config)]
    if "sim" in how:
        command += ["--sim", str(SHARED / how["sim"])]
    if out:
        command += ["--out", str(out / name)]
    done = subprocess.run(command, capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"error": done.stderr.strip().splitlines()[-1:] or [f"status {done.returncode}"]}


def effects(result):
    """Names with what else they could be; those that explain a part in brackets."""
    def words(found):
        near = found.get("alternatives", [])
        return "`" + found["name"] + "`" + (f" (or {', '.join(f'`{a}`' for a in near)})" if near else "")

    named = [words(f) for f in result["effects"]]
    partly = ["[" + words(f) + "]" for f in result.get("partial", [])]
    return ", ".join(named + partly) or "none"


def fits(result):
    """Held-out fit of every output before and after, and the noise ceiling."""
    fit = result["fit"]
    shown = lambda value: "–" if value is None else f"{value:.1f}"
    of = lambda part, name: shown((fit.get(part) or {}).get(name))
    return ", ".join(f"{n} {of('before', n)} → {of('after', n)} ({of('noise_ceiling', n)})" for n in fit["before"])


def main():
    if not SHARED.is_dir():
        print(f"skipped: there are no recordings in {SHARED}")
        return
    arguments = sys.argv[1:]
    out = None
    if "--out" in arguments:
        at = arguments.index("--out")
        out = pathlib.Path(arguments[at + 1])
        del arguments[at : at + 2]
    print("| recording | verdict | effects | where | held-out fit in %: before → after (ceiling) |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, file, how in ROWS:
            if arguments and name not in arguments:
                continue
            result = ask(name, file, how, pathlib.Path(folder), out)
            if "error" in result:
                print(f"| {name} | no answer | {' '.join(result['error'])} | | |", flush=True)
                continue
            cells = [name, result["verdict"], effects(result), result["where"]["statement"], fits(result)]
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
