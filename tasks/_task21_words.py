"""Lab 21 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers import task21 as by_hand
from ctlabs.tasks.answers.task21 import TIMES

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured=None, sd=None, when=None):
    """The lab in three sentences."""
    if not p.P0:
        return [
            "The slope is known from the start: its error variance is zero at all times, and the gain with it ({fig:gain}).",
            "Such a filter is stable in Lyapunov's sense but not asymptotically, as it takes no notice of the measurements.",
            "There is no other steady state, in the continuous filter as in the discrete one.",
        ]
    return [
        text("The filter of a constant slope falls asleep: its gain has a maximum of {gain:4} 1/s² at {when:4} s and then falls like 3/t², its variance like 3R/t³ ({fig:gain}, {fig:slope}).", gain=answer["gain_maximum"], when=answer["gain_maximum_time"]),
        "It is asymptotically stable, but neither uniformly nor exponentially: in the end an error stays the longer, the later it enters ({fig:decay}), and there is no steady state.",
        text("In the experiment the RMS error at {at:4} s was {measured}, where theory has {sd:4} m/s.", at=when, measured=measured, sd=sd),
    ]


def discussion(r, p):
    """What the numbers mean together."""
    if p.P0:
        r.says("**A memory that grows with age.** In the end every measurement of the past counts with equal rights in the least-squares line through the origin. That is right as long as the slope is a constant, and it is exactly what makes the filter slow: what enters at the time s is weighed against all data since 0, so that it takes a fixed fraction of s, and not a fixed time, to be forgotten ({tab:halving}).")
        r.says("**Why the theorem does not help.** Uniform stability needs a lower bound of P, hence process noise. Here F = 0 and Q = 0, nothing keeps the filter awake, and Lyapunov's function has no upper bound in terms of y² ({eq:lyapunov}). The practical cure is a small Q, which says that the slope may drift; then the gain tends to $\\sqrt{Q/R}$ instead of 0, P falls only like $\\sqrt{QR}/t$, and an error of the slope is forgotten the faster, the later it enters.")
        r.says("**The discrete filter.** It is better than the continuous one, which is a consequence of where its measurements lie: each stands for the period before it, but is taken where the factor t is largest ({eq:closed}, {tab:limit}). With measurements in the middle of the periods the difference would be of second order.")
        r.says("**Points outside the band.** The errors at s and at a later t have the correlation $\\sqrt{P(t)/P(s)}$, in the end $(s/t)^{3/2}$: late errors stay nearly the same number for long. So mean error, RMS and NEES in {fig:ensemble} move ever more slowly, and where they lie on one side or outside the band, they stay there for a time in proportion to t. Such a row of points is one deviation and not many; only the innovations, which are white, give a new test at every instant (NIS). {app:chance} takes this into account.")
    else:
        r.says("**A known slope.** With P(0) = 0 there is nothing to estimate. The measurements cannot change what is certain, and if the certainty is unfounded the filter will never find out: this is the extreme case of a filter that is asleep.")
    r.says("**Experiment.** {fig:errors} and {fig:ensemble} agree with theory within what chance allows ({app:chance}); the variances are known before any data come ({eq:variance}, {eq:closed}).")


def answers(p):
    """Each item of the sheet in a sentence or two."""
    return {
        "a": "The filter is that of {eq:filter}, with the variance and gain of {eq:variance}. It is stable, asymptotically stable, and bounded from z to the estimate, but neither uniformly asymptotically nor exponentially stable." if p.P0
             else "The filter is that of {eq:filter}; with P(0) = 0 its gain is zero. It is stable, but not asymptotically stable.",
        "b": "The filter is that of {eq:discrete}, its variance that of {eq:closed}.",
        "c": "No: P and K tend to zero ({eq:tails}, {fig:slope}), and the simulated errors agree with this ({fig:ensemble})." if p.P0 else "No, but for the trivial one in which nothing is measured.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = []
    if p.P0:
        lines.append(text("P(t) is {half} of $P_0$ at {when} s, where the gain is largest ({gain} 1/s²); from then on P falls like 3R/t³ and the gain like 3/t².", half="⅔", when=answer["gain_maximum_time"], gain=answer["gain_maximum"]))
        lines.append("The filter is asymptotically stable and turns bounded measurements into bounded estimates, but it is neither uniformly asymptotically nor exponentially stable: what goes wrong late is put right later still.")
        lines.append("There is no steady state: P and K tend to 0. A filter that must follow a slope which may change needs process noise in its model, or a bound below which the gain is not let fall.")
        k = by_hand.last(TIMES[-1], p.dt)
        t = k * p.dt
        if k:
            lines.append(text("With Δt = {dt} s the discrete filter's variance at {t} s is {ratio:4} times the continuous one: below it, since its measurements come at the ends of the periods, where the factor t is largest.", dt=p.dt, t=t, ratio=answer["posterior_variance"][-1] / by_hand.variance(p.R, p.P0, t)))
        else:
            lines.append(text("With Δt = {dt} s there is no measurement up to {t} s: the variances given there are $P_0$.", dt=p.dt, t=TIMES[-1]))
    else:
        lines.append("With $P_0 = 0$ the slope is known: the filter takes no notice of the measurements, and nothing changes.")
    lines.append(largest(r))
    r.items(lines)
