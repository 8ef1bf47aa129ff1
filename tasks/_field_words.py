"""The lab field in words: its result, what it means, the answers to the paper, and what it comes to."""

import math

from ctlabs.labs.portrait import largest
from ctlabs.text import Uncertain, text


def ensemble(drawn):
    """σ_ε of the printed filter over all seeds, with its standard error."""
    squares = drawn.printed**2
    root = math.sqrt(float(squares.mean()))
    return Uncertain(root, float(squares.std()) / (2 * root * math.sqrt(len(squares))), "u")


def result(r, p, drawn):
    """The lab in three sentences."""
    values = {name: value.value for name, value in r.values.items()}
    first = text("The printed filter has a true error of {true:4} u where the noise is {noise:4} u, and no causal filter has less than {bound:4} u ({fig:errors_in_time}).",
                 true=values["sigma_eps_true"], noise=p.sigma_n, bound=values["sigma_eps_bound"])
    if values["verdict_table"] is None:
        second = "The paper's table belongs to other values of the parameters and is not judged ({fig:sigma_eps})."
    elif values["verdict_table"]:
        second = "The printed errors are ordinary results of the printed filter ({fig:sigma_eps})."
    else:
        second = "The paper's claim, that the filter suppresses the noise, holds; its printed errors do not come from the printed filter on the printed field, for they lie where no causal filter can come on average ({fig:sigma_eps})." if values["verdict_claim"] else "The printed errors do not come from the printed filter on the printed field ({fig:sigma_eps})."
    third = "No ensemble was drawn, since the unstable field outgrows double precision." if drawn is None else text("In the experiment the error over all seeds was {measured}, where theory has {sd:4} u.", measured=ensemble(drawn), sd=values["sigma_eps_true"])
    return [first, second, third]


def discussion(r, p, drawn):
    """What the numbers mean together."""
    values = {name: value.value for name, value in r.values.items()}
    r.says("**Three errors, and which to print.** A filter claims an error, it has one, and there is one that cannot be beaten. They differ here only by what the filter was told of the start ({fig:errors_in_time}): told of an uncertainty that is not there, it listens too much to the first measurements. A paper that reports an error should say which of the three it is." if p.P0
           else "**Three errors, and which to print.** A filter claims an error, it has one, and there is one that cannot be beaten. Here they are one, since the filter knows the start ({fig:errors_in_time}); a paper that reports an error should say all the same which of the three it is.")
    r.says("**A test of a published table.** An average over one record scatters; a single printed number below the bound would prove nothing. Ten of them below it, for two fields and five noises, cannot be scatter, although all noises of one α share a record; this is what the percentiles say. So the table is not refuted by a theory that disagrees with it, but by its place among the results of the very program that it describes." if values["verdict_table"] is False and drawn is not None
           else "**A test of a published table.** An average over one record scatters, so a printed number is judged by its place among the results of many seeds, not by its distance from theory.")
    if values["verdict_table"] is False:
        r.says("**What could be different.** Tried, as far as the text permits: the start of the filter and of the field ($P_0 = 0$ gives the bound), and the averages over $k = 0 \\dots m$ or $k = 1 \\dots m$. Not tried, since the text says nothing of them: another noise, another scheme in place, an average over a part of the nodes. The printed mean and spread of the field give no hint of such a difference.")
    r.says("**Two conditions of stability.** The eigenvalues of Φ say what happens in the end, von Neumann's condition what happens before: between the two limits a disturbance grows while it travels, leaves a field of finite length at its end, and the matrix is stable after all. But by then the numbers have grown beyond any use ({fig:growth}). For a long field only the stricter condition counts." if values["dt_limit_von_neumann"] else
           "**Two conditions of stability.** For the given coefficients the equation itself lets waves grow, and no step in time makes the scheme stable.")
    r.says("**Why the gain is local.** The noise enters at every node by itself and every node is measured, so what happens far away is known there and need not be told here ({fig:gain_rows}).",
           " That is what makes long fields possible ({tab:costs})." if values["verdict_scale"] else " For the given parameters, however, far away means more than a hundred nodes, and only fields much longer than that gain by it ({tab:costs}).")
    r.says("**Experiment.** Theory and ensembles agree, for the field itself, the printed filter, and the causal bound at all nodes and steps ({app:chance}); errors of neighbouring nodes and instants are correlated, and the tests count the seeds alone as independent." if drawn is not None else "**Experiment.** The field is too large for an ensemble; the covariances stand without one.")


def answers(r, world):
    """Each item in a sentence or two."""
    values = {name: value.value for name, value in r.values.items()}
    judged = values["verdict_table"]
    return {
        "table": "The columns of the field are in {tab:fields}, the ten variants in {tab:table}, printed and ours.",
        "figures": "The surface is {fig:figure1}; field, measurement and estimate at a node are in {fig:figure2}." if world is not None else "The unstable field overflows, and there is nothing to draw.",
        "theory": "The three errors of the printed variants are in {tab:theory}, their course in {fig:errors_in_time}.",
        "verdict": "The printed numbers belong to other values of the parameters, and are not judged here." if judged is None
                   else "The printed errors are ordinary results of the printed filter ({tab:verdict})." if judged
                   else "The field's numbers are ordinary draws, the printed errors are not: all are below the causal bound ({tab:verdict}, {fig:sigma_eps}). The claim that the filter suppresses the noise holds." if values["verdict_field"] and values["verdict_claim"]
                   else "The printed errors are no ordinary results of the printed filter ({tab:verdict}, {fig:sigma_eps}).",
        "stability": "The scheme is stable up to von Neumann's limit, which is lower than that of the eigenvalues ({eq:waves}, {tab:limits}, {fig:growth})." if values["dt_limit_von_neumann"] else "No step in time is stable for the given coefficients ({eq:waves}, {tab:limits}).",
        "scale": "The structure gives the filter exactly ({eq:structure}); a local gain gives it with an error that is known, at a cost proportional to the length of a field that is longer than its window ({tab:costs}).",
    }


def conclusions(r, p):
    """What the numbers say."""
    values = {name: value.value for name, value in r.values.items()}
    true, own_P, bound = (values[f"sigma_eps_{kind}"] for kind in ("true", "filter", "bound"))
    lines = [text("For the given parameters the printed filter has a true error of {true} u, where the noise is {noise} u; it claims {claimed} u itself, and no causal filter does better than {bound} u.",
                  true=true, noise=p.sigma_n, claimed=own_P, bound=bound)]
    if values["verdict_claim"]:
        lines.append("The paper's claim holds: the filter suppresses the noise, the more the larger it is, and the more the smaller α is.")
    else:
        lines.append("The paper's claim does not hold for all ten variants with these values of Δt, h, $N_1$, m and $P_0$.")
    if values["verdict_table"] is None:
        lines.append("The printed table belongs to other values of the parameters and is not judged.")
    elif values["verdict_table"]:
        lines.append("The printed errors are ordinary results of the printed filter.")
    else:
        lines.append(
            "The printed mean and spread of the field are ordinary draws of the literal model; the printed errors are not results of the printed filter on the printed field."
            if values["verdict_field"] else
            "Neither the printed mean and spread of the field nor the printed errors are ordinary draws; the errors are not results of the printed filter on the printed field.")
    if values["verdict_stability"]:
        lines.append(text("The step of {dt} s is stable; von Neumann's limit is {limit} s, and the eigenvalues would wrongly allow {other} s.",
                          dt=p.dt, limit=values["dt_limit_von_neumann"], other=values["dt_limit_eigenvalue"]))
    elif not values["dt_limit_von_neumann"]:
        lines.append("No step in time is stable for the given coefficients. The filter's covariances stay finite, since every node is measured; the field grows while disturbances travel through it.")
    else:
        lines.append(text("The step of {dt} s is unstable: von Neumann's limit is {limit} s.",
                          " The filter's covariances stay small, since every node is measured; the field grows by orders of magnitude while disturbances travel through it." if p.dt <= values["dt_limit_eigenvalue"]
                          else " The filter's covariances stay finite, since every node is measured; the field grows without bound.",
                          dt=p.dt, limit=values["dt_limit_von_neumann"]))
    if values["verdict_scale"]:
        lines.append("The gain is local, so a long field is filtered at a cost proportional to its length.")
    else:
        lines.append("The gain reaches so far that a field of 241 nodes has no interior where it is a convolution; only longer ones gain by it.")
    lines.append(largest(r))
    r.items(lines)
