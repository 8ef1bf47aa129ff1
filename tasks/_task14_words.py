"""Lab 14 in words: why these instants, the result, the answers to the sheet, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def named(instants):
    """A selection in words: (5, 9)."""
    return f"({', '.join(map(str, instants))})"


def before(P0, Qd, R, instants, horizon):
    """The variances before the fixes of a selection."""
    found, P = [], P0
    for t in range(horizon):
        if t in instants:
            found.append(P)
            P = P * R / (P + R)
        P += Qd
    return found


def movable(P0, Qd, R, limit, instants, horizon):
    """How many fixes of a selection could be moved to the next instant: it is free, and the limit allows it."""
    priors = before(P0, Qd, R, instants, horizon)
    free = [t + 1 < horizon and t + 1 not in instants for t in instants]
    return sum(a and (limit is None or P + Qd <= limit**2 * (1 + 2e-12)) for a, P in zip(free, priors, strict=True))


def reasons(P0, Qd, R, instants, horizon):
    """For each fix of the best selection, what keeps it from being later."""
    lines = []
    for n, (t, P) in enumerate(zip(instants, before(P0, Qd, R, instants, horizon), strict=True), 1):
        now, then = math.sqrt(P), math.sqrt(P + Qd)
        if t == horizon - 1:
            lines.append(text("Fix {n} is at the last instant {t}; the RMS before it is {now:4} m.", n=n, t=t, now=now))
        elif t + 1 in instants:
            lines.append(text("Fix {n} at {t} stands directly before the next one; the RMS before it is {now:4} m.", n=n, t=t, now=now))
        else:
            lines.append(text("Fix {n} at {t} is as late as {eq:latest} allows: the RMS before it is {now:4} m, one period later it would be {then:4} m.", n=n, t=t, now=now, then=then))
    return lines


def result(p, answer, measured):
    """The lab in three sentences."""
    a, b = answer["a_best_pair"], answer["b_best_pair"]
    first = text("Without a limit the last instants are the best, {pair} with an RMS of {rms:4} m at the end, since a later fix shrinks more noise.", pair=named(a), rms=answer["a_terminal_rms"])
    if b is None:
        second = text("With the limit of {limit} m no selection is possible ({fig:pairs}).", limit=p.limit_rms)
    elif b == a:
        second = text("The limit of {limit} m on the RMS before a fix changes nothing in (b) ({fig:pairs}).", limit=p.limit_rms)
    else:
        second = text("The limit of {limit} m on the RMS before a fix makes {pair} the best, with {rms:4} m: each fix is as late as its limit, its neighbour or the end allows ({fig:pairs}).", limit=p.limit_rms, pair=named(b), rms=answer["b_terminal_rms"])
    return [first, second, text("In the experiment the RMS error at the end was {measured} under the plan of (a), where theory has {theory:4} m.", measured=measured, theory=answer["a_terminal_rms"])]


def discussion(r, p, answer):
    """What the numbers teach."""
    r.says("**What the two fixes are for.** Under a limit the fixes have different tasks. The last one makes the position accurate at the end. Those before it keep the vehicle on its map until then: that they make the end more accurate as well is a small gain where $R$ is not much larger than $Q_d$, for then the last fix hides most of what was before it."
           if p.fixes > 1 else "**What the fix is for.** It makes the position accurate at the end, and so it is taken as late as the limit allows.")
    none = [part for part in "bcde" if answer[f"{part}_best_pair"] is None]
    if none:
        r.says("**Where no plan exists.** That no plan keeps the limit, as in {parts}, is found before the flight and not in it. What helps always is a wider limit, which means a larger map ({fig:limits}). A better start helps where the RMS is beyond the limit at the start, a better drive where the noise of a single period takes it there; better fixes help only where that noise alone leaves it within the limit, $Q_d < L^2$.", parts=" and ".join(f"({part})" for part in none))
    r.says("**What is particular here.** That a fix is worth more later rests on one state that is not forgotten ($\\Phi = 1$) and noise that only adds. With several states, or a state that decays, a fix may be worth more early, and the proof fails; the search over all selections remains.")
    r.says("**Theory and experiment.** The points of {fig:flights} lie on the curves within what {app:chance} allows.")


def answers(answer):
    """Each item of the sheet in a sentence."""
    found = {"a": text("{pair}, with an RMS of {rms:4} m at the end; by {eq:exchange} a fix is worth more later.", pair=named(answer["a_best_pair"]), rms=answer["a_terminal_rms"])}
    for part in "bcde":
        pair = answer[f"{part}_best_pair"]
        if pair is None:
            found[part] = text("No selection keeps the limit; {needed:4} m would be the least.", needed=answer[f"{part}_needed"])
        else:
            found[part] = text("{pair}, with an RMS of {rms:4} m at the end: as late as {eq:latest}, the next fix, or the end allows.", pair=named(pair), rms=answer[f"{part}_terminal_rms"])
    found["f"] = text("There are {n} selections, all of them in {fig:pairs}; {fig:flights} is the experiment.", n=answer["pairs"])
    return found


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [text("Without a limit the best selection is {pair}: {rms:4} m at the end.", pair=named(answer["a_best_pair"]), rms=answer["a_terminal_rms"]),
             "A fix is worth more the later it is taken, for it shrinks all the noise that came before it. In the best selection none can be moved to a later instant."]
    for part in "bcde":
        pair = answer[f"{part}_best_pair"]
        if pair is None:
            lines.append(text("({part}) No selection keeps the limit of {limit} m; {needed:4} m would be the least.", part=part, limit=p.limit_rms, needed=answer[f"{part}_needed"]))
        else:
            lines.append(text("({part}) The best selection that keeps the limit is {pair}: {rms:4} m at the end.", part=part, pair=named(pair), rms=answer[f"{part}_terminal_rms"]))
    if answer["b_best_pair"] and answer["b_best_pair"] != answer["a_best_pair"]:
        lines.append(text("The limit of (b) costs {loss:3} m at the end: an early fix is spent to keep the vehicle on the map.", loss=answer["b_terminal_rms"] - answer["a_terminal_rms"]))
    lines.append(largest(r))
    r.items(lines)
