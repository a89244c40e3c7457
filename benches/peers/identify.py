"""The corrected identification with pandas, numpy and scipy: what `wheelwright identify --solver ols` is timed against.

    python3 benches/peers/identify.py FILE.csv
"""

import json
import sys

import numpy as np
import pandas
from scipy.signal import butter, sosfiltfilt


def identify(path, cutoff_hz=1.0, trim_s=5.0):
    log = pandas.read_csv(path)
    n = int(0.7 * len(log))
    t, u, w_ref, v, w = (log[c].to_numpy()[:n] for c in ("t", "v_ref", "omega_ref", "v", "omega"))
    period = np.median(np.diff(t))
    sos = butter(2, cutoff_hz, fs=1 / period, output="sos")
    trim = slice(int(trim_s / period), -int(trim_s / period))

    def filtered(x):
        return sosfiltfilt(sos, x)[trim]

    def held(x):
        return np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1])])

    def solve(columns, response, stiffness):
        theta = np.linalg.lstsq(np.column_stack([filtered(c) for c in columns]), filtered(held(response)), rcond=None)[0]
        k = theta[stiffness]
        theta[0] = k * period / (2 * np.arctanh(k * period / (2 * theta[0])))
        return theta

    th1, th3, th4 = solve([np.gradient(v, t), -w * w, v], u, 2)
    th2, th5, th6 = solve([np.gradient(w, t), v * w, w], w_ref, 2)
    return [th1, th2, th3, th4, th5, th6]


if __name__ == "__main__":
    print(json.dumps(identify(sys.argv[1])))
