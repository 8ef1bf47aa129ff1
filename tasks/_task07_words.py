"""Lab 7 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    gain, ratio = answer["gain_steady"], answer["suboptimal_variance_ratio"]
    if ratio is None:
        cost = text("a constant gain of {K} does not hold the system at all.", K=p.K_star)
    elif gain:
        cost = text("a constant gain of {K} costs {factor:4} times that variance, and every other choice costs more than $\\bar K$.", K=p.K_star, factor=ratio / gain)
    else:
        cost = text("a constant gain of {K} keeps a variance of {variance:4} m², where that of the optimal gain vanishes.", K=p.K_star, variance=ratio * p.R)
    return [
        text("The best constant gain is the limit of the optimal filter's, and it is the least ratio $\\bar P/R$ as well: $\\bar K = {gain:4}$ for the given numbers.", gain=gain),
        text("{fig:family} shows why this is the minimum; ") + cost,
        text("In the experiment the RMS error was {measured}, where theory has {sd:4} m.", measured=measured, sd=sd),
    ]


def conclusions(r, p, answer):
    """What the numbers say."""
    gain, ratio, lines = answer["gain_steady"], answer["suboptimal_variance_ratio"], []
    if p.P0 == 0 and p.Q == 0:
        lines.append("The state is known from the start and stays known: the gain is 0 and measurements change nothing.")
    elif gain:
        lines.append(text(
            "The gain tends to {gain}: a measurement lowers the error variance from {prior} to {posterior} m², and the next prediction brings it back. After an update it is the fraction {gain} of the measurement's own variance R.",
            gain=gain, prior=answer["prior_variance_steady"], posterior=answer["posterior_variance_steady"]))
    else:
        lines.append("The gain tends to 0 and with it the error variance: without process noise, and with |Φ| ≤ 1, the state becomes known exactly and later measurements are hardly used.")
    if ratio is None:
        lines.append(text("The constant gain {gain} does not hold the unstable system: its error grows by the factor {growth} each step. The optimal gain, {best}, does.",
                          gain=p.K_star, growth=abs((1 - p.K_star) * p.Phi), best=gain))
    elif gain and ratio <= gain * (1 + 1e-6):
        lines.append(text("The constant gain {gain} is the optimal one.", gain=p.K_star))
    elif gain:
        lines.append(text("The constant gain {gain} costs {factor} times the optimal error variance.", gain=p.K_star,
                          factor=ratio / gain))
    else:
        lines.append(text("The constant gain {gain} holds the error variance at {variance} m², where the optimal filter's tends to 0.",
                          gain=p.K_star, variance=ratio * p.R))
    if answer["noiseless_limit"]:
        lines.append(text("Without process noise the error variance would still not fall below {limit} m²: an unstable state cannot be known better, however long one measures.",
                          limit=answer["noiseless_limit"]))
    else:
        how = "at the first step" if p.Phi == 0 else "like R/i" if abs(p.Phi) == 1 else "geometrically"
        lines.append(text("Without process noise the state would become known exactly, {how}.", how=how))
    settled = r.values["settling_step"].value
    if settled is not None:
        lines.append(text("The filter settles (its variance stays within 1 % of the limit) at measurement {settled}.",
                          settled=settled))
    lines.append(largest(r))
    r.items(lines)


def discussion(r, p, answer):
    """What the experiment adds to the theory."""
    r.says("**Theory and experiment.** All tests of {app:chance} compare a sample with its exact distribution. That {fig:ensemble} has points outside the band is expected: of {n} instants about {out:1} lie outside the band of 95 %, and since the errors of successive instants share a factor of $(1-\\bar K)\\Phi = {pole:3}$ they come in groups.",
           n=40, out=2, pole=(1 - answer["gain_steady"]) * p.Phi)
    r.says("**Why a wrong gain is cheap near the best one.** At the minimum of {fig:family} the slope is zero, so an error δ in the gain costs in proportion to δ². The price is paid on the sides: a gain that is too small forgets too slowly, and for $|\\Phi| > 1$ below $1 - 1/|\\Phi|$ not at all.")
    r.says("**What the model cannot do.** $\\bar K$ depends on Q and R through their ratio alone. If both are wrong by one factor the estimates are the same, but the variance that the filter claims is wrong by that factor: only the innovations tell.")


def answers(answer):
    """Each item of the sheet in a sentence."""
    ratio = answer["suboptimal_variance_ratio"]
    return {
        "a": "{eq:prediction} and {eq:update}.",
        "b": "Proved: $P(t_i^-) \\ge Q$, $0 \\le P(t_i^+) \\le R$, $0 \\le K \\le 1$; {eq:constant} holds where $|(1-K_*)\\Phi| < 1$." if ratio is not None
             else "Proved: $P(t_i^-) \\ge Q$, $0 \\le P(t_i^+) \\le R$, $0 \\le K \\le 1$; {eq:constant} needs $|(1-K_*)\\Phi| < 1$, which the given gain does not fulfil.",
        "c": "The root {eq:best} of the numerator of {eq:derivative}, a minimum, and equal to the optimal filter's limit.",
        "d": "{fig:family}, {tab:family}: the minima lie at $K_* = \\bar K$, on the line $\\bar P/R = K_*$.",
        "e": "For $|\\Phi| \\le 1$ the state is found exactly in the end (like $R/i$ at $|\\Phi| = 1$); for $|\\Phi| > 1$ up to a variance $(\\Phi^2-1)R/\\Phi^2$.",
        "f": "{fig:table3} and {tab:table3}.",
        "g": "{fig:errors} and {fig:ensemble}: the ensemble agrees with the variances of (f) in all tests.",
    }
