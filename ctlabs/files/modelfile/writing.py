"""Model files written from models, or from nothing."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.files.modelfile.document import ModelFile, loads
from ctlabs.files.modelfile.schema import KINDS
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel, DiscreteModel

#: What every matrix is, as a comment above it.
COMMENTS = {
    "F": "dx/dt = F x + B u + G w",
    "Q": "strength of the white noise w, unit²·s",
    "Phi": "x(k+1) = Phi x(k) + B u(k) + offset + w(k)",
    "Qd": "covariance of w(k), unit²",
    "H": "z = H x + v",
    "D": "what the inputs u add to z",
    "measurement_offset": "a constant in z",
    "R": "covariance of a sampled measurement's noise v, unit²",
    "Rc": "strength of a continuous measurement's noise v, unit²·s; a sampled one has R = Rc/dt",
    "N": "what w and v have in common",
    "x0": "mean and covariance of x at t0",
    "dt": "period of the measurements, s",
}


def new(n: int = 2, s: int = 1, m: int = 1, kind: str = "continuous", title: str = "New model") -> ModelFile:
    """A model file to begin with: n states, s noises (of a continuous model), m measurements; plain numbers to be replaced.

    Of a continuous model the states are integrated one into the next and the noises drive the last of them; the first states are
    measured.

    >>> new(2, 1, 1).continuous().F
    array([[0., 1.],
           [0., 0.]])
    """
    if kind not in KINDS:
        raise ValueError(f"kind: expected {' or '.join(KINDS)}, received {kind!r}")
    n, m = checks.count("n", n), checks.count("m", m)
    s = min(checks.count("s", s), 10**6)
    shift = np.eye(n, k=1)
    if kind == "continuous":
        matrices: dict[str, Any] = {"F": shift, "G": np.eye(n, s, k=s - n) if s <= n else np.eye(n, s), "Q": np.eye(s)}
    else:
        matrices = {"Phi": np.eye(n) + shift, "Qd": np.eye(n)}
    matrices |= {"H": np.eye(m, n), "R": np.eye(m), "x0": np.zeros(n), "P0": np.eye(n)}
    labels = {
        "states": [f"x{i + 1}" for i in range(n)],
        "units": [""] * n,
        "measurements": [f"z{i + 1}" for i in range(m)],
        "measurement_units": [""] * m,
    }
    return loads(_text(kind, title, labels, matrices, 1.0))


def from_model(
    model: ContinuousModel | DiscreteModel, title: str = "Model", *, dt: float | None = None, R: ArrayLike | None = None
) -> ModelFile:
    """A model file of a model with constant matrices; what :meth:`ModelFile.discrete` gives back equals it to the bit.

    Parameters
    ----------
    model : a continuous model needs ``dt``, and ``R`` unless it has Rc
    dt : period, s
    R : (m, m), covariance of a sampled measurement

    Raises
    ------
    ValueError
        dt or R is missing or not wanted; matrices that vary with time (write them as expressions of t or k).

    >>> walk = DiscreteModel(Phi=[[1]], Qd=[[0.1]], H=[[1]], R=[[1]], x0=[0], P0=[[1]], dt=0.5)
    >>> from_model(walk, "Walk").discrete().Qd
    array([[0.1]])
    """
    if isinstance(model, ContinuousModel):
        names = ["F", "G", "Q", "B", "H", "D", "measurement_offset", "Rc", "N", "x0", "P0"]
        if dt is None:
            raise ValueError("dt: expected the period of the measurements, s, received None")
        if (R is None) == (model.Rc is None):
            raise ValueError(f"R: expected R or the model's Rc, received {'neither' if R is None else 'both'}")
    else:
        checks.instance("model", model, DiscreteModel)
        names = ["Phi", "Qd", "B", "offset", "H", "D", "measurement_offset", "R", "N", "x0", "P0"]
        if dt is not None or R is not None:
            raise ValueError("model: expected a discrete model with its own dt and R, received others beside it")
    matrices = {name: getattr(model, name) for name in names if getattr(model, name) is not None}
    for name, matrix in matrices.items():
        if matrix.ndim != (1 if name in {"offset", "measurement_offset", "x0"} else 2):
            raise ValueError(
                f"{name}: expected a constant matrix, received one that varies with time (write it as expressions of t or k)"
            )
    if R is not None:
        matrices["R"] = checks.measurement_covariance("R", R, (len(model.H),) * 2)
    labels = {"states": list(model.states), "units": list(model.units), "measurements": list(model.measurements)}
    kind = KINDS[isinstance(model, DiscreteModel)]
    period = model.dt if isinstance(model, DiscreteModel) else checks.positive("dt", dt)
    return loads(_text(kind, title, labels, matrices, period))


def _text(kind: str, title: str, labels: dict[str, list[str]], matrices: dict[str, Any], dt: float) -> str:
    lines = ["format = 1", f"title = {_quoted(title)}", f'kind = "{kind}"', "", "[constants]", "", "[model]"]
    lines += [f"{name} = [{', '.join(_quoted(label) for label in given)}]" for name, given in labels.items()]
    for name, matrix in matrices.items():
        lines += [f"# {COMMENTS[name]}"] if name in COMMENTS else []
        lines.append(f"{name} = {_matrix(matrix)}")
    lines += [
        f"# {COMMENTS['dt']}",
        f"dt = {_number(dt)}",
        "",
        "[experiment]",
        "t0 = 0",
        "first = 1",
        "steps = 200",
        "",
    ]
    return "\n".join(lines)


def _matrix(matrix: Array) -> str:
    """A matrix with one row to a line, in columns; a vector or a single row on one line."""
    if matrix.ndim == 1:
        return f"[{', '.join(_number(x) for x in matrix)}]"
    cells = [[_number(x) for x in row] for row in matrix]
    widths = [max(len(row[j]) for row in cells) for j in range(len(cells[0]))]
    rows = [f"[{', '.join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))}]" for row in cells]
    return f"[{rows[0]}]" if len(rows) == 1 else "[\n" + "".join(f"    {row},\n" for row in rows) + "]"


def _number(value: float) -> str:
    """The shortest text that is this double."""
    value = float(value)
    return (
        str(int(value))
        if value.is_integer() and abs(value) < 1e15 and (value or not np.signbit(value))
        else repr(value)
    )


def _quoted(text: str) -> str:
    """A text in quotes; JSON's escapes are TOML's, but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
