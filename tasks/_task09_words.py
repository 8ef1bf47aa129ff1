"""Lab 9 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.experiment import covariances
from ctlabs.labs.portrait import largest
from ctlabs.text import text


def variances(filters, steps):
    """Error variance of U1 without measurements, and of both filters before and after the last one."""
    last = {name: covariances(model, steps) for name, model in filters.items()}
    return last["unmeasured"].P_plus[-1, 0, 0], {name: (last[name].P_minus[-1, 0, 0], last[name].P_plus[-1, 0, 0]) for name in ("perfect", "noisy")}


def result(p, filters, missed):
    """The lab in three sentences."""
    unmeasured, last = variances(filters, p.steps)
    return [
        text("After the last of {n} measurements the error variance of $\\hat U_1$ is {perfect:3} b² with a perfect voltmeter and {noisy:3} b² with the noisy one, where without measurements it would be {unmeasured:3} b².",
             n=p.steps, perfect=last["perfect"][1], noisy=last["noisy"][1], unmeasured=unmeasured),
        text("{fig:variance} shows that even the perfect measurement does not last: the unknown input raises the variance from {after:3} to {before:3} b² until the next one.",
             after=last["perfect"][1], before=last["perfect"][0]),
        text("An alarm with a margin of three standard deviations leaves the voltage dangerous and unannounced in at most one moment in 740, but of the dangerous moments themselves it misses up to {share:2} % ({fig:alarm}).",
             share=100 * float(missed[:, :, -1].max())),
    ]


def discussion(r, p, filters):
    """What the experiment adds to the theory."""
    r.says("**What a measurement of $U_0$ tells of $U_1$.** $U_0$ is a mean of $U_1$ over the past, with weights that decay with the time constant $R_2C_2$. The input enters $U_1$ at once and $U_0$ only through $U_1$: what came in just before a measurement is in $U_1$ in full, and in $U_0$ hardly at all. This is why even a perfect voltmeter leaves a variance.")
    if 0 < p.R_over_b2 < math.inf:
        P = covariances(filters["noisy"], p.steps).P_minus[-1]
        S = P[1, 1]
        r.says("**What the noise costs.** At the last measurement $U_0$ is predicted with the variance {S:3} b² and $U_1$ with {P:3} b². The variance of the voltmeter, {R} b², is to be compared with the first of these and not with the second: $U_0$ itself is corrected with the gain {K:2}. The second section of the circuit smooths the signal before the noise is added, and not the noise.",
               S=S, P=P[0, 0], R=p.R_over_b2, K=S / (S + p.R_over_b2))
    r.says("**The promise of a margin.** A margin bounds the probability that two things happen together, danger and silence. Whoever owns the capacitor asks another question: if the voltage is dangerous, will I be told? The rarer the danger, the further apart the two answers are; at the limit of three standard deviations the voltage is dangerous in one moment in 740, which is the whole of what the margin of three allows to be missed.")
    r.says("**Points outside the bands.** Of the points in {fig:noisy_ensemble} one in twenty is expected outside. They come in groups, for part of an error survives a period and is found again at the next instant. {app:chance} takes the correlation into account.")


def answers(p):
    """Each item of the sheet in a sentence."""
    if p.R_over_b2 == 0:
        b = "With $R = 0$, as given here, the answer is that of (a)."
    elif math.isinf(p.R_over_b2):
        b = "$R = \\infty$ is given: the gain is 0, the estimate stays 0, and the variance is that without measurements."
    else:
        b = "The estimate is {eq:noisy}; its variances are in {tab:variance}, and their plot is the curve (b) of {fig:variance}."
    return {
        "a": "The estimate is {eq:estimate}, its variance {eq:fraction}; the plot is the curve (a) of {fig:variance}. $P^+$ has rank 1.",
        "b": b,
    }


def conclusions(r, p, filters, missed, price):
    """What the numbers say."""
    open_, last = variances(filters, p.steps)
    (before, perfect), (_before, noisy) = last["perfect"], last["noisy"]
    lines = [text("At t = {t} s the variance of $U_1$ is {open:3} b² without measurements; perfect measurements of $U_0$ leave {percent:3} % of it.",
                  t=p.steps * p.dt, open=open_, percent=100 * perfect / open_)]
    if p.R_over_b2 == 0:
        lines.append("The measurements of part (b) are given without noise, so it is part (a) again.")
    elif math.isinf(p.R_over_b2):
        lines.append("In part (b) nothing is measured: its variance is that without measurements.")
    else:
        lines.append(text("Noise of variance {R} b² leaves {percent:3} % of it, {factor:3} times as much.", R=p.R_over_b2, percent=100 * noisy / open_, factor=noisy / perfect))
    if before >= noisy:
        lines.append(text("However exact the voltmeter, the variance returns from {after:3} to {before:3} b² before the next measurement, above what the noisy voltmeter leaves after one: the margin of an alarm is set by the period, {dt} s, more than by the voltmeter.", after=perfect, before=before, dt=p.dt))
    elif not math.isinf(p.R_over_b2):
        lines.append(text("The noise of the voltmeter costs more than the wait between measurements: between two perfect ones the variance rises from {after:3} to {before:3} b² only.", after=perfect, before=before))
    lines.append(text("A margin of three standard deviations bounds the share of all moments that are dangerous and unannounced, one in 740. Of the dangerous moments themselves part (a) misses up to {a:2} % and part (b) up to {b:2} %: an estimate is drawn towards 0 just where the voltage is large. To miss 1 % at a limit of two standard deviations the alarm of part (a) must be on in {on_a:2} % of the time, that of part (b) in {on_b:2} % ({tab:thresholds}).",
                      on_a=100 * price["(a)"], on_b=100 * price["(b)"], a=100 * float(missed[0, :, -1].max()), b=100 * float(missed[1, :, -1].max())))
    lines.append(largest(r))
    r.items(lines)
