"""Lab 5, part (g): the true sensor, and what is made of its measurements."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from ctlabs.tasks._task05_model import LETTERS, STATES, STEP, UNITS, covariance, length, pseudo, start, system
from ctlabs.tasks.answers import task05 as by_hand

from ctlabs.analysis import sensitivity
from ctlabs.filtering import pairing, updates
from ctlabs.filtering.extended import Extended
from ctlabs.labs.portrait import agreement, rms
from ctlabs.models.nonlinear import NonlinearModel
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT
from ctlabs.text import Uncertain, text

#: Standard errors from which a difference of mean squares on the same data is called clear in the words of the report.
CLEAR = 4.0


def cost(r, answer):
    """Operations of an update."""
    whole, scalar, extra = (updates.flops(4, 2, way) for way in ("joint", "sequential", "decorrelation"))
    counted = [2 * updates.flops(2, 1, "sequential"), scalar, scalar + extra, whole]
    r.value("cost_of_update", counted, "flop", agrees=answer, routes=("counted while it is done", "formula in n"), kind=EXACT)
    r.table("cost", ["update", "additions, multiplications, divisions", "relative"], [
        (name, count, count / counted[2]) for name, count in zip((
            "variant 1 as two filters of two states", "variant 1, four states, element by element",
            "variant 2: decorrelation, then element by element", "the full R, both elements at once"), counted, strict=True)
    ], "Cost of one update of estimate and covariance, dense matrices (n = 4, m = 2). The zeros of H would save more, for all but the first alike.")
    r.says("**Cost.** {tab:cost} counts the operations. Decorrelation itself costs little ({extra} operations of {all}). What variant 2 really gives up is the separation into two small filters; its prediction (dense, $\\Phi P\\Phi^T + Q_d$) then takes {four} operations instead of twice {two}.", extra=extra, all=counted[2], four=prediction(4), two=prediction(2))


def prediction(n):
    """Operations of one dense prediction of estimate and covariance."""
    return n * (2 * n - 1) + 2 * n**2 * (2 * n - 1) + n**2


def polar(p, motion):
    """The true system: linear motion, range and bearing with their own noises."""
    return NonlinearModel(
        f=lambda _k, x, w: motion.Phi @ x + w, h=lambda _k, x, v: np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])]) + v,
        Qd=motion.Qd, R=np.diag([p.sigma_D**2, p.sigma_theta**2]), x0=motion.x0, P0=motion.P0, states=STATES, measurements=["D", "θ"],
    )


def converted(p, motion, *, correlated):
    """A filter of pseudo-measurements with R at the geometry it predicts; ``correlated``: decorrelated there (variant 2)."""
    def geometry(x):
        return pseudo(p, x[0], x[2])

    def difference(z, predicted):  # z − ẑ, with ẑ the predicted position; the conversion is that of the measured D and θ
        e = z[0] * np.array([np.cos(z[1]), np.sin(z[1])]) - predicted
        return np.array([e[0], e[1] - pseudo(p, *predicted)[3] * e[0]]) if correlated else e

    def H(_k, x):
        l21, zero = geometry(x)[3] if correlated else np.zeros_like(x[0]), np.zeros_like(x[0])
        return np.array([[zero + 1, zero, zero, zero], [-l21, zero, zero + 1, zero]])

    def R(_k, x):
        R11, R22, _R12, _l21, d2 = geometry(x)
        zero = np.zeros_like(R11)
        return np.array([[R11, zero], [zero, d2 if correlated else R22]])

    return NonlinearModel(f=lambda _k, x, w: motion.Phi @ x + w, h=lambda _k, x, v: x[[0, 2]] + v, F=lambda _k,
                          _x: motion.Phi, H=H, residual=difference, Qd=lambda _k, _x: motion.Qd, R=R, x0=motion.x0,
                          P0=motion.P0, states=STATES, measurements=["z1'", "z2'"])


def tracked(p, motion):
    """The extended filter on range and bearing themselves, without a conversion."""
    def H(_k, x):
        D = np.maximum(np.hypot(x[0], x[2]), 1e-9 * p.D)
        c, s, zero = x[0] / D, x[2] / D, np.zeros_like(D)
        return np.array([[c, zero, s, zero], [-s / D, zero, c / D, zero]])

    def difference(z, predicted):
        e = z - predicted
        return np.array([e[0], np.remainder(e[1] + math.pi, 2 * math.pi) - math.pi])

    return replace(polar(p, motion), F=lambda _k, _x: motion.Phi, H=H, residual=difference)


def trajectories(p, steps):
    """Name and initial velocity (m/s): at rest, towards the sensor to half of D, across the radius by D."""
    c, s, speed = math.cos(p.theta), math.sin(p.theta), p.D / (steps * p.tau)
    return {"at rest": (0.0, 0.0), "approaching": (-0.5 * speed * c, -0.5 * speed * s), "crossing": (-speed * s, speed * c)}


def small(p, runs, steps):
    """A factor of all noises at which nothing but the linear terms is seen by so many runs, or None where rounding would be."""
    position, velocity = by_hand.spread(p)
    t = steps * p.tau
    away = math.sqrt(position + velocity * t**2 + p.sigma_w2 * t**3 / 3) / p.D
    longer = max(p.D * p.sigma_theta / p.sigma_D, p.sigma_D / (p.D * p.sigma_theta))
    size = min(1.0, 0.01 / (longer**2 * (away + p.sigma_theta + p.sigma_D / p.D) * math.sqrt(runs)))
    return size if size * min(p.sigma_D / p.D, p.sigma_theta, math.sqrt(p.sigma_w2 * p.tau**3) / p.D) > 1e-9 else None


def scaled(p, size):
    """Parameters of the noises times a factor."""
    return p.model_copy(update={"sigma_D": size * p.sigma_D, "sigma_theta": size * p.sigma_theta, "sigma_w2": size**2 * p.sigma_w2})


def along(p, velocity, steps):
    """The linear model on the nominal trajectory: R at its geometry at every instant."""
    t = p.tau * np.arange(steps + 1)
    motion = system(p, covariance(p, start(p)[0] + velocity[0] * t, start(p)[1] + velocity[1] * t))
    return replace(motion, x0=[start(p)[0], velocity[0], start(p)[1], velocity[1]])


#: The filters of the true sensor, by name.
FILTERS = {
    "variant 1": partial(converted, correlated=False), "variant 2": partial(converted, correlated=True),
    "extended": tracked,
}


def nonlinear(r, p, experiment):
    """The true sensor."""
    steps = length(p)
    r.says("**The true sensor.** Range and bearing are simulated with their own noise. Variants 1 and 2 convert them and take R at the geometry they predict; a third filter, the extended one {ref:jazwinski, section 8.3}, takes range and bearing as they are and linearises about its prediction, so that it needs no pseudo-measurements. The errors are not exactly Gaussian now, and the linear theory on the nominal trajectory is an approximation.")
    names, shown = list(trajectories(p, steps)), {}
    for n, (name, velocity) in enumerate(trajectories(p, steps).items()):
        theory = along(p, velocity, steps)
        P = [sensitivity.actual(theory, design, steps).P_plus for design in (replace(theory, R=theory.R * np.eye(2)), theory)]
        if name == names[-1]:
            exact(r, p, experiment, velocity, steps, P)
        stats = [experiment.statistics(polar(p, theory), design(p, theory), steps=steps, stream=10 + n) for design in FILTERS.values()]
        together = experiment.statistics(polar(p, theory), lambda m=theory: pairing.Together(*(Extended(design(p, m)) for design in FILTERS.values())),
                                         steps=steps, stream=10 + n, compare=np.vstack([np.eye(4)] * 3))
        shown[name] = (stats, P, [pairing.paired(together.second_moment[-1][pick], together.runs) for pick in PAIRS])
    compared(r, experiment, shown, steps)
    return {"sensor": judged(r, shown)}


#: Where the errors of variants 1 and 2, and of variant 2 and the extended filter, are in the moments of all three.
PAIRS = (np.ix_(range(8), range(8)), np.ix_(range(4, 12), range(4, 12)))


def exact(r, p, experiment, velocity, steps, P):
    """The programme against theory where theory is exact."""
    size = small(p, experiment.runs, steps)
    if size is None:
        r.says("The programme is not tested with small noise here: it would have to be so small that rounding of D would be seen.")
        return
    r.says("That the programme does what the theory says is tested where the approximation is exact: all noises and the initial errors are made smaller by one factor, until the terms that are not linear are below a hundredth of a standard error. There the extended filter and variant 2 are the same.")
    few, tiny = scaled(p, size), along(scaled(p, size), velocity, steps)
    for n, (name, design) in enumerate(FILTERS.items()):
        stats = experiment.statistics(polar(few, tiny), design(few, tiny), steps=steps, stream=9)
        agreement(r, text("true sensor, small noise, {name}", name=name), stats, size**2 * P[min(n, 1)], consistent=False)


def compared(r, experiment, shown, steps):
    """Errors of the three filters, trajectory by trajectory."""
    rows, ratios, half = [], [], slice(steps // 2, None)
    for name, (stats, P, scores) in shown.items():
        for j, state in enumerate(LETTERS):
            means = [np.mean(each.rms[half, j] ** 2) for each in stats[:2]]
            believed = [np.mean(each[half, j, j]) for each in P]
            rows.append((name, f"{state}, {UNITS[j]}", *(rms(each, state=j) for each in stats), math.sqrt(P[1][-1, j, j])))
            ratios.append((name, state, means[0] / means[1], believed[0] / believed[1], *(round(float(score[j]), 1) for score in scores)))
    r.table("true_sensor", ["trajectory", "state", "RMS, variant 1", "RMS, variant 2", "RMS, extended", "σ of linear theory, variant 2"], rows,
            "Actual errors with the true sensor at the last measurement, {runs} runs on the same data.", runs=experiment.runs)
    r.table("true_ratios", ["trajectory", "state", "ratio 1 / 2", "in linear theory", "1 against 2", "2 against extended"], ratios,
            "The filters compared: ratio of the mean squares of variants 1 and 2 over the second half of the record, and how clearly two mean squares differ at the last measurement, run by run, in standard errors (positive: the first is larger).")
    name, (stats, P, _scores) = list(shown.items())[-1]
    i = np.arange(1, steps + 1)
    first, second = (np.sqrt(each[1:, 0, 0] + each[1:, 2, 2]) for each in P)
    position = {name: np.sqrt(each.rms[1:, 0] ** 2 + each.rms[1:, 2] ** 2) / second for name, each in zip(FILTERS, stats, strict=True)}
    r.figure("crossing", plots.lines(i, position, xlabel=STEP, ylabel="RMS error of the position, relative", steps=True, marker=".",
                                     straight={"linear theory of variants 1 and 2": (i, first / second), "_": (i, second / second)}),
             "Crossing trajectory with the true sensor: RMS error of the position of the three filters, over what the linear theory says of variant 2. Dashed: the linear theory, 1 for variant 2.")
    r.says("{tab:true_sensor} and {tab:true_ratios} have the errors on all trajectories, {fig:crossing} those of the position on the crossing one. As far as the first order is good, variant 2 and the extended filter follow the dashed line at 1, and variant 1 the upper one. All three deviate from theory together, for they see the same data. Where the first order is not good, the curves leave the theory.")
    r.table("nees", ["trajectory", *FILTERS], [(name, *(Uncertain(float(each.nees[-1]), math.sqrt(8 / each.runs)) for each in stats)) for name, (stats, _P, _scores) in shown.items()],
            "NEES at the last measurement, with the error that the average has for a consistent filter, whose NEES is 4.")


def judged(r, shown):
    """What the true sensor says of variant 2: where it is clearly better and clearly worse, and its NEES."""
    better, worse = ({name: [LETTERS[j] for j in np.flatnonzero(sign * scores[0] > CLEAR)] for name, (_s, _P, scores) in shown.items()} for sign in (1, -1))
    lines = []
    for name in shown:
        first = "{name}: variant 2 is clearly better in {better}" if better[name] else "{name}: variant 2 is clearly better in no state"
        lines.append(text(first, "; clearly worse in {worse}." if worse[name] else ".", name=name, better=", ".join(better[name]), worse=", ".join(worse[name])))
    r.says("Two mean squares count as clearly different if they are more than {count:2} standard errors apart. By this rule, for variant 2 beside variant 1,", count=CLEAR)
    r.items(lines)
    nees = [[float(each.nees[-1]) for each in stats] for stats, _P, _scores in shown.values()]
    scores = np.array([scores[1] for _s, _P, scores in shown.values()])
    r.says("{tab:nees} tells whether a filter can be believed. A NEES far above 4 means errors that are larger than P says.")
    return {"better": any(better.values()), "worse": any(worse.values()), "nees": np.array(nees).max(axis=0),
            "extended": bool((scores > CLEAR).any()), "not_extended": bool((scores < -CLEAR).any())}
