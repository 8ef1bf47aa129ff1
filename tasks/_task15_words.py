"""Lab 15 in words: its factors, its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers import task15 as by_hand

from ctlabs.filtering import settling
from ctlabs.labs.portrait import largest
from ctlabs.text import text

NO_LIMIT = "signal and noise are both Wiener processes: their difference is never seen, and its variance does not settle"


def variants(p):
    """The factors of part (c), one at a time: name, changes."""
    Q1s, En2s = (p.Q1 / 2, 1.5 * p.Q1) if p.Q1 else (1.0, 3.0), (2 * p.En2, 4 * p.En2) if p.En2 else (1.0, 2.0)
    return [
        ("given", {}),
        *((text("Q₁ = {x} V²/s", x=x), {"Q1": x}) for x in Q1s if x + p.Q2),
        *((text("E n²(t0) = {x} V²", x=x), {"En2": x}) for x in En2s),
        (text("wₙ = w₀ = {x} 1/s", x=p.w0), {"wn": p.w0}),
    ]


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    limit = answer["signal_variance_steady"]
    first = (
        "Without white noise in the measurement the filter shrinks to one state; here signal and noise are both Wiener processes, and their error variance does not settle." if limit is None
        else text("Without white noise in the measurement the filter shrinks to one state, and the signal's error variance tends to {limit:4} V² with the gain {gain:4} ({eq:recursion}, {eq:reduced}).", limit=limit, gain=answer["gain_steady"])
    )
    second = (
        "The strength of $w_1$ changes where the variance ends, the variance of $n(t_0)$ only where it begins, and equal frequencies make the filter a constant factor ({fig:factors})." if limit
        else "Equal frequencies make the filter a constant factor, and the variance of $n(t_0)$ does not enter the gain after the first measurement ({fig:factors})." if p.w0 == p.wn
        else "One of the two processes is not driven, and the variance tends to zero whatever the strength of the other and the variance of $n(t_0)$ are ({fig:factors})."
    )
    return [first, second, text("In the experiment the RMS error of the signal at {at:4} s was {measured}, where theory has {sd:4} V.", at=when, measured=measured, sd=sd)]


def discussion(r, answer):
    """What the numbers mean together."""
    r.says("**Coloured noise is a state, not a nuisance.** As soon as the noise is modelled, the measurement is perfect, and the question is no longer how large the noise is but how its spectrum differs from the signal's. What the filter uses is the difference $z_i - bz_{i-1}$ ({eq:derived}): it removes what is left of the old noise, and the part $(a-b)s_{i-1}$ that remains is the larger, the more the poles differ.")
    r.says("**When the poles are equal.** Then nothing remains: signal and noise are two processes of one shape, and no filter can do better than to divide z in the ratio of their strengths ({eq:equal}). The pair is unobservable; that it does no harm for a positive frequency is the difference between observability and detectability.")
    r.says("**Initial values and strengths.** A wrong variance of $n(t_0)$ is a mistake about the past, and a stable filter forgets it. A wrong strength is a mistake about all that is to come; it stays in the gain, and the filter's own variance does not show it ({eq:wrong}). The innovations do: their variance is no longer the claimed one and, unless the poles are equal, they are no longer white." if answer["signal_variance_steady"] else
           "**Initial values and strengths.** A wrong variance of $n(t_0)$ is a mistake about the past, and a stable filter forgets it. A wrong strength is one about all that is to come: in general it stays in the gain, and the filter's own variance does not show it.")
    r.says("**Points outside the band.** Successive errors share the factor {pole:3} ({eq:transfer}); where it is near 1, points of {fig:ensemble} that leave the band do so in groups. The tests of {app:chance} account for it.", pole=answer["filter_pole"])


def answers(answer):
    """Each item of the sheet in a sentence or two."""
    limit = answer["signal_variance_steady"]
    factors = (
        "Another strength of $w_1$ changes the steady state, another variance of $n(t_0)$ only the beginning, and equal frequencies make the filter static and the model unobservable, by analysis ({fig:factors}, {tab:factors}) and in the experiment ({tab:ensembles})." if limit
        else "For the given numbers the variance tends to no positive limit, so the factors change the way only ({fig:factors}, {tab:factors}, {tab:ensembles}); equal frequencies make the filter static and the model unobservable."
    )
    return {
        "a": "The recursion is {eq:recursion}, with the gain of {eq:gain} and the limit of {eq:steady}.",
        "b": "In the basis (z, s) of {eq:basis} one element is left; the reduced filter is {eq:reduced}.",
        "c": factors,
    }


def conclusions(r, p, answer, system):
    """What the numbers say."""
    limit, lines = answer["signal_variance_steady"], []
    given_ = by_hand.variance_limit(p.w0, p.wn, p.dt, p.Q1, p.Q2)
    lines.append("Without white noise in the measurement one combination of the states is known exactly: the filter reduces to one state and one scalar recursion, and gives the same estimates to rounding.")
    if limit is None:
        lines.append(text("There is no steady state: {reason}.", reason=NO_LIMIT))
    elif limit == 0:
        lines.append("The signal's error variance tends to 0: one of the two processes is not driven by noise and becomes known.")
    else:
        lines.append(text("The signal's error variance tends to {limit} V² with the gain {gain}; the filter's pole is {pole}.", limit=limit, gain=answer["gain_steady"], pole=answer["filter_pole"]))
    changed = [(name, by_hand.variance_limit(p.w0, p.wn, p.dt, c["Q1"], p.Q2)) for name, c in variants(p) if "Q1" in c]
    if given_ and all(x for _name, x in changed):
        lines.append(text("The strength of $w_1$ acts in the steady state; as multiples of the given variance: {list_}.", list_=", ".join(text("{name} gives {ratio:4}", name=name, ratio=x / given_) for name, x in changed)))
    lines.append("The initial variance of the noise acts only at the beginning; a filter with a wrong one becomes right by itself." if limit is not None else "The initial variance of the noise stays in the error variance for ever, though not in the gain.")
    equal = answer["signal_variance_steady_equal_frequencies"]
    if p.w0 == p.wn and equal:
        lines.append("The frequencies are equal: the filter is a constant factor, the difference of signal and noise is not observable but decays, so that the filter is stable.")
    elif equal and given_:
        lines.append(text("Equal frequencies, $w_n = w_0$, would give {equal} V² ({ratio} times the present variance) by a static filter, unobservable but stable.", equal=equal, ratio=equal / given_))
    elif equal is None:
        lines.append("Equal frequencies would here mean two Wiener processes, whose difference is neither seen nor stable: there is no steady state.")
    if limit:
        lines.append(text("The filter settles (p within 1 % of its limit) at measurement {settled}.", settled=settling(system, first=0)))
    lines.append(largest(r))
    r.items(lines)
