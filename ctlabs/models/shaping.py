r"""Shaping filters: coloured noise as the output of a linear system driven by white noise.

A block is a :class:`~ctlabs.models.ContinuousModel` whose measurement is the coloured process y(t); its noise input w
is white with the strength Q. The catalogue (:func:`bias`, :func:`random_walk`, :func:`gauss_markov`,
:func:`second_order`, :func:`oscillator`) states for each block the equation, the transfer function G(s) from
w to y, the autocorrelation :math:`\psi(\tau) = E[y(t+\tau)y(t)]` and the power spectral density
:math:`S(\omega) = \int\psi(\tau)e^{-j\omega\tau}d\tau = |G(j\omega)|^2Q` (two-sided, unit²·s, so that the variance is
:math:`\frac1{2\pi}\int S\,d\omega`). P0 is the stationary covariance where there is one.

:func:`augment` lets a block drive a plant; :func:`augment_measurement` adds its output to a measurement.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from ctlabs.linalg import checks, riccati
from ctlabs.linalg.checks import Array
from ctlabs.linalg.manyfold import Manyfold
from ctlabs.linalg.resolvent import resolvent
from ctlabs.linalg.staircase import growing
from ctlabs.linalg.units import balanced
from ctlabs.models import ContinuousModel
from ctlabs.text import mode

#: A mode is on the imaginary axis when its distance from it is below this fraction of the size of F in balanced units.
MARGIN = 1e-12


def bias(variance: float, *, name: str = "bias", unit: str = "") -> ContinuousModel:
    r"""A random constant: an unknown offset that stays the same throughout a run.

    .. math:: \dot y = 0, \quad G(s) = 0 \text{ (nothing drives it)}, \quad \psi(\tau) = \sigma^2, \quad
              S(\omega) = 2\pi\sigma^2\,\delta(\omega)

    Parameters
    ----------
    variance : σ², unit², ≥ 0
    name, unit : of the state

    Suitable for: turn-on bias of a sensor, unknown parameter. Source: Maybeck vol. 1, section 4.11.

    >>> bias(4.0).P0
    array([[4.]])
    """
    variance = checks.nonnegative("variance", variance)
    return ContinuousModel(
        [[0]], [[1]], [[0]], [[1]], P0=[[variance]], states=(name,), measurements=(name,), units=(unit,)
    )


def random_walk(strength: float, variance: float = 0.0, *, name: str = "walk", unit: str = "") -> ContinuousModel:
    r"""Brownian motion (Wiener process): the integral of white noise.

    .. math:: \dot y = w, \quad G(s) = \frac1s, \quad E[y(t)y(\tau)] = P_0 + Q\min(t, \tau)

    Not stationary: the variance grows like Qt, and Q/ω² is a density for ω ≠ 0 only.

    Parameters
    ----------
    strength : Q, unit²/s, ≥ 0
    variance : of y(0), unit², ≥ 0
    name, unit : of the state

    Suitable for: a slowly varying quantity of which nothing more is known. Source: Maybeck vol. 1, section 4.11.

    >>> random_walk(0.5).Q
    array([[0.5]])
    """
    strength, variance = checks.nonnegative("strength", strength), checks.nonnegative("variance", variance)
    return ContinuousModel(
        [[0]], [[1]], [[strength]], [[1]], P0=[[variance]], states=(name,), measurements=(name,), units=(unit,)
    )


def gauss_markov(variance: float, tau: float, *, name: str = "coloured", unit: str = "") -> ContinuousModel:
    r"""First-order Gauss–Markov process, exponentially correlated noise.

    .. math:: \dot y = -\frac1Ty + w, \quad Q = \frac{2\sigma^2}T, \quad G(s) = \frac1{s+1/T}

    .. math:: \psi(\tau) = \sigma^2e^{-|\tau|/T}, \quad S(\omega) = \frac{2\sigma^2/T}{\omega^2+1/T^2}

    Parameters
    ----------
    variance : σ², unit², ≥ 0
    tau : correlation time T, s, > 0
    name, unit : of the state

    Suitable for: band-limited noise of a known power. Source: Maybeck vol. 1, section 4.11.

    >>> gauss_markov(5.0, 0.1).Q
    array([[100.]])
    """
    variance, tau = checks.nonnegative("variance", variance), checks.positive("tau", tau)
    return ContinuousModel(
        [[-1 / tau]],
        [[1]],
        [[2 * variance / tau]],
        [[1]],
        P0=[[variance]],
        states=(name,),
        measurements=(name,),
        units=(unit,),
    )


def second_order(
    variance: float, natural_frequency: float, damping: float, *, name: str = "coloured", unit: str = ""
) -> ContinuousModel:
    r"""Second-order Gauss–Markov process: noise around a resonance.

    .. math:: \ddot y + 2\zeta\omega_0\dot y + \omega_0^2y = w, \quad Q = 4\zeta\omega_0^3\sigma^2, \quad
              G(s) = \frac1{s^2+2\zeta\omega_0s+\omega_0^2}

    .. math:: \psi(\tau) = \sigma^2e^{-\zeta\omega_0|\tau|}\left(\cos\omega_d\tau
              + \frac\zeta{\sqrt{1-\zeta^2}}\sin\omega_d|\tau|\right), \quad \omega_d = \omega_0\sqrt{1-\zeta^2}

    .. math:: S(\omega) = \frac{4\zeta\omega_0^3\sigma^2}{(\omega_0^2-\omega^2)^2+4\zeta^2\omega_0^2\omega^2}

    (ζ = 1: :math:`\psi = \sigma^2e^{-\omega_0|\tau|}(1+\omega_0|\tau|)`; ζ > 1: cosh and sinh.) The states are y and
    ẏ, P0 = diag(σ², ω0²σ²).

    Parameters
    ----------
    variance : σ² of y, unit², ≥ 0
    natural_frequency : ω0, rad/s, > 0
    damping : ζ, > 0
    name, unit : of the first state

    Suitable for: waves, bending modes, gusts. Source: Maybeck vol. 1, section 4.11.

    >>> second_order(1.0, 2.0, 0.5).F
    array([[ 0.,  1.],
           [-4., -2.]])
    """
    variance = checks.nonnegative("variance", variance)
    w0, zeta = checks.positive("natural_frequency", natural_frequency), checks.positive("damping", damping)
    return _resonance(variance, w0, zeta, name, unit)


def oscillator(variance: float, frequency: float, *, name: str = "tone", unit: str = "") -> ContinuousModel:
    r"""A sinusoid of known frequency with random amplitude and phase; :func:`second_order` without damping.

    .. math:: \ddot y + \omega_0^2y = 0, \quad G(s) = 0 \text{ (nothing drives it)}, \quad
              \psi(\tau) = \sigma^2\cos\omega_0\tau, \quad
              S(\omega) = \pi\sigma^2[\delta(\omega-\omega_0)+\delta(\omega+\omega_0)]

    Parameters
    ----------
    variance : σ² of y, unit², ≥ 0
    frequency : ω0, rad/s, > 0
    name, unit : of the first state

    Suitable for: hum, an imbalance, a tide.

    >>> oscillator(2.0, 3.0).P0
    array([[ 2.,  0.],
           [ 0., 18.]])
    """
    return _resonance(checks.nonnegative("variance", variance), checks.positive("frequency", frequency), 0.0, name, unit)


def augment(plant: ContinuousModel, block: ContinuousModel, into: int | Sequence[int] = 0) -> ContinuousModel:
    r"""A plant with coloured noise: the output of ``block`` takes the place of the plant's white noise input ``into``.

    .. math:: \dot x = Fx + G_{rest}w_{rest} + G_{into}(H_by + v_b), \quad \dot y = F_by + G_bw_b

    Parameters
    ----------
    plant : continuous model
    block : shaping filter; if it has Rc (and N), its output contains that white noise too
    into : index of the noise input, or one index for each output of the block

    Returns
    -------
    ContinuousModel with the states (x, y) and the noise (w_rest, [v_b,] w_b); the plant's measurements, known
        inputs, Rc and N are kept

    Raises
    ------
    ValueError
        An index out of range or twice; as many indices as the block has outputs; a replaced input that correlates
        with another one or with the measurement noise: the block does not say how it would then.

    Source: Maybeck vol. 1, section 4.11; design of lab 8.

    >>> plant = ContinuousModel([[-1]], [[1]], [[0]], [[1]], P0=[[0]], states=["x"])
    >>> model = augment(plant, gauss_markov(5.0, 0.1, name="y"))
    >>> model.F, model.states
    (array([[ -1.,   1.],
           [  0., -10.]]), ('x', 'y'))
    """
    columns = _indices(plant, block, into, "noise inputs")
    rest = [j for j in range(plant.s) if j not in columns]
    _unrelated(plant, columns, rest)
    G_into = plant.G[:, columns]
    F = np.block([[plant.F, G_into @ block.H], [np.zeros((block.n, plant.n)), block.F]])
    G, Q = _noises(block, G_into)
    N = None if plant.N is None else np.vstack([plant.N[rest], np.zeros((len(Q), plant.m))])
    return _joined(
        plant,
        block,
        F=F,
        G=np.hstack([np.vstack([plant.G[:, rest], np.zeros((block.n, len(rest)))]), G]),
        Q=scipy.linalg.block_diag(plant.Q[np.ix_(rest, rest)], Q),
        H=np.hstack([plant.H, np.zeros((plant.m, block.n))]),
        Rc=plant.Rc,
        N=N,
    )


def augment_measurement(
    plant: ContinuousModel, block: ContinuousModel, into: int | Sequence[int] = 0
) -> ContinuousModel:
    r"""A plant with coloured measurement noise: the output of ``block`` is added to measurement ``into``.

    .. math:: \dot x = Fx + Gw, \quad \dot y = F_by + G_bw_b, \quad z_{into} = (Hx + v)_{into} + H_by + v_b

    White noise that the plant's measurements have (Rc) stays; without Rc the coloured noise is the only one.

    Parameters
    ----------
    plant : continuous model
    block : shaping filter; its Rc (and N), if any, add to the plant's
    into : index of the measurement, or one index for each output of the block

    Returns
    -------
    ContinuousModel with the states (x, y) and the noise (w, w_b)

    Raises
    ------
    ValueError
        An index out of range or twice; as many indices as the block has outputs.

    Source: labs 15, 22, 23; Bryson & Johansen (1965), IEEE Trans. AC-10.

    >>> plant = ContinuousModel([[-1]], [[1]], [[2]], [[1]], P0=[[1]], states=["signal"])
    >>> augment_measurement(plant, gauss_markov(0.5, 0.5, name="noise")).H
    array([[1., 1.]])
    """
    rows = _indices(plant, block, into, "measurements")
    choose = np.zeros((plant.m, block.m))
    choose[rows, range(block.m)] = 1.0
    Rc, N = plant.Rc, None
    if block.Rc is not None:
        Rc = (0.0 if Rc is None else Rc) + choose @ block.Rc @ choose.T
    if plant.N is not None or block.N is not None:
        N = np.vstack([_cross(plant), _cross(block) @ choose.T])
    return _joined(
        plant,
        block,
        F=scipy.linalg.block_diag(plant.F, block.F),
        G=scipy.linalg.block_diag(plant.G, block.G),
        Q=scipy.linalg.block_diag(plant.Q, block.Q),
        H=np.hstack([plant.H, choose @ block.H]),
        Rc=Rc,
        N=N,
    )


def transfer_function(block: ContinuousModel, output: int = 0) -> tuple[Array, Array]:
    r"""From white noise of *unit* strength to an output: :math:`G(s)\sqrt Q = H(sI-F)^{-1}G\sqrt Q`.

    Returns
    -------
    num, den : descending powers of s; den is monic of degree n

    Raises
    ------
    ValueError
        More than one noise input: one spectrum then has several factors.

    >>> transfer_function(gauss_markov(1.0, 0.5))
    (array([2.]), array([1., 2.]))
    """
    checks.instance("block", block, ContinuousModel)
    _output(block, output)
    if block.s != 1:
        msg = f"block: expected one noise input, received {block.s}"
        raise ValueError(msg)
    num, den = resolvent(block.F, block.G[:, 0] * np.sqrt(block.Q[0, 0]), block.H[output])
    num = np.trim_zeros(num, "f")
    return (num if num.size else np.zeros(1)), den


def stationary_covariance(model: ContinuousModel) -> Array:
    r"""The covariance of the states that does not change: :math:`FP + PF^T + GQG^T = 0`.

    A model with undriven modes on the imaginary axis (a bias, an oscillator) is stationary if it starts so: then
    it is P0.

    Raises
    ------
    ValueError
        An unstable mode, or one on the imaginary axis that noise drives or P0 does not suit; it is named.

    >>> stationary_covariance(gauss_markov(5.0, 0.1))
    array([[5.]])
    """
    checks.instance("model", model, ContinuousModel)
    G = Manyfold.of(model.G, 2)
    exact = (G @ model.Q @ G.T).symmetric
    W, values = exact.high, np.linalg.eigvals(model.F)
    worst = values[values.real.argmax()]
    if (growing(model.F, continuous=True) < 0).all():
        return riccati.stationary(model.F, exact, continuous=True).P.high
    checks.finite_start("a covariance that does not change", model.P0)
    flow = model.F @ model.P0
    terms = 2 * np.abs(model.F) @ np.abs(model.P0)
    if (np.abs(flow + flow.T + W) <= MARGIN * (terms + terms.T + np.abs(W))).all():
        return np.array(model.P0)
    msg = (
        f"model: expected modes in the left half-plane (or P0 that does not change), received the mode {mode(worst)}"
        f" of the states {_states(model, worst)}: the process is not stationary"
    )
    raise ValueError(msg)


def autocorrelation(model: ContinuousModel, tau: ArrayLike, output: int = 0) -> Array:
    r"""Autocorrelation of an output :math:`y = Hx` of a stationary model, white v left out.

    .. math:: \psi(\tau) = E[y(t+\tau)y(t)] = He^{F|\tau|}PH^T

    Parameters
    ----------
    model : stationary, see :func:`stationary_covariance`
    tau : s, any shape
    output : index of the measurement

    >>> autocorrelation(gauss_markov(2.0, 0.5), [0.0, 0.5, -0.5]).round(6)
    array([2.      , 0.735759, 0.735759])
    """
    h = _output(model, output)
    tau = checks.array("tau", tau)
    right = stationary_covariance(model) @ h
    powers = scipy.linalg.expm(np.abs(tau).reshape(-1, 1, 1) * model.F)
    return (powers @ right @ h).reshape(tau.shape)


def psd(model: ContinuousModel, w: ArrayLike, output: int = 0) -> Array:
    r"""Two-sided power spectral density of an output :math:`y = Hx`, unit²·s, white v left out (it would add Rc).

    .. math:: S(\omega) = H(j\omega I-F)^{-1}\,GQG^T\,(j\omega I-F)^{-H}H^T

    Modes on the imaginary axis are lines: ∞ at their frequency; the power of an undriven one (a bias, a tone)
    appears nowhere else.

    Parameters
    ----------
    model : continuous model without unstable modes
    w : ω, rad/s, any shape
    output : index of the measurement

    Raises
    ------
    ValueError
        An unstable mode, which is named: its process has no spectrum.

    >>> psd(gauss_markov(5.0, 0.1), [0.0, 10.0])
    array([1. , 0.5])
    """
    h = _output(model, output)
    w = checks.array("w", w)
    values = np.linalg.eigvals(model.F)
    worst = values[values.real.argmax()]
    if worst.real > _margin(model.F):
        msg = (
            f"model: expected no mode in the right half-plane, received the mode {mode(worst)} "
            f"of the states {_states(model, worst)}: its process has no spectrum"
        )
        raise ValueError(msg)
    axis = values.imag[np.abs(values.real) <= _margin(model.F)]
    line = (np.abs(w.reshape(-1, 1) - axis) <= _margin(model.F)).any(axis=1)
    spectrum = np.full(w.size, np.inf)
    pencil = 1j * w.reshape(-1)[~line, None, None] * np.eye(model.n) - model.F
    response = np.linalg.solve(np.swapaxes(pencil, 1, 2), h[:, None].astype(complex))[..., 0] @ model.G
    spectrum[~line] = np.einsum("ka,ab,kb->k", response, model.Q, response.conj()).real
    return spectrum.reshape(w.shape)


def _resonance(variance: float, w0: float, zeta: float, name: str, unit: str) -> ContinuousModel:
    return ContinuousModel(
        [[0.0, 1.0], [-w0 * w0, -2 * zeta * w0]],
        [[0], [1]],
        [[4 * zeta * w0**3 * variance]],
        [[1, 0]],
        P0=np.diag([variance, w0**2 * variance]),
        states=(name, f"{name}_rate"),
        measurements=(name,),
        units=(unit, f"{unit}/s" if unit else ""),
    )


def _indices(plant: ContinuousModel, block: ContinuousModel, into: int | Sequence[int], what: str) -> list[int]:
    """``into`` as a list, checked."""
    checks.instance("plant", plant, ContinuousModel)
    checks.instance("block", block, ContinuousModel)
    size = plant.s if what == "noise inputs" else plant.m
    indices = list(into) if isinstance(into, Sequence | np.ndarray) else [into]
    whole = all(isinstance(i, int | np.integer) and not isinstance(i, bool) for i in indices)
    if not whole or not all(0 <= i < size for i in indices) or len(set(indices)) != len(indices):
        msg = f"into: expected different indices below {size} (the plant's {what}), received {into!r}"
        raise ValueError(msg)
    if len(indices) != block.m:
        msg = f"into: expected one index for each of the block's {block.m} outputs, received {into!r}"
        raise ValueError(msg)
    return [int(i) for i in indices]


def _unrelated(plant: ContinuousModel, columns: list[int], rest: list[int]) -> None:
    """Refuse to replace a noise that correlates with something that stays."""
    if plant.Q[np.ix_(columns, rest)].any():
        msg = f"Q: expected no correlation between the replaced noise inputs {columns} and the others, received one"
        raise ValueError(msg)
    if plant.N is not None and plant.N[columns].any():
        msg = f"N: expected 0 in the rows of the replaced noise inputs {columns}, received {plant.N[columns].tolist()}"
        raise ValueError(msg)


def _noises(block: ContinuousModel, G_into: Array) -> tuple[Array, Array]:
    """G and Q of the block's noises in the joint state: (v_b, w_b) if its output has a white part, else w_b."""
    G = np.vstack([np.zeros((len(G_into), block.s)), block.G])
    if block.Rc is None:
        return G, block.Q
    direct = np.vstack([G_into, np.zeros((block.n, block.m))])
    N = _cross(block)
    return np.hstack([direct, G]), np.block([[block.Rc, N.T], [N, block.Q]])


def _cross(model: ContinuousModel) -> Array:
    return np.zeros((model.s, model.m)) if model.N is None else model.N


def _joined(
    plant: ContinuousModel,
    block: ContinuousModel,
    *,
    F: Array,
    G: Array,
    Q: Array,
    H: Array,
    Rc: Array | None,
    N: Array | None,
) -> ContinuousModel:
    """The joint model; what does not depend on how the two are connected is put together here."""
    B = None
    if plant.B is not None or block.B is not None:
        inputs = [np.zeros((m.n, 0)) if m.B is None else m.B for m in (plant, block)]
        B = scipy.linalg.block_diag(*inputs)
    names = list(plant.states)
    for name in block.states:
        # A second block of the same kind, or default names, would give two states one name.
        alternatives = [name, *(f"{name}_{i}" for i in range(2, len(names) + 3))]
        names.append(next(new for new in alternatives if new not in names))
    return ContinuousModel(
        F=F,
        G=G,
        Q=Q,
        H=H,
        Rc=Rc,
        N=N,
        B=B,
        x0=np.concatenate([plant.x0, block.x0]),
        P0=scipy.linalg.block_diag(plant.P0, block.P0),
        states=tuple(names),
        measurements=plant.measurements,
        units=plant.units + block.units,
    )


def _output(model: ContinuousModel, output: int) -> Array:
    """The row of H of an output."""
    checks.instance("model", model, ContinuousModel)
    if isinstance(output, bool) or not isinstance(output, int | np.integer) or not 0 <= output < model.m:
        msg = f"output: expected an index below {model.m}, received {output!r}"
        raise ValueError(msg)
    return model.H[output]


def _margin(F: Array) -> float:
    """What counts as 0 among the modes' rates: rounding beside the elements of F in units in which they are alike."""
    x = balanced(F, continuous=True).states
    return MARGIN * max(np.abs(F * x / x[:, None]).max(initial=0.0), np.finfo(float).tiny)


def _states(model: ContinuousModel, value: complex) -> str:
    """The states in which a mode appears."""
    values: NDArray[np.complex128]
    values, vectors = np.linalg.eig(model.F)
    share = np.abs(vectors[:, np.abs(values - value).argmin()])
    return ", ".join(name for name, s in zip(model.states, share / share.max(), strict=True) if s > 1e-6)
