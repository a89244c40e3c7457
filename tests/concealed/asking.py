"""What the scripts here share: asking for a diagnosis, and what the key holds for as good as the truth."""

import json
import subprocess


def diagnose(program, recordings, folder, *more):
    """The answer to recordings of a case, with its validation and its profile if it has one."""
    robot = folder / "robot.toml"
    command = [program, "diagnose", *recordings, "--validate", folder / "validate.csv", *more, "--json", "--quiet"]
    command += ["--robot", robot] if robot.exists() else []
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def as_good(case, named):
    """Whether the key holds these names for as good as the truth."""
    return any(named == set(names) for names in case["acceptable"])
