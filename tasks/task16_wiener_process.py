r"""Lab 16. The Wiener process in white noise: the continuous filter, the discrete one, and their limits.

Source: Semushin & Tsyganova 2001, task 16. For ẋ = w, z = x + v with white w, v of strengths Q, R the sheet asks for the
continuous filter, its steady state and transfer function, the discrete model and filter with their steady state and
z-transfer function, and an experiment from which the settling times of both are estimated.

Expected answer: P' = Q − P²/R, P∞ = √(QR) = 8, K = √(Q/R) = 0.5, x̂/z = 0.5/(s + 0.5); with Q_d = Q dt, R_d = R/dt
P∓ = ±Q dt/2 + √(QR + Q²dt²/4), H(z) = K/(1 − (1−K)z⁻¹); both tend to the continuous filter as dt → 0, the bounds P⁻
and P⁺ like dt, their mean like dt².
"""

import math

import numpy as np
from ctlabs.tasks._task16_limits import TIME, limits, overlay, time_scale
from ctlabs.tasks._task16_words import answers, conclusions, discussion, result
from ctlabs.tasks.answers import task16 as by_hand
from ctlabs.tasks.answers.task16 import TIMES, WITHIN

from ctlabs.filtering import bucy, settling, settling_step, steady
from ctlabs.labs.comparison import fine
from ctlabs.labs.experiment import Experiment, covariances
from ctlabs.labs.portrait import mean_error, rms, tested
from ctlabs.labs.skeleton import Skeleton
from ctlabs.models import ContinuousModel
from ctlabs.models.discretisation import discretise
from ctlabs.montecarlo import chance
from ctlabs.reporting import plots
from ctlabs.reporting.draws import one_of, span
from ctlabs.reporting.params import LabParameters, Positive, Real, Variance, given
from ctlabs.reporting.report import EXACT, Report
from ctlabs.text import text

META = {
    "name": "task16",
    "title": "The Wiener process in white noise: continuous and discrete filter",
    "source": "Semushin & Tsyganova 2001, task 16",
    "parts": ["a", "b", "c"],
}


class Parameters(LabParameters):
    """What may be changed."""

    Q: Variance = given(4.0, unit="m²/s", meaning="strength of the process noise w", draw=span(1, 9, 0.5))
    R: Positive = given(16.0, unit="m²·s", meaning="strength of the measurement noise v", draw=span(4, 25, 1))
    x0_mean: Real = given(10.0, unit="m", meaning="mean of x(0)", symbol=r"\bar x_0", draw=span(5, 20, 5))
    P0: Variance = given(25.0, unit="m²", meaning="variance of x(0)", draw=span(10, 50, 5))
    dt: Positive = given(1.0, unit="s", meaning="period of the discrete measurements", symbol="dt", draw=one_of(0.5, 1, 1.5, 2))


def model(p):
    """ẋ = w, z = x + v."""
    return ContinuousModel(F=[[0]], G=[[1]], Q=[[p.Q]], H=[[1]], Rc=[[p.R]], x0=[p.x0_mean], P0=[[p.P0]], states=["x"],
                           measurements=["z"], units=["m"])


def part_a(r, p, answer, system):
    """The continuous filter."""
    r.section("a", "The continuous filter, its steady state and transfer function")
    r.model(system)
    r.says("The filter of Kalman and Bucy ({ref:kalman_bucy}; {ref:maybeck, section 5.11}) of this model, with $\\hat{x}(0) = \\bar{x}_0$ and $P(0) = P_0$:")
    r.math(r"\dot{\hat x} = K\,(z - \hat x), \qquad K(t) = \frac{P(t)}{R}, \qquad \dot P = Q - \frac{P^2}{R}", "filter")
    if p.Q:
        r.says("**The variance.** Put $P_\\infty = \\sqrt{QR}$ and $\\kappa = \\sqrt{Q/R}$, so that $\\dot{P} = (P_\\infty - P)(P_\\infty + P)/R$. The ratio $\\rho = (P - P_\\infty)/(P + P_\\infty)$ then obeys")
        r.math(r"\dot\rho = \frac{2P_\infty\dot P}{(P + P_\infty)^2} = -2\kappa\,\rho, \qquad \rho(t) = \frac{P_0 - P_\infty}{P_0 + P_\infty}\,e^{-2\kappa t}")
        r.math(r"P(t) = P_\infty\,\frac{P_0 + P_\infty\tanh\kappa t}{P_\infty + P_0\tanh\kappa t}", "variance")
        r.says("**The limit.** $|\\rho(0)| \\le 1$ for every $P_0 \\ge 0$, so $\\rho(t) \\to 0$ and $P(t) \\to P_\\infty$, $K(t) \\to P_\\infty/R = \\kappa$, whatever $P_0$ is. ∎")
        r.says("**Invariance.** With the constant gain κ the filter is $\\dot{\\hat{x}} = -\\kappa\\hat{x} + \\kappa z$: its coefficients do not depend on time, so a record that comes later gives the same estimate, as much later. From zero initial conditions")
        r.math(r"\frac{\hat x(s)}{z(s)} = \frac{\kappa}{s + \kappa}, \qquad \kappa = \sqrt{Q/R}", "transfer")
    else:
        r.says("Without process noise $\\dot{P} = -P^2/R$, hence $1/P(t) = 1/P_0 + t/R$: the variance and the gain tend to zero, and in the limit the filter takes no notice of the measurements.")
    routes = ("Riccati equation", "closed form")
    steady_and_transient(r, p, answer, system, routes)


def steady_and_transient(r, p, answer, system, routes):
    """The steady state, the verdict, and P(t)."""
    limit = bucy.steady(system)
    r.value("variance_steady_continuous", limit.P[0, 0], "m²", symbol=r"P_\infty", agrees=answer, routes=routes)
    r.value("gain_steady_continuous", limit.K[0, 0], "1/s", symbol=r"K_\infty", agrees=answer, routes=routes)
    num, den = bucy.transfer_function(system)
    r.value("filter_transfer_function", [num, den])
    for name, found, expected in zip(
        ("numerator", "denominator"), (num, den), answer["filter_transfer_function"], strict=True
    ):
        r.check(text("transfer function, {part}", part=name), found, expected, routes)
    invariant = bool(limit.poles[0].real < 0)
    r.value("verdict_a", invariant)
    transient = bucy.transient(system, TIMES)
    r.value("variance_continuous", transient.P[:, 0, 0], "m²", at=TIMES, agrees=answer,
            routes=("Riccati equation, integrated", "closed form"))
    if invariant:
        r.says("The criterion of invariance: the gain tends to a constant with which the filter is stable. Here $P_\\infty = {P}$ m², $K_\\infty = {K}$ 1/s, the pole is {pole} 1/s and the time constant {tau} s: the filter becomes time-invariant.",
               P=limit.P[0, 0], K=limit.K[0, 0], pole=limit.poles[0].real, tau=1 / answer["gain_steady_continuous"])
        r.says("The filter passes what changes slower than κ with gain 1 and attenuates the rest like κ/ω: a first-order low-pass whose bandwidth is the root of the ratio of the noise strengths. The more the process moves (Q) or the better it is measured (small R), the wider it is.")
    else:
        r.says("The criterion of invariance: the gain tends to a constant with which the filter is stable. Here it tends to 0 and the pole to the origin: the limit is no filter at all, and the optimal one never becomes time-invariant.")
    scale = time_scale(p)
    t = np.linspace(0.0, 4 * scale, 201)
    curve = bucy.transient(system, t).P[:, 0, 0]
    settled = answer["settling_time"]
    figure = plots.transient(t, {"P(t)": curve}, limits={"P(t)": limit.P[0, 0]}, xlabel=TIME,
                             ylabel="error variance, m²",
                             marks={"settled within 1 %": settled} if settled and settled <= t[-1] else None)
    r.figure("transient", figure, "Error variance of the continuous filter, its limit (dashed), and the instant from which it stays within 1 % of it." if settled and settled <= t[-1] else "Error variance of the continuous filter and its limit (dashed).")
    r.says("{fig:transient} shows $P(t)$ on its way to the limit." if p.Q else "{fig:transient} shows $P(t)$ on its way to 0.")


def part_b(r, p, answer, system, sampled):
    """The discrete model and filter."""
    r.section("b", "The discrete model, its filter and transfer function")
    r.says("Over one period $x$ changes by the integral of $w$, whose variance is $Q\\,dt$. The average of $v$ over a period has the variance $R/dt$, so one measurement with this noise is worth the continuous one over a period:")
    r.math(r"x(t_{i+1}) = x(t_i) + w_d(t_i), \quad z(t_i) = x(t_i) + v_d(t_i), \qquad Q_d = Q\,dt, \quad R_d = \frac{R}{dt}", "sampled")
    r.says("**What is left out.** While $z$ is averaged, $x$ itself moves. The average over the period that ends at $t_i$ is")
    r.math(r"\frac1{dt}\int_{t_{i-1}}^{t_i}z\,dt = x(t_i) + \frac1{dt}\int_{t_{i-1}}^{t_i}v\,dt - \frac1{dt}\int_{t_{i-1}}^{t_i}(\tau - t_{i-1})\,w(\tau)\,d\tau", "average")
    r.says("with a last term of the variance $Q\\,dt/3$, which is correlated with the $w_d$ of the same period, with the covariance $-Q\\,dt/2$. The model of {eq:sampled} leaves it out: it is that of a sampler that measures $x(t_i)$ itself. Beside the variance $R/dt$ of the noise that of the last term is the fraction $Q\\,dt^2/(3R) = (\\kappa\\,dt)^2/3$, here {share:2}. Its covariance does more: a filter that knows of both has the steady variance $P^+ = \\sqrt{QR}\\,(1 + (\\kappa\\,dt)^2/24 + \\dots)$, since averages lose next to nothing of the continuous record, while the sampler's is lower by $Q\\,dt/2$ to first order ({eq:steady}). Both tend to the continuous filter as $dt \\to 0$." if p.Q else
           "with a last term of the variance $Q\\,dt/3$, which is absent here, since without process noise x does not move: the average is a measurement of $x(t_i)$, and nothing is left out.", share=p.Q * p.dt**2 / (3 * p.R))
    r.model(sampled)
    r.check("Q_d", sampled.Qd, [[p.Q * p.dt]], ("integral of ΦGQGᵀΦᵀ", "by hand"), EXACT)
    r.check("R_d", sampled.R, [[p.R / p.dt]], ("model", "by hand"), EXACT)
    r.says("The filter ({ref:maybeck, section 5.3}), from $\\hat{x}(t_0^+) = \\bar{x}_0$ and $P(t_0^+) = P_0$:")
    r.math(r"\hat x(t_i^-) = \hat x(t_{i-1}^+), \qquad P(t_i^-) = P(t_{i-1}^+) + Q_d", "prediction")
    r.math(r"K(t_i) = \frac{P(t_i^-)}{P(t_i^-) + R_d}, \qquad \hat x(t_i^+) = \hat x(t_i^-) + K(t_i)[z(t_i) - \hat x(t_i^-)], \qquad P(t_i^+) = K(t_i)R_d", "update")
    r.says("**Steady state.** With $P^- = P^+ + Q_d$ the update $P^+ = P^-R_d/(P^- + R_d)$ becomes $P^-P^+ = Q_dR_d = QR$: the geometric mean of the two bounds is the continuous limit for every period, and their difference is $Q\\,dt$. Hence")
    r.math(r"P^\mp = \pm\frac{Q\,dt}{2} + \sqrt{QR + \frac{Q^2dt^2}{4}}, \qquad K = \frac{P^+}{R_d}, \qquad 1 - K = \frac{P^+}{P^-}", "steady")
    r.says("The filter with this gain is $\\hat{x}(t_i^+) = (1-K)\\hat{x}(t_{i-1}^+) + Kz(t_i)$, an average of the measurements with weights that fall geometrically. Its transfer function from $z$ to $\\hat{x}^+$ is")
    r.math(r"H(z) = \frac{K}{1 - (1-K)z^{-1}}", "pulse")
    limit, routes = steady.solve(sampled), ("Riccati equation", "closed form")
    r.value("prior_variance_steady", limit.P_minus[0, 0], "m²", symbol=r"\bar P^-", agrees=answer, routes=routes)
    r.value("posterior_variance_steady", limit.P_plus[0, 0], "m²", symbol=r"\bar P^+", agrees=answer, routes=routes)
    r.value("gain_steady", limit.K[0, 0], symbol=r"\bar K", agrees=answer, routes=routes)
    r.value("filter_z_transfer_function", list(steady.transfer_function(sampled)), agrees=answer, routes=routes)
    r.says("Here $P^- = {prior}$ m², $P^+ = {posterior}$ m², $K = {gain}$; the pole is $1 - K = {pole}$.",
           prior=limit.P_minus[0, 0], posterior=limit.P_plus[0, 0], gain=limit.K[0, 0], pole=1 - limit.K[0, 0])
    if p.Q:
        frequency(r, p, system, sampled, limit)
    else:
        r.says("With the gain 0 the transfer function is zero; there is nothing to plot.")


def frequency(r, p, system, sampled, limit):
    """Both filters in the frequency domain."""
    rate = math.sqrt(p.Q / p.R)
    omega = np.geomspace(rate / 50, 50 * rate, 400)
    names = "continuous", text("discrete, dt = {dt} s", dt=p.dt)
    num, den = steady.transfer_function(sampled)
    figure = plots.bode({names[0]: bucy.filter_system(system), names[1]: (num, den, p.dt)}, omega, marks={"κ": rate})
    r.figure("bode", figure,
             "Bode plot of both steady filters; the discrete one up to half the sampling frequency.")
    pole = float(limit.P_plus[0, 0] / limit.P_minus[0, 0])
    r.says("In {fig:bode} both filters pass what is slow and attenuate what is faster than κ, the continuous one like $\\kappa/\\omega$ without end. The discrete one follows it where a period is short beside $1/\\omega$; at half the sampling frequency it has its least gain and no lag, and beyond it repeats itself.")
    # asinh(x/2) = −½ ln((1−K)) of the closed forms: 1 − K = P⁺/P⁻ with P∓ = √(QR)·e^(±asinh(κ dt/2)).
    pole = float(limit.P_plus[0, 0] / limit.P_minus[0, 0])
    r.check("the discrete filter's pole in the plane of s", math.log(pole) / p.dt,
            -2 * math.asinh(rate * p.dt / 2) / p.dt, ("Riccati equation", "closed form −2 asinh(κ dt/2)/dt"))


def plan(r, p, experiment, system):
    """Every number chosen."""
    scale = time_scale(p)
    steps = min(max(math.ceil(10 * scale / p.dt), 20), 400)
    close = fine(system, p.dt, steps, scale)
    r.says("{tab:plan} lists what was chosen. The continuous filter cannot be run on a computer as it stands, since white noise has no values. It is replaced by the discrete filter with a period δ much shorter than its time constant, on measurements with the variance $R/\\delta$; the variance of this filter differs from $P(t)$ by $O(\\delta)$, and {tab:ensemble} says by how much. In the picture of a single run both filters follow the same path of x.")
    r.table("plan", ["quantity", "value", "why"], [
        ["period of the discrete filter dt, s", p.dt, "given"],
        ["its measurements", steps, "ten time constants, but 20 at least and 400 at most"],
        ["period δ in place of continuous time, s", close.model.dt, "a hundredth of the time constant, or dt if that is shorter; a whole number of them in dt"],
        ["steps of length δ", close.steps, "the same horizon, 4000 steps at most"],
        ["runs", experiment.runs, text("a standard error of the variance of {percent} %", percent=round(100 * math.sqrt(2 / experiment.runs), 1))],
        ["seed", experiment.seed, "another stream of random numbers for each ensemble"],
        ["settling", "1 %", "the variance stays within this fraction of its limit from then on"],
    ], "Plan of the experiment.")
    return {"close": close, "steps": steps}


def part_c(r, p, answer, system, sampled):
    """Settling of both, and the sawtooth over P(t)."""
    r.section("c", "Settling, the limit dt → 0, and the simulated filters")
    r.says("**Definition.** A filter has settled at the first time from which its error variance ($P(t)$, or $P(t_i^+)$ after each measurement) stays within 1 % of its limit. The gain is proportional to this variance and settles at the same time.")
    r.says("**In continuous time** the band is $|P - P_\\infty| \\le 0.01P_\\infty$, that is $|\\rho| \\le 0.01/(2 \\pm 0.01)$ with + from above and − from below. **In discrete time** the ratio $(P^+ - P^+_\\infty)/(P^+ + P^-_\\infty)$ shrinks by $(1-K)^2$ with each measurement, since it is the map $P \\to R_d(P + Q_d)/(P + Q_d + R_d)$ written in its fixed points $P^+_\\infty$ and $-P^-_\\infty$. Both give the time by a logarithm:")
    r.math(r"t_s = \frac{1}{2\kappa}\ln\frac{|\rho(0)|}{0.01/(2 \pm 0.01)}, \qquad k_s = \left\lceil\frac{\ln(|\rho_d(0)|/\rho_{d,s})}{-2\ln(1-K)}\right\rceil", "settling")
    r.says("where $\\rho_d(0)$ is that ratio at $P_0$ and $\\rho_{d,s}$ at the edge of the band, $P^+ = (1 \\pm 0.01)P^+_\\infty$; neither is below 0, nor $k_s$ below 1.")
    reason = "the limit is 0, and a variance that decays to 0 never stays within 1 % of it"
    when, step = bucy.settling_time(system, WITHIN), settling(sampled, WITHIN)
    routes = ("search along P(t)", "closed form")
    r.value("settling_time", when, "s", symbol="t_s", reason="" if when is not None else reason, agrees=answer, routes=routes)
    searched = step is not None or answer["settling_step"] is None
    step = step if searched else answer["settling_step"]
    r.value("settling_step", step, symbol="k_s", reason="" if step is not None else reason)
    if searched:
        r.check("settling step", step, answer["settling_step"], ("recursion", "closed form"), EXACT)
    else:
        r.says("The discrete filter needs so many measurements that the recursion is not run to that point; the closed form says how many, and a power of the step's matrix confirms it.")
    posterior = answer["posterior_variance_steady"]
    if step is not None and posterior:
        after = abs(by_hand.posterior_variance(p.Q, p.R, p.P0, p.dt, step) / posterior - 1)
        r.holds("P⁺ is in the band at the settling step", WITHIN - after, ("power of the step's matrix", "definition"),
                size=1.0)
        if step > 1:
            before = abs(by_hand.posterior_variance(p.Q, p.R, p.P0, p.dt, step - 1) / posterior - 1)
            r.holds("P⁺ is outside one step earlier", before - WITHIN, ("power of the step's matrix", "definition"),
                    size=1.0)
    if when is None:
        r.says("Without process noise there is no settling: $P(t) = 1/(1/P_0 + t/R)$ falls for ever, by half each time the elapsed time doubles.")
    else:
        r.says("By {eq:settling} the continuous filter settles at {when:4} s, the discrete one at measurement {step}, that is at {time} s.",
               when=when, step=step, time=step * p.dt)
    overlay(r, p, answer, system, sampled)


def one_path(r, experiment, sampled, close):
    """Both filters on one path of x."""
    runs = close.one_path(experiment, sampled)
    every = slice(None, None, close.ratio)
    tracks = {
        name: (e.t[cut], e.x_plus[cut, 0, 0], e.sd_plus[cut, 0])
        for name, e, cut in zip(("continuous filter", "discrete filter"), runs.values(), (slice(None), every), strict=False)
    }
    last = list(runs.values())[-1]
    figure = plots.estimates((last.t, last.truth[:, 0, 0]), tracks, xlabel=TIME, ylabel="x, m",
                             measurements=(last.t[every], last.z[every, 0, 0]) if len(runs) == 2 else None)
    r.figure("record", figure,
             "One path of $x$, the discrete measurements (the noise of the continuous ones is off the scale), and what each filter makes of it.")
    r.says("In {fig:record} both filters follow the same path. The continuous one takes in what comes at once, the discrete one waits for its next measurement; between them the estimate stays where it is, though straight lines are drawn.")


def ensembles(r, p, experiment, sampled, close, steps):
    """Both filters on simulated data."""
    one_path(r, experiment, sampled, close)
    row, _stats = ensemble(r, p, experiment, "continuous (period δ)", close.model, close.steps, 3)
    own, stats = ensemble(r, p, experiment, "discrete", sampled, steps, 4)
    theory = covariances(sampled, steps)
    r.figure("ensemble", plots.ensemble_against_theory(stats, theory.P_plus, xlabel=TIME, units=["m"]),
             "The ensemble of the discrete filter against theory: RMS and mean of the filtering error with the bands of 95 % of ensembles; NEES and NIS averaged over the runs.")
    r.table("ensemble", ["filter", "to t, s", "σ of theory, m", "RMS, m", "mean error, m", "P⁺ from P(t), % at most", "settled at, s"], [row, own],
            "Both ensembles at their last instant, with standard errors. The deviation from $P(t)$ is that of the variances of theory over the whole horizon.")
    r.says("{fig:ensemble} and {tab:ensemble} compare {runs} runs with theory. With the period δ in place of continuous time the variance differs from $P(t)$ by {percent:2} % at most: what the first ensemble shows holds for the continuous filter to that accuracy.",
           runs=experiment.runs, percent=row[5])
    return {"measured": rms(stats, unit="m"), "sd": float(theory.sd_plus[-1, 0])}


def ensemble(r, p, experiment, name, system, steps, stream):
    """One of the filters against theory; the row of it."""
    stats, theory = experiment.statistics(system, steps=steps, stream=stream), covariances(system, steps)
    tested(r, name, {
        "mean error": chance.bias(stats, theory.P_plus), "error variance": chance.variance(stats, theory.P_plus),
        "NEES": chance.nees(stats), "NIS": chance.nis(stats),
    })
    continuous = [by_hand.variance(p.Q, p.R, p.P0, t) for t in theory.t]
    apart = [abs(P / C - 1) for P, C in zip(theory.P_plus[:, 0, 0], continuous, strict=True) if C]
    settled = settling_step(theory.P_plus[:, :, 0], steady.solve(system).P_plus[0], WITHIN)
    return (name, theory.t[-1], theory.sd_plus[-1, 0], rms(stats), mean_error(stats), 100 * max(apart, default=0.0),
            None if settled is None else max(settled, 1) * system.dt), stats


PARTS = Skeleton(
    result=result,
    key="sawtooth",
    analysis=(part_a, part_b),
    plan=plan,
    experiment=(part_c, limits, ensembles),
    discussion=discussion,
    answers=answers,
    conclusions=conclusions,
)


def report(p, experiment: Experiment) -> Report:
    """Answer the sheet, item by item."""
    answer, system = by_hand.analytic(p), model(p)
    sampled = discretise(system, p.dt)
    return PARTS.report(META, p, experiment, answer=answer, system=system, sampled=sampled)


if __name__ == "__main__":
    from ctlabs.cli import script

    script(META)
