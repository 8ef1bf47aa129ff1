"""Lab 2 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers.task01 import variances

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, sd):
    """The lab in three sentences."""
    bias = answer["unmodelled_drift_bias_posterior"]
    second = (text("A filter that forgets the drift fails: its gain tends to 0, and its bias grows without limit.") if bias is None
              else text("With u = 0 there is nothing to forget, and a filter without the drift is the same filter.") if p.u == 0
              else text("A filter that forgets the drift has the steady bias {bias:4} m after an update ({fig:forgotten_drift}), of which its P says nothing.", bias=bias))
    third = (text("In the experiment the RMS error of the right filter was {measured} at the last measurement, where theory has {sd:4} m.", measured=measured, sd=sd) if measured is not None
             else text("The ensembles agree with theory.") if variances(p)[-1] == 0
             else text("As the last measurement is absent for ever, there is no filter in the long run to compare an ensemble with."))
    return [text("A known drift moves the prediction by $u\\tau = {step:4}$ m each period and changes neither gain nor variances: they are those of lab 1.", step=answer["control_increment"]), second, third]


def discussion(r, p, answer, R):
    """What the experiment adds to the theory."""
    r.says("**What is known costs nothing.** The input moves the state and the estimate alike, so that it cancels in the error. The estimate is a sum of what is known and of what was measured; only the second has a variance.")
    if answer["unmodelled_drift_bias_posterior"] is not None and p.u and R:
        ratio = answer["unmodelled_drift_bias_posterior"] ** 2 / (answer["gain_steady"] * R)
        r.says("**What is forgotten costs a bias.** The innovations of the forgetful filter have the mean $\\bar b^- = u\\tau/\\bar K$, and the gain turns this into just the $u\\tau$ that is lacking at each step. The square of the bias after an update is {ratio:3} times the variance that the filter claims. Such a fault shows in the mean of the innovations and not in P.", ratio=ratio)
    r.says("**Points outside the bands.** One point in twenty is expected outside. Of the error at one instant the share $1 - \\bar K$ passes to the next, so that neighbouring points tend to lie on one side; {app:chance} tests all instants at once and allows for it.")


def answers(p, answer):
    """Each item of the sheet in a sentence."""
    gain, bias = answer["gain_steady"], answer["unmodelled_drift_bias_posterior"]
    return {
        "a": "The filter predicts by {eq:prediction} and updates by {eq:update}: the input enters the mean alone. The diffusion has the same effect as in lab 1 ({tab:sweep_a}).",
        "b": "A larger R makes the estimates less accurate and the gain smaller, as in lab 1 and whatever u is ({tab:sweep_b})." if variances(p)[-1] else "Without errors of measurement each estimate is the last measurement, as in lab 1 and whatever u is ({tab:sweep_b}).",
        "c": "By {eq:steady} gain and relative accuracy depend on ρ alone ({fig:ratio})." if bias is None or p.u == 0
             else "By {eq:steady} gain and relative accuracy depend on ρ alone ({fig:ratio}). With the gain goes the bias of a filter that forgets the drift, {eq:forgotten}.",
        "d": "As in lab 1 a missing measurement leaves the prediction as it is, and a perfect one makes the error zero; the deviation from the limit then shrinks by $(1-\\bar K)^2$ at each measurement, whatever u is ({fig:anomaly})." if gain else "There is no steady state in which an anomaly could change anything here.",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [text("A known input moves the estimate by {step:4} m each period and changes nothing else: variances, gain and settling are those of lab 1.", step=answer["control_increment"])]
    bias = answer["unmodelled_drift_bias_posterior"]
    if bias is None:
        lines.append("A filter that forgets the drift fails here: its gain tends to 0, and its bias grows without limit.")
    elif p.u == 0:
        lines.append("With u = 0 there is nothing to forget: both filters are the same.")
    else:
        own = answer["gain_steady"] * variances(p)[-1]
        lines.append(text("A filter that forgets the drift has a steady bias of {bias:4} m after an update; its mean square error is {mse:4} m² where it claims {claimed:4} m². A larger gain would lower the bias.",
                          bias=bias, mse=answer["unmodelled_drift_mse"], claimed=own))
    lines.append(largest(r))
    r.items(lines)
