"""Every lab at the corners of what is allowed: its checks pass, its references lead somewhere, and no word or number is missing."""

import re

import pytest

from ctlabs.labs import catalogue as labs
from ctlabs.reporting.crossrefs import complaints
from ctlabs.reporting.markdown import markdown
from tests.labs.test_tasks import numbers

LABS = labs.catalogue()
inf = float("inf")
#: Noise that is absent, a start that is known, measurements that are perfect or lost, signals far above and below their noise.
CORNERS = [
    ("task01", {"sigma_w2": 0}), ("task01", {"R": [1, inf, 1, 0, 1, 1, 1], "P0": 0}), ("task01", {"R": 1e-6}),
    ("task02", {"u": 0}), ("task02", {"u": -1000, "R": 1e-6}),
    ("task03", {"sigma_w2": 0}), ("task03", {"R": 1e6, "tau": 0.01}),
    ("task04", {"tau": 100}), ("task04", {"R": 0}),
    ("task05", {"theta": 0}), ("task05", {"sigma_theta": 0.2}), ("task05", {"D": 20000}),
    ("task06", {"R": [inf, inf]}), ("task06", {"R": [0, 1, 0], "P0": 1e6}),
    ("task07", {"Phi": 1.3, "Q": 0, "K_star": 0.1}), ("task07", {"Phi": 0}),
    ("task08", {"a": 0, "T": 50}), ("task08", {"T": 1, "dt": 0.01}), ("task08", {"dt": 0.05}),
    ("task09", {"R_over_b2": 0}), ("task09", {"dt": 20, "C1": 100}),
    ("task10", {"dt_bad": 1.5708, "dt_good": 3.14159}), ("task10", {"dt_bad": 6.2, "dt_good": 3.2, "P0": [[4, 0], [0, 2]]}),
    ("task11", {"Q": 0}), ("task11", {"x1_second_moment": 1}),
    ("task12", {"t": 1.5707963267948966}), ("task12", {"P_posterior": 1e4, "x_posterior": 400}),
    ("task13", {"N_c": 36, "N_m": 81, "var_hc0": 22500}), ("task13", {"N_c": 0}),
    ("task14", {"fixes": 3}), ("task14", {"horizon": 60, "limit_rms": 20}),
    ("task15", {"wn": 1}), ("task15", {"w0": 0, "Q2": 0}),
    ("task16", {"dt": 50}), ("task16", {"P0": 8}), ("task16", {"Q": 0}),
    ("task17", {"q1": 0}),
    ("task18", {"sigma_r": 0.05}), ("task18", {"sigma_theta": 1e-9, "sigma_r": 1}),
    ("task19", {"beta": -1}), ("task19", {"alpha": 1, "beta": 1}),
    ("task20", {"R_values": [100], "P0": 0}),
    ("task21", {"P0": 0}),
    ("task22", {"a": 0}), ("task22", {"Q1": 0}),
    ("task23", {"noise_pole": 2}),
    ("coloured_plant", {"a": 1}), ("coloured_plant", {"a": -1, "b": 0}),
    ("slow_error", {"mu": 0, "sigma_mu2": 0}),
    ("field", {"dt": 0.3, "allow_unstable": True}), ("field", {"N1": 2, "m": 5, "node": 1}),
    ("task24", {"R": 0, "Phi_true": 1.45}), ("task24", {"Phi": 0.8, "Qu": 0, "P0": 0, "steps": 1}), ("task24", {"Phi": 1, "L_star": 9}),
    ("task24", {"R": 0, "Qu": 0, "P0": 0, "Phi": 2, "Phi_true": 0.1}), ("task24", {"Phi": 1.001, "Qu": 1e4, "R": 1e4, "Q": 1e-3}),
    ("task25", {"Qu": 0, "Rc": 0, "tau": 0}), ("task25", {"tau": 1.3, "dt_a": 57.44360221995541, "Qu_a": 1e4}),
    ("task25", {"dt": 20, "Rc": 0}), ("task25", {"dt": 0.001, "tau": 0.02, "Qu": 0, "Q": 1e-4}),
    ("task25", {"N_c": 1e-2, "N_m": 1e6, "dt_a": 300, "Qu_a": 1e-4}),
    ("task26", {"m": 1.2, "mu": 0}), ("task26", {"q": 1e4, "sigma": 1e4, "m": 1}),
    ("task26", {"q": 1e-6, "sigma": 1e-6, "m": 1.05, "mu": 1e6}),
    ("task26", {"q": 1e4, "sigma": 1e-3, "m": 0.99999, "mu": 1e-3}),
]  # fmt: skip


def test_every_lab_has_a_corner():
    """None is left out."""
    assert {name for name, _setting in CORNERS} == set(LABS)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "setting"), CORNERS, ids=[f"{name} {setting}" for name, setting in CORNERS])
def test_a_corner_is_reported_whole(name, setting):
    """With 25 runs and blank figures."""
    report = numbers(LABS[name], runs=25, **setting)
    assert [check for check in report.checks if not check.passed] == []
    assert complaints(report) == []
    body = markdown(report).split("## Appendix")[0]
    assert re.findall(r'[^\n]*(?:(?<!")\b(?:nan|NaN|inf)\b|[=:|] None\b)[^\n]*', body) == []
    assert re.findall(r"[^\n]*\(not in this report\)[^\n]*", body) == []
