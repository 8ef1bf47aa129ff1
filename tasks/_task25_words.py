"""Lab 25 in words: its result, what it means, the answers to the sheet, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def result(p, answer, measured, theory):
    """The lab in three sentences."""
    return [
        text("Sampled every {h} s, an integrator with noise of strength {q} m²/s cannot be held better than {J:4} m² on average, and the regulator that does it has the gain {g:4}/h: it moves the state beyond zero.",
             h=p.dt, q=p.Q, J=answer["cost_minimum"], g=answer["gain_times_period"]),
        "With a weighted input, a noisy sensor and a delay the cost is a sum of two roots and a product, {eq:whole}, in which the period counts like a weight and like a noise ({fig:periods}).",
        text("In the experiment the autopilot of lab 13 with a regulator had the mean cost {measured} m² over the last samples, where theory has {theory:4} m².", measured=measured, theory=theory),
    ]


def discussion(r, answer):
    """What the numbers mean together."""
    r.says("**A cost must be sampled like a plant.** The weights of {eq:weights} are as much a property of the held input as the model {eq:model} is. The rectangle rule and the omitted cross term do no harm for short periods with a weighted input, where both vanish beside ρ; with a free input they are there at every period, and the loss of {one:2} or {other:2} % stays the same however fast one samples.",
           one=100 * (answer["costs_naive"][0] / answer["cost_minimum"] - 1), other=100 * (answer["costs_naive"][1] / answer["cost_minimum"] - 1))
    r.says("**Period, noise and delay.** In {eq:whole} the period adds $h^2/12$ to the weight of the input and $qh/4$ to the strength of the sensor's noise, each times $q$ or $h$ as its unit demands: a slow computer is like an input that costs more and a sensor that is worse. A delay is different. Its cost is in proportion to τ from the first millisecond on, while that of a short period grows with its square where ρ and $R_c$ are not zero: time is better spent on an early answer than on a fast rate.")
    r.says("**The autopilot's bad periods.** At half the period of the oscillation the held input pushes one half-wave up and the next one down, and the samples see the oscillation always in the same phase. What they see and what the input moves are then one combination of the two states each. These two need not be the same: if the answer comes half a period late, a quarter of the oscillation, the input finds that phase which was measured, and a delay can lower the cost where sampling has nearly destroyed it ({fig:autopilot}).")
    r.says("**Theory and experiment.** The tests of {app:chance} compare the mean squares at all samples and the whole cost with their exact distributions. The naive designs agree with theory too: theory knows what they cost, only they do not.")


def answers():
    """Each item of the sheet in a sentence or two."""
    return {
        "a": "The model is {eq:model}, the weights are those of {eq:weights}; the noise adds {eq:constant} per second.",
        "b": "They are {eq:minimum}: the gain is larger than $1/h$ and the pole negative.",
        "c": "Gains and costs follow from {eq:gains} and stand in {tab:naive}; {fig:between} shows the variance between the samples.",
        "d": "The cost is {eq:whole}, drawn in {fig:periods}.",
        "e": "The gains follow from spectral factorisation; {fig:autopilot} shows the cost against the period.",
        "f": "Mean squares and costs of the ensembles agree with theory ({tab:ensemble}, {fig:ensemble}).",
    }


def conclusions(r, p, answer):
    """What the numbers say."""
    lines = [
        text("The least variance of a sampled integrator is (3 + √3)/6 = 0.789 times qh, here {J:4} m², with a gain of 1.268/h.", J=answer["cost_minimum"]),
        "A regulator that counts the samples only costs 5.7 % more, one without the cross term 18.7 %, at every period.",
        text("With the given weight, sensor and delay the cost is {J:4} m²: {w:3} m² for the disturbance, {v:3} m² for the sensor and {d:3} m² for the delay.",
             J=answer["cost_sampled"], w=answer["cost_disturbance"], v=answer["cost_sensor"], d=answer["cost_delay"]),
        text("The regulator of the autopilot, continuous, brings the standard deviation of the altitude from {free:3} to {held:3} m; with a period of {h} s its cost is {more:3} % larger.",
             free=answer["altitude_variance_free"] ** 0.5, held=answer["altitude_variance"] ** 0.5, h=p.dt_a, more=100 * (answer["autopilot_cost"] / answer["autopilot_cost_continuous"] - 1)),
        text("Periods near {lost:3} s are to be avoided, whatever the noises are.", lost=answer["losing_period"]),
    ]
    lines.append(largest(r))
    r.items(lines)
