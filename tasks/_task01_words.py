"""Lab 1 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers.task01 import AFTER

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, R, measured, sd):
    """The lab in three sentences."""
    gain = answer["gain_steady"]
    if gain is None:
        first = text("As the last measurement is absent for ever, the error variance grows without limit.")
    elif gain == 0:
        first = text("Without diffusion the state is a constant: the gain tends to 0 like 1/i, and the error variance to 0 like R/i.")
    elif R == 0:
        first = text("Measurements without error make the gain 1: after each of them the state is known.")
    else:
        first = text("With $\\rho = \\sigma_w^2\\tau/R = {ratio:3}$ the gain tends to $\\bar K = {gain:4}$ and the error variance after an update to $\\bar K R = {variance:4}$ m².",
                     ratio=p.sigma_w2 * p.tau / R, gain=gain, variance=answer["posterior_variance_steady"])
    third = (text("In the experiment the RMS error was {measured} at the last measurement, where theory has {sd:4} m, and the mean error was zero within its uncertainty.", measured=measured, sd=sd)
             if measured is not None else text("The ensembles agree with theory."))
    return [first, text("The steady gain, and with it the memory of the filter, depends on the ratio of $\\sigma_w^2\\tau$ to R alone ({fig:ratio}); R sets the scale of the variances."), third]


def discussion(r, answer, R):
    """What the experiment adds to the theory."""
    r.says("**What the diffusion does.** Without it all measurements would count equally for ever. With it an old measurement tells of a state that has moved since: its weight falls by the factor $1 - \\bar K$ at each step, and the filter has a finite memory.")
    if answer["gain_steady"] and R:
        r.says("In the steady state $\\bar P^+ = R\\bar K$: the estimate is as accurate as the mean of $1/\\bar K = {memory:3}$ measurements of a constant.", memory=1 / answer["gain_steady"])
    r.says("**Bias and variance** are different things. The variance is known beforehand and does not depend on the data; the bias comes from a wrong $\\bar x_0$, is not seen in P, and is forgotten by the same factors $1 - K$ as any old error. A large $P_0$ is the cure: the first gain is then near 1.")
    r.says("**Settling** is a statement about the way from $P_0$ to the limit. It is short where the gain is large, but also where $P_0$ is near the limit by accident, and infinite where the limit is 0.")
    r.says("**Points outside the bands.** One point in twenty is expected outside. Of the error at one instant the share $1 - \\bar K$ passes to the next, so that neighbouring points tend to lie on one side; {app:chance} tests all instants at once and allows for it.")


def answers(p, answer, R):
    """Each item of the sheet in a sentence."""
    gain = answer["gain_steady"]
    return {
        "a": "The filter predicts by {eq:prediction} and updates by {eq:update}. A larger diffusion makes the estimates less accurate and the filter quicker to forget ({tab:sweep_a}); it leaves them unbiased." if p.sigma_w2
             else "The filter predicts by {eq:prediction} and updates by {eq:update}. Without diffusion it averages all measurements alike ({tab:sweep_a}).",
        "b": "A larger R makes the estimates less accurate and the gain smaller ({tab:sweep_b}); the variance may change from one measurement to the next ({fig:varying})." if R or isinstance(p.R, tuple)
             else "Without errors of measurement the gain is 1, and each estimate is the last measurement ({tab:sweep_b}).",
        "c": "By {eq:steady} gain, relative accuracy and memory depend on $\\rho = \\sigma_w^2\\tau/R$ alone ({fig:ratio}).",
        "d": "A missing measurement leaves the prediction as it is, a perfect one makes the error zero; the deviation from the limit then shrinks by $(1-\\bar K)^2$ at each measurement ({fig:anomaly})." if gain
             else "There is no steady state in which an anomaly could change anything here.",
    }


def conclusions(r, p, answer, R):
    """What the numbers say."""
    lines = []
    gain = answer["gain_steady"]
    if gain is None:
        lines.append("The last measurement is absent for ever: the error variance grows without limit, like the Brownian motion.")
    elif gain == 0:
        lines.append("Without diffusion the state is a constant: the gain tends to 0 like 1/i and every measurement counts equally. The error variance tends to 0 and never settles.")
    elif R == 0:
        lines.append("Measurements without error make the gain 1: the estimate is the last measurement, its error zero until the next increment of the Brownian motion.")
    else:
        lines.append(text("At ρ = {ratio:3} the gain is {gain:4}. A larger diffusion or a smaller R raises it: the filter forgets faster, and its error variance is a larger share of R.",
                          ratio=p.sigma_w2 * p.tau / R, gain=gain))
        lines.append(text("A missing measurement raises the variance from {limit:4} to {missing:4} m², a perfect one lowers it to 0; {steps} measurements later they are at {later:4} and {perfect:4} m².",
                          limit=answer["posterior_variance_steady"], missing=answer["posterior_variance_missing"][0], steps=AFTER,
                          later=answer["posterior_variance_missing"][-1], perfect=answer["posterior_variance_perfect"][-1]))
    if gain and R:
        lines.append("Only the ratio $\\sigma_w^2\\tau/R$ shapes the filter; the scale of the variances is R.")
    lines.append("A filter that starts at the right mean is unbiased at every instant; the bias of a wrong one is forgotten by the factors $1 - K$, and P does not show it.")
    lines.append(largest(r))
    r.items(lines)
