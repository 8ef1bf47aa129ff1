r"""The texts of :mod:`ctlabs.workbench.help`.

The examples of the model's fields are two whole models: a wheel whose angle is driven by a random torque and measured by a
coarse sensor, as a continuous and as a discrete model, with the constants of ``model.constants``.
"""

from __future__ import annotations

from typing import NamedTuple

from ctlabs.workbench.help_entry import Help

_MODEL = (
    Help(
        "model.kind",
        "Kind of model",
        "Continuous: the system is described by differential equations, as physics gives them, and is discretised exactly "
        "over the period dt. Discrete: it is described from step to step.",
        r"\dot{x} = Fx + Bu + Gw \qquad\text{or}\qquad x(k+1) = \Phi x(k) + c + w(k)",
        example="continuous",
        note="Take continuous where you know rates and spectra; discrete where you know what happens in one step.",
    ),
    Help(
        "model.title",
        "Title",
        "What the model is called in lists and in reports.",
        example="Wheel with a coarse angle sensor",
    ),
    Help(
        "model.states",
        "States",
        "Names of the quantities that the filter estimates: those whose present values, with the inputs to come, say "
        "all of the future that can be known.",
        r"x = \begin{bmatrix} x_1 \\ \vdots \\ x_n \end{bmatrix}",
        example='["angle", "rate"]',
        note="Two states may not have the same name. Removing a state keeps the rows and columns of the others.",
    ),
    Help(
        "model.units",
        "Units of the states",
        "One unit for each state, for axes and tables. Numbers are never converted: type all of them in SI units.",
        example='["rad", "rad/s"]',
    ),
    Help(
        "model.measurements",
        "Measurements",
        "Names of what the sensors give, one for each row of H.",
        r"z = Hx + v",
        example='["sensor"]',
    ),
    Help(
        "model.measurement_units",
        "Units of the measurements",
        "One unit for each measurement, for axes and tables.",
        example='["rad"]',
    ),
    Help(
        "model.constants",
        "Constants",
        "Numbers with a name, to be used in every cell. One with a least and a greatest value also has a slider. A "
        "constant may be an expression of others.",
        example="sigma = 0.1",
        note="Names are letters, digits and _; t and k are the time and the step, pi, e and inf are known. Functions: "
        "sqrt exp log ln log10 log2 sin cos tan atan atan2 abs min max.",
    ),
    Help(
        "model.F",
        "System matrix F",
        "How the rate of every state depends on the states: row i has the coefficients of dxᵢ/dt.",
        r"\dot{x} = Fx + Bu + Gw",
        "(unit of the row) / (unit of the column) / s",
        '[[0, 1], [0, "-1/tau"]]',
        "An eigenvalue with positive real part makes the system unstable; its filter may well be stable.",
        "Maybeck vol. 1, section 4.8",
    ),
    Help(
        "model.B",
        "Input matrix B",
        "How known inputs drive the states: a control that you give, a force that you know.",
        r"\dot{x} = Fx + Bu + Gw",
        "(unit of the row) / (unit of the input) / s",
        "[[0], [1]]",
        "A known input moves the estimate and adds nothing to its uncertainty.",
    ),
    Help(
        "model.u",
        "Known input u",
        "The values of the known inputs, one for each column of B, held over a period. May vary with t and k.",
        r"\dot{x} = Fx + Bu + Gw",
        "(unit of the input)",
        "[0.1]",
    ),
    Help(
        "model.G",
        "Noise input matrix G",
        "How the white noise w enters: one column for each noise.",
        r"\dot{x} = Fx + Bu + Gw",
        "(unit of the row) / (unit of the noise) / s",
        "[[0], [1]]",
        "A zero row: that state is driven by the other states alone.",
    ),
    Help(
        "model.Q",
        "Strength of the noise, Q",
        "How strong the white noise w is: the height of its flat spectrum, not a variance. The variance that it adds to "
        "a state grows with time.",
        r"E[w(t)\,w(t')^T] = Q\,\delta(t-t'), \qquad Q_d \approx GQG^T\,\Delta t",
        "(input unit)²·s",
        '[["q"]]',
        "Symmetric, no negative eigenvalue. A larger Q makes the filter trust its model less and the data more.",
        "Maybeck vol. 1, section 4.3",
    ),
    Help(
        "model.H",
        "Measurement matrix H",
        "How every measurement depends on the states, one row for each.",
        r"z(k) = H\,x(k) + v(k)",
        "(unit of the row's measurement) / (unit of the column's state)",
        "[[1, 0]]",
        "Not every state has to be measured: the model tells of the others. The page Understand says whether it does.",
    ),
    Help(
        "model.R",
        "Covariance of a measurement, R",
        "The mean square of the measurement's error v(k), and between measurements the mean of the product.",
        r"E[v(k)\,v(k)^T] = R",
        "(unit of the measurement)²",
        '[["sigma^2"]]',
        "0 on the diagonal: a perfect measurement; inf: none at all. Type sigma^2 where a data sheet gives a standard "
        "deviation.",
    ),
    Help(
        "model.Rc",
        "Strength of continuous measurement noise, Rc",
        "For a measurement taken all the time: the height of the flat spectrum of v. It gives the Kalman–Bucy filter, "
        "and without R also samples that stand for it where the period is short.",
        r"E[v(t)\,v(t')^T] = R_c\,\delta(t-t'), \qquad R = R_c/\Delta t",
        "(unit of the measurement)²·s",
        '[["sigma^2*0.2"]]',
        "Positive definite: without noise a continuous measurement would tell everything at once.",
        "Kalman & Bucy (1961)",
    ),
    Help(
        "model.N",
        "Noise common to plant and measurement, N",
        "Says how the noise of the plant and that of the measurement at the same time belong together; leave it out "
        "where they are independent, as they mostly are.",
        r"E[w(k)\,v(k)^T] = N",
        "discrete: (unit of the state)·(unit of the measurement); continuous: that of a strength, ·s",
        "[[0.0001], [0.0005]]",
        "One row for each state (discrete) or noise (continuous). Small enough that the covariance of both noises together "
        "has no negative eigenvalue.",
        "Anderson & Moore, Optimal Filtering (1979), section 5.5",
    ),
    Help(
        "model.x0",
        "Estimate at the beginning, x0",
        "What is believed of the states at t0 before any measurement: their mean.",
        r"\hat{x}(t_0) = E[x(t_0)] = x_0",
        "(unit of the state)",
        "[0, 0]",
    ),
    Help(
        "model.P0",
        "Uncertainty at the beginning, P0",
        "The covariance of the error of x0: on the diagonal the squares of the standard deviations.",
        r"P_0 = E[(\hat{x}(t_0)-x(t_0))\,(\hat{x}(t_0)-x(t_0))^T]",
        "(unit of the row)·(unit of the column)",
        '[["0.5^2", 0], [0, 1]]',
        "Symmetric, no negative eigenvalue. A large P0 says that little is known; 0 says that the state is known exactly.",
    ),
    Help(
        "model.dt",
        "Period dt",
        "The time from one measurement to the next. A continuous model is discretised over it exactly, however stiff.",
        r"\Phi = e^{F\Delta t}, \qquad Q_d = \int_0^{\Delta t} e^{F\tau}\,GQG^T e^{F^T\tau}\,d\tau",
        "s",
        "0.2",
        "Near half the period of an oscillation of the system, or a multiple of that, a state may become invisible.",
    ),
    Help(
        "model.Phi",
        "Transition matrix Φ",
        "What a step makes of the states, if nothing disturbs them.",
        r"x(k+1) = \Phi\,x(k) + c + w(k)",
        "(unit of the row) / (unit of the column)",
        '[[1, "0.2*(1 - 0.05)"], [0, "exp(-0.2/tau)"]]',
        "An eigenvalue beyond 1 makes the system unstable; its filter may well be stable.",
    ),
    Help(
        "model.Qd",
        "Covariance of the noise of a step, Qd",
        "How much a step adds to the uncertainty: the mean square of w(k). Not the strength Q of a continuous model.",
        r"E[w(k)\,w(k)^T] = Q_d",
        "(unit of the row)·(unit of the column)",
        '[["q*0.2^3/3", "q*0.2^2/2"], ["q*0.2^2/2", "q*0.2"]]',
        "Symmetric, no negative eigenvalue; it may be singular.",
    ),
    Help(
        "model.offset",
        "Known displacement c",
        "What is added to the states in every step, and is known: the effect of a control, a drift.",
        r"x(k+1) = \Phi\,x(k) + c(k) + w(k)",
        "(unit of the state)",
        "[0.002, 0.019]",
    ),
    Help(
        "model.t0",
        "Time of the beginning, t0",
        "The time at which x0 and P0 hold; step k is at t0 + k·dt.",
        unit="s",
        example="0",
        note="It matters only where a matrix depends on t.",
    ),
    Help(
        "model.transfer",
        "Block from a transfer function",
        "Noise that has passed through a filter: type the filter as a function of s. It becomes states of its own, driven "
        "by white noise, whose output takes the place of a noise or is added to a measurement.",
        r"\frac{y(s)}{w(s)} = \frac{b_1s^{n-1} + \dots + b_n}{s^n + a_1s^{n-1} + \dots + a_n}",
        example="3/(2*s + 1)",
        note="No higher power of s above than below the line; into a measurement a lower one: white noise as such has no "
        "finite variance.",
        source="Maybeck vol. 1, section 4.11",
    ),
    Help(
        "model.psd",
        "Block from a spectrum",
        "Noise that is not white: type its power spectral density as a function of ω, written w. It is factored into a "
        "stable shaping filter driven by white noise.",
        r"\Psi(\omega) = |H(j\omega)|^2, \qquad "
        r"E[y(t)\,y(t+\tau)] = \sigma^2e^{-a|\tau|} \ \leftrightarrow\  \Psi(\omega) = \frac{2a\sigma^2}{\omega^2 + a^2}",
        unit="unit²·s (two-sided, over ω in rad/s)",
        example="2*a/(w^2 + a^2)",
        source="Maybeck vol. 1, section 4.11",
    ),
)

_UNDERSTAND = (
    Help(
        "understand.observability",
        "Observability",
        "Whether the measurements, for long enough and without noise, would tell every state. What they do not tell is "
        "shown as a direction: a combination of states that never shows.",
        r"\operatorname{rank}\begin{bmatrix} H \\ \lambda I - F \end{bmatrix} = n "
        r"\ \text{for every eigenvalue}\ \lambda",
        note="The smallest singular value says how nearly it fails: a rank alone is a matter of rounding.",
        source="Popov, Belevitch, Hautus",
    ),
    Help(
        "understand.detectability",
        "Detectability",
        "Whether every mode that does not die out by itself is seen. This is all that the filter needs to stay bounded.",
        r"|\lambda| \ge 1 \ \Rightarrow\ \lambda\ \text{is observed}",
    ),
    Help(
        "understand.poles",
        "Poles",
        "The eigenvalues of the system and of its filter. Those of the filter say how fast an error at the beginning is "
        "forgotten.",
        r"\det(\lambda I - F) = 0, \qquad \det(zI - (I - KH)\Phi) = 0",
        unit="1/s (continuous), 1 (discrete)",
        note="Stable: negative real part (continuous), inside the unit circle (discrete).",
    ),
    Help(
        "understand.steady",
        "Steady state",
        "The limits of the covariances and of the gain after many measurements, from the algebraic Riccati equation.",
        r"P^- = \Phi\left[P^- - P^-H^T(HP^-H^T+R)^{-1}HP^-\right]\Phi^T + Q_d",
        note="K updates the estimate at the same time; the predictor's gain is ΦK.",
        source="Maybeck vol. 1, section 5.8",
    ),
    Help(
        "understand.transfer",
        "Transfer function of the filter",
        "The settled filter as what it then is: a linear filter from each measurement to each estimate.",
        r"\hat{x}(z) = \left[I - (I-KH)\Phi z^{-1}\right]^{-1}K\,z(z)",
    ),
    Help(
        "understand.bode",
        "Bode plot of the filter",
        "How the settled filter passes on a sine of each frequency: its size and its delay.",
        r"|W(e^{j\omega\Delta t})|, \qquad \angle W(e^{j\omega\Delta t})",
        unit="1, degrees, over rad/s",
        note="A large Q/R makes it wide (quick and noisy), a small one narrow (smooth and late).",
    ),
    Help(
        "understand.variance",
        "Standard deviation over time",
        "What the filter will be able to do, before there are any data: the root of P over time. The sawtooth is prediction "
        "(up) and measurement (down).",
        r"\sigma_i(t) = \sqrt{P_{ii}(t)}",
        unit="(unit of the state)",
    ),
)

_EXPERIMENT = (
    Help(
        "experiment.steps",
        "Steps",
        "How many measurements each run has, one every dt.",
        unit="1",
        example="200",
        note="Take several times the settling time, which the page Understand shows.",
    ),
    Help(
        "experiment.runs",
        "Runs",
        "How often the experiment is repeated with other noise. Statistics become sharper with the square root of this "
        "number.",
        r"\text{relative standard error of an RMS} \approx \frac{1}{\sqrt{2\,\text{runs}}}",
        "1",
        "1000",
        "1000 runs give an RMS to 2.2 %.",
    ),
    Help(
        "experiment.seed",
        "Seed",
        "The beginning of the random numbers: the same seed gives the same experiment, to the last digit.",
        unit="1",
        example="1",
        note="Change it to see which part of a figure is chance.",
    ),
    Help(
        "experiment.first",
        "First measurement",
        "Whether the first measurement is at t1 or already at t0, together with x0 and P0.",
        example="1",
    ),
    Help(
        "experiment.algorithms",
        "Algorithms",
        "Which forms of the filter compute the estimates. In exact arithmetic all give the same; on a computer they differ "
        "in rounding and in time. Choose several to compare them.",
        example="joseph, ud",
        note="Joseph's form is right nearly always. A table on the page Help says what each can do.",
    ),
    Help(
        "experiment.design",
        "Design model",
        "What the filter believes, where that is not the truth: data come from the model, the filter from this copy of it. "
        "So you see what a wrong assumption costs.",
        r"\text{truth}\ (\Phi, Q_d, H, R)\ \to\ z\ \to\ \text{filter made for}\ (\Phi', Q_d', H', R')",
        note="It has the same measurements as the truth. Its own covariance is then a claim; the errors say what is true.",
    ),
    Help(
        "experiment.anomalies",
        "Anomalies",
        "Single measurements that are lost (R = ∞) or perfect (R = 0), at instants you choose. The filter knows of them.",
        r"R_{jj}(k) = \infty \ \text{or}\ 0",
        example="k = 20, sensor, lost",
        note="A perfect measurement needs an algorithm that allows R = 0.",
    ),
    Help(
        "experiment.data",
        "Measured data",
        "A CSV file of your own measurements: one row per instant, one column per measurement with its name in the first "
        "row, and a column t if the instants are not equidistant. Empty cells are missing measurements.",
        example="t,sensor",
        note="There is no truth to compare with then: the innovations say whether the model fits.",
    ),
    Help(
        "experiment.progress",
        "Progress",
        "Runs done, their rate and the time left. Cancel ends the run within a second; the page can be used meanwhile.",
        unit="runs/s",
    ),
)


class Ability(NamedTuple):
    """What an algorithm can do, and what it costs.

    ``perfect`` a measurement with R = 0 · ``singular_start`` a singular P0 · ``singular_motion`` a singular Φ ·
    ``unknown`` no information at the beginning (inf in P0) · ``gaps`` missing measurements, matrices that vary ·
    ``cost`` operations per step, leading terms (n states, m measurements, s = rank of Qd)
    """

    perfect: bool
    singular_start: bool
    singular_motion: bool
    unknown: bool
    gaps: bool
    cost: str


#: The forms of the filter, by name.
ABILITIES = {
    "conventional": Ability(True, True, True, True, True, "4n³ + 6mn² + 4m²n"),
    "joseph": Ability(True, True, True, True, True, "8n³ + 6mn² + 6m²n"),
    "information": Ability(False, False, False, True, True, "(32/3)n³ + (6s + 2m)n² + (4s² + 2m²)n + 2s³/3"),
    "sequential": Ability(True, True, True, True, True, "4n³ + 8mn² + m²n"),
    "potter": Ability(True, True, True, True, True, "10n³/3 + 2sn² + 6mn²"),
    "carlson": Ability(True, True, True, True, True, "10n³/3 + 2sn² + 4.5mn²"),
    "array": Ability(True, True, True, True, True, "10n³/3 + 2sn² + 4(m+n)³/3 + 2mn²"),
    "extended_array": Ability(False, True, True, True, True, "10n³/3 + 2sn² + 4(m+n)³/3 + 2mn² + 2(m+n)²"),
    "ud": Ability(True, True, True, True, True, "4n³ + 2sn² + 4mn²"),
    "ld": Ability(True, True, True, True, True, "4n³ + 2sn² + 2(m+n)³ + 2mn²"),
    "srif": Ability(False, False, True, True, True, "7n³ + (12s + 2m)n² + (8s² + m²)n + 4s³/3"),
    "steady": Ability(True, True, True, False, False, "2n² + 4mn"),
}

_ALGORITHMS = (
    Help(
        "algorithm.conventional",
        "Conventional form",
        "The formulas of 1960: the covariance after a measurement is what it was, less what the measurement tells. The "
        "short formula, and the one that rounding spoils first.",
        r"P^+ = P^- - KHP^-, \qquad K = P^-H^T(HP^-H^T+R)^{-1}",
        note="Where a measurement is far better than the prediction, P⁺ is a small difference of large numbers: it loses "
        "digits, its symmetry, at last its sign.",
        source="Kalman (1960); Maybeck vol. 1, section 5.3",
    ),
    Help(
        "algorithm.joseph",
        "Joseph's form",
        "The covariance as a sum of two squares: it stays symmetric and nonnegative for every gain, even a rounded one. "
        "The form to begin with, and the default.",
        r"P^+ = (I-KH)\,P^-\,(I-KH)^T + KRK^T",
        source="Bucy & Joseph (1968), section 16.2; Maybeck vol. 1, section 5.6",
    ),
    Help(
        "algorithm.information",
        "Information form",
        "Carries the inverse of the covariance: a measurement then is a sum. Can begin with no information at all; takes "
        "many measurements cheaply.",
        r"Y = P^{-1}, \qquad Y^+ = Y^- + H^TR^{-1}H, \qquad y^+ = y^- + H^TR^{-1}z",
        note="Needs R > 0 and a regular P0 and Φ.",
        source="Maybeck vol. 1, section 5.7",
    ),
    Help(
        "algorithm.sequential",
        "Sequential form",
        "Takes the measurements of an instant one after another, as scalars: no matrix is inverted. Correlated ones are "
        "separated first. As accurate as Joseph's form.",
        r"f = Ph, \qquad s = h^Tf + d, \qquad K = f/s, \qquad P \leftarrow (I-Kh^T)P(I-Kh^T)^T + KdK^T",
        source="Bierman (1977), chapters II and V",
    ),
    Help(
        "algorithm.potter",
        "Potter's square root",
        "Carries S with P = SSᵀ, so that P cannot lose its sign; numbers have half the range of exponents, as if there were "
        "twice the digits. It flew with Apollo.",
        r"S \leftarrow S - \frac{(Sf)f^T}{s+\sqrt{sd}}, \qquad f = S^Th, \qquad s = f^Tf + d",
        source="Battin (1964), section 9.5; Bierman (1977), chapter V",
    ),
    Help(
        "algorithm.carlson",
        "Carlson's triangular square root",
        "A square root that is a triangle and stays one through every measurement: less to store and to compute than "
        "Potter's.",
        r"P = CC^T, \qquad C_j \leftarrow \sqrt{a/a'}\,C_j - \frac{f_j}{\sqrt{aa'}}\,e, \qquad a' = a + f_j^2",
        source="Carlson, AIAA Journal 11 (1973)",
    ),
    Help(
        "algorithm.array",
        "Array square root (SRCF)",
        "A whole step as an orthogonal transformation of an array of numbers: the most trustworthy of the forms, and the "
        "one for parallel hardware. Noises may be correlated.",
        r"\begin{bmatrix}R^{1/2} & HP_-^{1/2}\\ 0 & P_-^{1/2}\end{bmatrix}\Theta "
        r"= \begin{bmatrix}S^{1/2} & 0\\ \bar{K} & P_+^{1/2}\end{bmatrix}",
        source="Kaminski, Bryson & Schmidt (1971); Kailath, Sayed & Hassibi, chapter 12",
    ),
    Help(
        "algorithm.extended_array",
        "Extended array square root (eSRCF)",
        "The array with one more row, from which the correction of the estimate comes out as well.",
        r"\begin{bmatrix}R^{1/2} & HP_-^{1/2}\\ 0 & P_-^{1/2}\\ -\nu^TR^{-T/2} & 0\end{bmatrix}\Theta "
        r"= \begin{bmatrix}S^{1/2} & 0\\ \bar{K} & P_+^{1/2}\\ -\bar{e}^T & y^T\end{bmatrix}",
        note="Needs R > 0. Where measurements are 10⁴ times more precise than predictions, take the array form.",
        source="Park & Kailath (1995)",
    ),
    Help(
        "algorithm.ud",
        "Factors UDUᵀ",
        "As accurate as a square root, without computing any: P = U D Uᵀ, U a triangle of ones, D diagonal. The form of "
        "most navigation systems.",
        r"P = U\,\operatorname{diag}(d)\,U^T",
        source="Bierman (1977), chapters V and VI; Thornton & Bierman (1980)",
    ),
    Help(
        "algorithm.ld",
        "Factors LDLᵀ in an array",
        "The dual of UD, for the whole measurement at once: weighted Gram–Schmidt in place of rotations, no square roots.",
        r"\begin{bmatrix}L_R & HL_-\\ 0 & L_-\end{bmatrix} \to "
        r"\begin{bmatrix}L_S & 0\\ \bar{K} & L_+\end{bmatrix}, \qquad P = L\,\operatorname{diag}(d)\,L^T",
        source="Jover & Kailath, Automatica 22 (1986)",
    ),
    Help(
        "algorithm.srif",
        "Square-root information filter (SRIF)",
        "What is known of the states as equations ρx = b with errors of variance 1; a measurement is one more equation. "
        "Can begin with no information at all; the form of orbit determination.",
        r"\Theta\begin{bmatrix}R^{-1/2}H & R^{-1/2}z\\ \rho_- & b_-\end{bmatrix} "
        r"= \begin{bmatrix}\rho_+ & b_+\\ 0 & e\end{bmatrix}, \qquad P^{-1} = \rho^T\rho",
        note="Needs R > 0 and a regular P0; Φ may be singular where ΦPΦᵀ + Qd is regular.",
        source="Dyer & McReynolds (1969); Bierman (1977), chapters V and VI",
    ),
    Help(
        "algorithm.steady",
        "Steady gain",
        "The gain's limit from the first step on: no covariances to compute, so the cheapest of all. Until the optimal filter "
        "would have settled, its errors are larger than that one's.",
        r"\hat{x}^+ = \hat{x}^- + K_\infty(z - H\hat{x}^-)",
        note="Only for a model that does not vary, and with every measurement present.",
        source="Maybeck vol. 1, section 5.8",
    ),
)

_RESULT = (
    Help(
        "result.states",
        "Truth, measurement, estimate",
        "One run: each state as it was, as it was measured where it is measured by itself, and as the filter estimated it, "
        "with a band of one standard deviation.",
        r"\hat{x}^+(k) \pm \sqrt{P^+_{ii}(k)}",
        "(unit of the state)",
        note="The truth is inside the band at about 68 % of the instants. If it is not, the filter claims too much.",
    ),
    Help(
        "result.errors",
        "Errors against theory",
        "The root of the mean square of the errors over all runs, at each instant, beside the standard deviation that the "
        "filter claims. They agree where the model is true.",
        r"\sqrt{\frac{1}{N}\sum_{r=1}^{N}(\hat{x}_r-x_r)^2} \quad\text{against}\quad \sqrt{P^+_{ii}}",
        "(unit of the state)",
        note="The error is e = x̂ − x: positive where the estimate is too large.",
    ),
    Help(
        "result.gain",
        "Gain",
        "How much of a surprise in each measurement goes into each estimate. It does not depend on the data.",
        r"\hat{x}^+ = \hat{x}^- + K\nu, \qquad K = P^-H^T(HP^-H^T+R)^{-1}",
        "(unit of the state) / (unit of the measurement)",
    ),
    Help(
        "result.variances",
        "Variances before and after",
        "The sawtooth: a step of the model adds uncertainty (P⁻), a measurement takes some away (P⁺).",
        r"P^- = \Phi P^+\Phi^T + Q_d, \qquad P^+ = P^- - KHP^-",
        "(unit of the state)²",
    ),
    Help(
        "result.innovations",
        "Innovations",
        "What was measured less what was expected. Of a right model they are white noise, 95 % of them inside the band.",
        r"\nu = z - H\hat{x}^-, \qquad S = HP^-H^T + R, \qquad \pm 1.96\sqrt{S_{ii}}",
        "(unit of the measurement)",
        note="The only test that needs no truth: it works on your own data.",
    ),
    Help(
        "result.nis",
        "Normalised innovations squared, NIS",
        "The size of each innovation in its own standard deviations. Its mean is the number of measurements, if the model "
        "is right.",
        r"\nu^TS^{-1}\nu \sim \chi^2(m)",
        "1",
        note="Above the band: R or Q is too small, or the model is wrong. Below: they are too large.",
        source="Bar-Shalom, Li & Kirubarajan (2001), section 5.4",
    ),
    Help(
        "result.nees",
        "Normalised error squared, NEES",
        "The size of the error in the standard deviations that the filter claims. Its mean over the runs is the number of "
        "states, if the model is right.",
        r"e^TP^{-1}e \sim \chi^2(n)",
        "1",
        source="Bar-Shalom, Li & Kirubarajan (2001), section 5.4",
    ),
    Help(
        "result.whiteness",
        "Whiteness",
        "Whether an innovation can be told from the ones before it. If it can, the model misses something that the data have.",
        r"\hat{\rho}_l = \frac{\sum_k e_ke_{k+l}}{\sum_k e_k^2}, \qquad |\hat{\rho}_l| < \frac{1.96}{\sqrt{N}}",
        "1",
        note="One bar in twenty is outside by chance.",
    ),
    Help(
        "result.algorithms",
        "Table of algorithms",
        "Every chosen form on the same data: the error of its covariances and estimates against a filter with 50 digits, "
        "its operations, and its time per step.",
        r"\max_k \frac{\|P^+ - P_{50}\|}{\|P_{50}\|}",
        note="1e-16 is the rounding of one number. Times are as measured, and never the same twice.",
    ),
    Help(
        "result.statistics",
        "Statistics and theory",
        "Mean and mean square of the errors over the runs, with the probability that so much deviation from theory is "
        "chance.",
        note="All steps and states are tested together: a right filter fails once in a hundred million experiments.",
    ),
    Help(
        "result.diagnosis",
        "Diagnosis",
        "What the innovations say of the model: whether it fits, and if not, which change of R, Q, an input or a bias "
        "would make the data most likely.",
        r"2\ln\frac{\max_{a,b}\,p(z;\,aR,\,bQ_d)}{p(z;\,R,\,Q_d)} \approx \chi^2(2)",
    ),
    Help(
        "result.difference",
        "Difference of two models",
        "The truth and the design side by side, cell by cell, where they are not the same.",
    ),
)

_KEEP = (
    Help(
        "keep.list",
        "Kept experiments",
        "Every experiment with its model, settings, seed and results. They stay until you delete them, and a deleted one "
        "can be put back for 30 days.",
    ),
    Help(
        "keep.compare",
        "Compare two",
        "Two experiments side by side: what differs in the models and settings, and what came of it.",
    ),
    Help(
        "keep.rerun",
        "Run again",
        "The same model, settings and seed once more: the same numbers, to the last digit.",
    ),
    Help(
        "keep.export",
        "Export",
        "The report as one HTML file, the numbers as CSV or JSON, the figures as PNG or SVG, or the lines of Python that "
        "reproduce the experiment with the library.",
        example="report.html",
    ),
)

_LABS = (
    Help(
        "labs.parameter",
        "A lab's parameter",
        "A number of the lab's statement that you may change. Its range is said beside it. The report's analytic answers "
        "follow, and are checked again.",
        example="pi/2",
        note="Lists are numbers with commas between them.",
    ),
    Help(
        "labs.runs",
        "Runs of a lab's experiment",
        "How often the lab's computational experiment is repeated with other noise.",
        unit="1",
        example="1000",
    ),
    Help("labs.seed", "Seed of a lab's experiment", "The beginning of its random numbers.", unit="1", example="1"),
    Help(
        "labs.checks",
        "Checks",
        "Every number that the lab asks for is computed in two ways that have nothing in common. A check says whether "
        "they agree within its tolerance.",
        note="EXACT: the same algebra twice, 1e-12 of each element. SOLVER: a solver against a formula, 1e-8. ORDER: an "
        "approximation within its own error. CHANCE: an ensemble; all of a lab together fail once in a million by chance.",
    ),
    Help(
        "labs.variant",
        "Variants",
        "The practicum's three selections of labs for a course. A star marks the labs of the control sessions.",
    ),
)

TEXTS = (*_MODEL, *_UNDERSTAND, *_EXPERIMENT, *_ALGORITHMS, *_RESULT, *_KEEP, *_LABS)
