"""A filter's matrices and gains as a file for other programs: NumPy, MATLAB, C.

What is written is what the filter needs on another computer: the model's matrices, and either the steady gains or the whole
schedule, under the letters of this library. All formats carry the same doubles to the bit.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ctlabs.filtering.results import Covariances
from ctlabs.filtering.steady import SteadyState
from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel

_EQUATIONS = """\
x[k+1] = Phi x[k] + offset + w[k],  E w w' = Qd        z[k] = H x[k] + v[k],  E v v' = R,  E w v' = N
update:   x_plus[k]    = x_minus[k] + K (z[k] - H x_minus[k])
predict:  x_minus[k+1] = Phi x_plus[k] + offset, and where N is given + N R^-1 (z[k] - H x_plus[k])
both, where K_pred is given:  x_minus[k+1] = Phi x_minus[k] + offset + K_pred (z[k] - H x_minus[k])"""


def write(
    model: DiscreteModel,
    result: SteadyState | Covariances,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
) -> Path:
    """Write the model and its steady state or schedule; the suffix of ``path`` chooses the format.

    - ``.npz`` : the arrays by name, ``numpy.load`` reads them (no pickles); names and units as arrays of strings
    - ``.mat`` : the same for MATLAB (version 5); vectors are columns, names are cells, and what varies with time has the
      time last: ``K(:,:,k)``
    - ``.h`` : a C or C++ header of ``static const double`` arrays named ``<stem>_<matrix>``, with 17 digits; the equations,
      names and units are in a comment

    An index k runs 0…steps; S is infinite where nothing is measured. The file appears whole or not at all.

    Parameters
    ----------
    model : discrete model
    result : of :func:`ctlabs.filtering.steady.solve` or :func:`ctlabs.filtering.covariances`, for this model
    path : a name that ends in one of the suffixes
    overwrite : whether a file that exists may be replaced

    Raises
    ------
    ValueError
        Another suffix; a result of other dimensions.
    FileExistsError
        The file exists, and ``overwrite`` was not given.

    >>> from ctlabs.filtering import steady
    >>> m = DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[10]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     float(np.load(write(m, steady.solve(m), Path(folder) / "gain.npz"))["K"].round(6)[0, 0])
    0.618034
    """
    arrays = _arrays(model, result)
    sizes = {"n": model.n, "m": model.m} | ({"steps": len(arrays["t"]) - 1} if "t" in arrays else {})
    title = ("A Kalman filter, written by ctlabs.", *_EQUATIONS.splitlines(), "Matrices by rows; SI units, covariances.")
    labels = {"states": model.states, "units": model.units, "measurements": model.measurements}
    return put(Exported(arrays, labels, {"x": "states", "z": "measurements"}, title, sizes), Path(path), overwrite=overwrite)


class Exported(NamedTuple):
    """What goes into a file.

    ``arrays`` by name · ``labels``, names of signals · ``letters`` → which labels name their elements in C's comment · ``title``, lines of
    that comment · ``sizes``, C's constants · ``code``, C functions that use the arrays, with ``{stem}`` for the name of the file
    """

    arrays: dict[str, Array]
    labels: dict[str, tuple[str, ...]]
    letters: dict[str, str]
    title: tuple[str, ...]
    sizes: dict[str, int]
    code: str = ""


def put(content: Exported, path: Path, *, overwrite: bool = False) -> Path:
    """Write arrays in the format of the suffix: .npz, .mat or .h; see :func:`write`."""
    match path.suffix:
        case ".npz":
            data = _npz(content)
        case ".mat":
            data = _mat(content)
        case ".h":
            data = _header(content, path.stem)
        case _:
            msg = f"path: expected a name that ends in .npz, .mat or .h, received {path.name!r}"
            raise ValueError(msg)
    _put(path, data, overwrite=overwrite)
    return path


def _arrays(model: DiscreteModel, result: SteadyState | Covariances) -> dict[str, Array]:
    """The model's matrices and the result's, in this order, under their names."""
    checks.instance("model", model, DiscreteModel)
    if not isinstance(result, SteadyState | Covariances):
        msg = f"result: expected a SteadyState or Covariances, received a {type(result).__name__}"
        raise TypeError(msg)
    if result.K.shape[-2:] != (model.n, model.m):
        msg = f"result: expected gains of shape {(model.n, model.m)} as the model's, received {result.K.shape[-2:]}"
        raise ValueError(msg)
    names = ("Phi", "Qd", "H", "R", "N", "B", "D", "offset", "measurement_offset", "x0", "P0", "dt")
    found = {name: getattr(model, name) for name in names}
    own = Covariances if isinstance(result, Covariances) else SteadyState  # of a filtered record what no data change
    found |= {field.name: getattr(result, field.name) for field in fields(own) if field.name != "algorithm"}
    return {name: np.asarray(value) for name, value in found.items() if value is not None}


def _npz(content: Exported) -> bytes:
    """NumPy's archive."""
    file = BytesIO()
    np.savez(file, **content.arrays, **{name: np.array(labels, dtype=str) for name, labels in content.labels.items()})  # type: ignore[arg-type]  # numpy's stubs take the names for its option allow_pickle
    return file.getvalue()


def _mat(content: Exported) -> bytes:
    """MATLAB's file, version 5."""
    from scipy.io import savemat

    file = BytesIO()
    found = {name: np.moveaxis(a, 0, -1) if a.ndim == 3 else a.T if _rows(name, a) else a for name, a in content.arrays.items()}
    cells = {name: np.array(labels, dtype=object) for name, labels in content.labels.items()}
    savemat(file, {**found, **cells}, oned_as="column")
    return file.getvalue()


def _rows(name: str, a: Array) -> bool:
    """Whether a table has the time in its rows."""
    return a.ndim == 2 and name in ("offset", "measurement_offset", "used")


def _header(content: Exported, stem: str) -> bytes:
    """C's header."""
    arrays = content.arrays
    stem = re.sub(r"\W", "_", stem, flags=re.ASCII)
    stem = stem if re.match(r"[A-Za-z]", stem) else f"m_{stem}"
    guard = f"CTLABS_{stem.upper()}_H"
    drawn = [_definition(stem, name, a) for name, a in arrays.items() if a.size]
    sizes = [f"#define {stem}_{name} {size}" for name, size in content.sizes.items()]
    infinite = any(np.isinf(a).any() for a in arrays.values())
    lines = [
        _comment(content),
        f"#ifndef {guard}\n#define {guard}\n",
        *(["#include <math.h> /* INFINITY: not measured */\n"] if infinite else []),
        *sizes,
        "",
        *drawn,
        *([content.code.replace("{stem}", stem)] if content.code else []),
        f"\n#endif /* {guard} */\n",
    ]
    return "\n".join(lines).encode()


def _comment(content: Exported) -> str:
    """Equations, names and units as a C comment that no name can end."""
    rows = list(content.title)
    for letter, which in content.letters.items():
        units = content.labels.get("units", ()) if which == "states" else ()
        for i, name in enumerate(content.labels[which]):
            unit = units[i] if i < len(units) else ""
            rows.append(f"{letter}[{i}]: {_quoted(name)}" + (f", {_quoted(unit)}" if unit else ""))
    return "/*\n" + "\n".join(f" * {row}" for row in rows) + "\n */"


def _quoted(text: str) -> str:
    """A name in quotes, as JSON: one line, nothing invisible, and without a mark that begins or ends a comment."""
    quoted = json.dumps(text, ensure_ascii=False)
    visible = "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in quoted)
    return re.sub(r"\*(?=/)|(?<=/)\*", r"\\u002a", visible)


def _definition(stem: str, name: str, a: Array) -> str:
    if np.iscomplexobj(a):
        a = np.stack([a.real, a.imag], axis=-1)  # real and imaginary parts in the last place
    sizes = "".join(f"[{d}]" for d in a.shape)
    return f"static const double {stem}_{name}{sizes} = {_braces(a.astype(np.float64))};"


def _braces(a: Array) -> str:
    if a.ndim == 0:
        return _number(float(a))
    inner = [_braces(row) for row in a]
    return "{" + (",\n " if a.ndim > 1 else ", ").join(inner) + "}"


def _number(value: float) -> str:
    """The double as C reads it back."""
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = f"{value:.17g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _put(path: Path, content: bytes, *, overwrite: bool) -> None:
    """Write a file under another name and give it its own when it is whole."""
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    except OSError as error:
        msg = f"path: expected a folder that can be written to, received {str(path.parent)!r} ({error.strerror})"
        raise type(error)(msg) from None
    part = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        part.chmod(0o644)
        if overwrite:
            part.replace(path)
        else:
            _claim(part, path)
    finally:
        part.unlink(missing_ok=True)


def _claim(part: Path, path: Path) -> None:
    """Give a file its name unless another one has it, also when that one appears at this moment."""
    try:
        path.hardlink_to(part)
    except FileExistsError:
        msg = f"path: expected a new file (or overwrite=True), received {str(path)!r}, which exists"
        raise FileExistsError(msg) from None
    except OSError:  # a file system without links
        if path.exists():
            msg = f"path: expected a new file (or overwrite=True), received {str(path)!r}, which exists"
            raise FileExistsError(msg) from None
        part.replace(path)
