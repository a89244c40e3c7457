"""The same free-run fit with scipy's least_squares: what the default solver is timed against.

    python3 benches/peers/output_error.py FILE.csv

Simulates from an estimated start with held commands, the linear part exactly and the couplings held over each sample, lets
least_squares difference the six parameters and the start, and takes standard errors from the Jacobian (white noise).
Prints the parameters, the standard errors and the CPU seconds of reading, fitting, and the whole process.
"""

import json
import sys
import time

import numpy as np
import pandas
from scipy.optimize import least_squares


def simulate(p, dt, v_ref, omega_ref):
    t1, t2, t3, t4, t5, t6, v, w = p
    ev, ew = np.exp(-t4 / t1 * dt), np.exp(-t6 / t2 * dt)
    vs, ws = [v], [w]
    for a, b, u, r in zip(ev, ew, v_ref, omega_ref):
        qv, qw = (u + t3 * w * w) / t4, (r - t5 * v * w) / t6
        v, w = qv + (v - qv) * a, qw + (w - qw) * b
        vs.append(v)
        ws.append(w)
    return np.array(vs), np.array(ws)


def fit(path):
    started = time.process_time()
    log = pandas.read_csv(path)
    n = int(0.7 * len(log))
    t, u, r, v, w = (log[c].to_numpy()[:n] for c in ("t", "v_ref", "omega_ref", "v", "omega"))
    dt, u, r = np.diff(t), u[:-1].tolist(), r[:-1].tolist()
    read = time.process_time()

    def error(p):
        vs, ws = simulate(p, dt, u, r)
        return np.concatenate([vs - v, ws - w])

    start = [0.3, 0.3, 0.0, 1.0, 0.0, 1.0, v[0], w[0]]
    found = least_squares(error, start, x_scale=[0.1, 0.1, 0.01, 1, 0.01, 1, 0.1, 0.1], method="trf")
    s2 = 2 * found.cost / (len(found.fun) - len(start))
    std = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)) * s2)
    done = time.process_time()
    return {
        "theta": found.x[:6].tolist(),
        "std": std[:6].tolist(),
        "evaluations": int(found.nfev),
        "cpu_s": {"read": read - started, "fit": done - read, "process": done},
    }


if __name__ == "__main__":
    print(json.dumps(fit(sys.argv[1])))
