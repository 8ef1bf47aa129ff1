"""The lab slow_error: its three examples."""

from dataclasses import replace

import numpy as np
from ctlabs.tasks.answers.slow_error import AR_DT, AR_N

from ctlabs.filtering import bayes
from ctlabs.filtering.bayes import SlowError
from ctlabs.models import DiscreteModel
from ctlabs.text import text

#: Example (ii): polynomial signal, harmonic drift; times of the samples, s, and of the estimates.
POLY_T, POLY_AT, OMEGA = 0.2 * np.arange(1, 61), 0.2 * np.arange(1, 81), 0.5
POLY_MEAN, POLY_VARIANCE, DRIFT_VARIANCE, POLY_NOISE = (1.0, 0.5, 0.05), (4.0, 0.25, 0.01), (2.0, 2.0), 0.25
AR_SLOW, AR_SLOW_VARIANCE, AR_SLOW_MEAN, AR_FAST, AR_FAST_VARIANCE, AR_WHITE = 0.97, 4.0, 3.0, 0.5, 1.0, 0.25
AR_MEAN, AR_VARIANCE = (10.0, 2.0), (100.0, 4.0)


def constants(p, noise=None, count=1, sm=None):
    """Section 5: a constant signal, a constant error, white noise."""
    one, sm = np.ones((len(noise) if noise is not None else count, 1)), p.sigma_mu2 if sm is None else sm
    return SlowError(one, one, p.sigma_w2 if noise is None else noise, [[p.sigma_lambda2]], [[sm]])


def named(problem):
    """The discrete model with units."""
    return replace(bayes.model(problem), units=("u", "u")[: problem.M + problem.L])


def alone(p):
    """What the estimates make of the last sample: its gain. All samples of section 5 have the same in the end."""
    return bayes.batch(constants(p, count=p.k), np.eye(1, p.k, p.k - 1)[0]).mean


def rounding(p):
    """What cancels in P and in inverses: relative errors of 10⁻¹⁴ k(σ_λ² + σ_μ²)/σ_w², in units of SOLVER, at least 1."""
    return max(1.0, 1e-6 * p.k * (p.sigma_lambda2 + p.sigma_mu2) / p.sigma_w2)


def truth(p, model):
    """The same measurements of the given λ and μ."""
    return replace(model, x0=[p.lam, p.mu], P0=np.zeros((2, 2)))


def polynomial():
    """Example (ii): 1, t, t² under cos ωt, sin ωt."""
    return SlowError(powers(POLY_T), np.column_stack([np.cos(OMEGA * POLY_T), np.sin(OMEGA * POLY_T)]), POLY_NOISE, np.diag(POLY_VARIANCE), np.diag(DRIFT_VARIANCE), POLY_MEAN)


def powers(t):
    """Regressors 1, t, t²."""
    return np.column_stack([np.ones_like(t), t, t**2])


def correlation(factor, variance):
    """Covariance of an AR(1) sequence."""
    i = np.arange(AR_N)
    return variance * factor ** np.abs(i[:, None] - i)


def moving():
    """Example (iii) for the batch: one μ a sample, of an AR(1) prior with its decaying mean; coloured noise."""
    k = np.arange(1, AR_N + 1)
    return SlowError(np.column_stack([np.ones(AR_N), k * AR_DT]), np.eye(AR_N),
                     correlation(AR_FAST, AR_FAST_VARIANCE) + AR_WHITE * np.eye(AR_N), np.diag(AR_VARIANCE),
                     correlation(AR_SLOW, AR_SLOW_VARIANCE), AR_MEAN, AR_SLOW_MEAN * AR_SLOW**k)


def moving_state(*, slow=True):
    """Example (iii) for the recursion: position, velocity, coloured noise and (last) the slow error as states."""
    kept = [0, 1, 2, 3] if slow else [0, 1, 2]
    part = np.ix_(kept, kept)
    Phi = np.diag([1.0, 1.0, AR_FAST, AR_SLOW])
    Phi[0, 1] = AR_DT
    Qd = np.diag([0, 0, AR_FAST_VARIANCE * (1 - AR_FAST**2), AR_SLOW_VARIANCE * (1 - AR_SLOW**2)])
    P0 = np.diag([*AR_VARIANCE, AR_FAST_VARIANCE, AR_SLOW_VARIANCE])
    return DiscreteModel(
        Phi[part], Qd[part], np.array([[1.0, 0.0, 1.0, 1.0]])[:, kept], [[AR_WHITE]], x0=np.array([*AR_MEAN, 0.0, AR_SLOW_MEAN])[kept], P0=P0[part], dt=AR_DT,
        states=["position", "velocity", "noise", "slow error"][: len(kept)], units=["m", "m/s", "m", "m"][: len(kept)], measurements=["y"],
    )


def examples(r, p):
    """What is computed with."""
    r.says("Three examples go through this report ({tab:plan}). The unit of the samples of (i) is written u; the paper names none.")
    r.table("plan", ["example", "signal", "slow error", "noise", "samples"], [
        ["(i)", text("constant, N(0, {v})", v=p.sigma_lambda2), text("constant, N(0, {v})", v=p.sigma_mu2), text("white, variance {v}", v=p.sigma_w2), p.k],
        ["(ii)", text("λ₀ + λ₁t + λ₂t², means {m}, variances {v}", m=POLY_MEAN, v=POLY_VARIANCE), text("μ₀cos ωt + μ₁sin ωt, ω = {w} 1/s, variances {v}", w=OMEGA, v=DRIFT_VARIANCE), text("white, variance {v}", v=POLY_NOISE), len(POLY_T)],
        ["(iii)", text("position and velocity, means {m}, variances {v}", m=AR_MEAN, v=AR_VARIANCE), text("AR(1), factor {f}, variance {v}, first mean {m}", f=AR_SLOW, v=AR_SLOW_VARIANCE, m=AR_SLOW_MEAN), text("AR(1), factor {f}, variance {v}, plus white of variance {w}", f=AR_FAST, v=AR_FAST_VARIANCE, w=AR_WHITE), AR_N],
    ], "The three examples. (i) is the paper's section 5; one record of it has λ = {lam} and μ = {mu}.", lam=p.lam, mu=p.mu)
