"""Labs 3 and 4 in words: their result, what it means, the answers to the sheet, and what it comes to."""

import math

import numpy as np
from ctlabs.tasks._kinematics_model import CURVE, QUANTITY, definition, growth, length, listed

from ctlabs.labs.portrait import largest, rms
from ctlabs.text import number, text


def deviations(lab):
    """Steady standard deviations after an update, with their units."""
    return listed(f"{math.sqrt(v):.3g} {u}" for v, u in zip(np.diag(lab.limit.P_plus), lab.system.units, strict=True))


def result(lab, stats, steps):
    """The lab in three sentences."""
    n, p = lab.n, lab.p
    states = "position and velocity" if n == 2 else "position, velocity and acceleration"
    measured = text("In the experiment the RMS error of x was {measured} at the last of {steps} measurements, still on the way to its limit, and all ensembles agree with theory." if lab.settled is not None and lab.settled > steps
                    else "In the experiment the RMS error of x was {measured} at the last of {steps} measurements, and all ensembles agree with theory.", measured=rms(stats, unit="m"), steps=steps)
    if not p.sigma_w2:
        return [text("Without disturbance the {quantity} is a constant, and the errors of all estimates tend to 0.", quantity=QUANTITY[n]),
                text("The gain tends to 0 with them, as each new measurement has less to add."), measured]
    return [text("The errors of {states} settle at the standard deviations {sd} after an update, although the variance of the coordinate itself grows like {growth}.", states=states, sd=deviations(lab), growth=growth(n)),
            text("{fig:bounded} shows both; in units of the period the gains of the steady filter depend on the ratio {ratio} alone ({fig:gains}).", ratio=f"${definition(n)}$"), measured]


def discussion(r, lab):
    """What the experiment adds to the theory."""
    n, p = lab.n, lab.p
    r.says("**Why the errors are bounded.** {n} measurements in a row determine the state but for their errors and for the noise that came between them. What came before does not matter to such an estimate, so its error cannot grow; the optimal one is at least as good.", n={2: "Two", 3: "Three"}[n])
    if p.sigma_w2 and p.R:
        r.says("**What ρ is.** In one period the noise moves the coordinate by the standard deviation {sd}, the state at its beginning being known; ρ is the square of that over R, but for a numerical factor. Where ρ is small the measurements are too coarse to see the noise of one period, and the filter has to average; where ρ is large each measurement shows it.", sd={2: r"$\sqrt{\sigma_w^2\tau^3/3}$", 3: r"$\sqrt{\sigma_w^2\tau^5/20}$"}[n])
        slow = float(np.abs(lab.limit.poles).max())
        r.says("**How long it takes.** Near the limit an error shrinks by the factor {slow:3} with each measurement, a deviation of the variances by the square of that. The settling step depends on $P_0$ as well, and so it is no property of the filter alone.", slow=slow)
    if lab.settled is not None and lab.settled > length(lab.settled):
        r.says("**Slow settling.** The {settled} measurements that this filter takes to settle are more than the {steps} of a run: the figures show the way to the limits and not the limits, which are those of {tab:limits}. A variance that moves little over a run is not yet at its limit.", settled=lab.settled, steps=length(lab.settled))
    r.says("**Points outside the bands.** One point in twenty is expected outside the bands of {fig:ensemble}. The errors of neighbouring instants are correlated, so that such points come in groups; {app:chance} tests them together and allows for it.")


def answers(lab):
    """Each item of the sheet in a sentence."""
    p, n = lab.p, lab.n
    return {
        "a": "The matrices are those of {part:a}; the noises of a period are written as $G_d\\bar w_d$ with a unit lower triangular $G_d$.",
        "b": "$\\bar G_d$ is the Cholesky factor of $Q_d$; the units are in {tab:units}.",
        "c": text("The solution is written out in {part:c}. By {eq:growth} the variances grow without bound, that of x like {growth} ({fig:open_loop}).", growth=growth(n)) if p.sigma_w2 else "The solution is written out in {part:c}; without disturbance the variances of {eq:growth} are 0.",
        "d": text("The motion is a Wiener process in the {quantity}; what is estimated is the current state and not the constant. The error variances are bounded ({fig:bounded}), their limits and the times to reach them are in {tab:limits}, the influence of the factors in {tab:factors}.", quantity=QUANTITY[n]) if p.sigma_w2
             else text("Without disturbance the coordinate is {curve}; all error variances tend to 0 ({tab:factors}).", curve=CURVE[n]),
    }


def conclusions(r, lab):
    """What the numbers say."""
    p, n, lines = lab.p, lab.n, []
    words = {"quantity": QUANTITY[n]}
    if p.sigma_w2:
        lines.append(text("The point's {quantity} wanders about its random start as a Wiener process; the variance of the coordinate grows like {growth} and has no bound.", growth=growth(n), **words))
        lines.append(text("The errors of the estimates are bounded, because {n} measurements in a row already determine the state. Their standard deviations tend to {sd} after an update.", n=n, sd=deviations(lab)))
        lines.append(regime(lab))
        if lab.settled is not None:
            lines.append(text("From the given $P_0$ all variances stay within 1 % of their limits from measurement {settled} on, that is, after {time} s.", settled=lab.settled, time=lab.settled * p.tau))
        else:
            lines.append("The variances need more than 100 000 measurements to come within 1 % of their limits.")
        lines.append("$P_0$ decides how the limit is approached and not the limit; $\\sigma_w^2$, R and τ act on the shape of the filter through ρ alone. A correct initial mean does not enter the errors.")
    else:
        lines.append(noiseless(lab))
    kept, steps = r.values["constant_variance"].value, length(lab.settled)
    if p.sigma_w2 and p.P0[-1][-1]:
        lines.append(text("What is estimated is the current {quantity} and not its constant part c, of whose initial variance {share:3} % is left after {steps} measurements.", **words, share=100 * kept / p.P0[-1][-1], steps=steps))
    lines.append(largest(r))
    r.items(lines)


def noiseless(lab):
    """What happens for σ_w² = 0."""
    p, words = lab.p, {"quantity": QUANTITY[lab.n], "curve": CURVE[lab.n]}
    if not np.any(p.P0):
        return "Nothing is random and everything is known from the start: the gain is 0 and measurements change nothing."
    if p.R == 0:
        return text("Without noise the {quantity} is a constant and the coordinate {curve}: with measurements free of error everything is known from measurement {settled} on.", settled=lab.settled, **words)
    found = text("Without noise the {quantity} is a constant and the coordinate {curve}. The error variances and the gain tend to 0 like powers of 1/i, and nothing settles within a fraction of its limit.", **words)
    if np.linalg.matrix_rank(p.P0) == lab.n:
        found += text(" The variance of x goes like {factor}R/i: that of the end of {curve} fitted to i points.", factor=lab.n**2, **words)
    return found


def regime(lab):
    """How the filter works at this ρ."""
    first = float(lab.limit.K[0, 0])
    if lab.p.R == 0:
        return text("The position is measured without error; only what is not measured has to be estimated, from the last few measurements. The scaled gains are those for ρ = ∞, {gain}.", gain=number(list(lab.limit.K[:, 0] * lab.p.tau ** np.arange(lab.n))))
    if first > 0.9:
        found = "At ρ = {ratio:3} a measurement weighs {gain:3}: the disturbance between two measurements exceeds their errors, and the filter follows the last few of them."
    elif first > 0.5:
        found = "At ρ = {ratio:3} a measurement of the position weighs {gain:3}, more than its prediction, whose variance is {excess:3} times R; in balance they would weigh ½ each."
    else:
        found = "At ρ = {ratio:3} a measurement weighs {gain:3}, less than its prediction: the filter averages over measurements, and the position is known {better:3} times better than one measurement tells it."
    return text(found, ratio=lab.ratio, gain=first, better=1 / math.sqrt(first), excess=float(lab.limit.P_minus[0, 0]) / lab.p.R)
