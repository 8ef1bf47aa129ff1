"""What a process of runs says to the server, request by request; here the process is that of the tests."""

import os
import resource
import signal
import threading
from collections.abc import Iterator
from multiprocessing import Pipe
from typing import Any

import pytest

from ctlabs.workbench.runs import inside


def double(x: float, workers: int) -> tuple[float, int]:
    """A run that takes the number of its threads, and tells nothing."""
    return 2 * x, workers


def counted(steps: int, progress: Any) -> int:
    """A run that tells how far it is."""
    for step in range(1, steps + 1):
        progress(step, steps, f"step {step}")
    return steps


def failing(how: str) -> Any:
    """A run that does not end well."""
    if how == "refused":
        msg = "steps: expected a whole number,\n received 0.5"
        raise ValueError(msg)
    if how == "memory":
        raise RuntimeError(how) from MemoryError()
    if how == "failed":
        raise RuntimeError(how)
    return lambda: how  # cannot be pickled


FUNCTIONS = {each.__name__: f"{__name__}:{each.__name__}" for each in (double, counted, failing)}


@pytest.fixture
def as_before() -> Iterator[None]:
    """A process of runs leaves Ctrl-C to the server, limits its memory, and asks for one thread."""
    handler, limit, told = signal.getsignal(signal.SIGINT), resource.getrlimit(resource.RLIMIT_AS), dict(os.environ)
    yield
    signal.signal(signal.SIGINT, handler)
    resource.setrlimit(resource.RLIMIT_AS, limit)
    os.environ.clear()
    os.environ.update(told)


def answers(*requests: Any) -> list[Any]:
    """All that is said after "loaded" until the last request is answered; then the server goes."""
    server, process = Pipe()
    said: list[Any] = []
    runs = sum(request != "stop" for request in requests)

    def serve() -> None:
        assert server.recv() == "loaded"
        while sum(each[0] != "progress" for each in said) < runs:
            said.append(server.recv())
        server.close()

    for request in requests:
        server.send(request)
    reader = threading.Thread(target=serve)
    reader.start()
    inside.work(process, FUNCTIONS, ("math",), 2**50)
    reader.join()
    return said


def test_each_request_has_its_answer(as_before: None) -> None:
    """A result, what was refused in one line, what failed with its kind, a result that cannot be sent; a late "stop" ends nothing."""
    kinds = ("refused", "memory", "failed", "unsendable")
    said = answers(("double", {"x": 2.5}, 3), "stop", *(("failing", {"how": how}, 1) for how in kinds), ("unknown", {}, 1))
    assert said[0] == ("done", (5.0, 3))
    assert [(each[0], each[1]) for each in said[1:]] == [("failed", kind) for kind in ("refused", "memory", "failed", "failed", "failed")]
    assert said[1][2] == "steps: expected a whole number, received 0.5"
    assert said[3][2] == "RuntimeError: failed"
    assert said[4][2].startswith("the result cannot be sent: ")
    assert said[5][2] == "KeyError: 'unknown'"
    assert "Traceback" in said[3][3]


def test_a_run_tells_how_far_it_is_and_ends_when_it_is_told(as_before: None) -> None:
    """The last step is always told; "stop" during a run ends it as one that nobody wants."""
    said = answers(("counted", {"steps": 3}, 1))
    assert said[-2:] == [("progress", 3, 3, "step 3"), ("done", 3)]
    said = answers(("counted", {"steps": 3}, 1), "stop")
    assert said == [("failed", "cancelled", "cancelled", "")]


def test_a_server_that_has_gone_ends_the_process(as_before: None) -> None:
    server, process = Pipe()
    server.close()
    inside.work(process, FUNCTIONS, (), 2**50)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
