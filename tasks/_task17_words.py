"""Lab 17 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(answer, measured, sd):
    """The lab in three sentences."""
    if answer["growth_rate_x1"]:
        second = text("The two-state model that the figure suggests has a variance of its first state that grows by {rate:3} m² a second for ever, while the variance of the sum settles ({fig:two_states}).", rate=answer["growth_rate_x1"])
    else:
        second = "The two-state model that the figure suggests gives the same estimate of the sum, but its own steady state depends on where it began ({fig:two_states})."
    first = text("One state is enough: the sum of two Wiener processes is a Wiener process, and its error variance tends to {limit:4} m².", limit=answer["variance_steady_continuous"])
    return [first, second, text("In the experiment the RMS error of the discrete filter was {measured} at the end, where theory has {sd:3} m.", measured=measured, sd=sd)]


def discussion(r, answer):
    """What the experiment adds to the theory."""
    r.says("**Minimal models.** The number of states is that of the transfer function from the noises to what is measured and wanted, not that of the integrators in a figure. States beyond it are not wrong: they are combinations on which no measurement has any bearing. They cost computation, and steady solvers, which look for one limit, cannot handle them.")
    r.says("**Detectable or not.** A mode that is not seen does no harm if it decays by itself; then the model is detectable and the covariance has one limit. Here it neither decays nor is seen", ", and the noises feed it: {eq:trap} has a source with no sink." if answer["growth_rate_x1"] else ". No noise feeds it either, so what is not known of it at the start is never known.")
    r.says("**Theory and experiment.** The error after a measurement contains a part of the one before, so that points of {fig:discrete_ensemble} outside a band come in groups as long as the memory of the filter. That the one-state filter passes the tests of {app:chance} on two-state data is the experimental answer to the question of the lab.")


def answers():
    """Each item of the sheet in a sentence."""
    return {
        "a": "The system needs one state ({eq:one}); the filter is {eq:filter} and tends to that of {eq:limit}, while the two-state model has no steady covariance ({eq:trap}).",
        "b": "The filter is {eq:discrete}, its steady state {eq:steady}; {fig:discrete_ensemble} and {tab:ensemble} are the experiment.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    Q, P0, limit = p.q1 + p.q2, p.P01 + p.P02, answer["variance_steady_continuous"]
    lines = [text("One state is enough: $x_3$ is a Wiener process of strength {Q} m²/s. Which part of it came from $w_1$ and which from $w_2$ no measurement tells, and the estimate does not need it.", Q=Q)]
    if Q:
        where = "$P_0$ is the limit itself, so that P(t) is constant" if math.isclose(P0, limit, rel_tol=1e-12) else "P(t) falls to it" if P0 > limit else "P(t) rises to it"
        lines.append(text("The continuous filter tends to κ/(s + κ) with κ = {rate:4} 1/s and the variance {limit:4} m²; from $P_0 = {P0}$ m² {where}.", rate=answer["gain_steady_continuous"], limit=limit, P0=P0, where=where))
        lines.append(text("The discrete filter reaches a steady state: {prior:4} m² before and {posterior:4} m² after a measurement, within 1 % from measurement {step} on ({time} s).",
                          prior=answer["prior_variance_steady"], posterior=answer["posterior_variance_steady"], step=answer["settling_step"], time=answer["settling_step"] * p.dt))
    else:
        lines.append("Without process noise $x_3$ is a constant; the filters learn it like 1/t and have no steady state other than the gain 0." if P0 else "$x_3$ is zero from the start and stays so: the gain is 0 all the time.")
    lines.append(text("The two-state filter is not wrong: its sum agrees with the one-state filter to rounding. But its $P_{11}$ grows by {rate:3} m² per second in the end, it has no steady state, and a solver asked for one has to refuse and say why.", rate=answer["growth_rate_x1"]) if answer["growth_rate_x1"]
                 else "The two-state filter is not wrong: its sum agrees with the one-state filter to rounding. Its $P_{11}$ has a limit here, but one that depends on $P_{01}$ and $P_{02}$, and a steady solver has to refuse.")
    lines.append(largest(r))
    r.items(lines)
