"""Lab 13 in words: why sampling costs what it does, the result, the answers to the sheet, and what it comes to."""

import math

from ctlabs.tasks._task13_coefficients import constants

from ctlabs.labs.portrait import largest
from ctlabs.reporting.report import SOLVER
from ctlabs.text import text


def explanation(r, p, answer):
    """Why sampling costs what it does."""
    prior, posterior, limit = (
        answer[f"altitude_variance_{name}"] for name in ("prior_steady", "posterior_steady", "steady_continuous")
    )
    if not limit:
        r.says("**Explanation.** Without noise in the command both filters learn the flight exactly, and the period makes no difference to the limit.")
        return
    found = [
        r.values[f"altitude_variance_{name}"].value
        for name in ("prior_steady", "posterior_steady", "steady_continuous")
    ]
    cost = 100 * (0.5 * (found[0] + found[1]) / found[2] - 1)
    r.value("sampling_cost", cost, "%")
    r.check("cost of sampling", cost, 100 * (0.5 * (prior + posterior) / limit - 1),
            ("Riccati equations", "spectral factorisation"), SOLVER, scale=100.0)
    r.says("**Explanation.** The steady filter has {constants}, the period is {dt} s. {words} Over a period the variance swings between {posterior} and {prior} m², and the mean of the two, {mean} m², is {cost:2} % above the continuous limit {limit} m². What the sampled filter loses is only what the altitude does between two measurements; the information of the measurements is the same, for $R_d\\,\\Delta t = N_m$.",
           constants=constants(answer), dt=p.dt, posterior=posterior, prior=prior, mean=0.5 * (prior + posterior),
           cost=cost, limit=limit, words=slowness(p, answer))


def slowness(p, answer):
    """Whether the filter is slow beside the period."""
    shortest = min(1 / math.hypot(*pole) for pole in answer["filter_poles_continuous"])
    if p.dt <= 0.2 * shortest:
        return text("It averages over some {n} measurements, so it matters little when exactly they come.",
                    n=round(shortest / p.dt))
    if p.dt <= shortest:
        return "It averages over a few measurements only, and sampling is felt."
    return "The period is longer than the filter's memory: each measurement stands almost alone, and sampling is felt strongly."


def conclusions(r, p, answer):
    """What the numbers say."""
    limit, lines = answer["altitude_variance_steady_continuous"], []
    if limit:
        lines.append(text("The continuous filter estimates the altitude with a variance that tends to {P:4} m² (σ = {sd:3} m) and the gain {K:3} 1/s; it has {constants}.",
                          P=limit, sd=math.sqrt(limit), K=answer["altitude_gain_steady_continuous"], constants=constants(answer)))
    else:
        lines.append("Without noise in the command the variance of the altitude tends to 0, like that of the command: in the end the model alone tells the altitude.")
    lines.append("The gains cannot be had from an algebraic Riccati equation of the three states, since nothing drives the constant command; they are integrated from $P_0$.")
    if p.var_hc0:
        lines.append(text("The variance of the commanded constant falls like $(N_c + N_m)/(t - t^*)$ with $t^* = {origin:3}$ s: σ = {sd:3} m at 300 s. Its gain $K_3$ tends to 0.",
                          origin=answer["command_time_origin"], sd=math.sqrt(answer["command_variance_continuous"][3])))
    else:
        lines.append("The command is known from the start, and only the noise of the command and of the measurements counts.")
    above = r.values["altitude_excess_300s"].value
    if above is not None and abs(above) > 1:
        lines.append(text("At 300 s the variance of the altitude differs from its limit by {above:2} %: the filter has not settled by the 1 % criterion.",
                          above=above))
    elif above is not None:
        lines.append(text("At 300 s the variance of the altitude is within 1 % of its limit ({above:2} %).", above=above))
    if limit:
        cost = r.values["sampling_cost"].value
        word = "nearly as good as" if cost < 5 else "worse than"
        lines.append(text("Measurements every {dt} s are {word} continuous ones: the variance swings between {posterior:4} and {prior:4} m², on average {cost:2} % above the continuous limit.",
                          dt=p.dt, word=word, posterior=answer["altitude_variance_posterior_steady"], prior=answer["altitude_variance_prior_steady"], cost=cost))
    lines.append(largest(r))
    r.items(lines)


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    limit = answer["altitude_variance_steady_continuous"]
    if not limit:
        return [
            "Without noise in the command the altitude becomes known from the model alone: its variance tends to 0 in both filters.",
            text("{fig:variances} shows how, as the one unknown constant is averaged out." if p.var_hc0 else "{fig:gains} shows gains that are 0 throughout."),
            text("In the experiment the RMS error of the altitude at the end was {measured}, where theory has {sd:3} m.", measured=measured, sd=sd),
        ]
    mean = 0.5 * (answer["altitude_variance_prior_steady"] + answer["altitude_variance_posterior_steady"])
    return [
        text("The variance of the altitude tends to {P:4} m² with continuous measurements, and the average over a period of {dt} s is {cost:2} % above it with sampled ones: ", P=limit, dt=p.dt, cost=100 * (mean / limit - 1))
        + text("sampling costs next to nothing." if mean / limit < 1.05 else "sampling is felt."),
        text("The gains cannot be the constant ones of a Riccati equation, for nothing drives the commanded constant: its variance falls for ever, in inverse proportion to time ({fig:variances})." if p.var_hc0
             else "The command is known from the start, and {fig:variances} shows the variance of the altitude rise to its limit."),
        text("At the end of the experiment the RMS error of the altitude was {measured} with sampled measurements, where theory has {sd:3} m.", measured=measured, sd=sd),
    ]


def discussion(r):
    """What the experiment adds to the theory."""
    r.says("**Theory and experiment.** Both ensembles agree with their covariances in the tests of {app:chance}. The points of {fig:ensemble} are correlated in time, over about the time constants of the filter for the altitude and over the whole run for the command: a mean error that lies on one side stays there for a while, and a row of points outside a band of 95 % is one event and no contradiction.")
    r.says("**Two readings of the data.** With the printed squares the aircraft may fly far higher than any aircraft can, or below the ground, of which a linear model knows nothing. What the lab asks about is the same in both readings, since after the first seconds the gains depend on $N_c/N_m$ alone. Only before that do they depend on the variance of the command: if it is large, the first measurement is taken over as it is.")
    r.says("**What the model leaves out.** The command is a constant that nothing drives, so that the filter becomes ever surer of it and $K_3 \\to 0$. Should the pilot change the command at a late time, the filter would follow only slowly; a small strength of noise in $\\dot{h}_{c0}$ keeps $K_3$ positive, gives the three-state Riccati equation its stabilising solution, and costs little accuracy.")


def answers():
    """Each item of the sheet in a sentence."""
    return {
        "a": "The estimate obeys the three equations that begin with {eq:estimate}; their gains are $P_{1i}(t)/N_m$, found beforehand by integrating the six equations that begin with {eq:riccati} from $P_0$. The limits are those of {eq:limit}.",
        "b": "The estimate is predicted by {eq:prediction} and updated by {eq:update}; its gains come from {eq:recursion}, from the same $P_0$, with $R_d = N_m/\\Delta t$.",
        "c": "The continuous variance runs between the teeth of the sampled one ({tab:compare}), the gains are nearly the same ({fig:gains}), and so are the estimates ({fig:flights}): the filters differ by what the altitude does within a period.",
    }
