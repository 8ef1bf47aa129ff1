"""Workers and checkpoints: the same bytes whoever computes, whatever fails, wherever it was stopped."""

import errno
import json
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ctlabs.models import DiscreteModel, NonlinearModel
from ctlabs.montecarlo import (
    BlockFailed,
    Interrupted,
    checkpoint,
    executors,
    identity,
    monte_carlo,
    plan,
    simulate,
    sweep,
    team,
)
from tests.reference import EXACT, close

MODEL = DiscreteModel([[0.9, 0.2], [0, 0.8]], [[1, 0.2], [0.2, 0.5]], [[1, 0]], [[0.7]], x0=[1, 2], P0=[[4, 1], [1, 2]])
#: Twelve blocks, the last one not full.
EXPERIMENT = {"steps": 40, "runs": 1150, "seed": 3, "progress": False}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """A hundred runs to a block, so that small experiments have many."""
    monkeypatch.setattr(plan, "layout", _layout := (lambda n, steps: plan.Tiling(50, 2)))
    monkeypatch.setattr("ctlabs.montecarlo.linear.layout", _layout)
    monkeypatch.setattr("ctlabs.montecarlo.functional.layout", _layout)


def same(a, b):
    """Whether every array of two statistics has the same bytes."""
    names = [name for name in type(a).__slots__ if isinstance(getattr(a, name), np.ndarray)]
    assert len(names) > 15
    return a.runs == b.runs and all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in names)


class Here(Executor):
    """Computes in this thread as if elsewhere; ``trouble`` may raise before a task, numbered from 0."""

    def __init__(self, trouble=lambda number: None):
        self.trouble, self.number, self._max_workers = trouble, -1, 2

    def submit(self, function, /, *args, **kwargs):
        self.number += 1
        future = Future()
        future.set_running_or_notify_cancel()
        try:
            self.trouble(self.number)
            future.set_result(function(*pickle.loads(pickle.dumps(args)), **kwargs))
        except Exception as why:
            future.set_exception(why)
        return future


@pytest.fixture(scope="module")
def expected():
    """The statistics that one worker gives, made with the blocks of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ctlabs.montecarlo.linear.layout", lambda n, steps: plan.Tiling(50, 2))
        return monte_carlo(MODEL, **EXPERIMENT, workers=1)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_any_number_of_threads_gives_the_same_bytes(workers, expected):
    """One, two or three threads: every byte of the statistics agrees; another seed differs."""
    assert same(monte_carlo(MODEL, **EXPERIMENT, workers=workers), expected)
    assert not same(monte_carlo(MODEL, **{**EXPERIMENT, "seed": 4}, workers=workers), expected)


def test_an_executor_of_ones_own_is_used_and_left_running(expected):
    """Thread pools and any other executor give the same bytes, and are not shut down."""
    with ThreadPoolExecutor(2) as pool:
        assert same(monte_carlo(MODEL, **EXPERIMENT, executor=pool), expected)
        assert pool.submit(int, 3).result() == 3
    executors.EXPERIMENTS.clear()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=Here()), expected)


def test_a_worker_without_the_experiment_is_sent_it(expected):
    """A worker that lost the experiment asks for it, and nothing is computed from another one."""
    executor = Here(lambda number: executors.EXPERIMENTS.clear() if number == 5 else None)
    executors.EXPERIMENTS.clear()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=executor), expected)
    assert 12 <= executor.number < 24  # twelve blocks, some of them sent twice
    for seed in range(6):  # a worker keeps only a few experiments
        monte_carlo(DiscreteModel([[0.5]], [[1]], [[1]], [[1 + seed]], x0=[0], P0=[[1]]), **EXPERIMENT, executor=Here())
    assert len(executors.EXPERIMENTS) <= 4


def test_failed_blocks_are_tried_again(expected):
    """Blocks whose worker fails now and then are computed again, with the same result."""

    def now_and_then(number):
        if number % 3 == 1:
            raise OSError("lost")

    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=Here(now_and_then)), expected)


def test_a_block_that_always_fails_is_an_error_that_keeps_the_rest(tmp_path, expected):
    """After three further attempts the error names block, runs and cause; what was finished is used the next time."""

    def from_the_sixth(number):
        if number >= 5:
            raise OSError("no such worker")

    with pytest.raises(
        BlockFailed, match=r"block \d+ \(runs \d+00 to \d+99\): failed 4 times.*OSError: no such worker"
    ) as caught:
        monte_carlo(MODEL, **EXPERIMENT, executor=Here(from_the_sixth), checkpoint=tmp_path)
    assert f"checkpoint={str(tmp_path)!r} resumes" in str(caught.value)
    counting = Here()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=counting, checkpoint=tmp_path), expected)
    assert counting.number + 1 == 12 - 5
    with pytest.raises(BlockFailed, match="nothing is kept"):
        monte_carlo(MODEL, **EXPERIMENT, executor=Here(from_the_sixth))


def test_an_executor_that_breaks_and_is_not_ours_is_an_error():
    """A broken executor of the caller's is reported at once; a pool that was shut down likewise."""

    def broken(number):
        if number == 3:
            raise BrokenExecutor("all workers died")

    with pytest.raises(BlockFailed, match="all workers died"):
        monte_carlo(MODEL, **EXPERIMENT, executor=Here(broken))
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(BlockFailed, match="shutdown"):
        monte_carlo(MODEL, **EXPERIMENT, executor=pool)


def test_workers_of_our_own_that_die_are_replaced(expected, monkeypatch):
    """When all processes are gone new ones are started, and the blocks that went down with them computed again."""
    made = []

    def processes(count):
        def dies(number, first=not made):
            if first and number >= 4:
                raise BrokenExecutor("killed")

        made.append(Here(dies))
        return made[-1]

    monkeypatch.setattr(executors, "_processes", processes)
    executors.EXPERIMENTS.clear()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor="processes", workers=2), expected)
    assert len(made) == 2


def test_functions_that_cannot_travel_are_refused():
    """A lambda cannot go to another process: the error says what to do."""
    model = NonlinearModel(lambda k, x, w: x + w, lambda k, x, v: x + v, [[1]], [[1]], [0], [[1]])
    with pytest.raises(TypeError, match="expected functions defined at the top of a module"):
        monte_carlo(model, steps=3, runs=3, seed=1, executor=Here())
    assert monte_carlo(model, steps=3, runs=3, seed=1, progress=False).runs == 3


def test_an_overflow_is_not_tried_again():
    """An overflow comes from the numbers: it is raised as it is."""

    def overflow(number):
        raise FloatingPointError("overflow at step 3")

    executor = Here(overflow)
    with pytest.raises(FloatingPointError, match="overflow at step 3"):
        monte_carlo(MODEL, **EXPERIMENT, executor=executor)
    assert executor.number <= 5


# Checkpoints


def stop_at(runs):
    """Progress that presses Ctrl-C after so many runs."""

    def progress(done, total):
        if done >= runs:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("where", [1, 300, 1000, 1100, 1150])
def test_an_interrupted_experiment_resumes_with_the_same_bytes(tmp_path, where, expected):
    """Ctrl-C at any time says how to resume; resumed it computes only the rest, with the same bytes."""
    with pytest.raises(
        Interrupted, match=rf"interrupted after \d+ of 1150 runs; .*checkpoint={str(tmp_path)!r} resumes"
    ):
        monte_carlo(MODEL, **{**EXPERIMENT, "progress": stop_at(where)}, workers=2, checkpoint=tmp_path)
    seen = []
    again = monte_carlo(MODEL, **{**EXPERIMENT, "progress": lambda done, _: seen.append(done)}, checkpoint=tmp_path)
    assert same(again, expected)
    assert seen[0] >= where - where % 100


def test_an_interrupt_without_a_checkpoint_says_so():
    """Without a folder nothing is kept, and the message says how to keep it."""
    with pytest.raises(Interrupted, match="nothing is kept"):
        monte_carlo(MODEL, **{**EXPERIMENT, "progress": stop_at(500)})


def test_more_runs_go_on_from_the_record(tmp_path, expected):
    """A record of some runs serves for more, not for fewer, and is never spoilt by either."""
    short = monte_carlo(MODEL, **{**EXPERIMENT, "runs": 450}, checkpoint=tmp_path)
    counting = Here()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=counting, checkpoint=tmp_path), expected)
    assert counting.number + 1 <= 8
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert same(monte_carlo(MODEL, **{**EXPERIMENT, "runs": 450}, checkpoint=tmp_path), short)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_finished_experiment_is_read_back(tmp_path, expected):
    """A second call computes nothing."""
    monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)
    counting = Here()
    assert same(monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path, executor=counting), expected)
    assert counting.number == -1


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.99])
def test_truncated_files_are_computed_again(tmp_path, share, expected):
    """Any file cut anywhere counts as absent: the result has the same bytes."""
    with pytest.raises(Interrupted):
        monte_carlo(MODEL, **{**EXPERIMENT, "progress": stop_at(900)}, checkpoint=tmp_path)
    files = sorted(tmp_path.iterdir())
    assert len(files) > 3
    for path in files[:: 2 if share else 1]:
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
    assert same(monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path), expected)


def test_one_damaged_record_of_the_merged_sums_is_not_missed(tmp_path, monkeypatch, expected):
    """The merged sums are kept twice; with the newer one damaged nothing is lost."""
    monkeypatch.setattr(checkpoint, "INTERVAL", 0.0)
    monte_carlo(MODEL, **EXPERIMENT, workers=1, checkpoint=tmp_path)
    newest = max(tmp_path.glob("merged-*"), key=lambda path: path.stat().st_mtime_ns)
    newest.write_bytes(newest.read_bytes()[:-1] + b"?")
    counting = Here()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=counting, checkpoint=tmp_path), expected)
    assert counting.number == -1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 4}, r"seed 3 there, 4 here"),
        ({"steps": 41}, r"steps 40 there, 41 here"),
        ({"first": 0}, r"first 1 there, 0 here"),
        (
            {"truth": DiscreteModel(MODEL.Phi, 1.01 * MODEL.Qd, MODEL.H, MODEL.R, x0=MODEL.x0, P0=MODEL.P0)},
            r"truth \w+ there",
        ),
        (
            {"design": DiscreteModel(MODEL.Phi, MODEL.Qd, MODEL.H, 1.01 * MODEL.R, x0=MODEL.x0, P0=MODEL.P0)},
            r"\(design \w+ there",
        ),
    ],
)
def test_a_checkpoint_of_another_experiment_is_refused(tmp_path, change, message):
    """Another seed, length, truth or design is refused, and the message says which it is."""
    monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)
    with pytest.raises(ValueError, match=f"expected the same experiment in .*{message}"):
        monte_carlo(**{"truth": MODEL, **EXPERIMENT, **change}, checkpoint=tmp_path)


def test_a_checkpoint_of_another_version_is_refused(tmp_path, monkeypatch):
    """Sums of another version of the kernel are not mixed with ours, with or without the description."""
    monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)
    monkeypatch.setattr(identity, "FORMAT", "0")
    with pytest.raises(
        ValueError, match=f"format {json.loads((tmp_path / 'experiment.json').read_text())['format']} there, 0 here"
    ):
        monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)
    (tmp_path / "experiment.json").write_text("{")
    with pytest.raises(ValueError, match="received another one"):
        monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)


def test_a_folder_that_cannot_be_is_refused(tmp_path):
    """A checkpoint inside a file is one line."""
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="checkpoint: expected a folder that can be written"):
        monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path / "file" / "folder")


def test_a_full_disk_is_reported_and_costs_nothing_but_the_record(tmp_path, monkeypatch, expected):
    """With no space left the experiment goes on after one warning; what was saved before is whole, and nothing is half written."""
    write = Path.write_bytes

    def full(path, content):
        if ".sums" in path.name and len(list(tmp_path.iterdir())) > 5:
            write(path, content[: len(content) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.warns(RuntimeWarning, match="No space left on device.*goes on") as caught:
        assert same(monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path), expected)
    assert len(caught) == 1
    monkeypatch.setattr(Path, "write_bytes", write)
    assert not list(tmp_path.glob(".*"))
    counting = Here()
    assert same(monte_carlo(MODEL, **EXPERIMENT, executor=counting, checkpoint=tmp_path), expected)
    assert 0 < counting.number + 1 < 12


def test_what_a_killed_process_left_is_swept_up(tmp_path):
    """Half-written files of a process long dead disappear; those of a living one stay."""
    old, young = tmp_path / ".block-00000000-100.sums.1", tmp_path / ".block-00000001-100.sums.2"
    for path in (old, young):
        path.write_bytes(b"")
    os.utime(old, (1, 1))
    monte_carlo(MODEL, **EXPERIMENT, checkpoint=tmp_path)
    assert not old.exists()
    assert young.exists()


def test_a_digest_knows_code_and_the_values_it_refers_to():
    """Functions differ by what they compute and close over, not by where they are defined twice alike."""

    def made(a):
        return lambda k, x, w: a * x + w

    def other(a):
        return lambda k, x, w: a * x - w

    assert identity.digest(made(1.0)) == identity.digest(made(1.0))
    assert identity.digest(made(1.0)) != identity.digest(made(2.0))
    assert identity.digest(made(1.0)) != identity.digest(other(1.0))
    assert identity.digest(made(np.zeros(2))) != identity.digest(made(np.ones(2)))
    assert identity.digest(MODEL) != identity.digest(DiscreteModel([[1]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]]))
    assert identity.digest({1, 2}, {"a": made}, int, MODEL.H.dot, same) == identity.digest(
        {2, 1}, {"a": made}, int, MODEL.H.dot, same
    )


def test_one_team_serves_a_whole_sweep():
    """The workers of a sweep are made once and serve every point."""
    with team("threads", 2) as crew:
        result = sweep(
            lambda r: DiscreteModel([[1]], [[1]], [[1]], [[r]], x0=[0], P0=[[1]]),
            {"r": [1.0, 2.0]},
            **EXPERIMENT,
            executor=crew,
        )
        assert not crew.stop.is_set()
    assert result.surface("rms_1").shape == (2,)


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    """Without dask, or without a scheduler, the message says what was expected."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"expected the extra 'cluster' for tcp://nowhere:1"):
        monte_carlo(MODEL, **EXPERIMENT, executor="tcp://nowhere:1")


# In processes of their own


SCRIPT = """
import sys, numpy as np
from ctlabs.models import DiscreteModel
from ctlabs.montecarlo import Interrupted, monte_carlo

MODEL = DiscreteModel([[0.9, 0.2], [0, 0.8]], [[1, 0.2], [0.2, 0.5]], [[1, 0]], [[0.7]], x0=[1, 2], P0=[[4, 1], [1, 2]])

if __name__ == "__main__":
    folder, runs, executor, workers = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    print("ready", flush=True)
    try:
        stats = monte_carlo(MODEL, steps=1000, runs=runs, seed=3, executor=executor, workers=workers, checkpoint=folder or None)
    except Interrupted as why:
        print(why)
        sys.exit(130)
    np.save(folder + "/result.npy", np.concatenate([stats.cov.ravel(), stats.nees, stats.nis[1:], stats.bias.ravel()]))
"""


def start(tmp_path, folder, runs, executor="threads", workers=2):
    """A script that runs an experiment in a process of its own."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(folder), str(runs), executor, str(workers)]
    root = str(Path(__file__).parents[2])
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": root},
    )


def finish(process):
    """Its output, when it has ended well."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out


def result(tmp_path, folder, *how):
    """The bytes of an experiment's result, run to its end."""
    finish(start(tmp_path, folder, *how))
    return (folder / "result.npy").read_bytes()


@pytest.mark.slow
def test_a_killed_experiment_resumes_with_the_same_bytes(tmp_path):
    """Killed (SIGKILL) twenty times at random moments, and finished at last, an experiment gives the same bytes."""
    whole, broken_ = tmp_path / "whole", tmp_path / "broken"
    runs = 400_000
    expected = result(tmp_path, whole, runs)
    rng, seen = np.random.default_rng(1), []
    for kill in range(20):
        before = _blocks_on_record(broken_)
        if before > 100:  # of 200: begin anew, so that no process can come to its end
            for path in broken_.iterdir():
                path.unlink()
            before = 0
        process = start(tmp_path, broken_, runs)
        assert process.stdout.readline() == "ready\n"
        # Every fifth is killed while it starts, the others while blocks are computed, written and merged.
        while kill % 5 and _blocks_on_record(broken_) <= before and process.poll() is None:
            time.sleep(0.002)
        time.sleep(rng.uniform(0.0, 0.25))
        assert process.poll() is None
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        assert _blocks_on_record(broken_) >= before
        seen.append(_blocks_on_record(broken_))
    assert len(set(seen)) > 10
    assert result(tmp_path, broken_, runs) == expected


def _blocks_on_record(folder):
    """Finished blocks in a folder that a process may be writing."""
    names = [path.name.split("-")[1] for path in folder.glob("block-*.sums")]
    merged = [json.loads(path.read_bytes().split(b"\n")[1])["number"] for path in folder.glob("merged-*.sums")]
    return len({int(name) for name in names} | set(range(max(merged, default=0))))


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_ctrl_c_stops_long_before_the_end(tmp_path, executor):
    """After an interrupt the process ends (of hours of work), without a traceback, and says how to resume."""
    process = start(tmp_path, tmp_path / "record", 50_000_000, executor)
    assert process.stdout.readline() == "ready\n"
    while not list((tmp_path / "record").glob("block-*.sums")):
        assert process.poll() is None
        time.sleep(0.01)
    time.sleep(0.3)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)  # benchmarks/interrupt.py shows how long it takes
    assert process.returncode == 130
    assert "the same call with checkpoint=" in out
    assert "Traceback" not in err


@pytest.mark.slow
def test_processes_give_the_bytes_of_threads(tmp_path):
    """Two threads, two processes and three processes: the same bytes."""
    threads = result(tmp_path, _folder(tmp_path, "threads"), 20_500)
    for workers in (2, 3):
        assert result(tmp_path, _folder(tmp_path, f"processes-{workers}"), 20_500, "processes", workers) == threads


def _folder(tmp_path, name):
    (tmp_path / name).mkdir()
    return tmp_path / name


@pytest.mark.slow
def test_a_process_that_compiles_gives_the_bytes_of_one_that_loads(tmp_path):
    """The first process compiles the kernel, the second loads it and compiles nothing: both give the same bytes."""
    kernels = tmp_path / "kernels"
    results, compiled = [], []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(kernels))
        for name in ("compiles", "loads"):
            results.append(result(tmp_path, _folder(tmp_path, name), 2500))
            compiled.append({path: path.stat().st_mtime_ns for path in kernels.rglob("*.nb?")})
    assert results[0] == results[1]
    assert compiled[0] == compiled[1] != {}


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # dask's own shutdown may warn
def test_a_dask_cluster_gives_the_bytes_of_threads(tmp_path):
    """A local cluster of two workers, by its address and as an executor, gives the bytes of threads; a lost worker is made good."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    threads = result(tmp_path, _folder(tmp_path, "threads"), 60_500)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True) as cluster:
        address = cluster.scheduler_address
        assert result(tmp_path, _folder(tmp_path, "dask"), 60_500, address) == threads
        process = start(tmp_path, lost := _folder(tmp_path, "lost"), 60_500, address)
        assert process.stdout.readline() == "ready\n"
        while not list(lost.glob("block-*.sums")) and process.poll() is None:
            time.sleep(0.01)
        victim = next(iter(cluster.workers.values()))
        os.kill(victim.pid, signal.SIGKILL)
        finish(process)
        assert (lost / "result.npy").read_bytes() == threads
        with distributed.Client(cluster) as client:
            pool = client.get_executor()
            here = monte_carlo(MODEL, steps=1000, runs=1000, seed=3, executor=pool, progress=False)
        assert close(here.rms, monte_carlo(MODEL, steps=1000, runs=1000, seed=3, progress=False).rms, EXACT)


@pytest.mark.slow
def test_mpi_workers_give_the_bytes_of_threads(tmp_path):
    """Two MPI workers through mpi4py.futures give the bytes of threads."""
    pytest.importorskip("mpi4py", reason="mpi4py is not installed")
    from shutil import which

    launcher = which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if launcher is None:
        pytest.skip("no mpiexec: an MPI is not installed")
    script = tmp_path / "parallel.py"
    root = str(Path(__file__).parents[2])
    script.write_text(
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from mpi4py.futures import MPIPoolExecutor\n"
        "from tests.montecarlo.test_montecarlo_workers import MODEL, same\n"
        "from ctlabs.montecarlo import run\n"
        "if __name__ == '__main__':\n"
        "    how = dict(steps=1000, runs=20_500, seed=3, progress=False)\n"
        "    with MPIPoolExecutor(max_workers=2) as pool:\n"
        "        print('same', same(monte_carlo(MODEL, **how, executor=pool), monte_carlo(MODEL, **how)))\n"
    )
    allowed = {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    }
    command = [launcher, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script), root]
    environment = {**os.environ, "PYTHONPATH": root, **allowed}
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, env=environment)
    assert "same True" in done.stdout, done.stderr


def test_memory_does_not_grow_with_runs():
    """What an experiment holds is bounded by the blocks in flight, whatever the number of runs."""
    import tracemalloc

    peaks = []
    for runs in (2000, 40_000):
        tracemalloc.start()
        monte_carlo(MODEL, **{**EXPERIMENT, "runs": runs}, workers=2)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2 * peaks[0] + 200_000
    assert simulate(MODEL, 2, 3, seed=1).x.shape == (3, 2, 3)
