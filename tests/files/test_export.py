"""Matrices and gains in files: the same doubles to the bit, in every format, and nothing overwritten by accident."""

import re
import shutil
import struct
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat

from ctlabs.files import export
from ctlabs.filtering import steady
from ctlabs.labs.experiment import covariances
from ctlabs.models import ContinuousModel, DiscreteModel

MODEL = DiscreteModel(
    [[1, 0.1], [-0.1, 0.7]], [[1 / 3, 0.01], [0.01, 0.2]], [[1, 0], [1e-300, 1 / 7]], [[0.5, 0.1], [0.1, 2000]],
    x0=[-0.0, 3], P0=[[2e20, 0], [0, 5e-324]], dt=0.1, offset=[0.0, 1e-3], states=["x", "v"], units=["m", "m/s"],
)  # fmt: skip
N = replace(MODEL, N=[[0.01, 0.0], [0.0, 0.02]])
GONE = replace(MODEL, R=[[0.5, 0.0], [0.0, np.inf]], N=None)
HOSTILE = replace(
    MODEL,
    states=("*/ int main(void) { return 1; } /*", 'a\\\nb "quoted" ??/'),
    units=("m²/°C \u202e */", "/*/"),
    measurements=("Δφ\x00", "*" * 3 + "/"),
)
VARYING = replace(MODEL, Phi=np.stack([MODEL.Phi, 0.9 * MODEL.Phi, MODEL.Phi]), offset=np.arange(6.0).reshape(3, 2))

CASES = {
    "steady": lambda: (MODEL, steady.solve(MODEL)),
    "correlated": lambda: (N, steady.solve(N)),
    "absent": lambda: (GONE, steady.solve(GONE)),
    "schedule": lambda: (MODEL, covariances(MODEL, 4)),
    "varying": lambda: (VARYING, covariances(VARYING, 3, first=0)),
    "hostile": lambda: (HOSTILE, steady.solve(HOSTILE)),
}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]()


def expected(model, result):
    """What a file must hold."""
    names = ("Phi", "Qd", "H", "R", "N", "B", "D", "offset", "measurement_offset", "x0", "P0", "dt")
    found = {name: getattr(model, name) for name in names}
    found |= {name: getattr(result, name) for name in result.__slots__ if name != "algorithm"}
    return {name: np.asarray(value) for name, value in found.items() if value is not None}


def same(a, b):
    """Equal to the bit: signs of zeros and infinities included."""
    a, b = np.asarray(a), np.asarray(b)
    return a.shape == b.shape and np.array_equal(a, b) and np.array_equal(np.signbit(a.real), np.signbit(b.real))


class TestNumpy:
    def test_every_array_comes_back_to_the_bit(self, case, tmp_path):
        """By name, without pickles, with the names of states and measurements."""
        model, result = case
        with np.load(export.write(model, result, tmp_path / "gains.npz"), allow_pickle=False) as file:
            wanted = expected(model, result)
            assert set(file) == {*wanted, "states", "units", "measurements"}
            assert all(same(file[name], value) for name, value in wanted.items())
            assert file["states"].tolist() == list(model.states)

    def test_a_gain_that_was_changed_is_not_the_same(self, tmp_path):
        """The comparison of these tests sees one bit."""
        result = steady.solve(MODEL)
        K = np.array(result.K)
        K[0, 0] = np.nextafter(K[0, 0], 1.0)
        with np.load(export.write(MODEL, result, tmp_path / "gains.npz")) as file:
            assert not same(file["K"], K)


class TestMatlab:
    def test_every_array_comes_back_to_the_bit_in_matlabs_order(self, case, tmp_path):
        """Vectors are columns, the time of a stack is its last index, names are cells."""
        model, result = case
        file = loadmat(export.write(model, result, tmp_path / "gains.mat"))
        for name, value in expected(model, result).items():
            if value.ndim == 3:
                assert same(file[name], np.moveaxis(value, 0, -1)), name
            elif value.ndim == 2 and name in ("offset", "used"):
                assert same(file[name], value.T), name
            else:
                assert same(file[name], value.reshape(-1, 1) if value.ndim < 2 else value), name
        assert [str(cell[0]) for cell in file["states"].ravel()] == list(model.states)


class TestHeader:
    @pytest.mark.skipif(shutil.which("gcc") is None, reason="needs a C compiler")
    def test_a_compiler_reads_the_same_doubles(self, case, tmp_path):
        """Compiled without a warning, included twice, every element has the bits it had; hostile names do no harm."""
        model, result = case
        export.write(model, result, tmp_path / "my-filter.h")
        wanted = expected(model, result)
        prints = "".join(f"dump((const double *)&my_filter_{name}, sizeof my_filter_{name});" for name in wanted)
        (tmp_path / "main.c").write_text(
            '#include <stdio.h>\n#include "my-filter.h"\n#include "my-filter.h"\n'
            "static void dump(const double *a, size_t n) { fwrite(a, 1, n, stdout); }\n"
            f"int main(void) {{ {prints} return my_filter_n == {model.n} && my_filter_m == {model.m} ? 0 : 1; }}\n"
        )
        flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wcomment", "-Wtrigraphs", "-Werror"]
        command = ["gcc", *flags, "main.c", "-o", "main"]
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert built.returncode == 0, built.stderr
        printed = subprocess.run([tmp_path / "main"], capture_output=True, check=True).stdout
        parts = [np.stack([v.real, v.imag], -1) if np.iscomplexobj(v) else v for v in wanted.values()]
        doubles = np.concatenate([part.astype(float).ravel() for part in parts])
        assert printed == struct.pack(f"={len(doubles)}d", *doubles)

    def test_dimensions_equations_names_and_units_are_there(self, tmp_path):
        """A reader needs no other file."""
        text = export.write(MODEL, covariances(MODEL, 4), tmp_path / "track.h").read_text(encoding="utf-8")
        assert "#ifndef CTLABS_TRACK_H\n#define CTLABS_TRACK_H" in text
        assert "static const double track_K[5][2][2] = " in text
        assert "#define track_steps 4" in text
        assert "static const double track_dt = 0.10000000000000001;" in text
        for words in ('x[1]: "v", "m/s"', 'z[0]: "z1"', "x_plus[k]    = x_minus[k] + K (z[k] - H x_minus[k])"):
            assert words in text

    def test_no_name_ends_the_comment(self, tmp_path):
        """Marks of comments, backslashes, line ends and invisible characters are made harmless; letters stay."""
        text = export.write(HOSTILE, steady.solve(HOSTILE), tmp_path / "x.h").read_text(encoding="utf-8")
        comment, rest = text.split("*/", 1)
        assert "/*" not in comment[2:]
        assert rest.lstrip().startswith("#ifndef")
        assert "Δφ" in comment
        assert "m²/°C" in comment
        assert all(c.isprintable() or c == "\n" for c in text)

    @pytest.mark.parametrize(("stem", "name"), [("2nd run", "m_2nd_run"), ("_x", "m__x"), ("Δ", "m__"), ("a.b", "a_b")])
    def test_the_files_name_becomes_an_identifier(self, stem, name, tmp_path):
        """Whatever the file is called, its arrays have names of C."""
        text = export.write(MODEL, steady.solve(MODEL), tmp_path / f"{stem}.h").read_text(encoding="utf-8")
        assert f"static const double {name}_K[2][2]" in text
        assert re.search(rf"#define CTLABS_{name.upper()}_H\n", text)


class TestFiles:
    def test_a_file_that_exists_is_kept_unless_told_otherwise(self, tmp_path):
        """The message says how; with overwrite it is replaced as a whole, and nothing else is left in the folder."""
        path = tmp_path / "gains.npz"
        path.write_text("precious")
        with pytest.raises(
            FileExistsError, match=r"path: expected a new file \(or overwrite=True\), received .*gains.npz"
        ):
            export.write(MODEL, steady.solve(MODEL), path)
        assert path.read_text() == "precious"
        export.write(MODEL, steady.solve(MODEL), path, overwrite=True)
        assert np.load(path)["dt"] == 0.1
        assert [p.name for p in tmp_path.iterdir()] == ["gains.npz"]

    def test_without_links_a_file_is_kept_too(self, tmp_path, monkeypatch):
        """On a file system that knows no hard links."""

        def refuse(self, target):
            raise PermissionError

        monkeypatch.setattr("pathlib.Path.hardlink_to", refuse)
        path = export.write(MODEL, steady.solve(MODEL), tmp_path / "gains.npz")
        before = path.read_bytes()
        with pytest.raises(FileExistsError):
            export.write(MODEL, steady.solve(MODEL), path)
        assert path.read_bytes() == before
        assert len(list(tmp_path.iterdir())) == 1

    def test_a_write_that_fails_leaves_the_previous_file_whole(self, tmp_path, monkeypatch):
        """The disk is full: the old file stays, the part is gone."""
        path = export.write(MODEL, steady.solve(MODEL), tmp_path / "gains.h")
        before = path.read_bytes()

        def full(self, target):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("pathlib.Path.replace", full)
        with pytest.raises(OSError, match="No space"):
            export.write(MODEL, steady.solve(MODEL), path, overwrite=True)
        assert path.read_bytes() == before
        assert len(list(tmp_path.iterdir())) == 1

    @pytest.mark.parametrize("name", ["gains.txt", "gains", "gains.npz.bak"])
    def test_other_suffixes_are_refused(self, name, tmp_path):
        """The message lists those that are known."""
        with pytest.raises(ValueError, match=f"expected a name that ends in .npz, .mat or .h, received '{name}'"):
            export.write(MODEL, steady.solve(MODEL), tmp_path / name)
        assert not list(tmp_path.iterdir())

    def test_a_folder_that_does_not_exist_is_named(self, tmp_path):
        """Not the name of the temporary file."""
        with pytest.raises(
            FileNotFoundError, match=r"path: expected a folder that can be written to, received '.*nowhere'"
        ):
            export.write(MODEL, steady.solve(MODEL), tmp_path / "nowhere" / "gains.h")

    def test_what_is_no_result_of_this_model_is_refused(self, tmp_path):
        """Other dimensions, other types."""
        other = DiscreteModel([[0.5]], [[1]], [[1]], [[1]], x0=[0], P0=[[1]])
        with pytest.raises(
            ValueError, match=r"result: expected gains of shape \(2, 2\) as the model's, received \(1, 1\)"
        ):
            export.write(MODEL, steady.solve(other), tmp_path / "gains.h")
        with pytest.raises(TypeError, match="result: expected a SteadyState or Covariances, received a ndarray"):
            export.write(MODEL, np.eye(2), tmp_path / "gains.h")
        continuous = ContinuousModel([[0]], [[1]], [[1]], [[1]], P0=[[1]])
        with pytest.raises(TypeError, match="model: expected a DiscreteModel"):
            export.write(continuous, steady.solve(other), tmp_path / "gains.h")
