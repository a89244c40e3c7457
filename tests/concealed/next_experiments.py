#!/usr/bin/env python3
"""Whether the proposed next experiment resolves what is ambiguous.

    next_experiments.py CASES KEY.json ANSWERS [--wheelwright PROGRAM] [--concealed PROGRAM]

Takes every ambiguous answer whose reported set holds the truth, drives the very robot of the case through the experiment that the diagnosis
proposes, and diagnoses both recordings together. Resolved is what is then explained by the truth, or by names that the key holds for as good.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

from asking import as_good, diagnose


def reported(answer):
    for effect in answer["effects"]:
        yield effect["name"]
        yield from effect["alternatives"]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("cases", type=pathlib.Path)
    arguments.add_argument("key", type=pathlib.Path)
    arguments.add_argument("answers", type=pathlib.Path)
    arguments.add_argument("--wheelwright", default="wheelwright")
    arguments.add_argument("--concealed", default="concealed")
    given = arguments.parse_args()
    asked = resolved = 0
    for case in json.loads(given.key.read_text())["cases"]:
        answer = json.loads((given.answers / f"{case['case']}.json").read_text())
        truth = {t["effect"] for t in case["truth"]}
        if answer["verdict"] != "ambiguous" or not truth <= set(reported(answer)):
            continue
        asked += 1
        folder = given.cases / case["case"]
        with tempfile.TemporaryDirectory() as scratch:
            out, drive = pathlib.Path(scratch) / "out", pathlib.Path(scratch) / "drive.csv"
            diagnose(given.wheelwright, [folder / "train.csv"], folder, "--out", out)
            commands = out / "next_experiment.csv"
            command = [given.concealed, "drive", "--key", given.key, "--case", case["case"], "--commands", commands, "--out", drive]
            subprocess.run([str(c) for c in command], check=True, capture_output=True)
            after = diagnose(given.wheelwright, [folder / "train.csv", drive], folder, "--out", out)
        named = {e["name"] for e in after["effects"]}
        good = after["verdict"] == "explained" and (named == truth or as_good(case, named))
        resolved += good
        print(f"{case['case']} {' + '.join(sorted(truth))}: {after['verdict']} {', '.join(sorted(named))}")
    print(f"resolved {resolved} of {asked}")


if __name__ == "__main__":
    main()
