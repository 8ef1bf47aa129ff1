"""Loops that are compiled where numba is there, and run as plain Python where it is not.

What is compiled is kept in the user's cache folder, so that a second start does not compile; processes that start together
wait for the one that is compiling. numba would write beside the source
file, or where its process-wide setting points; a library changes neither. ``NUMBA_CACHE_DIR``, if the user has set it, is
respected, and ``NUMBA_DISABLE_JIT=1`` means plain Python.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])

#: Whether there is a compiler.
COMPILED = find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


def folder() -> Path:
    """The folder of the compiled kernels; each version has its own, as what is kept names modules of that version."""
    import platformdirs

    from ctlabs import __version__

    return Path(platformdirs.user_cache_dir("ctlabs", appauthor=False)) / "kernels" / __version__


def cold() -> bool:
    """Whether nothing has been compiled on this machine yet, so that the next call takes ten to twenty-five seconds."""
    return not any(folder().glob("*.nbi"))


def helper(function: F, **options: Any) -> F:
    """A function that compiled loops may call, and plain Python too.

    Sums keep their order: the result is the same to the bit in every process, and short vectors gain nothing from another order.
    """
    if not COMPILED:
        return function
    from numba.extending import register_jitable

    marked: F = register_jitable(**options)(function) if options else register_jitable(function)
    return marked


def kernel(function: F | None = None, **options: Any) -> Any:
    """A decorator for a loop over arrays: compiled, without the interpreter's lock, and kept; or as it stands, without warnings."""
    if function is None:
        return lambda own: kernel(own, **options)
    if not COMPILED:

        @wraps(function)
        def plain(*arguments: Any) -> Any:
            with np.errstate(all="ignore"):  # as numba's error model has it: infinities and NaN are looked for by the callers
                return function(*arguments)

        return plain
    import numba

    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy"} | options
    dispatcher = numba.njit(**settings)(function)
    keep(dispatcher)
    return dispatcher


def keep(dispatcher: Any) -> None:
    """Keep what ``dispatcher`` compiles in :func:`folder`; where that cannot be written it compiles anew each time."""
    from numba.core import caching

    class Locator(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):
        """numba's index of one source file, in our folder."""

        def __init__(self, py_func: Any, py_file: str) -> None:
            self._py_file = py_file
            self._lineno = py_func.__code__.co_firstlineno

        def get_cache_path(self) -> str:
            return str(folder())

        def get_source_stamp(self) -> str:
            """A kernel is compiled anew when its file or one beside it changes: its helpers may stand there."""
            files = [*sorted(Path(self._py_file).parent.glob("*.py")), Path(__file__).with_name("rounding.py")]
            return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()

    class Implementation(caching.CompileResultCacheImpl):
        """numba's file format."""

    Implementation._locator_classes = [Locator]

    class Cache(caching.FunctionCache):
        """The cache of one function."""

        _impl_class = Implementation

        def __init__(self, py_func: Any) -> None:
            """What other sources left may name types that are gone: it is of another version, and is not read."""
            super().__init__(py_func)  # type: ignore[no-untyped-call]  # numba has no types
            self._cache_file._version += f" {self._cache_file._source_stamp}"

    try:
        if os.environ.get("NUMBA_CACHE_DIR"):
            dispatcher.enable_caching()
        else:
            kind: Any = Cache
            dispatcher._cache = kind(dispatcher.py_func)
    except (OSError, RuntimeError):  # a read-only home: numba raises when no locator fits
        return
    name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
    dispatcher.compile = wraps(dispatcher.compile)(lambda signature: _once(dispatcher, name, signature))


def _once(dispatcher: Any, name: str, signature: Any) -> Any:
    """Compile, or load what another process compiled: numba looks into the folder when its turn has come."""
    from numba.core.compiler_lock import global_compiler_lock

    with global_compiler_lock, alone(name):  # numba's first: a thread that waits for it holds nothing that another one needs
        return type(dispatcher).compile(dispatcher, signature)


@contextmanager
def alone(name: str) -> Iterator[None]:
    """A stretch in which one process at a time is, of those that compile ``name``; where files have no locks, any number of them."""
    file = _locked(folder() / f"{name}.lock")
    try:
        yield
    finally:
        if file is not None:
            file.close()


def _locked(path: Path) -> IO[str] | None:
    """The file, once no other process has it; the system lets it go when the file is closed or the process ends."""
    try:
        import fcntl

        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
    except (ImportError, OSError):
        return None
    try:
        fcntl.lockf(file, fcntl.LOCK_EX)  # of this process: a child that is forked meanwhile does not inherit it
    except OSError:
        file.close()
        return None
    return file
