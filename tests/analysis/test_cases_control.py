"""Transfer functions and spectra of the cases, judged with 40 digits, and the published Wiener filters."""

from __future__ import annotations

from typing import Any

import control
import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from ctlabs.files import datafile, modelfile
from ctlabs.filtering import bucy
from ctlabs.models import ContinuousModel, DiscreteModel, interop, shaping, spectra
from tests.cases import Case, near, numerics, peers

pytestmark = pytest.mark.numerical

Array = NDArray[Any]


def tolerance(case: Case, name: str) -> float:
    """The number in "relative 1e-9" or "|H| relative 1e-6"."""
    return float(case["tolerance"][name].split()[-1])


def resolved(A: Array, b: Array, s: Any) -> Any:
    """(sI − A)⁻¹b with the digits of mpmath's context."""
    pencil = s * mpmath.eye(len(A)) - mpmath.matrix(A.tolist())
    return mpmath.lu_solve(pencil, mpmath.matrix(b.tolist()))


def response(model: ContinuousModel, w: float, output: int = 0, source: int = 0) -> Any:
    """H(jωI − F)⁻¹G + D of a model made with Q = 1, whose N is then D; 40 digits."""
    with mpmath.workdps(40):
        x = resolved(model.F, model.G[:, source], mpmath.mpc(0, w))
        direct = 0.0 if model.N is None else model.N[source, output]
        return mpmath.fsum(mpmath.mpf(h) * v for h, v in zip(model.H[output].tolist(), x, strict=True)) + direct


def magnitude(model: DiscreteModel, w: float) -> float:
    """|H| of a discrete model made with Q = 1 and R = 0, from the spectrum of its output; 40 digits."""
    with mpmath.workdps(60):
        z = mpmath.expj(mpmath.mpf(w) * model.dt)
        # (zI − Φᵀ)⁻¹Hᵀ once gives H(zI − Φ)⁻¹ times anything.
        left = resolved(np.array(model.Phi.T), model.H[0], z)
        row = np.array(left.tolist(), dtype=object).ravel()
        through = row @ np.vectorize(mpmath.mpf, otypes=[object])(model.Qd) @ np.vectorize(mpmath.conj)(row)
        cross = 0 if model.N is None else (row @ np.vectorize(mpmath.mpf, otypes=[object])(model.N[:, 0]))
        return float(mpmath.sqrt((through + 2 * cross + float(model.R[0, 0])).real))


def made(case: Case, **more: Any) -> ContinuousModel | DiscreteModel:
    """The model of a case's transfer function, driven by white noise of strength 1."""
    given = case["given"]
    system = control.tf(given["num"], given["den"], given.get("dt", 0))
    n, inputs = case["right"]["states"], system.ninputs
    return interop.from_control(system, Q=np.eye(inputs), P0=np.zeros((n, n)), noise="input", **more)


PLANTS = [p for p in numerics("k7_*") if "states" in p.values[0]["right"]]
SEVERAL = [p for p in PLANTS if isinstance(p.values[0]["given"]["den"][0], list)]
SINGLE = [p for p in PLANTS if p not in SEVERAL]


@pytest.mark.parametrize("case", [p for p in SINGLE if "dt" not in p.values[0]["given"]])
@pytest.mark.parametrize("realisation", interop.REALISATIONS)
def test_a_transfer_function_keeps_its_response(case: Case, realisation: str) -> None:
    """Every coefficient counts, whatever its size; the way back through the model's polynomials ends where it began."""
    model = made(case, realisation=realisation)
    assert isinstance(model, ContinuousModel)
    limit = tolerance(case, "response")
    num, den = shaping.transfer_function(model)
    for w, *right in case["right"]["response"]:
        assert abs(response(model, w) / mpmath.mpc(*right) - 1) < limit
        with mpmath.workdps(40):
            back = mpmath.polyval(num.tolist(), mpmath.mpc(0, w)) / mpmath.polyval(den.tolist(), mpmath.mpc(0, w))
            direct = 0.0 if model.N is None else model.N[0, 0]
            assert abs((back + direct) / mpmath.mpc(*right) - 1) < limit
    if "direct" in case["right"]:
        assert model.N is not None
        assert model.N[0, 0] == case["right"]["direct"]
    if "G_observable_form" in case["right"] and realisation == "observable":
        assert model.G[:, 0].tolist() == case["right"]["G_observable_form"]


@pytest.mark.parametrize("case", [p for p in SINGLE if "dt" in p.values[0]["given"]])
def test_a_digital_filter_keeps_its_response(case: Case) -> None:
    """Numerators below 1e-14 are what a slow digital filter has."""
    model = made(case, R=[[0.0]])
    assert isinstance(model, DiscreteModel)
    for w, *right in case["right"]["response"]:
        assert abs(magnitude(model, w) / abs(complex(*right)) - 1) < tolerance(case, "response")


@pytest.mark.parametrize("case", SEVERAL)
def test_several_inputs_and_outputs_go_by_columns(case: Case) -> None:
    """Each response is that of its entry, and the states are named after their input."""
    model = made(case)
    assert isinstance(model, ContinuousModel)
    for i, row in enumerate(case["right"]["response"]):
        for j, entry in enumerate(row):
            for w, *right in entry:
                assert abs(response(model, w, i, j) / mpmath.mpc(*right) - 1) < tolerance(case, "response")
    named = [name.partition("_")[0] for name in model.states]
    assert named == (["u1", "u1", "u2", "u2"] if model.s == 2 else ["x1", "x2", "x3"])


@pytest.mark.parametrize("case", numerics("k7_improper"))
def test_an_improper_function_is_refused(case: Case) -> None:
    """It differentiates white noise."""
    with pytest.raises(ValueError, match=r"expected a proper transfer function.*differentiates"):
        interop.from_control(control.tf(case["given"]["num"], case["given"]["den"]), Q=[[1]], P0=[[0]])


def spectrum_at(num: Any, den: Any, w: float) -> float:
    """|num/den|² at s = jω with 40 digits."""
    with mpmath.workdps(40):
        top, bottom = (mpmath.polyval([mpmath.mpf(c) for c in p], mpmath.mpc(0, w)) for p in (num, den))
        return float(abs(top / bottom) ** 2)


FACTORED = [p for p in numerics("k8_*") if "S" in p.values[0]["right"]]
REFUSED = [p for p in numerics("k8_*") if p.values[0]["right"].get("refused")]
RESONANCES = [p for p in numerics("k8_*") if "or_refused_says" in p.values[0]["right"]]


@pytest.mark.parametrize("case", FACTORED)
def test_multiple_zeros_and_poles_factor(case: Case) -> None:
    """Zeros of any even order on the axis, clusters of them, and poles of order 8."""
    num, den = spectra.factor(spectra.parse(case["given"]["spectrum"]))
    largest = max(S for _, S in case["right"]["S"])
    for w, S in case["right"]["S"]:
        found = spectrum_at(num, den, w)
        assert abs(found - S) < (1e-6 * S if S > 1e-9 * largest else 1e-15 * largest)
    for name, p in (("num", num), ("den", den)):
        assert np.allclose(p, case["right"][name], rtol=1e-14, atol=0)


@pytest.mark.parametrize("case", REFUSED)
def test_a_negative_density_is_refused_with_its_frequency(case: Case) -> None:
    """However narrow the band, the message names a frequency inside it."""
    with pytest.raises(ValueError, match="expected a density >= 0 at every frequency, received a negative one") as caught:
        spectra.parse(case["given"]["spectrum"])
    low, high = case["right"]["negative_between"]
    assert low < float(str(caught.value).rpartition("w = ")[2]) < high


@pytest.mark.parametrize("case", RESONANCES)
def test_a_faint_damping_is_found_or_said_to_be_lost(case: Case) -> None:
    """A text says it exactly; doubles hold a damping of 1e-6, and of 1e-8 no more, which is no pole at a real frequency."""
    exact = spectra.parse(case["given"]["spectrum"])
    assert abs(spectra.factor(exact)[1][1] / case["right"]["den"][1] - 1) < 1e-12
    if case["right"]["or_refused_says"]:
        with pytest.raises(ValueError, match=r"above the precision of the coefficients.* at w = 1 ") as caught:
            spectra.Spectrum(exact.num, exact.den)
        assert "pole at a real frequency" not in str(caught.value)
        return
    _, den = spectra.factor(spectra.Spectrum(exact.num, exact.den))
    assert abs(den[1] / case["right"]["den"][1] - 1) < float(case["tolerance"]["damping"].split()[-1])


@pytest.mark.parametrize("published", peers("spectra"))
def test_published_wiener_filters(published: Case) -> None:
    """By the spectra, and by the Kalman-Bucy filter of the shaping filter."""
    signal, white = spectra.parse(published["given"]["signal"]), published["given"]["white"]
    found = spectra.wiener(signal, spectra.white(white))
    block = spectra.shaping_filter(signal)
    limit = bucy.steady(ContinuousModel(block.F, block.G, block.Q, block.H, Rc=[[white]], P0=block.P0))
    expected, tolerances = published["expected"], published["tolerance"]
    near(found.mse, expected["mse"], tolerances["mse"])
    near((block.H @ limit.P @ block.H.T)[0, 0], expected["mse"], tolerances["mse"])
    if "pole" in expected:
        near(np.roots(found.den)[0], expected["pole"], tolerances["pole"])
        near(limit.poles[0], expected["pole"], tolerances["pole"])


@pytest.mark.parametrize("case", numerics("k9_times_digits"))
def test_times_are_written_with_the_digits_that_distinguish_them(case: Case) -> None:
    """Two rows of one time, and two times that differ in the last digit of a double."""
    for times, says in ((case["given"]["t"], case["right"]["says"]), (["0.1", "0.30000000000000004", "0.3"], ["0.3000000"])):
        content = "t,z\n" + "".join(f"{t},1\n" for t in times)
        with pytest.raises(ValueError, match="column t: expected a time after") as caught:
            datafile.parse(content.encode(), ["z"])
        assert all(word in str(caught.value) for word in says)
        assert not any(word in str(caught.value) for word in case["right"]["says_not"])


def test_a_model_under_the_constants_is_told_that_its_section_is_missing() -> None:
    """[constants] in front of what should stand under [model]: one message with what is missing and what to write."""
    text = 'format = 1\nkind = "discrete"\n[constants]\nq = 2\nstates = ["x"]\nPhi = [[1]]\n'
    told = "expected a table [model], received none, and states, Phi under [constants]; write [model] above"
    assert modelfile.loads(text, check=False).problems() == [modelfile.Problem("model", told)]


def test_logarithms_have_their_base() -> None:
    """log10 and ln are themselves, not log."""
    text = 'format = 1\nkind = "discrete"\n[constants]\na = "log10(1000)"\nb = "ln(e^2)"\nc = "log2(8)"\n[model]\n'
    text += 'Phi = [["a"]]\nQd = [["b"]]\nH = [["c"]]\nR = [[1]]\nP0 = [[1]]\ndt = 1\n'
    assert modelfile.loads(text).constants == {"a": 3.0, "b": 2.0, "c": 3.0}
