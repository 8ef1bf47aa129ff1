"""The lab slow_error in words: misprints, result, what it means, the answers, and what it comes to."""

from ctlabs.labs.portrait import largest
from ctlabs.text import text


def misprints(r):
    """What is wrong in the paper, and what is taken instead."""
    r.says("**Misprints of the paper.** In the following places something else is taken:")
    r.items(["(8) begins with $\\varphi^T[k]$; it is $\\lambda^T\\varphi[k]$.",
             "(11): the bracket that opens before $K_\\lambda^{-1}$ is missing, and the last factor inside the inverse is $\\Phi_\\lambda$, not $\\Phi_\\mu$. As printed, a 3×2 matrix would be subtracted from a 3×3 one in example (ii). Where signal and error have equally many parameters the printed product exists and is wrong, unless $\\Phi_\\lambda = \\Phi_\\mu$ as in (i).",
             "(15): $R[n]$, $\\hat{s}[n, k]$ and $\\varphi[n]$ belong to the instant $N$ of the estimate, past or future.",
             "(18): the covariances have one index, $Q[k]$, $R[k]$, $S[k]$; they need only be nonnegative (in section 5 they are 0).",
             "Before (30), “$K_{11}[k]$ is the covariance of the error”: it is $P_{11}[k]$. In (30) the last term of $M$ is $U[k]$, not $v[k]$.",
             "Section 5, $U = G = 1$: it is $H = G = 1$; there is no noise $u$, $v$, so $U = 0$.",
             "The vector $\\bar{y}[k]$ of (3) has $k + 1$ samples, 0 to $k$, whereas the recursion has its prior at 0 and samples 1 to $k$. Equal numbers of samples are compared here, 1 to $k$."])


def both(p):
    """Whether signal and slow error are both unknown beforehand."""
    return bool(p.sigma_lambda2 * p.sigma_mu2)


def result(p, answer, measured, sd, count):
    """The lab in three sentences."""
    first = (
        text("A constant signal and a constant slow error are never told apart, however long one measures: the error variance of the signal stays above {floor:4} u², and only the sum is found ({eq:closed}, {fig:figure2}).", floor=answer["variance_floor"]) if both(p)
        else "One of signal and slow error is known beforehand, so that all measurements serve the other ({eq:closed}, {fig:figure2})."
    )
    return [
        first,
        "Batch and recursive estimates are one estimator in all three examples; the printed errors of 7 % and 15 % are one ordinary draw, and they do not vanish with more measurements ({tab:statement}).",
        text("In the experiment the RMS error of the signal after {count} measurements was {measured}, where theory has {sd:4} u.", count=count, measured=measured, sd=sd),
    ]


def discussion(r, p):
    """What the numbers mean together."""
    r.says("**What cannot be separated.** Two quantities can be told apart only if they act differently on the samples. A constant error acts like a constant signal, and the prior variances alone divide their sum; a harmonic drift under a polynomial, or an error that fades beside a moving position, acts differently and is found ({fig:polynomial}, {fig:moving}). Observability of the augmented state is the test, to be made before any filter is built.")
    if both(p):
        r.says("**More data, worse estimates.** An estimator that ignores the error averages the noise away and takes what remains for the signal. While noise dominates it is nearly optimal; later it trusts its average more than that deserves, and if $2\\sigma_\\mu^2 > \\sigma_\\lambda^2$ its variance has a minimum and rises again ({eq:naive}, {fig:figure2}). The optimal estimator, and the one that considers the error without estimating it ({fig:consider}), keep a gain that allows for it.")
        r.says("**Numbers.** As λ + μ becomes known, the covariance of (λ, μ) becomes nearly singular. What a filter loses there is not accuracy of the estimates but the small variance of the sum ({tab:rounding}); who needs it carries a root of P.")
    r.says("**Points outside the band.** In {fig:section5_ensemble} the errors of a run are nearly the same number from one measurement to the next. So the averages over the runs keep to one side for long, and a row of points outside the band is one event. The tests of {app:chance} take the correlation into account.")


def answers(p):
    """Each item of the sheet in a sentence or two."""
    return {
        "batch": "Estimate and risk are {eq:batch}, the misprints of the source removed; they are those of the joint Gaussian distribution ({tab:batch}).",
        "recursive": "The filter is {eq:recursion} for the state of signal and error together, and it gives the batch estimate; for constants {eq:closed}.",
        "figure1": "Both are drawn in {fig:figure1}: they settle in the ratio of the prior variances, not at the true values." if both(p) else "Both are drawn in {fig:figure1}; one of them is known beforehand.",
        "figure2": "{fig:figure2} with {eq:naive}: the optimal variance tends to its floor, the other to the variance of μ.",
        "statement": "They are one draw among many about errors that do not vanish ({tab:statement}, {eq:errors}).",
    }


def conclusions(r, p):
    """What the numbers say."""
    v = {name: value.value for name, value in r.values.items()}
    lines = [text("Batch, recursion and conditioning of the joint distribution give the same estimates to {d:2} of the prior spread, for constant, polynomial and moving signals, white and coloured noise, inside the record and beyond it.", d=v["batch_minus_recursive_max"])]
    if both(p):
        lines.append(text("A constant signal and a constant error are never separated: λ̂/μ̂ = {ratio} at every k, and the variance of λ̂ stays above {floor} u² (it is {now} u² at k = {k}). Only λ + μ is found.", ratio=p.sigma_lambda2 / p.sigma_mu2, floor=v["variance_floor"], now=v["lambda_variance"], k=p.k))
    else:
        lines.append(text("One of λ and μ is known beforehand, so the samples tell of the other alone: the variance of λ̂ is {now} u² at k = {k}.", now=v["lambda_variance"], k=p.k))
    if v["lambda_variance"]:
        lines.append(text("Ignoring μ gives a variance of {naive} u² at k = {k}, {ratio:4} times the optimal one.", naive=v["naive_variance"], k=p.k, ratio=v["naive_variance"] / v["lambda_variance"]))
    if v["naive_minimum_k"] is not None:
        lines.append(text("Beyond k = {k} more data make the estimator that ignores μ worse.", k=v["naive_minimum_k"]))
    lines.append("The printed 7 % and 15 % are one ordinary draw about 8.26 % and −13.39 %, and do not vanish with k." if v["verdict_statement"] else "The printed 7 % and 15 % are no ordinary draw of the model.")
    lines.append(largest(r))
    r.items(lines)
