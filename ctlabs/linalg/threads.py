"""How many threads the linear algebra uses."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

_CONTROLLER: list[Any] = []
#: Who is within :func:`one_thread` now, of all threads of the process, and what puts the setting back when the last one leaves.
_WITHIN: list[object] = []
_LEAVING = ExitStack()
_TURN = threading.Lock()


@contextmanager
def one_thread() -> Iterator[None]:
    """BLAS on one thread, for the workers are the parallel part; the setting before is put back.

    The setting is one of the process: of several that ask for it at a time the first makes it, and the last puts it back.
    """
    import scipy.linalg  # noqa: F401  # brings a BLAS of its own, which is to be found
    from threadpoolctl import ThreadpoolController

    own = object()
    with _TURN:
        if not _WITHIN:
            if not _CONTROLLER:
                _CONTROLLER.append(ThreadpoolController())  # looks through the loaded libraries, so only once
            _LEAVING.enter_context(_CONTROLLER[0].limit(limits=1, user_api="blas"))
        _WITHIN.append(own)
    try:
        yield
    finally:
        with _TURN:
            _WITHIN.remove(own)
            if not _WITHIN:
                _LEAVING.close()
