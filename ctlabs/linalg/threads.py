"""How many threads the linear algebra uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_CONTROLLER: list[Any] = []


@contextmanager
def one_thread() -> Iterator[None]:
    """BLAS on one thread, for the workers are the parallel part; the setting before is put back."""
    import scipy.linalg  # noqa: F401  # brings a BLAS of its own, which is to be found
    from threadpoolctl import ThreadpoolController

    if not _CONTROLLER:
        _CONTROLLER.append(ThreadpoolController())  # looks through the loaded libraries, so only once
    with _CONTROLLER[0].limit(limits=1, user_api="blas"):
        yield
