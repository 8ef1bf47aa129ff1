r"""What a regulator shall keep small: a quadratic cost of states and inputs.

.. math:: J = E\int (x^TQ_xx + 2x^TNu + u^TQ_uu)\,dt \quad\text{or}\quad
          J = E\sum_k (x_k^TQ_xx_k + 2x_k^TNu_k + u_k^TQ_uu_k)

per second of a :class:`~ctlabs.models.linear.ContinuousModel`, per step of a :class:`~ctlabs.models.linear.DiscreteModel`: the
type of the model that the cost meets chooses between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import ContinuousModel, DiscreteModel

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Outputs: TypeAlias = Mapping[str, "float | tuple[ArrayLike, float]"] | ArrayLike

#: A default that ``__post_init__`` replaces.
DEFAULT: Any = None


class Weights(NamedTuple):
    """The weights for one model, those of its outputs included: Qx (n, n), Qu (r, r), N (n, r), Qf (n, n)."""

    Qx: Array
    Qu: Array
    N: Array
    Qf: Array

    @property
    def joint(self) -> Array:
        """[[Qx, N], [Nᵀ, Qu]], (n+r, n+r)."""
        return np.block([[self.Qx, self.N], [np.swapaxes(self.N, -1, -2), self.Qu]])


@dataclass(frozen=True, slots=True, eq=False)
class Cost:
    r"""A quadratic cost.

    Parameters
    ----------
    Qx : (n, n) or (steps, n, n), weight of the states, 1/unit² (and per second of a continuous model); zero where only outputs count
    Qu : (r, r) or (steps, r, r), weight of the inputs. It may be singular, 0 included, where the least variance is sought with
        whatever inputs that takes
    N : (n, r) or (steps, n, r), cross weight, or ``None``
    Qf : (n, n), weight of the state at the end of a finite horizon, or ``None``
    horizon : the end: whole steps of a discrete model, seconds of a continuous one; ``None``, the mean per step or second for ever
    outputs : weights of what is measured, (m, m), or by name: ``{"position": 2.0}`` a measurement, ``{"miss": ([1, -1], 3.0)}``
        a combination of the states under a name of its own. :math:`y = Cx + Du` adds :math:`C^TQ_yC` to Qx, and with the model's D
        :math:`C^TQ_yD` to N, :math:`D^TQ_yD` to Qu
    discount : weight of what comes one step or one second later, 0 < discount ≤ 1
    constant : what is added per step or second whatever the inputs do (noise between the samples: :func:`ctlabs.regulation.sample`)

    Raises
    ------
    ValueError, TypeError
        A shape that does not fit; an indefinite Qx, Qu, Qf or [[Qx, N], [Nᵀ, Qu]]; a horizon or discount out of range.

    Source: Anderson & Moore, *Optimal Control: Linear Quadratic Methods* (1990), section 2.3, 3.4.

    >>> cost = Cost(Qx=[[1, 0], [0, 0]], Qu=[[0.1]])
    >>> cost.Qx.shape, cost.Qu
    ((2, 2), array([[0.1]]))
    >>> Cost(Qx=[[1]], Qu=[[-1]])
    Traceback (most recent call last):
    ...
    ValueError: Qu: expected weights >= 0 on the diagonal, received -1
    """

    Qx: Array | None = None
    Qu: Array = DEFAULT
    N: Array | None = None
    Qf: Array | None = None
    horizon: float | None = None
    _: KW_ONLY
    outputs: Any = None
    discount: float = 1.0
    constant: float = 0.0

    if TYPE_CHECKING:  # what may be given: anything array-like; what is read: arrays

        def __init__(
            self,
            Qx: ArrayLike | None = None,
            Qu: ArrayLike | None = None,
            N: ArrayLike | None = None,
            Qf: ArrayLike | None = None,
            horizon: float | None = None,
            *,
            outputs: Outputs | None = None,
            discount: float = 1.0,
            constant: float = 0.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        if self.Qu is None or (self.Qx is None and self.outputs is None):
            missing = "Qu" if self.Qu is None else "Qx (or outputs)"
            msg = f"Cost: expected {missing}, received none"
            raise ValueError(msg)
        put("Qu", checks.weight("Qu", self.Qu, ("r", "r"), ("steps", "r", "r")))
        r, n = self.Qu.shape[-1], "n"
        if self.Qx is not None:
            put("Qx", checks.weight("Qx", self.Qx, ("n", "n"), ("steps", "n", "n")))
            n = self.Qx.shape[-1]
        if self.N is not None:
            put("N", checks.shaped("N", self.N, (n, r), ("steps", n, r)))
        if self.Qf is not None:
            put("Qf", checks.weight("Qf", self.Qf, (n, n)))
        if self.N is not None and self.outputs is None:
            self._joint(self.Qx, self.N, self.Qu)
        put("outputs", _outputs(self.outputs))
        put("discount", checks.positive("discount", self.discount))
        if self.discount > 1:
            msg = f"discount: expected a number in (0, 1], received {self.discount:g}"
            raise ValueError(msg)
        put("constant", checks.nonnegative("constant", self.constant))
        if self.horizon is not None:
            put("horizon", checks.positive("horizon", self.horizon))
        elif self.Qf is not None:
            msg = "Qf: expected a horizon beside the weight of the last state, received none"
            raise ValueError(msg)

    @staticmethod
    def _joint(Qx: Array | None, N: Array, Qu: Array) -> None:
        if Qx is None:
            return
        whole = Weights(*_alike(Qx, Qu, N), np.zeros(0)).joint
        checks.weight("[[Qx, N], [N', Qu]]", whole, *((whole.shape,) if whole.ndim == 2 else (("steps", *whole.shape[1:]),)))

    def weights(self, model: ContinuousModel | DiscreteModel) -> Weights:
        """The weights for a model, with those of its outputs and zeros for what is not given.

        >>> cart = ContinuousModel([[0, 1], [0, 0]], [[0], [1]], [[1]], [[1, 0]], B=[[0], [1]], P0=np.eye(2), measurements=["place"])
        >>> Cost(Qu=[[1]], outputs={"place": 4.0}).weights(cart).Qx
        array([[4., 0.],
               [0., 0.]])
        """
        n, r = model.n, model.r
        if model.B is None:
            msg = "model: expected B, how an input moves the states, received none"
            raise ValueError(msg)
        if self.Qu.shape[-1] != r:
            msg = f"Qu: expected shape ({r}, {r}) as the model's inputs, received {self.Qu.shape}"
            raise ValueError(msg)
        if self.Qx is not None and self.Qx.shape[-1] != n:
            msg = f"Qx: expected shape ({n}, {n}) as the model's states, received {self.Qx.shape}"
            raise ValueError(msg)
        Qx = np.zeros((n, n)) if self.Qx is None else self.Qx
        N = np.zeros((n, r)) if self.N is None else self.N
        if N.shape[-2:] != (n, r):
            msg = f"N: expected shape ({n}, {r}), received {N.shape}"
            raise ValueError(msg)
        Qu = self.Qu
        for C, D, weight in self._seen(model):
            Qx, N, Qu = Qx + C.T @ weight @ C, N + C.T @ weight @ D, Qu + D.T @ weight @ D
        if N.any():
            self._joint(Qx, N, Qu)
        Qf = np.zeros((n, n)) if self.Qf is None else checks.shaped("Qf", self.Qf, (n, n))
        return Weights(*_alike(Qx, Qu, N), Qf)

    def _seen(self, model: ContinuousModel | DiscreteModel) -> list[tuple[Array, Array, Array]]:
        """C, D and weight of each group of outputs."""
        if self.outputs is None:
            return []
        H, D = model.H, np.zeros((model.m, model.r)) if model.D is None else model.D
        named = isinstance(self.outputs, dict)
        measured = not named or any(row is None for row, _weight in self.outputs.values())
        if measured and (H.ndim == 3 or D.ndim == 3):
            msg = "outputs: expected a model whose H and D are constant, received ones that vary (put their weights into Qx)"
            raise ValueError(msg)
        if not named:
            return [(H, D, checks.shaped("outputs", self.outputs, (model.m, model.m)))]
        found = []
        for name, (row, weight) in self.outputs.items():
            if row is None and name not in model.measurements:
                known = ", ".join(repr(each) for each in model.measurements)
                msg = f"outputs: expected a measurement ({known}) or a name with a row, ([...], weight), received {name!r}"
                raise ValueError(msg)
            i = model.measurements.index(name) if row is None else 0
            c = H[i] if row is None else checks.shaped(f"outputs[{name!r}]", row, (model.n,))
            d = D[i] if row is None else np.zeros(model.r)
            found.append((c[None], d[None], np.array([[weight]])))
        return found

    def _repr_latex_(self) -> str:
        from ctlabs.text import latex_matrix

        shown = {"Q_x": self.Qx, "N": self.N, "Q_u": self.Qu, "Q_f": self.Qf}
        return "$$" + r" \qquad ".join(f"{k} = {latex_matrix(v)}" for k, v in shown.items() if v is not None and v.ndim == 2) + "$$"


def _alike(Qx: Array, Qu: Array, N: Array) -> tuple[Array, Array, Array]:
    """Qx, Qu, N, all with a time axis where one has it."""
    steps = {len(M) for M in (Qx, Qu, N) if M.ndim == 3}
    if len(steps) > 1:
        msg = f"Cost: expected weights that vary over one number of steps, received {sorted(steps)}"
        raise ValueError(msg)
    if not steps:
        return Qx, Qu, N
    (count,) = steps
    whole = [np.broadcast_to(M, (count, *M.shape[-2:])) for M in (Qx, Qu, N)]
    return whole[0], whole[1], whole[2]


def _outputs(given: Any) -> Any:
    """The weights of outputs, checked: a matrix, or name → (row or None, weight)."""
    if given is None:
        return None
    if not isinstance(given, Mapping):
        return checks.weight("outputs", given, ("m", "m"))
    found: dict[str, tuple[Array | None, float]] = {}
    for name, value in given.items():
        row, weight = value if isinstance(value, tuple | list) else (None, value)
        where = f"outputs[{name!r}]"
        found[name] = (None if row is None else checks.shaped(where, row, ("n",)), checks.nonnegative(where, weight))
    return found
