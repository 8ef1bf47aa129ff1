"""A regulator as a file for other programs: NumPy, MATLAB, and C with the function that runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ctlabs.files.export import Exported, put
from ctlabs.linalg.checks import Array
from ctlabs.regulation.controller import AXES, ContinuousMachine, Machine

_TITLE = (
    "A regulator, written by ctlabs.",
    "u[k]    = C xi[k] + D z[k] + F r[k] + f       z: the measurement of the same instant, r: set points of the tracked outputs",
    "xi[k+1] = A xi[k] + B z[k] + G r[k] + g       xi[0] = xi0; u is added to the plant (the feedback's sign is in C and D)",
    "An element of z that is missing (NaN) is replaced by that of H_hat xi + d_hat + D_hat u.",
    "Matrices by rows; SI units; the period is dt seconds.",
)
_CONTINUOUS = (
    "A regulator in continuous time, written by ctlabs.",
    "u = C xi + D z + F r,   dxi/dt = A xi + B z + G r,   xi(0) = xi0; u is added to the plant (the feedback's sign is in C and D)",
    "Matrices by rows; SI units.",
)
#: One step: no library, no memory but the state that is handed over; sums run in the order of the indices.
_STEP = """
/* One step: z (NaN: not measured) and r (NULL: zero) in, u out; xi, {stem}_q numbers, is the memory: copy {stem}_xi0 into it at t0. */
static inline void {stem}_step(double *xi, const double *z, const double *r, double *u)
{
    double next[{stem}_q], seen[{stem}_m];
    int i, j;
UNUSED    for (i = 0; i < {stem}_r; i++) {
        double sum = {stem}_f[i];
        for (j = 0; j < {stem}_q; j++) sum += {stem}_C[i][j] * xi[j];
SETPOINT_U        u[i] = sum;
    }
    for (i = 0; i < {stem}_m; i++) {
        double sum = {stem}_d_hat[i];
        for (j = 0; j < {stem}_q; j++) sum += {stem}_H_hat[i][j] * xi[j];
        for (j = 0; j < {stem}_r; j++) sum += {stem}_D_hat[i][j] * u[j];
        seen[i] = z[i] == z[i] ? z[i] : sum;
    }
    for (i = 0; i < {stem}_r; i++)
        for (j = 0; j < {stem}_m; j++) u[i] += {stem}_D[i][j] * seen[j];
    for (i = 0; i < {stem}_q; i++) {
        double sum = {stem}_g[i];
        for (j = 0; j < {stem}_q; j++) sum += {stem}_A[i][j] * xi[j];
        for (j = 0; j < {stem}_m; j++) sum += {stem}_B[i][j] * seen[j];
SETPOINT_XI        next[i] = sum;
    }
    for (i = 0; i < {stem}_q; i++) xi[i] = next[i];
}
"""
_SETPOINT = "        if (r) for (j = 0; j < {stem}_p; j++) sum += {stem}_%s[i][j] * r[j];\n"


def write(machine: Machine | ContinuousMachine, path: Path, *, overwrite: bool = False) -> Path:
    """Write a controller: .npz, .mat, or .h with the arrays and, where the gains are constant, the function of one step.

    Raises
    ------
    ValueError
        Another suffix.
    FileExistsError
        The file exists, and ``overwrite`` was not given.
    """
    arrays: dict[str, Array] = {name: np.asarray(getattr(machine, name)) for name in ("A", "B", "C", "D", "F", "G", "xi0")}
    q, r, m, p = arrays["A"].shape[-1], arrays["C"].shape[-2], arrays["B"].shape[-1], len(machine.set_points)
    sizes = {"q": q, "r": r, "m": m, "p": p}
    measured = machine.measurements if isinstance(machine, Machine) else tuple(f"z{i + 1}" for i in range(m))
    labels = {"states": machine.states, "measurements": measured, "set_points": machine.set_points}
    letters = {"xi": "states", "z": "measurements", "r": "set_points"}
    if isinstance(machine, ContinuousMachine):
        return put(Exported(arrays, labels, letters, _CONTINUOUS, sizes), path, overwrite=overwrite)
    arrays |= {name: np.asarray(getattr(machine, name)) for name in AXES if name not in arrays} | {"dt": np.asarray(machine.dt)}
    code = ""
    if machine.steps is None:
        first, second = ((_SETPOINT % name if p else "") for name in ("F", "G"))
        code = _STEP.replace("SETPOINT_U", first).replace("SETPOINT_XI", second).replace("UNUSED", "" if p else "    (void)r;\n")
    else:
        sizes["steps"] = machine.steps
    return put(Exported(arrays, labels, letters, _TITLE, sizes, code), path, overwrite=overwrite)
