"""Lab 22 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks._task22_bounds import NO_LIMIT

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd, when):
    """The lab in three sentences."""
    end = answer["variance_steady_continuous"]
    first = (
        "With a = 0 object and noise are both integrators, and no record tells them apart: the error variance of x₁ grows without bound." if end is None
        else text("Where the measurement has no white noise, one of the two states is known at every moment and the filter shrinks to one state; its error variance tends to {end:4} m² ({eq:limit}, {fig:sampled}).", end=end)
    )
    second = (
        text("The steady filter is time-invariant, (c₁s + ac₁)/(s + ac₁) with c₁ = {c1:4}, and differentiates nothing ({eq:transfer}).", c1=answer["c1"]) if end is not None and p.Q1
        else "The filter does not become a stable time-invariant one."
    )
    return [first, second, text("In the experiment the RMS error of x₁ at {at:4} s was {measured}, where theory has {sd:4} m.", at=when, measured=measured, sd=sd)]


def discussion(r, p, answer):
    """What the numbers mean together."""
    r.says("**A perfect measurement is not a perfect estimate.** z is known exactly, but it is the sum of two unknowns. Each exact value takes away one unknown, not both; what is left is one state, and what z tells of it is in the way z changes ({eq:derived}). The same happens in labs 15 and 23, with another object.")
    r.says("**Why nothing has to be differentiated.** The formula asks for $\\dot{z}$, which does not exist as a function. But it enters an integrator, so the product $k\\dot{z}$ can be integrated by parts beforehand ({eq:built}); in discrete time the difference $z_i - bz_{i-1}$ does the same, with one number to be stored ({eq:reduced}).")
    if p.a and p.Q1 and p.Q2:
        r.says("**How close the discrete filter is.** The samples miss only what happened between them, and of that the sum of the two states at the ends tells nearly all: the variances differ at second order in Δt, while with white noise (lab 16) they differ at first order.")
        r.says("**What must be known.** In {tab:ensembles} a filter with a wrong parameter is compared with the right one. What counts is the ratio of $Q_1$ to $Q_2$, which sets the gain, and a, which sets the colour; a common factor of $Q_1$ and $Q_2$ would change the variance and leave the filter as it is.")
    r.says("**Points outside the band.** One point in twenty of {fig:ensemble} is expected outside. The fraction {pole:3} of an error is left a period later, which is why such points come in groups where it is near 1; {app:chance} has the tests in which this is accounted for.", pole=answer["filter_pole"])


def answers(p, answer):
    """Each item of the sheet in a sentence or two."""
    invariant = answer["variance_steady_continuous"] is not None and p.Q1
    return {
        "a": "The estimate is that of {eq:filter}, begun with {eq:start} and built as {eq:built}; the filter becomes time-invariant with {eq:transfer}." if invariant
             else "The estimate is that of {eq:filter}, begun with {eq:start} and built as {eq:built}; for the given parameters it does not become a stable time-invariant filter.",
        "b": "The model is {eq:sampled}, the filter {eq:prediction} and {eq:update}.",
        "c": "In the basis (z, x₁) of {eq:basis} one state is left, and its filter is {eq:reduced}.",
        "d": "The bounds are P(0⁺) and P∞ ({tab:sets}, {fig:sets}); the simulated errors agree with them ({fig:ensemble}, {tab:ensembles})." if p.a
             else "There is no upper bound with a = 0 ({fig:sets}); the simulated errors agree with the growing variance ({fig:ensemble}, {tab:ensembles}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    end, lines = answer["variance_steady_continuous"], []
    if end is None:
        lines.append(text("There is no steady state: {reason}.", reason=NO_LIMIT))
    elif end == 0:
        which = "the noise is not driven, so that its value becomes known" if p.Q1 else "the object stands still, and averaging finds its place"
        lines.append(text("The error variance tends to 0: {which}.", which=which))
    else:
        lines.append(text("The error variance of x₁ goes monotonically from {start} to {end} m², and the filter becomes time-invariant with $c_1 = {c1}$ and the pole −{pole} 1/s.",
                          start=answer["variance_after_first_measurement"], end=end, c1=answer["c1"], pole=p.a * answer["c1"]))
        lines.append(text("Sampled every {dt} s it is {above:3} % larger in the steady state.", dt=p.dt, above=100 * (answer["posterior_variance_steady"] / end - 1)))
    settled = r.values["settling_time"].value
    if settled is not None:
        lines.append(text("The continuous filter settles in {when} s, the discrete one at measurement {step}.", when=settled, step=r.values["settling_step"].value))
    lines.append("Perfect measurements make the filter smaller: one of the two states is known after each of them, and one state is left, whose derived measurement has noise correlated with that of the process. No measurement has to be differentiated.")
    if not p.a:
        lines.append("The model is not observable: object and noise cannot be told apart.")
    lines.append(largest(r))
    r.items(lines)
