"""BLAS on one thread while anybody asks for it, and as before afterwards."""

from contextlib import ExitStack

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from ctlabs.linalg.threads import one_thread


def threads() -> set[int]:
    """How many threads each BLAS of this process uses."""
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.mark.parametrize("order", ["first in, first out", "first in, last out"])
def test_the_last_to_leave_puts_the_setting_back(order: str) -> None:
    """Whoever leaves first: the number of threads is the one before, not what the second found."""
    with threadpool_limits(2, user_api="blas"):
        first, second = ExitStack(), ExitStack()
        first.enter_context(one_thread())
        second.enter_context(one_thread())
        assert threads() == {1}
        leaving = (first, second) if order == "first in, first out" else (second, first)
        leaving[0].close()
        assert threads() == {1}
        leaving[1].close()
        assert threads() == {2}


def test_an_exception_puts_it_back_too() -> None:
    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(ArithmeticError), one_thread():
            raise ArithmeticError
        assert threads() == {2}
