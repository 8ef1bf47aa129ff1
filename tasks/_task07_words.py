"""Lab 7 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    gain, ratio = answer["gain_steady"], answer["suboptimal_variance_ratio"]
    if ratio is None:
        cost = text("{fig:family} shows why this is the minimum; a constant gain of {K} does not hold the given system at all.", K=p.K_star)
    elif gain and ratio <= gain * (1 + 1e-6):
        cost = text("{fig:family} shows why this is the minimum, at which the given constant gain {K} lies.", K=p.K_star)
    elif gain:
        cost = text("{fig:family} shows why this is the minimum: every other constant gain gives a larger variance, the gain {K} one {factor:4} times as large.", K=p.K_star, factor=ratio / gain)
    else:
        cost = text("{fig:family} shows the minima for other numbers; here a constant gain of {K} keeps a variance of {variance:4} m², where that of the optimal gain vanishes.", K=p.K_star, variance=ratio * p.R)
    return [
        text("The best constant gain is the limit of the optimal gain, $\\bar K = {gain:4}$ for the given numbers, and it is equal to the least ratio $\\bar P/R$.", gain=gain),
        cost,
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
        lines.append("The gain tends to 0 and with it the error variance: without process noise, and with |Φ| ≤ 1, the state becomes known exactly and later measurements hardly count.")
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
        lines.append("Without process noise the state would be known exactly from the first step on." if p.Phi == 0
                     else "Without process noise the state would become known exactly, the error variance falling like R/i." if abs(p.Phi) == 1
                     else "Without process noise the state would become known exactly, the error variance falling geometrically.")
    settled = r.values["settling_step"].value
    if settled is not None:
        lines.append(text("The filter settles (its variance stays within 1 % of the limit) at measurement {settled}.",
                          settled=settled))
    lines.append(largest(r))
    r.items(lines)


def discussion(r, p, answer, steps):
    """What the experiment adds to the theory."""
    r.says("**Theory and experiment.** All tests of {app:chance} compare a sample with its exact distribution. That {fig:ensemble} has points outside the band is expected: on average {out:2} of {n} instants lie outside a band of 95 %. They come in groups, since the factor $(1-\\bar K)\\Phi = {pole:3}$ of an error passes to the next instant.",
           n=steps, out=0.05 * steps, pole=(1 - answer["gain_steady"]) * p.Phi)
    r.says("**Why a wrong gain is cheap near the best one.** At the minimum of {fig:family} the slope is zero, so an error δ in the gain costs in proportion to δ². The price is paid on the sides: a gain that is too small forgets too slowly, and for $|\\Phi| > 1$ below $1 - 1/|\\Phi|$ not at all.")
    r.says("**What the model cannot do.** $\\bar K$ depends on Q and R through their ratio alone. If both are wrong by one factor the estimates are the same, but the variance that the filter claims is wrong by that factor, which only the innovations show. If R alone is too large in the filter, its gain is too small: it is a little less accurate than it could be, and yet it claims more than its true variance, so that NEES and NIS are below 1 on average.")


def answers(answer):
    """Each item of the sheet in a sentence."""
    ratio = answer["suboptimal_variance_ratio"]
    return {
        "a": "The filter predicts by {eq:prediction} and updates by {eq:update}.",
        "b": "Proved: $P(t_i^-) \\ge Q$, $0 \\le P(t_i^+) \\le R$, $0 \\le K \\le 1$; {eq:constant} holds where $|(1-K_*)\\Phi| < 1$." if ratio is not None
             else "Proved: $P(t_i^-) \\ge Q$, $0 \\le P(t_i^+) \\le R$, $0 \\le K \\le 1$; {eq:constant} needs $|(1-K_*)\\Phi| < 1$, which the given gain does not fulfil.",
        "c": "$\\bar K$ is {eq:best}, the root of the numerator of {eq:derivative} at which the variance is least; the optimal gain has the same limit.",
        "d": "The curves are those of {fig:family}; their minima lie at $K_* = \\bar K$, on the line $\\bar P/R = K_*$ ({tab:family}).",
        "e": "For $|\\Phi| \\le 1$ the state is found exactly in the end (like $R/i$ at $|\\Phi| = 1$); for $|\\Phi| > 1$ up to a variance $(\\Phi^2-1)R/\\Phi^2$.",
        "f": "The curves are in {fig:table3}, the numbers in {tab:table3}; the variances come down to their limits, or rise to them where $P_0$ is small beside Q.",
        "g": "The ensemble agrees with the variances of (f) in all tests ({fig:errors}, {fig:ensemble}, {tab:ensemble}).",
    }
