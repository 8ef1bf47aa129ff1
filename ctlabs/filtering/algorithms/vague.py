r"""A start of which little or nothing is known: x = x̂ + e + Aδ.

e is an ordinary error with the covariance P = LLᵀ, and the columns of A (n, d) are what is vaguely known, with δ ~ N(0, I), or not known
at all, with a flat δ (``inf`` in P0). A measured element h with the noise r sees :math:`s = hPh^T + r` of e, β of one vague column
and α of one unknown column, after reflections of the columns (:mod:`ctlabs.linalg.columns`). With
:math:`K = Ph^T/s` and, where there is a vague column V, :math:`F = s + \beta^2`,

.. math:: L \leftarrow [(I-Kh)L,\ \sqrt rK]\,\Theta, \quad K_v = K + (V-K\beta)\beta/F, \quad
          V \leftarrow (V-K\beta)\sqrt{s/F}

An unknown column U is determined: the gain is :math:`U/\alpha`, and :math:`(U-K_v\alpha)\sqrt F/\alpha` is a vague column in its
place. There is no limit and no infinite covariance, and nothing large is subtracted from something large; R = 0 and singular Φ or Q
are no exceptions. A vague column that has become about as small as the noises becomes one of L, and when no
column is left any form of the filter goes on from x̂ and P.

e is carried by its root (Θ is orthogonal): what is known of a state beside δ may be a part of 1e-12 of its whole variance, and the
rounding of P, which is that of the whole, would make P indefinite there.

The likelihood of the elements that determine the unknown columns is :math:`-\tfrac12\ln 2\pi - \tfrac12\ln\alpha^2`.

Source: Rosenberg, *Annals of Economic and Social Measurement* 2 (1973); de Jong, *Annals of Statistics* 19 (1991) 1073–1083; the
likelihood of Durbin & Koopman, *Time Series Analysis by State Space Methods* (2nd ed., 2012), sections 5.2 and 7.2.2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ctlabs.filtering.algorithms import contract
from ctlabs.filtering.algorithms.contract import Noise, Numbers, precision
from ctlabs.linalg import columns, rounding
from ctlabs.linalg.checks import Array
from ctlabs.models import DiscreteModel, at

#: A vague column is one whose variance, as a measurement sees it, is so many times that of the noises.
LARGE = 1e6
#: Measurements that are looked at beforehand, in a model that varies, for each state.
LOOKED = 20


class State(NamedTuple):
    """``x`` (n, runs) · ``P`` (n, n), without what A holds, and its root ``L`` (n, n) · ``A`` (n, d), first the ``unknown`` columns.

    ``x`` has any number where a state is not known. ``sight`` (rows, n): in units of the noises, what measurements see
    of the states.
    """

    x: Numbers
    P: Numbers
    L: Numbers
    A: Numbers
    unknown: int
    sight: Array

    @property
    def settled(self) -> bool:
        """Whether an ordinary filter may go on from x and P."""
        return self.A.shape[1] == 0

    @property
    def lost(self) -> NDArray[np.bool_]:
        """The states of which nothing is known, (n,)."""
        return (contract.doubles(self.A[:, : self.unknown]) != 0).any(axis=1)

    @property
    def mean(self) -> Numbers:
        """The estimate, (n, runs); NaN for a state not known at all."""
        return np.where(self.lost[:, None], contract.like(np.nan, self.x), self.x)

    @property
    def covariance(self) -> Numbers:
        """The covariance of its error, (n, n); ``inf`` and zeros beside it for a state not known at all."""
        lost, vague = self.lost, self.A[:, self.unknown :]
        P = np.where(lost[:, None] | lost, contract.zeros(self.P.shape, self.P), self.P + vague @ vague.T)
        P[lost, lost] = contract.like(np.inf, P)
        return P


class VagueUpdate(NamedTuple):
    """What one instant says: ``log_likelihood`` and ``nis`` (runs,), the ``used`` elements (m,).

    ``determined``: how many unknown columns it determined · ``excess`` (m, runs), the innovation of an element that is left out,
    given the ones before it, and the ``terms`` (m,) whose rounding may be in it; NaN where one is used
    """

    log_likelihood: Numbers
    nis: Numbers
    used: NDArray[np.bool_]
    determined: int
    excess: Array
    terms: Array


def needed(model: DiscreteModel, P0: Array) -> bool:
    """Whether P0 is such that an ordinary filter would lose digits, or could not start.

    ``inf`` on its diagonal, or a part that a measurement sees :data:`LARGE` times as large as the noises.
    """
    return too_large(sight(model), P0)


def too_large(sight: Array, P0: Array) -> bool:
    """Whether P0 may have a part that is large in the :func:`sight`: none of its roots has larger elements than the standard deviations."""
    with np.errstate(invalid="ignore"):  # 0·inf: what no measurement sees
        size = np.abs(sight) @ np.sqrt(P0.diagonal())
    return bool((size > LARGE**0.5).any()) or not np.isfinite(P0.diagonal()).all()


def start(model: DiscreteModel, P0: Numbers, there: Array | None = None) -> State:
    """The state at t0: mean ``model.x0``, covariance ``P0`` with ``inf`` where nothing is known.

    What is large, the :func:`sight` ``there`` decides; by default the model's, and nothing where P0 has more digits than doubles.
    """
    if there is None:
        there = sight(model) if P0.dtype == np.float64 else np.zeros((0, model.n))
    x, none = contract.column(model, P0), contract.zeros((len(P0), 0), P0)
    if not too_large(there, contract.doubles(P0)):
        return State(x, P0, _square(contract.rooted(P0)), none, 0, there)
    unknown = contract.unknown(P0)
    x = np.where(unknown[:, None], contract.zeros((len(P0), 1), P0), x)
    known = np.where(unknown[:, None] | unknown, contract.zeros(P0.shape, P0), P0)
    A, root = contract.identity(len(P0), P0)[:, unknown], contract.rooted(known)
    large = seen(there, root)
    L = _square(root[:, ~large])
    return State(x, L @ L.T if large.any() else known, L, np.hstack([A, root[:, large]]), A.shape[1], there)


def _square(L: Numbers) -> Numbers:
    """A root (n, n) of the same covariance: zeros in the columns that it has not."""
    return np.hstack([L, contract.zeros((len(L), len(L) - L.shape[1]), L)])


def sight(model: DiscreteModel) -> Array:
    r"""What the measurements of the first instants see of the states: rows :math:`h\Phi^k/\sqrt{r_k}`, (rows, n).

    :math:`r_k` is the variance of their noises, those of the disturbances on the way included; where all of them are zero there is
    no row.
    """
    last = model.n if model.horizon is None else model.horizon
    Phi, Q, rows, noises = np.eye(model.n), np.zeros((model.n, model.n)), list[Array](), list[Array]()
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for k in range(last + 1):
            H = at(model.H, k, 2)
            rows.append(H @ Phi)
            noises.append(((H @ Q) * H).sum(axis=1) + at(model.R, k, 2).diagonal())
            if k == last or (k >= model.n and len(rows) * model.m > LOOKED * model.n):
                break
            step = at(model.Phi, k, 2)
            Phi, Q = step @ Phi, step @ Q @ step.T + at(model.Qd, k, 2)
        found, noise = np.vstack(rows), np.concatenate(noises)
        found = found / np.sqrt(noise)[:, None]
    return found[(noise > 0) & np.isfinite(found).all(axis=1)]


def seen(sight: Array, A: Numbers) -> NDArray[np.bool_]:
    """Which columns (n, d) are :data:`LARGE` in units of the noises; terms that cancel count."""
    size = (np.abs(sight) @ np.abs(contract.doubles(A))).max(axis=0, initial=0.0)
    return np.asarray(size > LARGE**0.5)


def predict(state: State, Phi: Numbers, c: Numbers | None, Q: Noise) -> State:
    """One step ahead."""
    unknown = columns.moved(Phi, state.A[:, : state.unknown], precision(state.P))
    A = np.hstack([unknown, Phi @ state.A[:, state.unknown :]])
    moved = rooted(state, Phi @ state.L, Q.columns)
    return folded(moved._replace(x=contract.moved(Phi, state.x, c), A=A, unknown=unknown.shape[1]))


def rooted(state: State, *parts: Numbers) -> State:
    """The state with the P of which these columns together are a root."""
    L = contract.triangular(np.hstack(parts))
    return state._replace(P=L @ L.T, L=L)


def update(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[State, VagueUpdate]:
    """One instant's measurements, one element after another; a perfect one of what is known already is left out."""
    z, H, r = contract.decorrelated(z, H, R)
    state = state._replace(x=np.repeat(state.x, z.shape[1] // state.x.shape[1], axis=1))
    none = contract.zeros(z.shape[1], state.P)
    told = VagueUpdate(none, none, np.ones(len(z), dtype=bool), 0, np.full(z.shape, np.nan), np.full(len(z), np.nan))
    for i in range(len(z)):
        state, told = _element(state, told, i, z[i], H[i], r[i])
    return folded(state), told


def _element(state: State, told: VagueUpdate, i: int, z: Numbers, h: Numbers, r: Any) -> tuple[State, VagueUpdate]:
    """One element z (runs,) with the row h (n,) and the variance r."""
    eps, number = precision(state.P), state.unknown
    nu, K, s = z - h @ state.x, *_gain(state, h, r, eps)
    unknown, vague = state.A[:, :number], state.A[:, number:]
    b, F, K_v = columns.seen(h, vague, eps, 0.25), s, K
    if b.any():
        vague = columns.cleaned(*columns.turned(vague, b), eps)
        beta = h @ vague[:, 0]
        F, V = s + beta * beta, vague[:, 0] - K * beta
        K_v = K + V * (beta / F)
        vague = np.column_stack([V * (s / F) ** 0.5, vague[:, 1:]])
    a = columns.seen(h, unknown, eps)
    if a.any():
        unknown = columns.cleaned(*columns.turned(unknown, a), eps)
        U, alpha = unknown[:, 0], h @ unknown[:, 0]
        K_all, rest = U / alpha, unknown[:, 1:]
        unknown = rest - np.outer(K_all, h @ rest)  # which h sees no more: not even the rounding of the reflection
        vague = np.column_stack([vague, (U - K_v * alpha) * (F**0.5 / alpha)])
        own = contract.independent(0 * nu[None], np.array([alpha * alpha], dtype=nu.dtype))
        told = told._replace(determined=told.determined + 1)
    elif not F > 0:
        return state, _left_out(told, i, nu, np.abs(z) + np.abs(h) @ np.abs(state.x))
    else:
        K_all, own = K_v, contract.independent(nu[None], np.array([F], dtype=nu.dtype))
    told = told._replace(log_likelihood=told.log_likelihood + own.log_likelihood, nis=told.nis + own.nis)
    vague = vague[:, (vague != 0).any(axis=0)]
    left = contract.identity(len(h), state.P) - np.outer(K, h)
    after = rooted(state, left @ state.L, (K * r**0.5)[:, None])
    if r == 0 and after.P.dtype == np.float64:
        P = rounding.corrected(after.P, state.P, K[:, None], h[None])
        after = after._replace(P=P, L=np.where(P.diagonal()[:, None] == 0, 0.0, after.L))
    elif r == 0:
        terms = (contract.identity(len(h), K) + np.abs(np.outer(K, h))) @ np.abs(state.P.diagonal()) ** 0.5
        L = columns.cleaned(after.L, np.outer(terms, np.ones(len(h))), eps)
        after = after._replace(P=L @ L.T, L=L)
    A = np.hstack([unknown, vague])
    return after._replace(x=state.x + np.outer(K_all, nu), A=A, unknown=unknown.shape[1]), told


def _left_out(told: VagueUpdate, i: int, nu: Numbers, terms: Numbers) -> VagueUpdate:
    """An element whose innovation ν (runs,) has no variance."""
    used, excess, size = told.used.copy(), told.excess.copy(), told.terms.copy()
    used[i], excess[i], size[i] = False, contract.doubles(nu), contract.doubles(terms).max()
    return told._replace(used=used, excess=excess, terms=size)


def _gain(state: State, h: Numbers, r: Any, eps: float) -> tuple[Numbers, Any]:
    """K = Phᵀ/s and s = hPhᵀ + r; both zero where a perfect measurement sees what is known."""
    row = h @ state.L
    s = row @ row + r
    terms = (np.abs(h) @ np.abs(state.P.diagonal()) ** 0.5) ** 2
    if r == 0 and s <= 4 * rounding.level(terms, len(h), eps):
        return 0 * h, 0 * s
    return state.L @ row / s, s


def folded(state: State) -> State:
    """The state with the vague columns that are no longer large in P."""
    vague = state.A[:, state.unknown :]
    if not vague.shape[1]:
        return state
    large = seen(state.sight, vague)
    if large.all():
        return state
    small = vague[:, ~large]
    A = np.hstack([state.A[:, : state.unknown], vague[:, large]])
    return rooted(state, state.L, small)._replace(A=A)




def innovation(state: State, z: Numbers, H: Numbers, R: Noise) -> tuple[Array, Array]:
    """ν and S in doubles; NaN, and ``inf`` on the diagonal, for an element that sees something unknown."""
    A, vague = state.A[:, : state.unknown], state.A[:, state.unknown :]
    eps = precision(state.P)
    free = np.array([columns.seen(h, A, eps).any() for h in H], dtype=bool)
    rows = H @ vague
    nu = contract.doubles(z - H @ state.x)
    S = contract.doubles(H @ state.P @ H.T + rows @ rows.T + R.matrix)
    nu[free], S[free], S[:, free] = np.nan, 0.0, 0.0
    S[free, free] = np.inf
    return nu, S
