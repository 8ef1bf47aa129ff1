"""Lab 13, part (a): how the coefficients are found, and the way of the continuous filter to its limit."""

import math

import numpy as np
from ctlabs.tasks.answers import task13 as by_hand
from ctlabs.tasks.answers.task13 import TIMES

from ctlabs.filtering import bucy
from ctlabs.models import ContinuousModel, observability
from ctlabs.reporting import plots
from ctlabs.reporting.report import EXACT, SOLVER
from ctlabs.text import latex_number, text

TIME = "t, s"


def scalar(r):
    """Three estimate equations, three gains, six Riccati equations."""
    r.says("**The estimate** by the filter of Kalman and Bucy ({ref:kalman_bucy}; {ref:maybeck, section 5.11}), in scalar form, where $z$ is the measured altitude $h_m$:")
    r.math(r"\dot{\hat h} = -a_1\hat h + \hat x_2 + b_1\hat h_{c0} + K_1(z - \hat h)", "estimate")
    r.math(r"\dot{\hat x}_2 = -a_0\hat h + b_0\hat h_{c0} + K_2(z - \hat h), \qquad \dot{\hat h}_{c0} = K_3(z - \hat h)")
    r.says("**The gains** and the **six scalar Riccati equations** of their covariance:")
    r.math(r"K_1 = \frac{P_{11}}{N_m}, \qquad K_2 = \frac{P_{12}}{N_m}, \qquad K_3 = \frac{P_{13}}{N_m}")
    r.math(r"\dot P_{11} = -2a_1P_{11} + 2P_{12} + 2b_1P_{13} + b_1^2N_c - \frac{P_{11}^2}{N_m}", "riccati")
    r.math(r"\dot P_{12} = -a_0P_{11} - a_1P_{12} + b_0P_{13} + P_{22} + b_1P_{23} + b_0b_1N_c - \frac{P_{11}P_{12}}{N_m}")
    r.math(r"\dot P_{13} = -a_1P_{13} + P_{23} + b_1P_{33} - \frac{P_{11}P_{13}}{N_m}, \qquad \dot P_{22} = -2a_0P_{12} + 2b_0P_{23} + b_0^2N_c - \frac{P_{12}^2}{N_m}")
    r.math(r"\dot P_{23} = -a_0P_{13} + b_0P_{33} - \frac{P_{12}P_{13}}{N_m}, \qquad \dot P_{33} = -\frac{P_{13}^2}{N_m}")


def coefficients(r, answer, two, three):
    """Why the gains come from integration, and what they tend to."""
    r.says("**The coefficients.** The numbers $a_i$, $b_i$ come from the transfer function. The gains depend on $P(t)$, and $P(t)$ on $N_c$, $N_m$ and $P_0$, but on no measurement: the six equations that begin with {eq:riccati} are integrated beforehand, from $P_0$, and $K_i(t) = P_{1i}(t)/N_m$. It is tempting to take the constant gains of the algebraic Riccati equation instead. But that equation has a stabilising solution only if noise drives every mode whose eigenvalue lies on the imaginary axis (see {ref:kwakernaak_sivan, chapter 4}):")
    dual = ContinuousModel(
        F=three.F.T, G=np.eye(3), Q=np.zeros((3, 3)), H=(three.G @ three.Q).T, P0=np.zeros((3, 3)), states=three.states
    )
    undriven = observability.analyse(dual).undetectable_modes
    limit = bucy.steady(three)
    r.items([
        "No noise drives $h_{c0}$: its mode has the eigenvalue 0 and neither decays nor is disturbed.",
        "So the Hamiltonian matrix of the equation has {zeros} eigenvalues on the imaginary axis (at 0) where a stabilising solution needs none.",
        "The covariance does have a limit, $P_{33} \\to 0$ and with it $K_3 \\to 0$, but with the limit gains the filter has the poles ${poles}$ 1/s: the one at 0 means that an error of $\\hat{h}_{c0}$ would never be corrected. The constant gain is optimal only when nothing is left to estimate.",
    ], zeros=2 * len(undriven), poles=", ".join(latex_number(float(z.real)) if not z.imag else f"{latex_number(float(z.real))} ± {latex_number(abs(float(z.imag)))}i" for z in limit.poles if z.imag >= 0))
    stabilising = bool((limit.poles.real < -observability.MARGIN * np.abs(limit.poles).max()).all())
    r.value("verdict_a", stabilising)
    r.check("eigenvalues at 0 of the Hamiltonian matrix", 2 * len(undriven), by_hand.zero_roots(),
            ("undriven modes that do not decay, twice", "characteristic polynomial by sympy"), EXACT)
    two_state_limit(r, answer, two, limit)


def two_state_limit(r, answer, two, limit):
    """The limit that the two driven states have, and its filter."""
    r.says("**The limit** is that of the two states which the noise drives, with a command that is known. Its Riccati equation has a stabilising solution; by hand it comes from spectral factorisation, where $d(s) = s^2 + d_1s + d_0$ is the polynomial of the filter:")
    r.math(r"d(s)d(-s) = a(s)a(-s) + \frac{N_c}{N_m}b(s)b(-s) \;\Rightarrow\; d_0 = \sqrt{a_0^2 + \frac{N_c}{N_m}b_0^2}, \quad d_1 = \sqrt{a_1^2 - 2a_0 + \frac{N_c}{N_m}b_1^2 + 2d_0}", "factor")
    r.math(r"K_1 = d_1 - a_1, \qquad K_2 = d_0 - a_0, \qquad P_{11} = N_mK_1", "limit")
    found, routes = bucy.steady(two), ("Riccati equation", "spectral factorisation")
    r.value("altitude_variance_steady_continuous", found.P[0, 0], "m²", symbol=r"P_{11}(\infty)", agrees=answer, routes=routes)
    r.value("altitude_gain_steady_continuous", found.K[0, 0], "1/s", symbol=r"K_1(\infty)", agrees=answer, routes=routes)
    r.value("filter_polynomial", bucy.transfer_function(two)[1], "1", agrees=answer, routes=routes)
    poles = [[float(z.real), float(z.imag)] for z in np.sort_complex(found.poles)]
    r.value("filter_poles_continuous", poles, "1/s", agrees=answer, routes=routes)
    r.check("limit of the three-state covariance", limit.P[:2, :2], answer["steady_covariance"],
            ("Riccati equation without the undriven mode", "spectral factorisation"))
    r.check("limit of P33", limit.P[2, 2], 0.0, ("Riccati equation without the undriven mode", "proved"), EXACT)
    r.says("Matching the powers of $s$ gives {eq:factor}, and the difference of the polynomials of the filter and the plant gives the gains. Here $P_{11} \\to {P}$ m², $K_1 \\to {K1}$ 1/s, $K_2 \\to {K2}$ 1/s², and the filter has {poles}.",
           P=found.P[0, 0], K1=found.K[0, 0], K2=found.K[1, 0], poles=constants(answer))


def constants(answer):
    """The time constants of the filter in words."""
    first, second = answer["filter_poles_continuous"]
    if first[1]:
        return text("an oscillation of {rate} rad/s that decays with the time constant {tau} s", rate=abs(first[1]),
                    tau=-1 / first[0])
    return text("the time constants {fast} s and {slow} s", fast=-1 / first[0], slow=-1 / second[0])


def transient(r, p, answer, three):
    """P(t) and its approach to the limit."""
    found = bucy.transient(three, (*TIMES, answer["far"]))
    P, routes = found.P, ("Riccati equation, integrated", "closed form, 60 digits")
    r.value("altitude_variance_continuous", P[:4, 0, 0], "m²", at=TIMES, agrees=answer, routes=routes)
    r.value("command_variance_continuous", P[:4, 2, 2], "m²", at=TIMES, agrees=answer, routes=routes)
    r.check("whole covariance at these times", P[:4], answer["covariance_continuous"], routes)
    six = by_hand.scalar_equations(p.N_c, p.N_m, answer["covariance_continuous"][0], TIMES)
    upper = [covariance[np.triu_indices(3)] for covariance in P[1:4]]
    r.check("the six scalar equations from 1 s on", upper, six,
            ("Riccati equation, integrated", "scalar equations by LSODA"))
    origin = None
    if p.var_hc0:
        r.says("**The command.** If $h_{c0}$ were known, two states would be left, whose filter starts from $P = 0$ and settles. An error of $h_{c0}$ by 1 m shifts its innovations by $S(t)$, which tends to $a_0/d_0$. The innovations of that filter are white with the strength $N_m$, and so they add information on $h_{c0}$ at the rate $S^2/N_m$:")
        r.math(r"\frac1{P_{33}(t)} = \frac1{\mathrm{var}(h_{c0})} + \int_0^t\frac{S^2(\tau)}{N_m}d\tau, \qquad \frac{S^2}{N_m} \to \frac{a_0^2}{d_0^2N_m} = \frac1{N_c + N_m}", "information")
        r.says("The last step uses $b_0 = a_0$: the autopilot holds a constant command without error. In the long run the constant is seen through noise of both kinds, $N_c + N_m$, and its variance falls in inverse proportion to the time since an origin $t^*$, which depends on the beginning:")
        r.math(r"P_{33} \to \frac{N_c + N_m}{t - t^*}, \qquad P_{11} \to P_{11}(\infty) + \frac{N_m}{t - t^*}, \qquad K_3 \to \frac{\sqrt{1 + N_c/N_m}}{t - t^*} \to 0", "asymptotes")
        r.says("The second limit follows because the error of the altitude is that with the command known plus an independent part, which in the limit is the error of the command times $b_0/d_0 = \\sqrt{N_m/(N_c + N_m)}$; the third is $P_{13}/N_m$ for that part. ∎")
        origin, far = answer["far"] - (p.N_c + p.N_m) / P[4, 2, 2], answer["far"]
        r.value("command_time_origin", origin, "s", symbol="t^*")
        # t* is what is left of the late time t when (N_c + N_m)/P33 is taken from it.
        r.check("command time origin", origin, answer["command_time_origin"], routes, SOLVER, scale=far + abs(origin))
        late = far - origin
        excess = P[4, 0, 0] - answer["altitude_variance_steady_continuous"]
        r.check(text("P11 − P11(∞) at {t} s", t=far), excess, p.N_m / late, ("Riccati equation, integrated", "asymptote"), SOLVER,
                scale=float(P[4, 0, 0]))
        r.check(text("K3(t − t*) at {t} s", t=far), found.K[4, 2, 0] * late, math.sqrt(1 + p.N_c / p.N_m),
                ("Riccati equation, integrated", "asymptote"))
    else:
        r.value("command_time_origin", None, "s", reason="the command is known from the start")
        r.says("**The command** is known from the start (its variance is 0), so $P_{33} = 0$ and $K_3 = 0$ all the time, and only two states are estimated.")
    transient_table(r, p, answer, three, found, P, origin)


def transient_table(r, p, answer, three, found, P, origin):
    """Variances and gains in time."""
    asymptote = [(p.N_c + p.N_m) / (t - origin) if origin is not None and t > origin else None for t in found.t]
    above = [100 * (C[0, 0] / answer["altitude_variance_steady_continuous"] - 1) if p.N_c else None for C in P]
    rows = [
        (t, C[0, 0], a, C[2, 2], s, *K[:, 0])
        for t, C, a, s, K in zip(found.t, P, above, asymptote, found.K, strict=True)
    ]
    r.table("transient", ["t, s", "$P_{11}$, m²", "above its limit, %", "$P_{33}$, m²", "$(N_c + N_m)/(t - t^*)$, m²", "$K_1$, 1/s", "$K_2$, 1/s²", "$K_3$, 1/s"], rows,
            "Variances and gains of the continuous filter; the last row is at 30 times its longest time constant.")
    if P[2, 0, 0] > P[1, 0, 0] and p.var_hc0:
        r.says("In {tab:transient} $P_{11}$ does not fall all the time: it is the sum of the variance with the command known, which rises from 0 to the limit, and of the part of the command, which falls. Here it rises from {early:4} m² at 10 s to {late:4} m² at 60 s.",
               early=P[1, 0, 0], late=P[2, 0, 0])
    settled(r, p, answer, above[3], origin)
    figures(r, p, answer, three, origin)


def said(r, p, origin):
    """What the figure of the variances shows."""
    if origin is None:
        r.says("In {fig:variances} the variance of the altitude rises from 0, as the flight is known at the start, to its limit (dashed).")
    elif p.N_c:
        r.says("In {fig:variances} both variances are the same at first, since a single number is unknown, and fall as the measurements are averaged. When the noise of the command has been at work for as long as the filter remembers, they part: the altitude turns towards its own limit (dashed), while the command falls on and joins its asymptote $(N_c + N_m)/(t - t^*)$.")
    else:
        r.says("In {fig:variances} both variances fall without end: no noise drives the flight, and one constant is all there is to learn.")


def settled(r, p, answer, above, origin):
    """Whether the filter has settled at 300 s."""
    if above is None:
        r.value("altitude_excess_300s", None, "%", reason="the limit is 0")
        r.says("Without noise in the command $P_{11}$ tends to 0 and never stays within a fraction of its limit: there is no settling.")
        return
    r.value("altitude_excess_300s", above, "%")
    hand = 100 * (answer["altitude_variance_continuous"][3] / answer["altitude_variance_steady_continuous"] - 1)
    r.check("excess of P11 at 300 s", above, hand, ("Riccati equation, integrated", "closed form, 60 digits"), SOLVER,
            scale=100.0)
    if abs(above) <= 1:
        r.says("At 300 s $P_{11}$ is {above:2} % from its limit: by the 1 % criterion the altitude has settled, while $P_{33}$ goes on falling.",
               above=above)
    else:
        words = (
            text(
                "By {eq:asymptotes} it reaches the 1 % band at about {t:2} s.",
                t=origin + 100 * p.N_m / answer["altitude_variance_steady_continuous"],
            )
            if origin is not None
            else ""
        )
        r.says("At 300 s $P_{11}$ is still {above:2} % from its limit: by the 1 % criterion it has **not settled**, since it contains what is left of the error of the command. {words}",
               above=above, words=words)


def figures(r, p, answer, three, origin):
    """P11(t), P33(t)."""
    t = np.geomspace(0.1, max(1000.0, p.steps * p.dt), 121)
    curve = bucy.transient(three, t).P
    variances = {"$P_{11}$, altitude": curve[:, 0, 0], "$P_{33}$, command": curve[:, 2, 2]}
    limits = {"$P_{11}$, altitude": answer["altitude_variance_steady_continuous"]} if p.N_c else {}
    if origin is not None:
        late = t > max(1.2 * origin, origin + 10)
        variances["$(N_c + N_m)/(t - t^*)$"] = np.where(late, (p.N_c + p.N_m) / np.where(late, t - origin, 1.0), np.nan)
    shown = {name: np.where(values > 0, values, np.nan) for name, values in variances.items() if (values > 0).any()}
    if shown:
        figure = plots.transient(t, shown, xlabel=TIME, ylabel="variance, m²", log="xy",
                                 limits={name: value for name, value in limits.items() if name in shown})
        r.figure("variances", figure,
                 "Variances of the continuous filter. The altitude tends to a limit; the command falls for ever along its asymptote." if limits and origin is not None else "Variances of the continuous filter.")
        said(r, p, origin)
    else:
        r.says("All variances are zero: nothing is unknown, and there is nothing to plot.")
