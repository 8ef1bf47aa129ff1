"""Lab 26 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.tasks.answers.task26 import price

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def borne(bounds):
    """How much weaker and stronger the input may be, in per cent."""
    return {"least": 100 * (1 - bounds[0]), "most": 100 * (bounds[1] - 1)}


def result(answer, measured, theory):
    """The lab in three sentences."""
    low, high = answer["gain_margins"]
    return [
        text("The optimal regulator of Doyle's plant loses its stability where the input is {up:3} % stronger or {down:3} % weaker than believed, while the optimal feedback of the known state bears half the gain and any larger one.",
             up=100 * (high - 1), down=100 * (1 - low)),
        text("{fig:gain} shows the cost between these bounds; with a filter that believes in noise at the input the loop bears {most:3} % and {least:3} % and costs {percent:3} % more.",
             **borne(answer["recovered_gain_margins"]), percent=price(answer)),
        text("In the experiment with the right plant the mean cost was {measured}, where theory has {theory:5}: the experiment does not see how fragile the loop is.", measured=measured, theory=theory),
    ]


def discussion(r):
    """What the numbers mean together."""
    r.says("**Optimal for one plant.** The cost is a mean over the noises that the model has, and no error of the model is among them. So the optimum may rely on any property of the model. Here it relies on the last coefficient of {eq:polynomial}, $1 + fd - m\\,fd$: for large gains it is a small difference of large numbers, 1 for the right plant and 0 at the upper bound.")
    r.says("**Who asks for it.** A large $q$ says that the input is cheap, a large σ that the sensor is good. Both make the gains large, and large gains are trusted to the last digit of the model. A designer who increases them until a simulation of the model looks well will not be warned: an ensemble of the model agrees with theory for every $q$ and σ.")
    r.says("**Why noise at the input helps.** An error of the input's gain acts on the plant like a disturbance at the input. A filter that expects one there relies less on what it believes the input to do, and more on the measurements; it pays with the noise of the sensor. The true remedy is the same: put into the model what is not known, and let the optimum be one for that.")
    r.says("**Theory and experiment.** The tests of {app:chance} compare mean squares at all instants and the whole cost with their exact distributions. That they agree is evidence for the formulas, not for the regulator.")


def answers(answer):
    """Each item of the sheet in a sentence or two."""
    return {
        "a": "The gains are those of {eq:gains}, the least cost is {eq:cost}.",
        "b": "The bounds are {eq:bounds}; with the state known only {eq:known} is asked. {fig:nyquist} shows why. The optimal loop's margins of phase, delay and distance are φ, τ and $\\min|1 + \\ell|$; those of the known state's feedback stand in the section.",
        "c": "The cost stands in {fig:gain}; it grows beyond all bounds at {eq:bounds}." if answer["cost_actual"] is not None else "With the given $m$ the loop is not stable ({fig:gain}).",
        "d": "The upper bound is $1 + 1/(fd)$ and tends to 1 as $q$ or σ grows; the lower one does so if both grow ({fig:margins}, {tab:weights}).",
        "e": "The filter's gain is {eq:recovered}; {fig:recovery} shows the margins and the price.",
        "f": "The ensemble agrees with theory ({tab:ensemble}), and says nothing of the margins ({fig:growth}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [
        text("The optimal gains are f = {f:4} and d = {d:4}; the least cost is {J:5}.", f=answer["feedback_gain"][0], d=answer["filter_gain"][0], J=answer["cost"]),
        text("The loop bears an input that is less than {most:3} % too strong and less than {least:3} % too weak, the feedback of a known state all above {known:3} of the believed one.", **borne(answer["gain_margins"]), known=answer["known_state_margin"]),
    ]
    if answer["cost_actual"] is None:
        lines.append(text("With m = {m} it is not stable.", m=p.m))
    elif p.m != 1:
        lines.append(text("With m = {m} its cost differs by {percent:3} % from that with m = 1.", m=p.m, percent=100 * (answer["cost_actual"] / answer["cost"] - 1)))
    lines.append(text("A filter designed with noise of strength {mu} at the input costs {percent:3} % more and bears {most:3} % and {least:3} %.",
                      mu=p.mu, percent=price(answer), **borne(answer["recovered_gain_margins"])))
    lines.append("Margins have to be looked at; they are not part of what was made least.")
    lines.append(largest(r))
    r.items(lines)
