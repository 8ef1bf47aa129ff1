"""The tests on every Python that is found, with the lowest versions that pyproject.toml admits, and without numba.

python .ci/matrix.py [PYTEST'S ARGUMENTS] makes an environment for each below build/matrix (with uv, which it installs there) and prints a
line for each. Without arguments it runs what `make test` runs; `make matrix TESTS="tests/linalg"` tries a part. Ends with 1 if one failed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "build" / "matrix"
VERSIONS = ("3.11", "3.12", "3.13", "3.14", "3.15")


class Case(NamedTuple):
    """One environment: its name, its interpreter, further options of the installation, and what is taken out again."""

    name: str
    python: str
    options: tuple[str, ...] = ()
    without: str = ""


def interpreters() -> Iterator[tuple[str, str]]:
    """Version and path of every Python that runs."""
    for version in VERSIONS:
        for path in candidates(version):
            code = "import sys, venv; print('%d.%d' % sys.version_info[:2])"
            done = subprocess.run([path, "-c", code], capture_output=True, text=True, check=False)
            if done.stdout.strip() == version:
                yield version, path
                break


def candidates(version: str) -> list[str]:
    """Where a version may be: on the path, and where pyenv keeps it."""
    found = shutil.which(f"python{version}")
    kept = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python"))
    return [*map(str, reversed(kept)), *([found] if found else [])]


def uv() -> Path:
    """The installer, in an environment of its own."""
    place = PLACE / "uv"
    if not (place / "bin" / "uv").exists():
        subprocess.run([sys.executable, "-m", "venv", place], check=True)
        subprocess.run([place / "bin" / "python", "-m", "pip", "install", "--quiet", "uv"], check=True)
    return place / "bin" / "uv"


def tried(case: Case, tests: Sequence[str]) -> bool:
    """Install for a case, and run the tests in it."""
    place, installer = PLACE / case.name, uv()
    python = place / "bin" / "python"
    subprocess.run([installer, "venv", "--quiet", "--clear", "--python", case.python, place], check=True)
    install = [installer, "pip", "install", "--quiet", "--python", python, *case.options, "--editable", f"{ROOT}[test]"]
    if subprocess.run(install, check=False).returncode:
        return False
    if case.without:
        subprocess.run([installer, "pip", "uninstall", "--quiet", "--python", python, *case.without.split()], check=True)
    environment = os.environ | {"XDG_CACHE_HOME": str(place / "cache")}
    command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode == 0


def main(tests: Sequence[str]) -> int:
    """Try all; 1 if one failed."""
    found = list(interpreters())
    if not found:
        print("no Python >= 3.11 found", file=sys.stderr)
        return 1
    PLACE.mkdir(parents=True, exist_ok=True)
    (oldest, python), *_ = found
    cases = [Case(version, path) for version, path in found]
    cases += [Case(f"{oldest}-lowest", python, ("--resolution", "lowest-direct"))]
    cases += [Case(f"{oldest}-without-numba", python, without="numba llvmlite")]
    results = {}
    for case in cases:
        print(f"== {case.name}", flush=True)
        results[case.name] = tried(case, tests or ("-m", "not slow", "-n", "2", "--dist", "loadgroup"))
    missing = set(VERSIONS) - {version for version, _ in found}
    print("\n".join(f"{name:<20} {'passed' if good else 'FAILED'}" for name, good in results.items()))
    print("not found: " + (", ".join(sorted(missing)) or "none"))
    return int(not all(results.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
