"""Lab 18 in words: its result, what it means, the answers to the sheet, and what it comes to."""

import math

from ctlabs.tasks import _task18_scales as scales
from ctlabs.tasks._task18_scales import STATES
from ctlabs.tasks.answers.task18 import SETS

from ctlabs.labs.portrait import largest
from ctlabs.text import prose, text


def result(p, schedules, ranks, measured, sd):
    """The lab in three sentences."""
    if ranks["theta"] == 4:
        first = "The angle is the better single measurement: it observes the whole state, where the range never finds a constant angle, however accurate it is."
    else:
        first = text("At this period between samples the angle observes {one} of four directions and the range {two}: the period is a bad one, and the angle is still the better single measurement.",
                     one=ranks["theta"], two=ranks["range"])
    ends = [schedules[name].sd_plus[p.steps, 2] * 1e6 for name in SETS]
    return [
        first,
        text("{fig:sd} shows the standard deviations: that of the angle ends at {theta:3} µrad with the angle only, {range:3} µrad with the range only, and {both:3} µrad with both.", theta=ends[0], range=ends[1], both=ends[2]),
        text("On a linear truth the RMS error of the range with both measurements was {measured}, where theory has {sd:3} m.", measured=measured, sd=sd),
    ]


def discussion(r, found):
    """What the experiment adds to the theory."""
    r.says("**Theory and experiment.** On the linear truth the ensembles of the three sets pass all tests of {app:chance}; the run of points outside a band in {fig:ensemble} is expected, for without process noise an error is carried on from one instant to the next.")
    if found:
        r.says("**What linearisation costs.** The equations are linear for deviations that are small beside the errors of the filter, not only beside the orbit: a quadratic term of the size $\\rho^2r_0$ is nothing on a map of the orbit and may be large beside σ. That is why a linear filter about the nominal orbit may be inconsistent ({fig:nees}) although {fig:orbit} shows two motions that hardly differ.")
    r.says("**Why no noise is a warning.** With $Q = 0$ the filter falls asleep: its variances tend to 0, and any force that the model leaves out (drag, the shape of the Earth) will then lead it astray. In use a small $Q$ keeps it awake.")
    r.says("**Why the range cannot find the angle.** The field is central, so a turn of the whole motion is again a motion with the same ranges. No accuracy and no number of measurements helps: observability is a property of what is measured, not of how well.")


def answers(ranks):
    """Each item of the sheet in a sentence."""
    return {
        "a": "The matrices are those of {eq:any}; along a general trajectory the model varies with time.",
        "b": "The model is {eq:circle}, with the transition matrix of {eq:transition}; no noise drives the state.",
        "c": text("By the criterion of observability the angle: ranks {one} with the angle, {two} with the range, {three} with both ({tab:ranks}). Both together ", one=ranks["theta"], two=ranks["range"], three=ranks["both"])
        + text("observe more than either." if ranks["both"] > max(ranks["theta"], ranks["range"]) else "observe no more than the angle, but make the estimates more accurate ({tab:variances})."),
        "d": "On the linear truth the errors are those of theory ({fig:errors}, {fig:ensemble}, {tab:variances}), and the angle is found only where it is measured.",
    }


def conclusions(r, p, answer, schedules, ranks, found):
    """What the numbers say."""
    sd = {name: schedules[name].sd_plus[p.steps] for name in SETS}
    better = [state for i, state in enumerate(STATES) if sd["theta"][i] < sd["range"][i]]
    worse = [state for i, state in enumerate(STATES) if sd["theta"][i] > sd["range"][i]]
    all_seen = ranks["theta"] == 4
    lines = [
        "The angle alone observes the whole state; the range alone leaves a constant angle unobserved for ever. So the angle is the better single measurement." if all_seen else
        "Continuously the angle alone would observe the whole state, the range alone all but a constant angle. At this sampling period even the angle loses a part, and the range loses more: the angle is the better single measurement, but the period is a bad one.",
        text("In numbers, after {n} measurements: {better}; {worse}.", n=p.steps,
             better=text("the angle alone is more accurate in {states}", states=", ".join(better)) if better else "the angle alone is more accurate in no state",
             worse=text("the range alone in {states}", states=", ".join(worse)) if worse else "the range alone in none"),
    ]
    ratios = [min(sd["theta"][i], sd["range"][i]) / sd["both"][i] if sd["both"][i] else 1.0 for i in range(4)]
    lines.append(text("Both together add no new direction to what the angle observes" if ranks["both"] == ranks["theta"] else "At this period both together observe {rank} directions, more than either", ", and they are more accurate: σ of the four states is smaller than that of the better single measurement by the factors {ratios}." if max(ratios) > 1.0005 else "; nor are they more accurate by anything worth mentioning.",
                      rank=ranks["both"], ratios=prose(ratios, 3)))
    lines.append(text("There is no process noise, so the variances of all that is observed tend to 0 and with them the gains; with the range only the gain of the angle tends to {limit:3} rad/m instead, and its variance grows without bound.", limit=answer["gain_limit"]) if all_seen and scales.regular(p) else
                 "There is no process noise: what is observed becomes known better and better; what is not observed does not.")
    if found:
        bound = 4 * (1 + 6 * math.sqrt(0.5 / found["both"][0].runs))
        words = {"theta": "the angle", "range": "the range", "both": "both measurements"}
        for j, label in enumerate(("linear", "extended")):
            ends = {name: found[name][j].nees[-1] / max(found[name][j].nees_dof[-1], 1) * 4 for name in SETS}
            wrong = [words[name] for name in SETS if ends[name] > bound]
            lines.append(text("On the nonlinear truth the NEES of the {label} filter ends at {ends} with the angle, the range, and both (4 is consistent): ",
                              "its variances are right." if not wrong else
                              "its variances are too small with {sets}, for it linearises about an orbit that is not the satellite's." if j == 0 else
                              "its variances are too small with {sets}, where its first estimates are too far from the truth to linearise about.",
                              sets=" and ".join(wrong) if len(wrong) < 3 else "each of the three sets", label=label, ends=prose(list(ends.values()), 3)))
    lines.append(largest(r))
    r.items(lines)
