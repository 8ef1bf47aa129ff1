"""Labs 3 and 4: the model, and what all parts of the report share."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ctlabs.filtering import steady
from ctlabs.linalg.factors import factor, unit_triangular
from ctlabs.models import DiscreteModel, kinematics, symbolic
from ctlabs.models.discretisation import discretise
from ctlabs.text import text

#: The states in the sheet's letters.
STATES = ("x", "v_x", "a")
#: What the two sheets call the quantity that is a constant plus a Brownian motion, and the curve without it.
QUANTITY = {2: "velocity", 3: "acceleration"}
CURVE = {2: "a straight line", 3: "a parabola"}


@dataclass(frozen=True)
class Lab:
    """One of the two labs, with everything its sections look at."""

    p: Any
    answer: Mapping[str, Any]
    chain: symbolic.Chain
    system: DiscreteModel
    limit: steady.SteadyState
    settled: int | None

    @property
    def n(self) -> int:
        """Number of integrators."""
        return self.system.n

    @property
    def ratio(self) -> float:
        """ρ = σ_w²τ²ⁿ⁻¹/R, on which the shape of the filter depends."""
        c = self.p.sigma_w2 * self.p.tau ** (2 * self.n - 1)
        return c / self.p.R if self.p.R else (math.inf if c else 0.0)


def continuous(p):
    """ẋ = Fx + Gw: the random constant is the initial value of the last state, the Brownian motion its increments."""
    n = len(p.P0)
    return replace(kinematics.integrators(n, p.sigma_w2, P0=p.P0, x0=p.x0_mean), states=STATES[:n])


def sampled(p):
    """The discrete model."""
    return discretise(continuous(p), p.tau, [[p.R]])


def factors(p):
    """G_d, the variances in Q̄_d, and Ḡ_d; G_d does not depend on σ_w², so it exists for σ_w² = 0 too."""
    unit = sampled(p.model_copy(update={"sigma_w2": 1.0})).Qd
    lower, variances = unit_triangular(unit)
    return lower, p.sigma_w2 * variances, math.sqrt(p.sigma_w2) * factor(unit)


def named(lab):
    """States with their units."""
    return [f"${name}$, {unit}" for name, unit in zip(lab.system.states, lab.system.units, strict=True)]


def lettered(lab):
    """States as a reader sees them."""
    return [f"${name}$" for name in lab.system.states]


def growth(n):
    """How the variance of x grows without measurements."""
    return f"$t^{2 * n - 1}$"


def squared(lab):
    """Units of the variances."""
    return [str(kinematics.Unit.parse(unit) ** 2) for unit in lab.system.units]


def listed(words):
    """Words in a row, "and" before the last."""
    *first, last = words
    return text("{first} and {last}", first=", ".join(first), last=last) if first else last


def definition(n):
    """ρ in LaTeX."""
    return rf"\rho = \sigma_w^2\tau^{2 * n - 1}/R"


def length(settled):
    """Measurements simulated: two settling times, at least 20; 40 where nothing settles, 300 at most."""
    return 40 if settled is None else int(np.clip(2 * settled, 20, 300))


def positive(values):
    """What a logarithmic axis can show."""
    return np.where(values > 0, values, np.nan)
