"""The answers of the lab slow_error by hand: the second route, which owes nothing to the library."""

import math

import numpy as np

#: Example (iii): samples, samples beyond the record, period; factors, variances and mean of the two AR(1) sequences.
AR_N, AR_BEYOND, AR_DT = 60, 20, 1.0


def analytic(p):
    """The closed forms of section 5."""
    sw, sl, sm, k = p.sigma_w2, p.sigma_lambda2, p.sigma_mu2, p.k
    D = sw + k * (sl + sm)
    answer = {
        "lambda_variance": sl * (sw + k * sm) / D,
        "mu_variance": sm * (sw + k * sl) / D,
        "covariance": -k * sl * sm / D,
        "variance_floor": sl * sm / (sl + sm) if sl + sm else 0.0,
        "naive_variance": naive(k, sw, sl, sm),
        "naive_minimum_k": sw / (2 * sm - sl) if 2 * sm > sl > 0 else None,
        "lambda_gain": sl / D,
        "mu_gain": sm / D,
    }
    return answer | percentages(p.lam, p.mu, sw, sl, sm, k)


def naive(k, sw, sl, sm):
    """True error variance of the estimator that ignores μ."""
    return sl * sw / (sw + k * sl) + (k * sl / (sw + k * sl)) ** 2 * sm


def percentages(lam, mu, sw, sl, sm, k):
    """Mean and standard deviation of the errors of λ̂ and μ̂, for given λ and μ, in per cent of them."""
    D, found = sw + k * (sl + sm), {}
    for name, true, share in (("lambda", lam, sl), ("mu", mu, sm)):
        found[f"{name}_error_percent_expected"] = 100 * (k * share * (lam + mu) / D - true) / true if true else None
        found[f"{name}_error_percent_sd"] = 100 * share * math.sqrt(k * sw) / D / abs(true) if true else None
    return found


def limits(lam, mu, sl, sm):
    """The errors that no number of measurements removes, in per cent (None for a true value of 0)."""
    share = sl / (sl + sm) if sl + sm else 0.0
    return [
        100 * (part * (lam + mu) - true) / true if true else None for part, true in ((share, lam), (1 - share, mu) if sl + sm else (0.0, mu))
    ]


def conditioned(phi, psi, K, K_lambda, K_mu, m_lambda, m_mu, y):
    """Mean and covariance of (λ, μ) from the joint Gaussian distribution of (λ, μ) and y, by its definition."""
    H, n = np.hstack([phi, psi]), len(m_lambda)
    P = np.zeros((n + len(m_mu), n + len(m_mu)))
    P[:n, :n], P[n:, n:] = K_lambda, K_mu
    m = np.concatenate([m_lambda, m_mu])
    gain = np.linalg.solve(H @ P @ H.T + K, H @ P).T
    return m + gain @ (y - H @ m), P - gain @ H @ P


def corrected(phi, psi, K, K_lambda, K_mu, m_lambda, m_mu, y, *, last=None):
    """Estimate and covariance of λ by equations (11), (12), (15), misprints removed, inverses as printed.

    ``last`` is the last factor inside the inverse, where it is not to be Φ_λ.
    """
    W, Kl, Km = np.linalg.inv(K), np.linalg.inv(K_lambda), np.linalg.inv(K_mu)
    A = np.linalg.inv(Km + psi.T @ W @ psi)
    P = np.linalg.inv(Kl + phi.T @ W @ phi - phi.T @ W @ psi @ A @ psi.T @ W @ (phi if last is None else last))
    return P @ (Kl @ m_lambda + phi.T @ W @ y - phi.T @ W @ psi @ A.T @ (Km @ m_mu + psi.T @ W @ y)), P


def by_inverses(sl, sm, i):
    """Risk (15) of section 5 for the information i = k/σ_w² of the samples, as printed; infinite where all digits cancel."""
    left = 1 / sl + i - i * (1 / (1 / sm + i)) * i
    return 1 / left if left else math.inf


def log_density(y, mean, K):
    """log N(y; mean, K)."""
    e = y - mean
    return -0.5 * (e @ np.linalg.solve(K, e) + np.linalg.slogdet(K)[1] + len(y) * math.log(2 * math.pi))


def posterior_odds(average, k, sw, sl, sm):
    """Probability that a slow error is present, from the average of k samples (even odds beforehand)."""
    absent, present = sl + sw / k, sl + sm + sw / k
    return 1 / (1 + math.sqrt(present / absent) * math.exp(-0.5 * average**2 * (1 / absent - 1 / present)))


def state_of_moving():
    """Position and velocity at the last sample, and the slow error there, from (λ, μ) of the batch."""
    C = np.zeros((3, 2 + AR_N))
    C[0, :2], C[1, 1], C[2, -1] = (1.0, AR_N * AR_DT), 1.0, 1.0
    return C
