"""The lab field, its analysis: stability of the scheme, and the errors without random numbers."""

import math
from dataclasses import replace

import numpy as np
from ctlabs.tasks.answers import field as by_hand

from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT
from ctlabs.text import prose

TIME, PLACE = "time t, s", "place x, m"


def ratio_of(a, b):
    """a/b, infinite where nothing is left of b."""
    return a / b if b else math.inf


def of_nodes(P, field):
    """Variances of z at every time and node from a stack of covariances of the state."""
    return np.diagonal(P, axis1=1, axis2=2)[:, : field.nodes]


def resolved(field, m, sigma_n):
    """Whether the field stays small enough that ẑ − z means something in double precision."""
    size = finite_variance(field, m)
    return size is not None and math.sqrt(size.max()) <= 1e6 * sigma_n


def statement(r, p, field):
    """The field, its difference scheme and the filter, with the misprints named."""
    r.says(r"In {ref:lipatov} the field $z(x, t)$ obeys, with white noise $\eta$ on the right,")
    r.math(r"b_{20}z_{tt} + b_{10}z_t + b_{00}z + b_{11}z_{xt} + b_{01}z_x = b_{30}\eta, \qquad b_{10} = \beta,\ b_{01} = \alpha,\ b_{00} = \alpha\beta,\ b_{30} = \sqrt{4\alpha\beta}.", "field")
    r.says("With $z_* = z_t$, a forward difference in time and the difference with the left neighbour in place, at the nodes $x_i = ih$, $i = 1 \\dots N_1$ (equations (15) to (19) of the paper), from rest and with a boundary node 0 that keeps its values, it becomes")
    r.math(r"z_i^{k+1} = z_i^k + \Delta t\,z_{*i}^k, \qquad z_{*i}^{k+1} = e_0z_{*i}^k + e_2z_i^k - e_3z_{i-1}^k - e_1z_{*i-1}^k + e_4\eta_i^k,", "scheme")
    e = field.coefficients
    r.math(r"e_0 = {e0}, \quad e_1 = {e1}, \quad e_2 = {e2}, \quad e_3 = {e3}, \quad e_4 = {e4}", **e._asdict())
    r.says(r"The state holds all $z_i$ and then all $z_{*i}$, $2N = {size}$ numbers with $N = N_1 + 1 = {N}$; the noise $\eta_i^k$ has the variance $\sigma_\eta^2$, and every $z_i$ is measured at every step after $t_0$ with the variance $\sigma_n^2$: $H = [I\ 0]$, $R = \sigma_n^2I$. The filter, (46) to (49) of the paper and {ref:maybeck, section 5.3}, starts from $\hat{X}_0 = 0$ and $P_0 = {P0}\,I$.",
           size=2 * field.nodes, N=field.nodes, P0=p.P0)
    r.says("The paper gives no units. Here places are in metres, times in seconds and the field in its own unit u; with $b_{11}$ a pure number the equation then fixes α in 1/s, β in 1/m, $b_{20}$ in s/m and η in u/√(m·s).")
    r.says('**Misprints** of the paper, and how they are read: “n = 1” among the numbers is $h = 1$, and “N = N + 1” is $N = N_1 + 1$; the list of values after $\\sigma_\\eta$ is that of $\\sigma_n$ and lacks 3; in (24) the second matrix Φ is G; the columns of (26) belong to $z_j$; (37) puts η where the measured field $z_n$ stands; ε is both the unit matrix and the error; row 5 of the table prints 0.335, but its ratio 8.45 needs 0.355, which is used here.')


def part_stability(r, p, answer, field):
    """Waves against eigenvalues, the limits of the step, and what a smaller step changes."""
    r.section("stability", "Stability of the difference scheme")
    r.says("A wave $z_i \\propto e^{\\mathrm{i}\\theta i}$ has the rates μ, with $w = e^{-\\mathrm{i}\\theta}$,")
    r.math(r"b_{20}\mu^2 + \Big(\beta + b_{11}\frac{1-w}h\Big)\mu + \alpha\Big(\beta + \frac{1-w}h\Big) = 0, \qquad \lambda = 1 + \mu\,\Delta t,", "waves")
    r.says("and $|\\lambda| \\le 1$ for $\\Delta t \\le -2\\,\\mathrm{Re}\\,\\mu/|\\mu|^2$. Von Neumann's condition {ref:richtmyer, chapter 4} asks this of every θ. The eigenvalues of Φ ask it only of $w = 0$: a node depends on its left neighbour and never on the right one, so Φ is block triangular and has the eigenvalues of the block")
    r.math(r"\begin{bmatrix} 1 & \Delta t \\ e_2 & e_0 \end{bmatrix}")
    r.says("each $N_1$ times, besides the two ones of the boundary node. Φ is defective: an eigenvalue of multiplicity $N_1$ comes out of a general solver with an error of the order $\\varepsilon^{1/N_1}$, so the block is what must be used. The largest modulus of an eigenvalue is a subharmonic function of $w$, hence some wave is always multiplied by at least as much as the block: von Neumann's condition is the stricter one.")
    routes = ("rates of the waves", "amplification from node to node")
    r.value("spectral_radius", field.spectral_radius, symbol=r"\max|\lambda|\;(w = 0)", agrees=answer,
            routes=("rates of the block", "Schur's conditions"))
    r.value("von_neumann_factor", field.von_neumann_factor, symbol=r"\max_\theta|\lambda|", agrees=answer, routes=routes)
    r.value("dt_limit_von_neumann", field.dt_limit_von_neumann, "s", symbol=r"\Delta t_{\max}", agrees=answer, routes=routes)
    r.value("dt_limit_eigenvalue", field.dt_limit_eigenvalue, "s", symbol=r"\Delta t\;\text{of the eigenvalues}", agrees=answer,
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
    r.says("{tab:limits} has both limits.")
    r.table("limits", ["α, 1/s", "β, 1/m", "limit of the waves, s", "limit of the eigenvalues, s", "factor of the waves", "spectral radius", "RMS of z between the limits, u", "RMS of z at the second limit, u"], rows,
            "Limits of Δt, the factors at Δt = {dt} s, and the theoretical root mean square of z at the last node after {m} steps with a Δt at the geometric mean of the two limits and at the second one.", dt=p.dt, m=p.m)
    limit, other, growth = rows[0][2], rows[0][3], rows[0][6:]
    if not limit:
        r.says("For the given α, β, $b_{11}$ and $b_{20}$ the equation itself lets some wave grow ($\\alpha/\\beta = {ratio}$ is too large beside $b_{11}/b_{20} = {speed}$): there is no admissible step, however small.",
               ratio=p.alpha / p.beta, speed=p.b11 / p.b20)
    elif stable:
        r.says("The given step, {dt} s, is within von Neumann's limit {limit} s: no wave grows, the slowest decays by {factor} a step. The eigenvalues alone would allow {other} s; a step between the two limits looks stable by them, yet the field grows while a disturbance travels from node to node: after {m} steps to an RMS of {between} u halfway and of {end} u at the second limit.",
               dt=p.dt, limit=limit, other=other, factor=field.von_neumann_factor, m=p.m, **{name: "more than 10¹⁵⁰" if size is None else prose(size, 2) for name, size in zip(("between", "end"), growth, strict=True)})
    else:
        r.says("The given step, {dt} s, is beyond von Neumann's limit {limit} s: some wave is multiplied by {factor} in each step. The eigenvalues ({radius} at most) {say}.",
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
    growth = {}
    for dt in steps:
        size = finite_variance(replace(field, dt=dt, allow_unstable=True), p.m)
        if size is not None and size.max() > 0:
            spread = np.sqrt(size[:, 1:].mean(axis=1))
            growth[f"Δt = {dt:.4g} s"] = np.where(spread > 0, spread, np.nan)
    if growth:
        r.says("{fig:growth} shows the growth that the eigenvalues do not: up to von Neumann's limit the root mean square settles, beyond it the curves rise geometrically until the disturbances have left the field, although up to the other limit all eigenvalues but those of the boundary node are inside the unit circle.")
        r.figure("growth", plots.lines(np.arange(p.m + 1), growth, xlabel="step number k", ylabel="RMS of z over the nodes, u", log="y", ordered=True, steps=True),
                 "The field's theoretical root mean square for the given Δt, for the two limits of {eq:waves}, and for their geometric mean.")


def held(r, p, answer, field):
    """The stationary variance, and what happens to it when the grid is refined."""
    radius = field.spectral_radius
    steady_variance = field.stationary_variance() if radius < 1 else None
    r.value("stationary_variance_mean", None if steady_variance is None else float(steady_variance[1:].mean()), "u²",
            reason="" if radius < 1 else "an eigenvalue is on or outside the unit circle: the variance grows without bound",
            agrees=answer, routes=("integral over frequencies", "long recursion"))
    r.says("**What is held.** $\\sigma_\\eta$ is the standard deviation of a *discrete* noise. The white field of equation (2) of the paper has $E[\\eta\\eta] = \\frac C2\\delta\\delta$, and a sample of it over one cell has the variance $\\sigma_\\eta^2 = C/(2h\\Delta t)$. Whoever halves Δt or $h$ and keeps $\\sigma_\\eta$ halves the strength C; the field changes because its noise has become weaker, not because the scheme has become finer. Here $C = 2\\sigma_\\eta^2h\\,\\Delta t = {C}$ u²; {tab:held} holds once $\\sigma_\\eta$ (as in this lab when Δt or h is changed) and once C, over the same length and time.",
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
    r.items(["the filter's own, $P_k$ of (49): what it claims;",
             "the true one of the printed filter: $P^{\\mathrm{true}}_{k+1} = (I - KH)(\\Phi P^{\\mathrm{true}}_k\\Phi^T + GQG^T)(I - KH)^T + KRK^T$ with the gains of (47) and $P^{\\mathrm{true}}_0 = 0$;",
             "the causal bound: (47) to (49) with $P_0 = 0$. No filter of the measurements up to $t_k$ has a smaller mean square error on this field."])
    r.says("The gains being given, the error is linear in its sources, so the first two differ by the share of $e_0$ alone: $P_k - P^{\\mathrm{true}}_k = P_0\\,\\Psi_k\\Psi_k^T \\succeq 0$ with $\\Psi_k = \\prod (I - K_jH)\\Phi$; and $P^{\\mathrm{true}}_k \\succeq P^{\\mathrm{bound}}_k$ because the bound belongs to the optimal gains. Hence $\\sigma^{\\mathrm{bound}} \\le \\sigma^{\\mathrm{true}} \\le \\sigma^{\\mathrm{filter}}$ at every node and time. ∎")
    field = here.field
    claimed, true, bound = (of_nodes(P, field) for P in (here.claimed.P_plus, here.actual.mse_plus, here.bound.P_plus))
    printed = "printed equations, literally"
    r.says("Below, $\\sigma_\\varepsilon$ is the root of the average over all nodes and over $k = 0 \\dots {m}$ (the filter's own over $k = 1 \\dots {m}$, since at $t_0$ it is $P_0$).",
           m=p.m)
    r.value("sigma_eps_true", by_hand.root_mean(true), "u", symbol=r"\sigma_\varepsilon^{\text{true}}", agrees=answer, routes=("sensitivity analysis", printed))
    r.value("sigma_eps_filter", by_hand.root_mean(claimed[1:]), "u", symbol=r"\sigma_\varepsilon^{\text{filter}}", agrees=answer,
            routes=("discrete filter's covariance", printed))
    r.value("sigma_eps_bound", by_hand.root_mean(bound), "u", symbol=r"\sigma_\varepsilon^{\text{bound}}", agrees=answer, routes=("discrete filter's covariance", printed))
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
            "Theoretical errors of the ten variants for the given Δt, h, N₁, m, P₀.")
    theory_pictures(r, p, here, claimed, true, bound)
    expected_size(r, p, answer, field)
    consistency(r, p, here, experiment)


def theory_pictures(r, p, here, claimed, true, bound):
    """Errors over time and place, rows of the gain."""
    field, node = here.field, watched(p)
    names = ("filter's own", "true, printed filter", "causal bound")
    t = here.claimed.t
    curves = {name: np.sqrt(P.mean(axis=1))[1:] for name, P in zip(names, (claimed, true, bound), strict=True)}
    r.figure("errors_in_time", plots.lines(t[1:], curves, xlabel=TIME, ylabel="RMS error over the nodes, u", log="x"),
             "The three errors over time, on a logarithmic axis.")
    r.says("{tab:theory} has the errors of the ten variants. {fig:errors_in_time} shows that the three differ at the beginning, while the filter forgets the uncertainty at $t_0$ that it was told, and are one afterwards." if p.P0 else "{tab:theory} has the errors of the ten variants; in {fig:errors_in_time} the three are one, as the filter knows the start.")
    times = sorted({k for k in (1, 2, 5, 20, p.m) if k <= p.m})
    rows = {f"k = {k}": (here.claimed.K[k, node], here.claimed.K[k, field.nodes + node]) for k in times}
    r.figure("gain_rows", plots.gain_rows(np.arange(field.nodes), rows, xlabel="number of the measured node", ylabels=("gain for z", "gain for ∂z/∂t, 1/s")),
             "Rows of the gain for node {node}: how much the innovation at each node corrects $\\hat{z}$ (above) and its rate (below).", node=node)
    r.says("{fig:gain_rows} shows where a correction comes from. It falls off quickly with the distance from the node. The row for $\\hat{z}$ is that of a symmetric matrix ($K_1 = I - \\sigma_n^2S^{-1}$), that for the rate leans to the left, whence the field comes.")


def expected_size(r, p, answer, field):
    """The root mean square of the field itself."""
    size = finite_variance(field, p.m)
    r.value("sigma_z_expected", None if size is None else by_hand.root_mean(size), "u", reason="" if size is not None else "the unstable field overflows",
            agrees=answer, routes=("sum over the answers to one unit of noise", "covariance recursion"))
    if size is None:
        return


def consistency(r, p, here, experiment):
    """NEES: only where X_0 is drawn as the filter believes."""
    r.says("**NEES.** $e^TP^{-1}e$ averages to the number of states, {n}, only if the error has the covariance that the filter claims: $X_0$ must be drawn from $N(0, P_0)$, or the filter be started from $P_0 = 0$. In the printed experiment its mean is $\\mathrm{tr}(P_k^{-1}P^{\\mathrm{true}}_k)$, which begins far below; a test that expects {n} would reject a correct program. Both ensembles were run, and agree with the covariances that belong to them ({app:chance}).",
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


def watched(p):
    """The node of figures 2 and 3."""
    return min(p.node, p.N1)
