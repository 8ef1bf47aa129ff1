"""Jobs in processes of their own: in the order of the jobs where that is asked for, and no further one after a failure."""

import time
from pathlib import Path

import pytest

from ctlabs.labs.together import several


def slow_first(number: int) -> int:
    """The first is ready last."""
    time.sleep(1.0 if number == 0 else 0.0)
    return number


def marked(job: tuple[Path, int]) -> int:
    """The first job fails; the others leave a file."""
    folder, number = job
    if number == 0:
        raise ValueError("no")
    time.sleep(0.2)
    (folder / str(number)).touch()
    return number


def test_results_come_as_they_are_ready_or_in_order():
    """One and two at a time give the same ones."""
    assert list(several(slow_first, [0, 1, 2], 2, ordered=True)) == [0, 1, 2] == list(several(slow_first, [0, 1, 2], 1))
    assert sorted(several(slow_first, [0, 1, 2], 2)) == [0, 1, 2]


def test_after_a_failure_no_further_job_begins(tmp_path):
    """Of fifty, those that were handed over at that moment."""
    with pytest.raises(ValueError, match="no"):
        list(several(marked, [(tmp_path, number) for number in range(50)], 2))
    assert len(list(tmp_path.iterdir())) < 25
