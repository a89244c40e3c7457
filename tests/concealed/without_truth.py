#!/usr/bin/env python3
"""How honest a diagnosis is whose library lacks the true effect.

    without_truth.py CASES KEY.json [--wheelwright PROGRAM] [--jobs N]

Diagnoses every case with one hidden effect with that effect left out of the library, and prints what was said: nothing more than
"unexplained" or "ambiguous" should be, unless the key holds another name for as good. What is told with confidence otherwise is wrong.
Of it is told apart what foresees the held-out driving as well as the whole library's answer does: nothing in these data speaks against it.
"""

import argparse
import collections
import json
import math
import pathlib
from concurrent.futures import ThreadPoolExecutor

from asking import as_good, diagnose


# Difference in twice the log-likelihood of held-out data that decides, as in the diagnosis itself.
DECISIVE = 10


def foresees(answer, whole, rows):
    """Whether an answer foresees held-out data as well as another: nothing decisive between their errors, taken as white."""
    off = lambda a, output: 1 - a["fit"]["after"][output] / 100
    return sum(2 * rows * math.log(off(answer, y) / off(whole, y)) for y in whole["fit"]["after"]) < DECISIVE


def judged(case, answer, ask_whole, rows):
    """What the answer is worth: honest, as good as the truth, or wrong."""
    named = {e["name"] for e in answer["effects"]}
    if answer["verdict"] != "explained":
        return answer["verdict"]
    if as_good(case, named):
        return "stated equivalent"
    return "confidently wrong, as good on held-out data" if foresees(answer, ask_whole(), rows) else "confidently wrong"


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("cases", type=pathlib.Path)
    arguments.add_argument("key", type=pathlib.Path)
    arguments.add_argument("--wheelwright", default="wheelwright")
    arguments.add_argument("--jobs", type=int, default=2)
    given = arguments.parse_args()
    single = [c for c in json.loads(given.key.read_text())["cases"] if len(c["truth"]) == 1]

    def run(case):
        folder = given.cases / case["case"]
        ask = lambda *more: diagnose(given.wheelwright, [folder / "train.csv"], folder, *more)
        rows = len((folder / "validate.csv").read_text().splitlines()) - 1
        answer = ask("--without", case["truth"][0]["effect"])
        return case, answer, judged(case, answer, ask, rows)

    totals = {True: collections.Counter(), False: collections.Counter()}
    with ThreadPoolExecutor(given.jobs) as pool:
        for case, answer, verdict in pool.map(run, single):
            totals[case["excitation"] == "rich"][verdict] += 1
            if verdict.startswith("confidently"):
                named = ", ".join(e["name"] for e in answer["effects"])
                print(f"{case['case']} {case['truth'][0]['effect']} ({case['excitation']}): {named}; {verdict}")
    for rich, counts in totals.items():
        n = sum(counts.values())
        said = ", ".join(f"{verdict} {count}" for verdict, count in sorted(counts.items()))
        print(f"{'rich' if rich else 'other'} driving, {n} cases: {said}")


if __name__ == "__main__":
    main()
