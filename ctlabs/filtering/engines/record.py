"""One record as a form of the filter sees it: what moves the state and what is measured, instant by instant, in any kind of number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering import motion
from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Counted, Noise, Numbers
from ctlabs.linalg.checks import Array
from ctlabs.models.linear import DiscreteModel, at


class ByInstant:
    """A model with data, instant by instant, as the forms take it: in one kind of number, only what is measured.

    ``used`` (steps+1, m): which elements enter the updates (:func:`entering`).
    """

    def __init__(self, model: DiscreteModel, z: Array, kind: Any, used: NDArray[np.bool_]) -> None:
        self.model, self.z, self.kind, self.used = model, z, kind, used
        self._kept: dict[Any, Any] = {}

    def made(self, model: DiscreteModel, kind: Any, used: NDArray[np.bool_]) -> ByInstant:
        """The same data beside another model, in another kind of number."""
        return ByInstant(model, self.z, kind, used)

    def motion(self, k: int) -> tuple[Numbers, Numbers | None, Noise]:
        """Φ, c and Q from k to k+1; with N ≠ 0 what z_k tells of w_k is in them: Φ−NR⁺H, Qd−NR⁺Nᵀ, c + NR⁺z."""
        model, used = self.model, self.used[k]
        coupled = model.N is not None and bool(used.any())
        matrices = (model.Phi, model.Qd, model.H, model.R) if coupled else (model.Phi, model.Qd)
        key = ("motion", used.tobytes() if coupled else b"")
        Phi, Q, M = self._keep(key, matrices, lambda: self._motion(k, coupled))
        c = None
        if model.offset is not None:
            offset = model.offset[..., None]
            c = self._keep(("offset",), (offset,), lambda: contract.numbers(at(offset, k, 2), self.kind))
        if M is not None:
            told = M @ contract.numbers(self.z[k, used], self.kind)
            c = told if c is None else c + told
        return Phi, c, Q

    def measurement(self, k: int) -> tuple[Numbers, Numbers, Noise]:
        """z, H and R of the elements used at k."""
        model, used = self.model, self.used[k]
        place = used.tobytes()
        H = self._keep(("H", place), (model.H,), lambda: contract.numbers(at(model.H, k, 2)[used], self.kind))
        R = self._keep(("R", place), (model.R,), lambda: self._noise(at(model.R, k, 2)[np.ix_(used, used)]))
        return contract.numbers(self.z[k, used], self.kind), H, R

    def _keep(self, key: Any, matrices: tuple[Array, ...], make: Callable[[], Any]) -> Any:
        """What is made of constant matrices is made once."""
        if any(matrix.ndim == 3 for matrix in matrices):
            return make()
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _noise(self, matrix: Array) -> Noise:
        return Noise(contract.numbers(matrix, self.kind))

    def _motion(self, k: int, coupled: bool) -> tuple[Numbers, Noise, Numbers | None]:
        model, used = self.model, self.used[k]
        if not coupled or self.kind in (float, Counted):
            Phi, Qd, M = motion.motion(model, k, used)
            own = None if M is None else contract.numbers(M, self.kind)
            return contract.numbers(Phi, self.kind), self._noise(Qd), own
        # The same in this kind of number; any generalised inverse of R serves, as N has nothing outside R's range.
        rounded = motion.motion(model, k, used)[1]
        assert model.N is not None
        Phi, Qd, H, N, R = (
            contract.numbers(part, self.kind)
            for part in (
                at(model.Phi, k, 2),
                at(model.Qd, k, 2),
                at(model.H, k, 2)[used],
                model.N[:, used],
                at(model.R, k, 2)[np.ix_(used, used)],
            )
        )
        noise = Noise(R)
        inverse = np.array([1 / d if d else d for d in noise.d], dtype=object)
        rows = contract.substituted(noise.L, N.T) * inverse[:, None]
        M = contract.substituted_back(noise.L.T, rows).T
        left = Qd - M @ N.T
        left[rounded == 0] = contract.like(0.0, left)
        return Phi - M @ H, Noise(left), M
