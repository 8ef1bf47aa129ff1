"""What all tests share: reproducible hypothesis runs, English texts, one thread per worker."""

import os

os.environ["LANGUAGE"] = "en"  # read by gettext when ctlabs.text is imported
for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")  # read when numpy loads

import pytest  # noqa: E402  # after the environment is set
from hypothesis import is_hypothesis_test, settings  # noqa: E402

# Derandomised: the same examples on every machine; the seeds of a failing run are those of the next one.
settings.register_profile("ctlabs", deadline=None, derandomize=True, max_examples=50, print_blob=True)
settings.load_profile("ctlabs")


def pytest_addoption(parser: pytest.Parser) -> None:
    """How many of hypothesis's examples are run, at most; and how many random models."""
    parser.addoption("--examples", type=int, help="run at most so many examples of each property (tests/kernels.py)")
    parser.addoption("--twins", type=int, default=8, help="random models of each of four seeds (tests/test_twins.py)")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Fewer examples of every property, where the option asks for it."""
    limit = config.getoption("--examples")
    for item in items if limit else ():
        test = getattr(getattr(item, "obj", None), "__func__", getattr(item, "obj", None))
        if is_hypothesis_test(test):
            own = test._hypothesis_internal_use_settings
            test._hypothesis_internal_use_settings = settings(own, max_examples=min(limit, own.max_examples))
