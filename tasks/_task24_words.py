"""Lab 24 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def share(answer):
    """What of the cost is due to not knowing the state, in per cent."""
    return 100 * (1 - answer["cost_known"] / answer["cost_current"])


def result(p, answer, measured, theory):
    """The lab in three sentences."""
    first = "With the state known the disturbance costs {known:4} m² per step; not knowing it costs {price:3} m² more, and another {late:3} m² if each measurement is answered a step late." if p.R else "With a perfect sensor the regulator costs no more than with the state known, {known:4} m² per step; answering each measurement a step late costs {late:3} m² more."
    return [
        text(first, known=answer["cost_known"], price=answer["cost_current"] - answer["cost_known"], late=answer["cost_delayed"] - answer["cost_current"]),
        "The two halves of the regulator are designed apart: its gain is that of the known state whatever the sensor, and its filter is that of the plant whatever the cost ({fig:noise}).",
        text("In the experiment the mean cost of the last steps was {measured} m², where theory has {theory:4} m².", measured=measured, theory=theory),
    ]


def discussion(r):
    """What the numbers mean together."""
    r.says("**What separation says, and what not.** It says that the optimal gain is found without the sensor and the optimal filter without the cost. It does not say that the cost falls apart into independent pieces: the price of an error of the estimate is $L^2W$, which the regulator decides. A regulator that acts little does not need to know much.")
    r.says("**Certainty equivalence.** The input treats the estimate as if it were the truth, and never acts in order to learn. That is right here because the input does not change what will be known: in {eq:filter} no $u$ appears. Where the input multiplies an unknown quantity, the separation fails.")
    r.says("**What it assumes.** The model is exact. In (f) it is not, and the two halves are no longer apart: the estimator then makes errors that depend on the state, and the stability of the loop depends on the product $KbL$ of both gains ({eq:characteristic}). That each half is stable for itself guarantees nothing about a loop with another plant; lab 26 has an example in which a few per cent are enough.")
    r.says("**Theory and experiment.** The tests of {app:chance} compare all mean squares, and the whole cost of all runs, with their exact distributions. Neighbouring points of {fig:ensemble} are correlated, as the loop carries a disturbance on with its poles.")


def answers(answer):
    """Each item of the sheet in a sentence or two."""
    return {
        "a": "The feedback is that of {eq:square} with the positive root of {eq:riccati}; the cost is $SQ$.",
        "b": "The input is $-L\\hat x$ and the cost {eq:separation}: not knowing the state adds $L^2WP$ ({tab:budget}).",
        "c": "By {eq:other} and {eq:whole} the minima do not move ({fig:gains}, {fig:estimators}); {fig:tradeoff} shows what can be had." if answer["cost_other_gain"] is not None
             else "By {eq:other} and {eq:whole} the minima do not move ({fig:gains}, {fig:estimators}); {fig:tradeoff} shows what can be had. The gain $L_*$ does not hold the plant.",
        "d": "They are listed in the section, and {fig:noise} shows those of the sensor; an unstable plant needs at least the input of {eq:least}.",
        "e": "The gains are those of {eq:backwards} and the filter's, the whole cost is {eq:finite} ({fig:schedule}).",
        "f": "The loop bears the factors of {eq:bounds}; {fig:truth} shows the cost between them." if answer["cost_actual"] is not None
             else "The loop bears the factors of {eq:bounds}, among which the given one is not; {fig:truth} shows the cost between them.",
        "g": "Mean squares and mean cost of the ensemble agree with theory ({fig:ensemble}, {tab:ensemble}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [text("The regulator's gain is {L:4}, the filter's {K:4}; neither depends on what decides the other.", L=answer["feedback_gain"], K=answer["gain_steady"])]
    if p.R:
        lines.append(text("Of the {J:4} m² per step {share:3} % are due to not knowing the state.", J=answer["cost_current"], share=share(answer)))
    else:
        lines.append("With a perfect sensor the state is known, and not knowing costs nothing to a regulator that answers at once.")
    lines.append(text("Answering a step late raises the cost by {late:3} %.", late=100 * (answer["cost_delayed"] / answer["cost_current"] - 1)))
    if p.Phi > 1:
        lines.append(text("The unstable plant cannot be held with an input of less than {sd:3} m RMS, whatever the cost is made of.", sd=answer["least_input_variance"] ** 0.5))
    low, high = answer["true_factor_limits"]
    if answer["cost_actual"] is None:
        lines.append(text("A plant with the factor {a} instead of {Phi} is not held by this regulator; it bears factors from {low:4} to {high:4}.", a=p.Phi_true, Phi=p.Phi, low=low, high=high))
    else:
        lines.append(text("A plant with the factor {a} instead of {Phi} costs {cost:4} m² per step; the regulator bears factors from {low:4} to {high:4}.", a=p.Phi_true, Phi=p.Phi, cost=answer["cost_actual"], low=low, high=high))
    lines.append(largest(r))
    r.items(lines)
