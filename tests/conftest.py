"""What all tests share: reproducible hypothesis runs, English texts, one thread per worker."""

import gc
import os
import sys
from collections.abc import Iterator
from importlib import import_module
from pkgutil import walk_packages

os.environ["LANGUAGE"] = "en"  # read by gettext when ctlabs.text is imported
for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")  # read when numpy loads

import pytest  # noqa: E402  # after the environment is set
from hypothesis import is_hypothesis_test, settings  # noqa: E402

import ctlabs  # noqa: E402
from tests.untraced import untraced, unwatched  # noqa: E402

# Derandomised: the same examples on every machine; the seeds of a failing run are those of the next one.
settings.register_profile("ctlabs", deadline=None, derandomize=True, max_examples=50, print_blob=True)
settings.load_profile("ctlabs")


#: Modules of ctlabs that do something when they are loaded.
PROGRAMS = ("ctlabs.__main__", "ctlabs.workbench.runs.warm")
#: Libraries of others that the tests load in any case.
HEAVY = ("control", "filterpy.kalman", "matplotlib.figure", "mpmath", "nicegui", "numba.core.dispatcher", "pandas", "scipy.stats", "sympy")


@untraced
def _others() -> None:
    """What costs most of the code of others is loaded, and marked."""
    for library in HEAVY:
        import_module(library)
    import matplotlib.figure
    import mpmath
    import numba.core.dispatcher
    import sympy
    from matplotlib.backend_bases import FigureCanvasBase

    for place, names in (
        (numba.core.dispatcher.Dispatcher, ["compile"]),
        (FigureCanvasBase, ["print_figure"]),
        (matplotlib.figure.FigureBase, ["subplots", "legend"]),
        (matplotlib.axes.Axes, ["plot", "fill_between", "step", "hist"]),
        (mpmath.matrix, ["__add__", "__sub__", "__mul__", "__pow__"]),
        (mpmath.mp, ["lu_solve", "inverse", "expm", "cholesky", "eigsy", "quad"]),
        (sympy, ["simplify"]),
    ):
        for name in names:
            setattr(place, name, untraced(getattr(place, name)))


def _looked_at(config: pytest.Config) -> bool:
    """Whether coverage looks at this process; the one that hands out the tests runs none."""
    return sys.gettrace() is not None and config.getoption("dist", "no") == "no"


def pytest_configure(config: pytest.Config) -> None:
    """Coverage looks away from the code of others that takes long (the pieces of ctlabs that are called back there are tiny)."""
    if _looked_at(config):
        _others()


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """Coverage sees how the modules of ctlabs are loaded, and need not see how pytest looks for tests. Ten thousand tests are kept."""
    if _looked_at(session.config):
        for module in walk_packages(ctlabs.__path__, "ctlabs."):
            if module.name not in PROGRAMS:
                import_module(module.name)
    gc.disable()  # what is loaded and collected stays to the end: no search for garbage need go through it, now or later
    try:
        with unwatched():
            return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    """How many of hypothesis's examples are run, at most; which cases; and how many random models."""
    parser.addoption("--examples", type=int, default=10, help="run at most so many examples of each property")
    parser.addoption("--share", default="0/1", help="i/n: of the cases of a parametrised test every n-th, from the i-th on")
    parser.addoption("--variants", type=int, default=3, help="students' variants of each lab that are run (tests/course/test_issue.py)")
    parser.addoption("--twins", type=int, default=8, help="random models of each of four seeds (tests/test_twins.py)")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Properties are marked, and have as many examples as the option allows and they ask for."""
    limit = config.getoption("--examples")
    for item in items:
        test = getattr(getattr(item, "obj", None), "__func__", getattr(item, "obj", None))
        if is_hypothesis_test(test):
            own = test._hypothesis_internal_use_settings
            test._hypothesis_internal_use_settings = settings(own, max_examples=min(limit, own.max_examples))
            item.add_marker(pytest.mark.property)
    items[:] = dealt(items, *map(int, config.getoption("--share").split("/")))


def dealt(items: list[pytest.Item], i: int, n: int) -> list[pytest.Item]:
    """Every n-th case of each test with several, from the i-th on; tests of one case are kept. All i together have all cases."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept = {id(item) for own in cases.values() for item in (own[i::n] or own)}
    return [item for item in items if id(item) in kept]
