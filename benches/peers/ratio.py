"""CPU time of `identify --quick` and of its scipy peer on the same file, in turn in the same run.

    python3 benches/peers/ratio.py WHEELWRIGHT FILE.csv [REPEATS]

Whole processes, user and system time, the least of the repeats: on a machine that is not quiet, what others take away only adds.
"""

import json
import pathlib
import resource
import subprocess
import sys


def run(command):
    def spent():
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = spent()
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return spent() - before, json.loads(output)


def main(program, recording, repeats="12"):
    peer = pathlib.Path(__file__).with_name("output_error.py")
    own, whole, fit = [], [], []
    for _ in range(int(repeats)):
        own.append(run([program, "identify", recording, "--quick", "--json"])[0])
        seconds, document = run([sys.executable, str(peer), recording])
        whole.append(seconds)
        fit.append(document["cpu_s"]["fit"])
    own, whole, fit = min(own), min(whole), min(fit)
    print(f"identify --quick {own:.3f} s; scipy {whole:.3f} s ({whole / own:.0f} times), its fit alone {fit:.3f} s ({fit / own:.1f} times)")


if __name__ == "__main__":
    main(*sys.argv[1:])
