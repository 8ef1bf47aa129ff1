"""The wheel and the source distribution, the same bytes wherever and whenever a commit is built.

python .ci/dist.py [FOLDER] builds them from the folder above this one. The time in the archives is SOURCE_DATE_EPOCH, or that of the last
commit. setuptools heeds it in wheels; the source distribution is packed again here.
"""

from __future__ import annotations

import gzip
import io
import os
import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def main(out: Path) -> None:
    """Build both into ``out``."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH") or committed()
    command = [sys.executable, "-m", "build", "--outdir", str(out), str(ROOT)]
    subprocess.run(command, env=os.environ | {"SOURCE_DATE_EPOCH": epoch}, check=True, stdout=subprocess.DEVNULL)
    for path in out.glob("*.tar.gz"):
        path.write_bytes(repacked(path.read_bytes(), int(epoch)))


def committed() -> str:
    """The time of the last commit, in seconds since 1970."""
    command = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def repacked(archive: bytes, epoch: int) -> bytes:
    """The files of a packed archive in order, with one time, no owner, and the two usual modes."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=io.BytesIO(archive)) as old, tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as new:
        for member in sorted(old.getmembers(), key=lambda each: each.name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = epoch, 0, 0, "", ""
            member.mode = 0o755 if member.isdir() else 0o644
            member.pax_headers = {}
            new.addfile(member, old.extractfile(member) if member.isfile() else None)
    return gzip.compress(plain.getvalue(), mtime=epoch)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "dist"))
