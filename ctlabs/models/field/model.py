r"""A random field from a stochastic partial differential equation, as a discrete state-space model.

.. math:: b_{20}z_{tt} + b_{10}z_t + b_{00}z + b_{11}z_{xt} + b_{01}z_x = b_{30}\eta, \qquad
          b_{10} = \beta,\ b_{01} = \alpha,\ b_{00} = \alpha\beta,\ b_{30} = \sqrt{4\alpha\beta}

With :math:`z_* = z_t`, Euler's step in time and the difference with the left neighbour in space, at the nodes i = 1…N1:

.. math:: z_i^{k+1} = z_i^k + \Delta t\,z_{*i}^k, \qquad
          z_{*i}^{k+1} = e_0z_{*i}^k + e_2z_i^k - e_3z_{i-1}^k - e_1z_{*i-1}^k + e_4\eta_i^k

Node 0 keeps its values. The state is (z_0…z_N1, z*_0…z*_N1); all z are measured in white noise. Units, with the
field's own unit u: α 1/s, β 1/m, b20 s/m, b11 1, η u/√(m·s).

Source: I. N. Lipatov, "Use of the Kalman filter for suppressing the measurement error of a random field" (Perm, 2010),
eq. 1-43.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike

from ctlabs.linalg import checks
from ctlabs.linalg.checks import Array
from ctlabs.models.field import stability
from ctlabs.models.linear import DiscreteModel
from ctlabs.text import moment


class Coefficients(NamedTuple):
    """e0…e4 of the recursion, eq. 17."""

    e0: float
    e1: float
    e2: float
    e3: float
    e4: float


class Sparse(NamedTuple):
    """The model's matrices as sparse arrays: Phi (2N, 2N), G (2N, N), H (N, 2N), with N = N1 + 1 nodes."""

    Phi: scipy.sparse.csr_array
    G: scipy.sparse.csr_array
    H: scipy.sparse.csr_array


@dataclass(frozen=True, slots=True)
class RandomField:
    """The field, its grid and the step in time.

    Parameters
    ----------
    alpha, beta : b01 (1/s) and b10 (1/m); b00 = αβ, b30 = √(4αβ)
    b20, b11 : s/m and 1
    h, dt : distance of the nodes, m; step in time, s
    N1 : number of the last node; node 0 is the boundary
    sigma_eta : standard deviation of the discrete white field η, u/√(m·s)
    allow_unstable : take a step beyond von Neumann's limit

    Raises
    ------
    ValueError
        A number out of its range; dt beyond von Neumann's limit (the largest admissible dt is in the message).

    >>> field = RandomField(alpha=0.1, beta=0.1, b20=0.25, b11=1, h=1, dt=0.2, N1=30, sigma_eta=3)
    >>> [round(e, 3) for e in field.coefficients]
    [0.12, -0.8, -0.088, -0.08, 0.16]
    >>> RandomField(alpha=0.1, beta=0.1, b20=0.25, b11=1, h=1, dt=0.3, N1=30, sigma_eta=3)
    Traceback (most recent call last):
    ...
    ValueError: dt: expected at most 0.240999 s (von Neumann's limit for this equation and h), received 0.3 s
    """

    alpha: float
    beta: float
    b20: float
    b11: float
    h: float
    dt: float
    N1: int
    sigma_eta: float
    _: KW_ONLY
    allow_unstable: bool = False

    def __post_init__(self) -> None:
        for name in ("alpha", "beta", "b11", "sigma_eta"):
            object.__setattr__(self, name, checks.nonnegative(name, getattr(self, name)))
        for name in ("b20", "h", "dt"):
            object.__setattr__(self, name, checks.positive(name, getattr(self, name)))
        object.__setattr__(self, "N1", checks.count("N1", self.N1))
        if not self.allow_unstable and self.dt > (limit := self.dt_limit_von_neumann):
            wanted = f"at most {math.floor(limit * 1e6) / 1e6:g} s (von Neumann's limit for this equation and h)"
            if not limit:
                ratio = f"alpha/beta = {self.alpha / self.beta if self.beta else math.inf:g}"
                speed = f"b11/b20 = {self.b11 / self.b20:g}"
                wanted = (
                    f"an equation whose waves do not grow, but with {ratio} and {speed} some grow whatever the step"
                )
            msg = f"dt: expected {wanted}, received {self.dt:g} s"
            raise ValueError(msg)

    @property
    def nodes(self) -> int:
        """N = N1 + 1, number of nodes."""
        return self.N1 + 1

    @property
    def x(self) -> Array:
        """Places of the nodes, (N1+1,) m."""
        return self.h * np.arange(self.nodes)

    @property
    def equation(self) -> stability.FieldEquation:
        """b20, b10, b00, b11, b01 and h."""
        return stability.FieldEquation(self.b20, self.beta, self.alpha * self.beta, self.b11, self.alpha, self.h)

    @property
    def coefficients(self) -> Coefficients:
        """e0…e4, eq. 17."""
        b, dt = self.equation, self.dt / self.b20
        return Coefficients(
            1 - dt * (b.b10 + b.b11 / self.h),
            -dt * b.b11 / self.h,
            -dt * (b.b00 + b.b01 / self.h),
            -dt * b.b01 / self.h,
            dt * math.sqrt(4 * self.alpha * self.beta),
        )

    @property
    def spectral_radius(self) -> float:
        """Of Φ without the boundary node: of the block [[1, dt], [e2, e0]], which is exact where Φ is defective."""
        return stability.spectral_radius(self.equation, self.dt)

    @property
    def von_neumann_factor(self) -> float:
        """The largest factor by which a wave is multiplied in a step."""
        return stability.von_neumann_factor(self.equation, self.dt)

    @property
    def dt_limit_von_neumann(self) -> float:
        """The largest step (s) at which no wave grows."""
        return stability.dt_limit_von_neumann(self.equation)

    @property
    def dt_limit_eigenvalue(self) -> float:
        """The largest step (s) at which the eigenvalues of Φ stay inside the unit circle."""
        return stability.dt_limit_eigenvalue(self.equation)

    def matrices(self) -> Sparse:
        """Φ, G and H of eq. 23–28 and 38 as sparse arrays."""
        e, N = self.coefficients, self.nodes
        inner = np.ones(N)
        inner[0] = 0.0

        def two(diagonal: float, lower: float, first: float) -> scipy.sparse.dia_array:
            main = diagonal * inner
            main[0] = first
            return scipy.sparse.diags_array([main, np.full(N - 1, lower)], offsets=[0, -1])

        Phi = scipy.sparse.block_array([
            [scipy.sparse.eye_array(N), scipy.sparse.diags_array(self.dt * inner)],
            [two(e.e2, -e.e3, 0.0), two(e.e0, -e.e1, 1.0)],
        ])  # fmt: skip
        G = scipy.sparse.vstack([scipy.sparse.csr_array((N, N)), scipy.sparse.diags_array(e.e4 * inner)])
        H = scipy.sparse.eye_array(N, 2 * N)
        return Sparse(Phi.tocsr(), G.tocsr(), H.tocsr())

    def model(self, sigma_n: float, P0: float = 10.0) -> DiscreteModel:
        """The state-space model with dense matrices.

        Parameters
        ----------
        sigma_n : standard deviation of the measurement noise at every node, u
        P0 : variance of every state at t0, P0·I (u² for z, u²/s² for z*)

        >>> RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 2, 3).model(sigma_n=1).Phi.round(3)[3:]
        array([[ 0.   ,  0.   ,  0.   ,  1.   ,  0.   ,  0.   ],
               [ 0.08 , -0.088,  0.   ,  0.8  ,  0.12 ,  0.   ],
               [ 0.   ,  0.08 , -0.088,  0.   ,  0.8  ,  0.12 ]])
        """
        sigma_n, P0, N = checks.positive("sigma_n", sigma_n), checks.nonnegative("P0", P0), self.nodes
        Phi, G, H = (matrix.toarray() for matrix in self.matrices())
        return DiscreteModel(
            Phi=Phi,
            Qd=self.sigma_eta**2 * G @ G.T,
            H=H,
            R=sigma_n**2 * np.eye(N),
            x0=np.zeros(2 * N),
            P0=P0 * np.eye(2 * N),
            dt=self.dt,
            states=[f"z{i}" for i in range(N)] + [f"z*{i}" for i in range(N)],
            measurements=[f"z{i}" for i in range(N)],
            units=["u"] * N + ["u/s"] * N,
        )

    def advance(self, x: Array) -> Array:
        """Φx for a state or for columns of states, (2N, …), by the recursion: no matrix is formed."""
        e, N = self.coefficients, self.nodes
        z, rate = x[:N], x[N:]
        moved = np.array(x)
        moved[1:N] += self.dt * rate[1:]
        moved[N + 1 :] = e.e0 * rate[1:] + e.e2 * z[1:] - e.e3 * z[:-1] - e.e1 * rate[:-1]
        return moved

    def simulate(self, steps: int, seed: int, runs: int = 1) -> Array:
        """The field z from rest, (steps+1, N1+1), or (steps+1, N1+1, runs) for ``runs`` > 1; u.

        The first runs do not depend on how many there are.

        Raises
        ------
        FloatingPointError
            An unstable field overflows: the step and the time are in the message.

        >>> field = RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 30, 3)
        >>> field.simulate(100, seed=1).shape, field.simulate(100, seed=1, runs=3).shape
        ((101, 31), (101, 31, 3))
        """
        steps, runs = checks.count("steps", steps), checks.count("runs", runs)
        eta = white(seed, 0, (steps, self.N1), runs)
        eta *= self.coefficients.e4 * self.sigma_eta
        z = self._driven(eta, steps)
        return z[:, :, 0] if runs == 1 else z

    def response(self, steps: int) -> Array:
        """The field after a unit of η at node 1 in the first step, (steps+1, N1+1): Green's function of the recursion.

        A unit at another node is felt the same way, so many nodes to the right.
        """
        steps = checks.count("steps", steps)
        impulse = np.zeros((steps, self.N1, 1))
        impulse[0, 0, 0] = self.coefficients.e4
        return self._driven(impulse, steps)[:, :, 0]

    def variance(self, steps: int) -> Array:
        """Variance of z from rest, (steps+1, N1+1) u², without random numbers: η at every node and step adds its share.

        >>> field = RandomField(0.05, 0.05, 0.25, 1, 1, 0.2, 30, 3)
        >>> round(float(field.variance(100).mean()) ** 0.5, 3)
        0.807
        """
        with np.errstate(over="ignore"):  # an unstable field's variance may be infinite
            share = (self.sigma_eta * self.response(steps)) ** 2
            variance = np.zeros_like(share)
            variance[1:, 1:] = np.cumsum(np.cumsum(share, axis=0), axis=1)[1:, 1:]
        return variance

    def stationary_variance(self) -> Array:
        r"""Steady variance of z at each node, (N1+1,) u².

        At frequency ω a node passes on its left neighbour's oscillation multiplied by a(ω), and η by b(ω), so

        .. math:: \mathrm{var}\,z_i = \frac{\sigma_\eta^2}{2\pi}\int_{-\pi}^{\pi}|b|^2\,
                  (1 + |a|^2 + \dots + |a|^{2(i-1)})\,d\omega

        Raises
        ------
        ValueError
            The field has no steady state: an eigenvalue on or outside the unit circle.

        >>> field = RandomField(0.1, 0.1, 0.25, 1, 1, 0.2, 30, 3)
        >>> field.stationary_variance()[[0, 1, 30]].round(4)
        array([0.    , 0.306 , 1.9582])
        """
        if self.spectral_radius >= 1:
            msg = (
                f"stationary variance: expected eigenvalues inside the unit circle, received {self.spectral_radius:.6g}"
            )
            raise ValueError(msg)
        points, before = 256, np.full(self.nodes, np.inf)
        while True:  # the sum over equidistant frequencies converges geometrically
            found = self._spectral_sum(points)
            change = np.abs(found - before).max()
            if change <= 1e-14 * found.max() or points >= 1 << 20:
                return found
            points, before = 2 * points, found

    def _spectral_sum(self, points: int) -> Array:
        """The integral of :meth:`stationary_variance` by ``points`` frequencies."""
        e, dt = self.coefficients, self.dt
        q = np.exp(1j * np.pi * (np.arange(points // 2 + 1)) / (points // 2))
        weight = np.full(len(q), 2.0 / points)
        weight[[0, -1]] /= 2
        D = (q - 1) * (q - e.e0) - e.e2 * dt
        power = weight * np.abs(self.sigma_eta * e.e4 * dt / D) ** 2
        passed = np.abs((e.e1 * (q - 1) + e.e3 * dt) / D) ** 2
        variance = np.zeros(self.nodes)
        for i in range(1, self.nodes):
            variance[i] = variance[i - 1] + power.sum()
            power *= passed
        return variance

    def _driven(self, eta: Array, steps: int) -> Array:
        """z from rest under e4·η (steps, N1, runs), (steps+1, N1+1, runs)."""
        N, runs = self.nodes, eta.shape[2]
        z = np.zeros((steps + 1, N, runs))
        x = np.zeros((2 * N, runs))
        with np.errstate(over="ignore", invalid="ignore"):  # an overflow is reported below, with its time
            for k in range(steps):
                x = self.advance(x)
                x[N + 1 :] += eta[k]
                z[k + 1] = x[:N]
        bad = ~np.isfinite(z).all(axis=(1, 2))
        if bad.any():
            k = int(np.argmax(bad))
            msg = f"z: expected a finite field, received an overflow at step {k} (t = {moment(k * self.dt)} s)"
            raise FloatingPointError(msg)
        return z


def measure(z: ArrayLike, sigma_n: float, seed: int) -> Array:
    """z with white noise of standard deviation ``sigma_n`` (u), in the shape of z; row 0 (t0) is not measured: NaN.

    The noise does not depend on the field or on ``sigma_n``, but for its size.
    """
    field = np.array(checks.array("z", z))
    if field.ndim not in (2, 3):
        msg = f"z: expected shape (steps+1, N1+1[, runs]), received {field.shape}"
        raise ValueError(msg)
    sigma_n = checks.nonnegative("sigma_n", sigma_n)
    runs = field.shape[2] if field.ndim == 3 else 1
    noise = white(seed, 1, (len(field) - 1, field.shape[1]), runs)
    field[1:] += sigma_n * noise.reshape(field[1:].shape)
    field[0] = np.nan
    return field


def white(seed: int, stream: int, shape: tuple[int, int], runs: int) -> Array:
    """Standard normals ``(*shape, runs)``, each run from a stream of its own."""
    seed = checks.count("seed", seed, least=0)
    values = np.empty((runs, *shape))
    for run, row in enumerate(values):
        source = np.random.SeedSequence(seed, spawn_key=(run, stream))
        np.random.Generator(np.random.SFC64(source)).standard_normal(out=row)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))
