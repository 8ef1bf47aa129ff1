r"""Motion whose derivative of some order is a random constant plus Brownian motion, and the SI units of its model.

:func:`integrators` is n integrators in a row driven by white noise,

.. math:: x^{(n)} = w, \quad E[w(t)w(t')] = \sigma_w^2\,\delta(t-t')

a Wiener velocity for n = 2 and a Wiener acceleration for n = 3. :func:`units` derives the unit of every quantity of a
model and of its filter from the units of its states, and :func:`rescaled` writes the model in other units of length and
time. A result then changes as its unit says, or one of the two is wrong: dimensional analysis by numbers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models import ContinuousModel
from ctlabs.text import LOWERED, RAISED

NAMES = ("x", "v", "a", "j")
_FACTOR = re.compile(r"(m|s|rad|1)(\^?-?[0-9]*|⁻?[⁰¹²³⁴⁵⁶⁷⁸⁹]+(?:ᐟ[⁰¹²³⁴⁵⁶⁷⁸⁹]+)?)")


@dataclass(frozen=True, slots=True)
class Unit:
    """A product of powers of the metre and the second (a radian is 1).

    >>> speed = Unit(1, -1)
    >>> str(speed), str(speed**2 / Unit(0, 1)), str(speed / speed)
    ('m/s', 'm²/s³', '1')
    """

    metre: Fraction | int = 0
    second: Fraction | int = 0

    @classmethod
    def parse(cls, text: str) -> Unit:
        """The unit that a text such as "m²/s³", "m·s^2", "1/s" or "" names.

        >>> Unit.parse("m²/s³") == Unit(2, -3)
        True
        """
        exponents = {"m": Fraction(0), "s": Fraction(0)}
        above, slash, below = text.replace(" ", "").replace("*", "·").partition("/")
        if below.startswith("(") and below.endswith(")"):
            below = below[1:-1]
        elif "·" in below:  # m/s·s: divided or multiplied by the second s?
            below = "?"
        for sign, part in ((1, above if above or slash else "1"), (-1, below if slash else "1")):
            for word in part.split("·"):
                found = _FACTOR.fullmatch(word)
                if found is None or found[2] in ("^", "-", "^-"):
                    msg = f"unit: expected powers of m and s such as m²/s³ or 1/(m·s), received {text!r}"
                    raise ValueError(msg)
                if found[1] in exponents:
                    exponents[found[1]] += sign * Fraction(found[2].translate(LOWERED).strip("^") or 1)
        return cls(exponents["m"], exponents["s"])

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.metre + other.metre, self.second + other.second)

    def __truediv__(self, other: Unit) -> Unit:
        return Unit(self.metre - other.metre, self.second - other.second)

    def __pow__(self, power: Fraction | int) -> Unit:
        return Unit(self.metre * power, self.second * power)

    def __str__(self) -> str:
        powers = [("m", self.metre), ("s", self.second)]
        above = "·".join(_power(base, p) for base, p in powers if p > 0)
        below = "·".join(_power(base, -p) for base, p in powers if p < 0)
        return (above or "1") + (f"/({below})" if "·" in below else f"/{below}" if below else "")

    def size(self, metre: float, second: float) -> float:
        """How many of this unit, made of the ordinary metre and second, the unit made of others is."""
        return float(metre ** float(self.metre) * second ** float(self.second))


#: A unit, or a vector or matrix of them, one for each element.
Units = Any


def integrators(n: int, strength: float, *, P0: ArrayLike, x0: ArrayLike | None = None) -> ContinuousModel:
    r"""A coordinate whose n-th derivative is white noise, and its first n − 1 derivatives; the coordinate is measured.

    .. math:: \dot x_i = x_{i+1}, \quad \dot x_n = w, \quad z = x_1 + v

    Parameters
    ----------
    n : number of integrators: 1 position, 2 velocity, 3 acceleration is a Brownian motion
    strength : σ_w², m²/s^(2n−1), ≥ 0, of the white noise w, which is the diffusion of that Brownian motion
    P0, x0 : (n, n), (n,), covariance and mean of the states at t0; x0 defaults to zeros

    Returns
    -------
    ContinuousModel with the states x, v, a, … in m, m/s, m/s², …; it has no Rc, measurements are sampled

    Source: Semushin & Tsyganova 2001, section 4.1 and tasks 1, 3, 4.

    >>> integrators(2, 0.5, P0=[[1, 0], [0, 1]]).units
    ('m', 'm/s')
    """
    n = checks.count("n", n)
    states = [*NAMES, *(f"d{i}x" for i in range(len(NAMES), n))][:n]
    return ContinuousModel(
        F=np.eye(n, k=1),
        G=np.eye(n)[:, -1:],
        Q=[[strength]],
        H=np.eye(n)[:1],
        x0=x0,
        P0=P0,
        states=states,
        measurements=["z"],
        units=[str(Unit(1, -i)) for i in range(n)],
    )


def with_constant(model: ContinuousModel) -> ContinuousModel:
    r"""The same motion with the last state taken apart: its random constant c and its Brownian motion β.

    .. math:: x_n(t) = c + \beta(t), \quad \dot c = 0, \quad \dot\beta = w, \quad \beta(t_0) = 0

    Parameters
    ----------
    model : from :func:`integrators`

    Returns
    -------
    ContinuousModel with n + 1 states, the last two c and β. Measurements never tell them apart: the direction (1, −1)
        is not observable, and what is known of c comes from β(t0) = 0.

    Source: Semushin & Tsyganova 2001, tasks 3 and 4 (what is estimated?).

    >>> with_constant(integrators(2, 1.0, P0=[[1, 0], [0, 4]])).F
    array([[0., 1., 1.],
           [0., 0., 0.],
           [0., 0., 0.]])
    """
    checks.instance("model", model, ContinuousModel)
    n = model.n
    if not (np.array_equal(model.F, np.eye(n, k=1)) and np.array_equal(model.G, np.eye(n)[:, -1:])):
        msg = f"model: expected integrators in a row, received F = {model.F.tolist()}, G = {model.G.tolist()}"
        raise ValueError(msg)
    F = np.zeros((n + 1, n + 1))
    F[:n, :n] = model.F
    F[: n - 1, n] = model.F[:-1, n - 1]
    H = np.hstack([model.H, model.H[:, -1:]])
    P0 = np.zeros((n + 1, n + 1))
    P0[:n, :n] = model.P0
    return ContinuousModel(
        F=F,
        G=np.eye(n + 1)[:, -1:],
        Q=model.Q,
        H=H,
        x0=[*model.x0, 0.0],
        P0=P0,
        states=[*model.states[:-1], "c", "β"],
        measurements=model.measurements,
        units=[*model.units, model.units[-1]],
    )


def units(model: ContinuousModel) -> dict[str, Units]:
    r"""The SI unit of every quantity in a model, its discretisation and its filter.

    Everything follows from the units of the states in ẋ = Fx + Gw, z = Hx + v, with G and H pure numbers: an element
    (i, j) of Φ turns unit j into unit i, a covariance has the product of two units, δ(t) in E[ww'] = Qδ is 1/s.

    Parameters
    ----------
    model : continuous model with units of its states in metres and seconds

    Returns
    -------
    by letter, a :class:`Unit` or nested lists of them in the shape of the quantity: ``t, x, w, z, v; F, Q, H, x0, P0, R; Phi, Qd``,
        the factors ``Gd`` (unit triangular), ``Qd_diagonal``, ``Gd_standardised`` with their noises
        ``w_diagonal``, ``w_standardised``; ``P, K, S`` and ``Rc``

    Raises
    ------
    ValueError
        A unit that is no product of metres and seconds; a noise or a measurement that would add different units.

    Source: Semushin & Tsyganova 2001, task 3 (b).

    >>> table = units(integrators(2, 1.0, P0=[[1, 0], [0, 1]]))
    >>> str(table["Q"][0][0]), str(table["Gd"][1][0]), [str(row[0]) for row in table["K"]]
    ('m²/s³', '1/s', ['1', '1/s'])
    """
    checks.instance("model", model, ContinuousModel)
    one, second = Unit(), Unit(0, 1)
    x = [Unit.parse(unit) for unit in model.units]
    w = [_common("G", [x[i] / second for i in np.flatnonzero(column)], column) for column in model.G.T]
    z = [_common("H", [x[i] for i in np.flatnonzero(row)], row) for row in model.H]
    ratio, product = _outer(x, [one / unit for unit in x]), _outer(x, x)
    return {
        "t": second, "x": x, "w": w, "z": z, "v": z,
        "F": [[unit / second for unit in row] for row in ratio],
        "G": [[one] * model.s] * model.n, "H": [[one] * model.n] * model.m,
        "Q": [[unit * second for unit in row] for row in _outer(w, w)],
        "x0": x, "P0": product, "P": product, "R": _outer(z, z), "S": _outer(z, z),
        "Rc": [[unit * second for unit in row] for row in _outer(z, z)],
        "Phi": ratio, "Qd": product,
        "Gd": ratio, "w_diagonal": x, "Qd_diagonal": [unit**2 for unit in x],
        "Gd_standardised": [[unit] * model.n for unit in x], "w_standardised": [one] * model.n,
        "K": _outer(x, [one / unit for unit in z]),
    }  # fmt: skip


def converted(value: ArrayLike, unit: Units, metre: float, second: float) -> Array:
    """Numbers in SI units as numbers in units made of other lengths and times.

    Parameters
    ----------
    value : number or array · unit : its :class:`Unit`, or one for each element (of the last axes)
    metre, second : the new unit of length in m, of time in s

    >>> converted([36.0, 1.0], [Unit(1, -1), Unit(0, 1)], 1000.0, 3600.0).round(6)
    array([1.296e+02, 2.780e-04])
    """
    return np.asarray(value, dtype=np.float64) / _sizes(unit, metre, second)


def rescaled(model: ContinuousModel, metre: float, second: float) -> ContinuousModel:
    """The same model with all its numbers in other units of length and time.

    Parameters
    ----------
    model : continuous model with units of its states in metres and seconds
    metre, second : the new unit of length in m, of time in s, both > 0

    The names of the units are dropped: the numbers are no longer in SI units.

    >>> rescaled(integrators(1, 1.0, P0=[[4]]), metre=2.0, second=1.0).P0
    array([[1.]])
    """
    metre, second = checks.positive("metre", metre), checks.positive("second", second)
    table = units(model)
    if model.N is not None or model.B is not None:
        msg = "model: expected neither N nor B, whose units the states do not determine, received one"
        raise ValueError(msg)
    matrices = {"F": model.F, "Q": model.Q, "x0": model.x0, "P0": model.P0, "Rc": model.Rc}
    changed: dict[str, Any] = {
        name: converted(value, table[name], metre, second) for name, value in matrices.items() if value is not None
    }
    return replace(model, **changed, units=("",) * model.n)


def _power(base: str, power: Fraction | int) -> str:
    return base if power == 1 else base + str(power).translate(RAISED)


def _outer(rows: Sequence[Unit], columns: Sequence[Unit]) -> list[list[Unit]]:
    return [[a * b for b in columns] for a in rows]


def _common(name: str, found: Sequence[Unit], numbers: Array) -> Unit:
    """The one unit of the terms that a row of H adds, or that a column of G drives."""
    if len(set(found)) > 1:
        msg = f"{name}: expected states of one unit where {name} has {numbers.tolist()}, received {sorted(map(str, set(found)))}"
        raise ValueError(msg)
    return found[0] if found else Unit()


def _sizes(unit: Units, metre: float, second: float) -> Any:
    if isinstance(unit, Unit):
        return unit.size(metre, second)
    return np.array([_sizes(element, metre, second) for element in unit])
