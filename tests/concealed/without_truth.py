#!/usr/bin/env python3
"""How honest a diagnosis is whose library lacks the true effect.

    without_truth.py CASES KEY.json [--wheelwright PROGRAM] [--jobs N]

Diagnoses every case with one hidden effect with that effect left out of the library, and prints what was said: nothing more than
"unexplained" or "ambiguous" should be, unless the key holds another name for as good. What is told with confidence otherwise is wrong.
"""

import argparse
import collections
import json
import pathlib
from concurrent.futures import ThreadPoolExecutor

from asking import as_good, diagnose


def judged(case, answer):
    """What the answer is worth: honest, as good as the truth, or wrong."""
    named = {e["name"] for e in answer["effects"]}
    if answer["verdict"] != "explained":
        return answer["verdict"]
    return "stated equivalent" if as_good(case, named) else "confidently wrong"


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
        answer = diagnose(given.wheelwright, [folder / "train.csv"], folder, "--without", case["truth"][0]["effect"])
        return case, answer, judged(case, answer)

    totals = {True: collections.Counter(), False: collections.Counter()}
    with ThreadPoolExecutor(given.jobs) as pool:
        for case, answer, verdict in pool.map(run, single):
            totals[case["excitation"] == "rich"][verdict] += 1
            if verdict == "confidently wrong":
                named = ", ".join(e["name"] for e in answer["effects"])
                print(f"{case['case']} {case['truth'][0]['effect']} ({case['excitation']}): {named}")
    for rich, counts in totals.items():
        n = sum(counts.values())
        said = ", ".join(f"{verdict} {count}" for verdict, count in sorted(counts.items()))
        print(f"{'rich' if rich else 'other'} driving, {n} cases: {said}")


if __name__ == "__main__":
    main()
