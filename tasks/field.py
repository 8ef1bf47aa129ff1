r"""Field. Kalman filter for a random field: the published table and figures beside our own.

Source: Lipatov 2010, "Use of the Kalman filter for suppressing the measurement error of a random field", eq. 1-51, table,
figures 1-3. A field z(x, t) driven by white noise through a partial differential equation is written as a difference
scheme in state-space form, measured at every node in white noise, and filtered; the paper reports ten simulated variants.

Expected answer: the field's mean and spread agree with the printed ones; the printed errors lie below the error of the
best causal filter and cannot come from the filter alone; the claim holds: the filter suppresses the noise, and the ratio
σ_n/σ_ε grows with σ_n and falls with α. The step in time is limited by von Neumann's condition, not by the eigenvalues.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from ctlabs.tasks.answers import field as by_hand
from ctlabs.tasks.answers.field import PRINTED
from pydantic import model_validator

from ctlabs.analysis import sensitivity
from ctlabs.filtering import Covariances, fields
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import largest
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models.field import RandomField, stability
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.params import Count, Flag, LabParameters, Positive, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "field",
    "title": "Kalman filter for a random field",
    "source": "Lipatov 2010",
    "parts": ["table", "figures", "theory", "verdict", "stability", "scale"],
    "runs": 1000,
}

#: Its field columns: m̂_z and σ̂_z by α.
PRINTED_FIELD = {0.05: (0.103, 0.555), 0.1: (0.176, 0.804)}
#: The numbers the table was printed for.
PAPER = {"sigma_eta": 3.0, "b20": 0.25, "b11": 1.0, "dt": 0.2, "h": 1.0, "N1": 30, "m": 100, "P0": 10.0}
TIME, PLACE = "time t, s", "place x, m"


class Parameters(LabParameters):
    """What may be changed; the printed variants of the table keep their own α = β and σ_n. u is the field's unit."""

    alpha: Positive = given(0.1, unit="1/s", meaning="coefficient α = b01 of the equation")
    beta: Positive = given(0.1, unit="1/m", meaning="coefficient β = b10 of the equation")
    sigma_n: Positive = given(1.0, unit="u", meaning="standard deviation of the measurement noise at a node")
    sigma_eta: Positive = given(
        3.0, unit="u/√(m·s)", meaning="standard deviation of the driving noise at a node and step"
    )
    b20: Positive = given(0.25, unit="s/m", meaning="coefficient of the second derivative in time")
    b11: Variance = given(1.0, unit="1", meaning="coefficient of the mixed derivative")
    dt: Positive = given(0.2, unit="s", meaning="step in time Δt")
    h: Positive = given(1.0, unit="m", meaning="distance of the nodes")
    N1: Count = given(30, unit="1", meaning="number of the last node; node 0 is the boundary")
    m: Count = given(100, unit="1", meaning="number of steps in time")
    P0: Variance = given(10.0, unit="u² and u²/s²", meaning="variance of every state at t0, as the filter believes it")
    node: Count = given(
        22, unit="1", meaning="node of figures 2 and 3 (the last one, where a shorter field is asked for)"
    )
    allow_unstable: Flag = given(False, unit="yes/no", meaning="take a step beyond von Neumann's limit")

    @model_validator(mode="after")
    def fits(self):
        """The step is stable and the node exists."""
        own(self)
        if "node" in self.model_fields_set and self.node > self.N1:
            msg = f"node: expected at most N1 = {self.N1}, received {self.node}"
            raise ValueError(msg)
        return self


def ratio_of(a, b):
    """a/b, infinite where nothing is left of b."""
    return a / b if b else math.inf


def own(p):
    """The field of the given parameters."""
    return RandomField(p.alpha, p.beta, p.b20, p.b11, p.h, p.dt, p.N1, p.sigma_eta, allow_unstable=p.allow_unstable)


class Case(NamedTuple):
    """One variant without random numbers: the filter's claim, its true error, and the filter that knows X_0 = 0."""

    field: RandomField
    sigma_n: float
    claimed: Covariances
    actual: sensitivity.Actual
    bound: Covariances


def case(p, alpha, beta, sigma_n):
    """Covariances of a variant; the printed ones are computed for whatever dt is given."""
    field = replace(own(p), alpha=alpha, beta=beta, allow_unstable=True)
    design, truth = field.model(sigma_n, p.P0), field.model(sigma_n, 0.0)
    claimed = covariances(design, p.m)
    return Case(field, sigma_n, claimed, sensitivity.actual(truth, design, p.m, gains=claimed), covariances(truth, p.m))


def of_nodes(P, field):
    """Variances of z at every time and node from a stack of covariances of the state."""
    return np.diagonal(P, axis1=1, axis2=2)[:, : field.nodes]


class World(NamedTuple):
    """An ensemble of one field: z and unit noise of its first run (m+1, N1+1), m̂_z and σ̂_z of every run."""

    z: np.ndarray
    noise: np.ndarray
    mean: np.ndarray
    spread: np.ndarray
    test: chance.Verdict


class Sample(NamedTuple):
    """An ensemble of one variant: σ̂_ε of every run with the printed filter and with the one that knows X_0 = 0.

    ``rms`` (m+1,) is the root mean square error over nodes and runs, of both.
    """

    printed: np.ndarray
    bound: np.ndarray
    rms: tuple[np.ndarray, np.ndarray]
    tests: tuple[chance.Verdict, chance.Verdict]


def resolved(field, m, sigma_n):
    """Whether the field stays small enough that ẑ − z means something in double precision."""
    size = finite_variance(field, m)
    return size is not None and math.sqrt(size.max()) <= 1e6 * sigma_n


def run_all(p, experiment, cases):
    """Worlds by (α, β) and samples by variant; None where the field outgrows double precision."""
    worlds, samples = {}, {}
    for alpha, beta in dict.fromkeys(key[:2] for key in cases):
        several = {key: found for key, found in cases.items() if key[:2] == (alpha, beta)}
        field = next(iter(several.values())).field
        size = finite_variance(field, p.m)
        worlds[alpha, beta] = None
        samples |= dict.fromkeys(several)
        if size is None or size.max() > 1e200:
            continue
        z = field.simulate(p.m, experiment.seed, experiment.runs).reshape(p.m + 1, field.nodes, experiment.runs)
        noise = fields.measure(np.zeros_like(z), 1.0, experiment.seed)
        test = chance.mean_square(z, field.variance(p.m))
        worlds[alpha, beta] = World(z[:, :, 0], noise[:, :, 0], z.mean(axis=(0, 1)), z.std(axis=(0, 1)), test)
        samples |= {
            key: sample(p, found, z, noise) for key, found in several.items() if resolved(field, p.m, found.sigma_n)
        }
    return worlds, samples


def simulated(p, experiment, cases, key):
    """The fields of all cases, and what the filters make of them; those of the given parameters apart."""
    worlds, samples = run_all(p, experiment, cases)
    return {"worlds": worlds, "samples": samples, "world": worlds[key[:2]], "drawn": samples[key]}


def sample(p, found, z, noise):
    """Filter all runs of a variant, twice."""
    data, sigmas, rms, tests = z + found.sigma_n * noise, [], [], []
    for P0, P in ((p.P0, found.actual.P_plus), (0.0, found.bound.P_plus)):
        error = fields.filter_exact(found.field, data[1:], sigma_n=found.sigma_n, P0=P0).z_hat.reshape(z.shape) - z
        sigmas.append(np.sqrt((error**2).mean(axis=(0, 1))))
        rms.append(np.sqrt((error**2).mean(axis=(1, 2))))
        tests.append(chance.mean_square(error, of_nodes(P, found.field)))
    return Sample(sigmas[0], sigmas[1], (rms[0], rms[1]), (tests[0], tests[1]))


def percentile(value, ensemble):
    """Share of the ensemble below a value, %."""
    return 100.0 * float((ensemble < value).mean() + 0.5 * (ensemble == value).mean())


def statement(r, p, field):
    """The field, its difference scheme and the filter, with the misprints named."""
    r.says(r"The field $z(x, t)$ obeys, with white noise $\eta$ on the right,")
    r.math(r"b_{20}z_{tt} + b_{10}z_t + b_{00}z + b_{11}z_{xt} + b_{01}z_x = b_{30}\eta, \qquad b_{10} = \beta,\ b_{01} = \alpha,\ b_{00} = \alpha\beta,\ b_{30} = \sqrt{4\alpha\beta}")
    r.says("With $z_* = z_t$, a forward difference in time and the difference with the left neighbour in place, at the nodes $x_i = ih$, $i = 1 \\dots N_1$ (eq. 15-19), from rest and with a boundary node 0 that keeps its values:")
    r.math(r"z_i^{k+1} = z_i^k + \Delta t\,z_{*i}^k, \qquad z_{*i}^{k+1} = e_0z_{*i}^k + e_2z_i^k - e_3z_{i-1}^k - e_1z_{*i-1}^k + e_4\eta_i^k")
    e = field.coefficients
    r.math(r"e_0 = {e0}, \quad e_1 = {e1}, \quad e_2 = {e2}, \quad e_3 = {e3}, \quad e_4 = {e4}", **e._asdict())
    r.says(r"The state holds all $z_i$ and then all $z_{*i}$, $2N = {size}$ numbers with $N = N_1 + 1 = {N}$; the noise $\eta_i^k$ has the variance $\sigma_\eta^2$, and every $z_i$ is measured at every step after $t_0$ with the variance $\sigma_n^2$: $H = [I\ 0]$, $R = \sigma_n^2I$. The filter (eq. 46-49) starts from $\hat{X}_0 = 0$ and $P_0 = {P0}\,I$.",
           size=2 * field.nodes, N=field.nodes, P0=p.P0)
    r.says("The paper gives no units. Here places are in metres, times in seconds and the field in its own unit u; with $b_{11}$ a pure number the equation then fixes α in 1/s, β in 1/m, $b_{20}$ in s/m and η in u/√(m·s).")
    r.says('**Misprints** and how they are read: "n = 1" among the numbers is $h = 1$, and "N = N + 1" is $N = N_1 + 1$; the list of values after $\\sigma_\\eta$ is that of $\\sigma_n$ and lacks 3; in (24) the second matrix Φ is G; the columns of (26) belong to $z_j$; (37) puts η where the measured field $z_n$ stands; ε is both the unit matrix and the error; row 5 of the table prints 0.335, but its ratio 8.45 needs 0.355, which is used here.')


def part_stability(r, p, answer, field):
    """Waves against eigenvalues, the limits of the step, and what a smaller step changes."""
    r.section("stability", "Stability of the difference scheme")
    r.says("A wave $z_i \\propto e^{\\mathrm{i}\\theta i}$ has the rates μ, with $w = e^{-\\mathrm{i}\\theta}$,")
    r.math(r"b_{20}\mu^2 + \Big(\beta + b_{11}\frac{1-w}h\Big)\mu + \alpha\Big(\beta + \frac{1-w}h\Big) = 0, \qquad \lambda = 1 + \mu\,\Delta t")
    r.says("and $|\\lambda| \\le 1$ for $\\Delta t \\le -2\\,\\mathrm{Re}\\,\\mu/|\\mu|^2$. Von Neumann's condition asks this of every θ. The eigenvalues of Φ ask it only of $w = 0$: a node depends on its left neighbour and never on the right one, so Φ is block triangular and has the eigenvalues of the block")
    r.math(r"\begin{bmatrix} 1 & \Delta t \\ e_2 & e_0 \end{bmatrix}")
    r.says("each $N_1$ times, besides the two ones of the boundary node. Φ is defective: an eigenvalue of multiplicity $N_1$ comes out of a general solver with an error of the order $\\varepsilon^{1/N_1}$, so the block is what must be used. The largest modulus of an eigenvalue is a subharmonic function of $w$, hence some wave is always multiplied by at least as much as the block: von Neumann's condition is the stricter one.")
    routes = ("rates of the waves", "amplification from node to node")
    r.value("spectral_radius", field.spectral_radius, agrees=answer,
            routes=("rates of the block", "Schur's conditions"))
    r.value("von_neumann_factor", field.von_neumann_factor, agrees=answer, routes=routes)
    r.value("dt_limit_von_neumann", field.dt_limit_von_neumann, "s", agrees=answer, routes=routes)
    r.value("dt_limit_eigenvalue", field.dt_limit_eigenvalue, "s", agrees=answer,
            routes=("rates of the block", "Schur's conditions"))
    Phi = answer["here"]["Phi"]
    block = np.linalg.eigvals(np.array([[1.0, p.dt], [field.coefficients.e2, field.coefficients.e0]]))
    powers = [float(np.trace(np.linalg.matrix_power(Phi, j))) for j in (1, 2, 3)]
    r.check("trace of Φ, Φ², Φ³ = 2 + N1 Σλʲ", powers, [2 + p.N1 * float((block**j).sum().real) for j in (1, 2, 3)],
            ("printed matrix", "eigenvalues of the block"), EXACT)
    stable = bool(p.dt <= field.dt_limit_von_neumann)
    r.value("verdict_stability", stable)
    stability_words(r, p, field, stable)
    stability_pictures(r, p, field)
    held(r, p, answer, field)


def stability_words(r, p, field, stable):
    """What the limits are for these numbers and the printed ones, and what happens between them."""
    rows = []
    for alpha, beta in dict.fromkeys([(p.alpha, p.beta), (0.05, 0.05), (0.1, 0.1)]):
        each = replace(field, alpha=alpha, beta=beta, allow_unstable=True)
        rows.append((alpha, beta, each.dt_limit_von_neumann, each.dt_limit_eigenvalue, each.von_neumann_factor,
                     each.spectral_radius, *grown(p, each)))
    r.table("limits", ["α, 1/s", "β, 1/m", "limit of the waves, s", "limit of the eigenvalues, s", "factor of the waves", "spectral radius", "RMS of z between the limits, u", "RMS of z at the second limit, u"], rows,
            "Limits of Δt, the factors at Δt = {dt} s, and the theoretical root mean square of z at the last node after {m} steps with a Δt at the geometric mean of the two limits and at the second one.", dt=p.dt, m=p.m)
    limit, other, growth = rows[0][2], rows[0][3], rows[0][6:]
    if not limit:
        r.says("For the given α, β, $b_{11}$ and $b_{20}$ the equation itself lets some wave grow ($\\alpha/\\beta = {ratio}$ is too large beside $b_{11}/b_{20} = {speed}$): there is no admissible step, however small.",
               ratio=p.alpha / p.beta, speed=p.b11 / p.b20)
    elif stable:
        r.says("The given step, {dt} s, is within von Neumann's limit {limit} s: no wave grows, the slowest decays by {factor} a step. The eigenvalues alone would allow {other} s; a step between the two limits looks stable by them, yet the field grows while a disturbance travels from node to node: after {m} steps to an RMS of {between} u halfway and of {end} u at the second limit.",
               dt=p.dt, limit=limit, other=other, factor=field.von_neumann_factor, m=p.m, **{name: "more than 1e150" if size is None else f"{size:.1e}" for name, size in zip(("between", "end"), growth, strict=True)})
    else:
        r.says("The given step, {dt} s, is beyond von Neumann's limit {limit} s: some wave is multiplied by {factor} in each step. `allow_unstable` shows what happens. The eigenvalues ({radius} at most) {say}.",
               dt=p.dt, limit=limit, factor=field.von_neumann_factor, radius=field.spectral_radius,
               say="do not show it: they bound the growth only after the disturbance has passed all nodes" if field.spectral_radius < 1 else "show it too")


def grown(p, field):
    """Theoretical RMS of z at the last node after m steps: with Δt halfway between the limits, and at the second one."""
    low, high = field.dt_limit_von_neumann, field.dt_limit_eigenvalue
    found = []
    for dt in (math.sqrt(low * high), high):
        size = finite_variance(replace(field, dt=dt), p.m) if 0 < low < high else None
        found.append(None if size is None else math.sqrt(float(size[-1, -1])))
    return found


def finite_variance(field, m):
    """Variances of z over time and nodes, or None where they overflow."""
    try:
        found = field.variance(m)
    except FloatingPointError:
        return None
    return found if np.isfinite(found).all() else None


def stability_pictures(r, p, field):
    """Factor against wave number, growth against time, for several steps."""
    limit = field.dt_limit_von_neumann or p.dt
    steps = dict.fromkeys(sorted([p.dt, limit, math.sqrt(limit * max(field.dt_limit_eigenvalue, limit)), field.dt_limit_eigenvalue]))
    theta = np.linspace(0.0, np.pi, 361)
    curves = {f"Δt = {dt:.4g} s": stability.factor(field.equation, dt, theta) for dt in steps}
    r.figure("waves", plots.lines(theta, curves, xlabel="wave number θ, radians per node", ylabel="factor in one step", ordered=True, straight={"1": ([0, np.pi], [1, 1])}),
             "Factor by which a wave is multiplied in a step, for the given Δt, the two limits and their geometric mean.")
    growth = {}
    for dt in steps:
        size = finite_variance(replace(field, dt=dt, allow_unstable=True), p.m)
        if size is not None and size.max() > 0:
            spread = np.sqrt(size[:, 1:].mean(axis=1))
            growth[f"Δt = {dt:.4g} s"] = np.where(spread > 0, spread, np.nan)
    if growth:
        r.figure("growth", plots.lines(np.arange(p.m + 1), growth, xlabel="step number k", ylabel="RMS of z over the nodes, u", log="y", ordered=True, steps=True),
                 "The field's theoretical root mean square for the same Δt: beyond von Neumann's limit it grows geometrically, though all eigenvalues are inside the unit circle up to the other limit.")


def held(r, p, answer, field):
    """The stationary variance, and what happens to it when the grid is refined."""
    radius = field.spectral_radius
    steady_variance = field.stationary_variance() if radius < 1 else None
    r.value("stationary_variance_mean", None if steady_variance is None else float(steady_variance[1:].mean()), "u²",
            reason="" if radius < 1 else "an eigenvalue is on or outside the unit circle: the variance grows without bound",
            agrees=answer, routes=("integral over frequencies", "long recursion"))
    r.says("**What is held.** $\\sigma_\\eta$ is the standard deviation of a *discrete* noise. The white field of eq. 2 has $E[\\eta\\eta] = \\frac C2\\delta\\delta$, and a sample of it over one cell has the variance $\\sigma_\\eta^2 = C/(2h\\Delta t)$. Whoever halves Δt or $h$ and keeps $\\sigma_\\eta$ halves the strength C; the field changes because its noise has become weaker, not because the scheme has become finer. Here $C = 2\\sigma_\\eta^2h\\,\\Delta t = {C}$ u²; the table holds once $\\sigma_\\eta$ (as the parameters `dt` and `h` do) and once C, over the same length and time.",
           C=2 * p.sigma_eta**2 * p.h * p.dt)
    rows = []
    for finer_x, finer_t in ((1, 1), (1, 2), (1, 4), (2, 2), (2, 4)):
        grid = replace(field, h=p.h / finer_x, dt=p.dt / finer_t, N1=p.N1 * finer_x, allow_unstable=True)
        kept = replace(grid, sigma_eta=p.sigma_eta * math.sqrt(finer_x * finer_t))
        sizes = [finite_variance(each, p.m * finer_t) for each in (grid, kept)]
        rows.append((grid.h, grid.dt, grid.dt_limit_von_neumann,
                     *(None if size is None or grid.dt > grid.dt_limit_von_neumann else by_hand.root_mean(size) for size in sizes)))
    r.table("held", ["h, m", "Δt, s", "limit of Δt, s", "σ_z, σ_η held, u", "σ_z, C held, u"], rows,
            "Theoretical σ_z over all nodes and times on finer grids; — where the step is beyond the limit.")
    if p.alpha and p.beta and radius < 1:
        node = [
            replace(
                field, N1=1, dt=p.dt / 2**j, sigma_eta=p.sigma_eta * 2 ** (j / 2), allow_unstable=True
            ).stationary_variance()[1]
            for j in (4, 5, 6)
        ]
        c, d = (p.alpha * p.beta + p.alpha / p.h) / p.b20, (p.beta + p.b11 / p.h) / p.b20
        limit = 4 * p.alpha * p.beta / p.b20**2 * p.sigma_eta**2 * p.dt / (2 * c * d)
        r.says("With C held the first node's variance tends to that of the continuous second-order equation, $b_{30}^2\\sigma_\\eta^2\\Delta t/(2b_{20}^2cd) = {limit}$ u² with $c = (\\alpha\\beta + \\alpha/h)/b_{20}$ and $d = (\\beta + b_{11}/h)/b_{20}$, at first order in Δt; with $\\sigma_\\eta$ held it would tend to 0.",
               limit=limit)
        r.order("variance of node 1 as Δt is halved", [abs(v - limit) for v in node], 1.0,
                ("difference scheme", "continuous equation"))


def part_theory(r, p, answer, several, here, experiment):
    """Three kinds of error, without random numbers; and what NEES means here."""
    r.section("theory", "Three errors without random numbers")
    r.says("The experiment starts the field from $X_0 = 0$ and the filter from $P_0 = {P0}\\,I$: {say}. Three covariances must be told apart:", P0=p.P0,
           say="the filter believes in an uncertainty that is not there" if p.P0 else "the filter knows the start, so that here the three coincide")
    r.items(["the filter's own, $P_k$ of eq. 49: what it claims;",
             "the true one of the printed filter: $P^{\\mathrm{true}}_{k+1} = (I - KH)(\\Phi P^{\\mathrm{true}}_k\\Phi^T + GQG^T)(I - KH)^T + KRK^T$ with the gains of eq. 47 and $P^{\\mathrm{true}}_0 = 0$;",
             "the causal bound: eq. 47-49 with $P_0 = 0$. No filter of the measurements up to $t_k$ has a smaller mean square error on this field."])
    r.says("The gains being given, the error is linear in its sources, so the first two differ by the share of $e_0$ alone: $P_k - P^{\\mathrm{true}}_k = P_0\\,\\Psi_k\\Psi_k^T \\succeq 0$ with $\\Psi_k = \\prod (I - K_jH)\\Phi$; and $P^{\\mathrm{true}}_k \\succeq P^{\\mathrm{bound}}_k$ because the bound belongs to the optimal gains. Hence $\\sigma^{\\mathrm{bound}} \\le \\sigma^{\\mathrm{true}} \\le \\sigma^{\\mathrm{filter}}$ at every node and time. ∎")
    field = here.field
    claimed, true, bound = (of_nodes(P, field) for P in (here.claimed.P_plus, here.actual.mse_plus, here.bound.P_plus))
    printed = "printed equations, literally"
    r.says("Below, σ_ε is the root of the average over all nodes and over $k = 0 \\dots {m}$ (the filter's own over $k = 1 \\dots {m}$, since at $t_0$ it is $P_0$).",
           m=p.m)
    r.value("sigma_eps_true", by_hand.root_mean(true), "u", agrees=answer, routes=("sensitivity analysis", printed))
    r.value("sigma_eps_filter", by_hand.root_mean(claimed[1:]), "u", agrees=answer,
            routes=("discrete filter's covariance", printed))
    r.value("sigma_eps_bound", by_hand.root_mean(bound), "u", agrees=answer, routes=("discrete filter's covariance", printed))
    trues = [by_hand.root_mean(of_nodes(each.actual.mse_plus, each.field)) for each in several]
    bounds = [by_hand.root_mean(of_nodes(each.bound.P_plus, each.field)) for each in several]
    r.value("sigma_eps_true_by_variant", trues, "u", agrees=answer, routes=("sensitivity analysis", printed))
    r.value("sigma_eps_bound_by_variant", bounds, "u", agrees=answer, routes=("discrete filter's covariance", printed))
    order = ("one covariance recursion", "inequality proved")
    size = float(claimed.max()) or 1.0
    r.holds("filter's own variance ≥ true one", claimed - true, order, size=size)
    r.holds("true variance ≥ causal bound", true - bound, order, size=size)
    rows = [
        (i + 1, each.field.alpha, each.sigma_n, true_i, by_hand.root_mean(of_nodes(each.claimed.P_plus, each.field)[1:]), bound_i, ratio_of(each.sigma_n, true_i))
        for i, (each, true_i, bound_i) in enumerate(zip(several, trues, bounds, strict=True))
    ]
    r.table("theory", ["variant", "α = β", "σ_n, u", "σ_ε true, u", "σ_ε filter, u", "σ_ε bound, u", "σ_n/σ_ε true"], rows,
            "Theoretical errors of the ten variants for the given Δt, h, N1, m, P0.")
    theory_pictures(r, p, here, claimed, true, bound)
    expected_size(r, p, answer, field)
    consistency(r, p, here, experiment)


def theory_pictures(r, p, here, claimed, true, bound):
    """Errors over time and place, rows of the gain."""
    field, node = here.field, watched(p)
    names = ("filter's own", "true, printed filter", "causal bound")
    t = here.claimed.t
    curves = {name: np.sqrt(P.mean(axis=1))[1:] for name, P in zip(names, (claimed, true, bound), strict=True)}
    r.figure("errors_in_time", plots.lines(t[1:], curves, xlabel=TIME, ylabel="RMS error over the nodes, u"),
             "The three errors over time: they differ while the filter forgets the uncertainty at $t_0$ that it was told.")
    times = sorted({k for k in (1, 2, 5, 20, p.m) if k <= p.m})
    r.figure("diagonal", plots.lines(field.x, {f"k = {k}": np.sqrt(claimed[k]) for k in times}, xlabel=PLACE, ylabel="standard deviation of the error of z, u", marker=".", ordered=True),
             "Roots of P's diagonal, as the filter claims them, over the nodes at several steps. The boundary node has no noise: it is known ever better, but only as fast as averaging allows; the last node has no neighbour to the right that would tell of it later.")
    rows = {f"k = {k}": (here.claimed.K[k, node], here.claimed.K[k, field.nodes + node]) for k in times}
    r.figure("gain_rows", plots.gain_rows(np.arange(field.nodes), rows, xlabel="number of the measured node", ylabels=("gain for z", "gain for ∂z/∂t, 1/s")),
             "Rows of the gain for node {node}: how much the innovation at each node corrects $\\hat{z}$ (above) and its rate (below). A correction is local. That of $\\hat{z}$ is symmetric ($K_1 = I - \\sigma_n^2S^{-1}$), that of the rate leans to the left, whence the field comes.", node=node)


def expected_size(r, p, answer, field):
    """The root mean square of the field itself."""
    size = finite_variance(field, p.m)
    r.value("sigma_z_expected", None if size is None else by_hand.root_mean(size), "u", reason="" if size is not None else "the unstable field overflows",
            agrees=answer, routes=("sum over the answers to one unit of noise", "covariance recursion"))
    if size is None:
        return
    curves = {text("k = {k}", k=k): np.sqrt(size[k]) for k in sorted({max(p.m // 4, 1), max(p.m // 2, 1), p.m})}
    if field.spectral_radius < 1 and field.von_neumann_factor <= 1:
        curves["steady"] = np.sqrt(field.stationary_variance())
    r.figure("spread", plots.lines(field.x, curves, xlabel=PLACE, ylabel="standard deviation of z, u", ordered=True),
             "Standard deviation of the field over the nodes. It starts from rest, so the experiment shows only part of the steady field.")


def consistency(r, p, here, experiment):
    """NEES: only where X_0 is drawn as the filter believes."""
    r.says("**NEES.** $e^TP^{-1}e$ averages to the number of states, {n}, only if the error has the covariance that the filter claims: $X_0$ must be drawn from $N(0, P_0)$, or the filter be started from $P_0 = 0$. In the printed experiment its mean is $\\mathrm{tr}(P_k^{-1}P^{\\mathrm{true}}_k)$, which begins far below; a test that expects {n} would reject a correct program.",
           n=2 * here.field.nodes)
    design, truth = here.field.model(here.sigma_n, p.P0), here.field.model(here.sigma_n, 0.0)
    if not resolved(here.field, p.m, here.sigma_n):
        r.says("The field grows beyond what double precision resolves, so no ensemble is drawn here.")
        return
    matched = experiment.statistics(design, steps=p.m)
    r.chance("NEES, X_0 drawn from N(0, P0)", chance.nees(matched))
    r.chance("error variances, X_0 drawn from N(0, P0)", chance.variance(matched, here.claimed.P_plus))
    if not p.P0:
        return
    printed = experiment.statistics(truth, design, steps=p.m, gains=here.claimed)
    r.chance("error variances of the printed experiment", chance.variance(printed, here.actual.P_plus))
    theory = np.trace(np.linalg.solve(here.claimed.P_plus, here.actual.P_plus), axis1=1, axis2=2)
    curves = {"X_0 drawn from N(0, P0)": matched.nees, "printed: X_0 = 0": printed.nees}
    straight = {"theory": (matched.t, np.full(p.m + 1, 2.0 * here.field.nodes)), "_printed": (matched.t, theory)}
    r.figure("nees", plots.lines(matched.t, curves, xlabel=TIME, ylabel="NEES, average", straight=straight),
             "NEES of the same filter, averaged over {runs} runs, with the field started as the filter believes and as the paper does.", runs=experiment.runs)


def watched(p):
    """The node of figures 2 and 3."""
    return min(p.node, p.N1)


def plan(r, p, experiment):
    """Every number chosen."""
    r.says("One record per α is the table's field; the ensemble says which of its numbers are typical. All variants of one α share field and noise (scaled by $\\sigma_n$), as in the paper.")
    r.table("plan", ["quantity", "value", "why"], [
        ["steps m", p.m, "the paper's k = 0…m, unless set"],
        ["nodes", p.N1 + 1, "N = N1 + 1"],
        ["seeds", experiment.runs, "a percentile of the ensemble is known to about ±3 % with 1000"],
        ["seed", experiment.seed, "its first run is the record of the table and the figures"],
        ["start", "X_0 = 0", "the paper's; the filter believes P0"],
        ["measurements", "every node, k = 1…m", "eq. 36"],
    ], "Plan of the experiment.")


def part_table(r, p, answer, cases, worlds, samples, variants):
    """The table of ten variants beside the printed one."""
    r.section("table", "The table")
    r.says("$\\hat{m}_z$ and $\\hat{\\sigma}_z$ (eq. 44, 45) and $\\hat{\\sigma}_\\varepsilon$ (eq. 51) are averages over all nodes and $k = 0 \\dots m$ of one record. Ours are of seed {seed}; the percentile says which share of {runs} seeds lies below the printed number.",
           seed=r.seed, runs=r.runs)
    rows, fields_rows, error_rows, lost = [], [], [], False
    for i, (key, (_alpha, sigma_n, sigma_eps, ratio)) in enumerate(zip(variants, PRINTED, strict=True)):
        world, drawn = worlds[key[:2]], samples[key]
        m_z, sigma_z = (None, None) if world is None else (float(world.mean[0]), float(world.spread[0]))
        ours = None
        if drawn is None:
            lost = True
            r.check(text("gains of variant {n}", n=i + 1), cases[key].claimed.K,
                    np.array(answer["filters"][i]["gains"]), ("discrete filter", "eq. 47-49, literally"))
        else:
            data = world.z + sigma_n * world.noise
            z_hat = fields.filter_dense(
                cases[key].field, data[1:], sigma_n=sigma_n, P0=p.P0, gains=cases[key].claimed
            ).z_hat
            ours = float(np.sqrt(np.mean((z_hat - world.z) ** 2)))
            literal = by_hand.printed_estimate(answer["filters"][i], data) - world.z
            r.check(text("σ̂_ε of variant {n}", n=i + 1), ours, float(np.sqrt(np.mean(literal**2))),
                    ("discrete filter", "eq. 46, literally"))
        rows.append([m_z, sigma_z, sigma_n, ours, None if ours is None else ratio_of(sigma_n, ours)])
        error_rows.append((i + 1, key[0], sigma_n, sigma_eps, ours,
                           None if drawn is None else percentile(sigma_eps, drawn.printed), ratio, rows[-1][4]))
        if key[:2] not in [variant[:2] for variant in variants[:i]]:
            printed = PRINTED_FIELD[key[0]]
            more = (
                [None] * 4
                if world is None
                else [
                    percentile(printed[0], world.mean),
                    percentile(printed[1], world.spread),
                    float(world.spread.mean()),
                    float(world.spread.std()),
                ]
            )
            fields_rows.append((key[0], printed[0], m_z, more[0], printed[1], sigma_z, more[1], more[2], more[3]))
    table_says(r, p, worlds, samples, variants, rows, fields_rows, error_rows, lost)


def table_says(r, p, worlds, samples, variants, rows, fields_rows, error_rows, lost):
    """The tables, and the tests of the ensembles behind them."""
    r.value("table", rows, "u, u, u, u, 1",
            reason="the unstable field is too large for ẑ − z to be resolved in double precision" if lost else "")
    r.table("fields", ["α = β", "m̂_z printed, u", "ours, u", "percentile", "σ̂_z printed, u", "ours, u ", "percentile ", "mean of seeds, u", "their spread, u"], fields_rows,
            "The field columns of the table: printed, ours, the percentile of the printed number, and σ̂_z over all seeds.")
    r.table("table", ["variant", "α = β", "σ_n, u", "σ̂_ε printed, u", "ours, u", "percentile", "σ_n/σ̂_ε printed", "ours"], error_rows,
            "The ten variants: printed, ours, and the percentile of the printed σ̂_ε among all seeds of the printed filter.")
    different = [name for name, value in PAPER.items() if getattr(p, name) != value]
    if different:
        r.says("The printed table holds for {paper}. Here {others}: the comparison is with another experiment.",
               paper=", ".join(f"{name} = {value:g}" for name, value in PAPER.items()), others=", ".join(f"{name} = {getattr(p, name):g}" for name in different))
    for alpha in PRINTED_FIELD:
        if worlds[alpha, alpha] is not None:
            r.chance(text("variances of z at all nodes and steps, α = {alpha}", alpha=alpha), worlds[alpha, alpha].test,
                     ("ensemble", "sum over the answers to one unit of noise"))
    for i, key in enumerate(variants):
        if samples[key] is not None:
            r.chance(text("error variances at all nodes and steps, variant {n}", n=i + 1), samples[key].tests[0],
                     ("ensemble of the structured filter", "sensitivity analysis"))


def part_figures(r, p, answer, here, world, drawn):
    """Figures 1-3 of the paper for the given parameters, and the error over (x, t)."""
    r.section("figures", "The figures")
    field, node = here.field, watched(p)
    if world is None:
        r.says("The unstable field overflows, or nearly so: there is nothing to draw.")
        r.check("gains", here.claimed.K, np.array(answer["here"]["gains"]), ("discrete filter", "eq. 47-49, literally"))
        return
    z, data, t = world.z, world.z + here.sigma_n * world.noise, here.claimed.t
    z_hat = fields.filter_dense(field, data[1:], sigma_n=here.sigma_n, P0=p.P0, gains=here.claimed).z_hat
    literal = by_hand.printed_estimate(answer["here"], data)
    r.check("estimate drawn at every node and step", z_hat, literal, ("discrete filter", "eq. 46, literally"), scale=float(np.abs(literal).max()) or 1.0)
    r.check("estimate drawn, by structure", z_hat,
            fields.filter_exact(field, data[1:], sigma_n=here.sigma_n, P0=p.P0).z_hat, ("dense matrices", "structure"))
    r.figure("figure1", plots.surface(field.x, t, z, xlabel=PLACE, tlabel=TIME, zlabel="field z, u"),
             "Figure 1 of the paper: the field z(x_i, t_k) for α = {alpha}, β = {beta}.", alpha=p.alpha, beta=p.beta)
    r.figure("figure2", plots.lines(t, {"measured $z_n$": data[:, node], "field z": z[:, node]}, xlabel=TIME, ylabel="field at one node, u"),
             "Figure 2: the field and its measurement at node {node}, σ_n = {sigma_n} u.", node=node, sigma_n=p.sigma_n)
    r.figure("figure3", plots.lines(t, {"estimate $\\hat{z}$": z_hat[:, node], "field z": z[:, node]}, xlabel=TIME, ylabel="field at one node, u"),
             "Figure 3: the field and its estimate at node {node}.", node=node)
    error = z_hat - z
    names = ("z, u", "$\\hat{z}$, u", "error $\\hat{z} - z$, u")
    r.figure("error_map", plots.maps(field.x, t, dict(zip(names, (z, z_hat, error), strict=True)), xlabel=PLACE, tlabel=TIME, common=names[:2]),
             "Field, estimate and error over place and time; the error has its own scale.")
    if drawn is None:
        r.says("The field is so large, {large} u at most, that rounding is a part of the error drawn, {size} u at most; the theory has an RMS of {theory} u. No ensemble of errors is formed.",
               large=f"{np.abs(z).max():.1e}", size=f"{np.abs(error).max():.1e}", theory=by_hand.root_mean(of_nodes(here.actual.mse_plus, field)))
        return
    sigma = float(np.sqrt((error**2).mean()))
    r.check("σ̂_ε of what is drawn", sigma, float(drawn.printed[0]), ("record drawn", "first run of the ensemble"))
    k = np.argmax(np.abs(error).max(axis=1))
    r.says("In this record $\\hat{\\sigma}_z = {spread}$ u and $\\hat{\\sigma}_\\varepsilon = {sigma}$ u: the noise of {sigma_n} u is suppressed {ratio} times. The largest error, {largest} u, is at t = {t} s; at node {node} the root mean square error is {own} u.",
           spread=float(z.std()), sigma=sigma, sigma_n=p.sigma_n, ratio=ratio_of(p.sigma_n, sigma), largest=float(np.abs(error).max()), t=float(t[k]), node=node, own=float(np.sqrt((error[:, node] ** 2).mean())))
    curves = {"printed filter, ensemble": drawn.rms[0], "P0 = 0, ensemble": drawn.rms[1]}
    theory = [np.sqrt(of_nodes(P, field).mean(axis=1)) for P in (here.actual.mse_plus, here.bound.P_plus)]
    r.figure("ensemble", plots.lines(t, curves, xlabel=TIME, ylabel="RMS error over nodes and runs, u", straight={"theory": (t, theory[0]), "_bound": (t, theory[1])}),
             "Root mean square error over nodes and {runs} seeds, against the theory.", runs=r.runs)


def part_verdict(r, p, cases, worlds, samples, variants):
    """What agrees, what cannot, what holds: computed."""
    r.section("verdict", "Verdict")
    true, bound = ([by_hand.root_mean(of_nodes(P, cases[key].field)) for key, P in pick] for pick in (
        [(key, cases[key].actual.mse_plus) for key in variants], [(key, cases[key].bound.P_plus) for key in variants]))
    noise, printed = np.array([key[2] for key in variants]), np.array([row[2] for row in PRINTED])
    same = all(getattr(p, name) == value for name, value in PAPER.items())
    lower, whole = np.array(bound), all(samples[key] is not None for key in variants)
    for i, key in enumerate(variants):
        if samples[key] is not None:
            r.chance(text("causal bound of variant {n} at all nodes and steps", n=i + 1), samples[key].tests[1],
                     ("ensemble with P0 = 0", "discrete filter's covariance"))
    r.holds("σ_bound ≤ σ_n", noise - lower, ("covariance recursion", "P⁺ ⪯ R"), size=float(noise.max()))
    suppression = (lower / noise).reshape(2, 5)
    r.holds("σ_bound/σ_n falls with σ_n", -np.diff(suppression, axis=1),
            ("covariance recursion", "P(Q, R)/R depends on Q/R and grows with it"), size=1.0)
    ratio = np.array([ratio_of(*pair) for pair in zip(noise, true, strict=True)]).reshape(2, 5)
    suppresses, falls = bool((ratio > 1).all()), bool((ratio[1] < ratio[0]).all())
    grows = bool((ratio[:, 1:] > ratio[:, :-1]).all())
    r.value("verdict_claim", suppresses and grows and falls)
    groups = {}
    for row, alpha in enumerate(PRINTED_FIELD):
        pick = slice(5 * row, 5 * row + 5)
        group = {"noise": noise[pick], "printed": printed[pick], "true": true[pick], "bound": bound[pick]}
        if all(samples[key] is not None for key in variants[pick]):
            group |= {
                name: [float(np.quantile(samples[key].printed, q)) for key in variants[pick]]
                for name, q in (("low", 0.025), ("high", 0.975))
            }
        groups[text("α = β = {alpha}", alpha=alpha)] = group
    r.figure("sigma_eps", plots.errors_by_noise(groups, xlabel="measurement noise σ_n, u", ylabel="filtering error σ_ε, u"),
             "Filtering error against measurement noise: printed, the printed filter in theory and over seeds, and the causal bound.")
    says_claim(r, suppresses, grows, falls, ratio)
    if not same:
        r.value("verdict_table", None, reason="the printed numbers hold for other values of the parameters")
        r.says("The printed numbers are not judged here: they hold for {paper}.",
               paper=", ".join(f"{name} = {value:g}" for name, value in PAPER.items()))
        return
    judged(r, worlds, samples, variants, true, bound, printed, lower, whole)


def judged(r, worlds, samples, variants, true, bound, printed, lower, whole):
    """The printed numbers against theory and the seeds."""
    below = 100 * (1 - printed / lower)
    percent = (
        [
            (percentile(row[2], samples[key].printed), percentile(row[2], samples[key].bound))
            for key, row in zip(variants, PRINTED, strict=True)
        ]
        if whole
        else []
    )
    r.table("verdict", ["variant", "σ̂_ε printed, u", "σ_ε true, u", "σ_ε bound, u", "printed below the bound, %", "percentile, printed filter", "percentile, P0 = 0"],
            [(i + 1, printed[i], true[i], bound[i], below[i], *percent[i]) for i in range(len(variants))],
            "The printed errors against theory, and their percentiles among {runs} seeds of the printed filter and of the best causal one.", runs=r.runs)
    spread = {
        alpha: [
            percentile(value, ensemble)
            for value, ensemble in zip(PRINTED_FIELD[alpha], worlds[alpha, alpha][2:4], strict=True)
        ]
        for alpha in PRINTED_FIELD
    }
    typical = all(1 < share < 99 for shares in spread.values() for share in shares)
    r.says("**The field.** The printed $\\hat{m}_z$ and $\\hat{\\sigma}_z$ are at the percentiles {a} (α = 0.05) and {b} (α = 0.1) of our seeds: {say}.",
           a=[round(share) for share in spread[0.05]], b=[round(share) for share in spread[0.1]],
           say="ordinary draws of the literal model" if typical else "not ordinary draws of the literal model")
    r.value("verdict_field", typical)
    reproduced = all(1 < share[0] < 99 for share in percent)
    r.value("verdict_table", reproduced)
    if (below > 0).all():
        r.says("**The errors.** Every printed $\\hat{\\sigma}_\\varepsilon$ is below the causal bound, by {least} to {most} %. The bound is an average; among the seeds of the best causal filter the printed numbers are at the percentiles {low} to {high}. No choice of $P_0$, gains or start can lower the average error of a filter of these data below the bound, so the printed errors do not come from a different reading of the filter: the field or noise of that program, or its averaging, must have differed. The parameters are not tuned to match.",
               least=round(below.min(), 1), most=round(below.max(), 1), low=round(min(share[1] for share in percent), 1), high=round(max(share[1] for share in percent), 1))
    else:
        r.says("**The errors.** The printed $\\hat{\\sigma}_\\varepsilon$ are not all below the causal bound.")


def says_claim(r, suppresses, grows, falls, ratio):
    """The paper's claim, by the theory of the printed filter."""
    r.says("**The claim** of the paper is that the filter suppresses the noise substantially. By the theory of the printed filter the ratio $\\sigma_n/\\sigma_\\varepsilon$ is {least} to {most}: the noise {a} in all ten variants, the ratio {b} with $\\sigma_n$, and it {c} from α = 0.05 to α = 0.1 (criterion of `verdict_claim`: all three hold).",
           least=round(ratio.min(), 2), most=round(ratio.max(), 2), a="is suppressed" if suppresses else "is not suppressed",
           b="grows" if grows else "does not always grow", c="falls" if falls else "does not always fall")


def part_scale(r, p, experiment, field):
    """The same filter for long fields: structure, then a convolution."""
    r.section("scale", "Long fields")
    r.says("**By structure.** $H = [I\\ 0]$ and $R = \\sigma_n^2I$ leave one matrix of $N$ rows to factor, $S = P^-_{11} + \\sigma_n^2I$. With $W = S^{-1}[P^-_{11}\\ P^-_{12}]$ the update is")
    r.math(r"P^+_{11} = \sigma_n^2W_1, \qquad P^+_{12} = \sigma_n^2W_2, \qquad P^+_{22} = P^-_{22} - P^-_{21}W_2")
    r.says("and $\\Phi P\\Phi^T$ is the recursion of eq. 15-16 applied to the columns and then to the rows of $P$: of order $N^2$. The numbers are those of the literal filter.")
    r.says("**By a kernel.** Far from both ends the gain is a convolution. On an infinite line the covariance falls apart into waves, each with a 2×2 Riccati equation; the inverse transform of their gains is the kernel. The ends take the exact gains of a short field. Cost and memory grow like $N$.")
    steps, tolerance = min(p.m, 30), 1e-9
    for N1 in sorted({p.N1, 60}):
        each, data = lengthened(p, experiment, field, N1, steps)
        dense = fields.filter_dense(each, data[1:], sigma_n=p.sigma_n, P0=p.P0)
        exact = fields.filter_exact(each, data[1:], sigma_n=p.sigma_n, P0=p.P0)
        r.check(text("estimates, N1 = {N1}", N1=N1), exact.z_hat, dense.z_hat, ("structure", "dense matrices"), scale=float(np.abs(dense.z_hat).max()) or 1.0)
        r.check(text("variances, N1 = {N1}", N1=N1), exact.variance, dense.variance, ("structure", "dense matrices"))
    each, data = lengthened(p, experiment, field, 240, steps)
    exact = fields.filter_exact(each, data[1:], sigma_n=p.sigma_n, P0=p.P0)
    local = fields.filter_local(each, data[1:], sigma_n=p.sigma_n, P0=p.P0, tolerance=tolerance)
    r.check("estimates, N1 = 240", local.z_hat, exact.z_hat, ("convolution", "structure"), scale=float(np.abs(exact.z_hat).max()) or 1.0)
    worst = float(np.abs(local.z_hat - exact.z_hat).max())
    if local.truncation:
        r.says("For {steps} steps and a tolerance of {tolerance} a correction reaches {w} nodes to a side at most; what is left out is {left} of the gain, and $\\hat{z}$ at N1 = 240 differs from the exact filter's by {worst} u at most.",
               steps=steps, tolerance=tolerance, w=local.half_width, left=f"{local.truncation:.1e}", worst=f"{worst:.1e}")
    else:
        r.says("For {steps} steps and a tolerance of {tolerance} a window would be as long as this field of 241 nodes, so the local filter is the exact one here.",
               steps=steps, tolerance=tolerance)
    costs_and_pictures(r, local)


def costs_and_pictures(r, local):
    """What the local gain costs, and what it looks like."""
    w = local.half_width
    r.value("verdict_scale", bool(local.truncation))
    sizes = [30, 100, 300, 1000, 10_000, 100_000]
    costs = [
        (
            N1,
            51.0 * (N1 + 1) ** 3,
            3.2 * (N1 + 1) ** 3,
            3.2 * min(2 * w + 1, N1 + 1) ** 3 + (4.0 * (2 * w + 1) * N1 if 2 * w + 1 < N1 else 0.0),
        )
        for N1 in sizes
    ]
    r.table("costs", ["N1", "dense", "structure", "convolution"], costs,
            "Multiplications per step for one record: dense matrices with 2N states take 51N³, the structure 3.2N³, the convolution at most a window of 2w + 1 = {width} nodes and 4(2w + 1)N.", width=2 * w + 1)
    columns = list(zip(*costs, strict=True))
    r.figure("scaling", plots.lines(columns[0], {"dense matrices": columns[1], "structure": columns[2], "convolution": columns[3]}, xlabel="number of the last node N1", ylabel="number of multiplications per step", log="xy", marker="o"),
             "Cost of one step against the length of the field.")


def lengthened(p, experiment, field, N1, steps):
    """A field of N1 + 1 nodes and its measurements; only noise where the field is too large to be resolved."""
    each = replace(field, N1=N1, allow_unstable=True)
    size = finite_variance(each, steps)
    large = size is None or math.sqrt(size.max()) > 1e6 * p.sigma_n
    z = np.zeros((steps + 1, N1 + 1)) if large else each.simulate(steps, experiment.seed)
    return each, fields.measure(z, p.sigma_n, experiment.seed)


def conclusions(r, p):
    """What the numbers say."""
    values = {name: value.value for name, value in r.values.items()}
    true, own_P, bound = (values[f"sigma_eps_{kind}"] for kind in ("true", "filter", "bound"))
    lines = [text("For the given parameters the printed filter has a true error of {true} u, where the noise is {noise} u; it claims {claimed} u itself, and no causal filter does better than {bound} u.",
                  true=true, noise=p.sigma_n, claimed=own_P, bound=bound)]
    if values["verdict_claim"]:
        lines.append("The paper's claim holds: the filter suppresses the noise, the more the larger it is, and the more the smaller α is.")
    else:
        lines.append("The paper's claim does not hold for all ten variants with these values of Δt, h, N1, m and P0.")
    if values["verdict_table"] is None:
        lines.append("The printed table belongs to other values of the parameters and is not judged.")
    elif values["verdict_table"]:
        lines.append("The printed errors are ordinary results of the printed filter.")
    else:
        lines.append(
            "The printed mean and spread of the field are ordinary draws of the literal model; the printed errors are not results of the printed filter on the printed field."
            if values["verdict_field"] else
            "Neither the printed mean and spread of the field nor the printed errors are ordinary draws; the errors are not results of the printed filter on the printed field.")
    if values["verdict_stability"]:
        lines.append(text("The step of {dt} s is stable; von Neumann's limit is {limit} s, and the eigenvalues would wrongly allow {other} s.",
                          dt=p.dt, limit=values["dt_limit_von_neumann"], other=values["dt_limit_eigenvalue"]))
    else:
        lines.append(text("The step of {dt} s is unstable: von Neumann's limit is {limit} s. The filter's covariances stay finite, since every node is measured; the field does not.",
                          dt=p.dt, limit=values["dt_limit_von_neumann"]))
    if values["verdict_scale"]:
        lines.append("The gain is local, so a long field is filtered at a cost proportional to its length.")
    else:
        lines.append("The gain reaches so far that a field of 241 nodes has no interior where it is a convolution; only longer ones gain by it.")
    lines.append(largest(r))
    r.items(lines)


PARTS = Skeleton(
    analysis=(statement, part_stability, part_theory),
    plan=plan,
    experiment=(simulated, part_table, part_figures, part_verdict, part_scale),
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the paper, item by item."""
    variants = [(alpha, alpha, sigma_n) for alpha, sigma_n, *_rest in PRINTED]
    key = (p.alpha, p.beta, p.sigma_n)
    cases = {each: case(p, *each) for each in dict.fromkeys([*variants, key])}
    here, several = cases[key], [cases[each] for each in variants]
    return PARTS.report(META, p, experiment, answer=by_hand.analytic(p), variants=variants, key=key, cases=cases,
                        here=here, several=several, field=here.field)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
