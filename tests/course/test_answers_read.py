"""Units, numbers, matrices and files as people write them: what is read, and what is refused in words."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path

import numpy as np
import pint
import pytest

from ctlabs.course import reading
from ctlabs.course.units import BASES, UnitError, WrittenUnit, coherent, unit
from ctlabs.course.values import AnswerError, answer, scalar

# Units -----------------------------------------------------------------------------------------------------------------

#: As people write it, and as pint does.
UNITS = {
    "m": "m",
    "cm²": "cm^2",
    "m2/s": "m^2/s",
    "m²/s²": "m^2/s^2",
    "1/s": "1/s",
    "s^-1": "1/s",
    "s⁻¹": "1/s",
    "1/(m²·s)": "1/(m^2*s)",
    "(m/s)²": "m^2/s^2",
    "мкм": "um",
    "км/ч": "km/h",
    "km/h": "km/h",
    "mrad": "mrad",
    "deg": "deg",
    "°": "deg",
    "%": "percent",
    "rad²/s²": "rad^2/s^2",
    "мВ²": "mV^2",
    "mV**2": "mV^2",
    "m**(-2)": "1/m^2",
    "min": "min",
    "ms": "ms",
    "м с^-2": "m/s^2",
    "кГц": "kHz",
    "m/s/s": "m/s^2",
    "μs": "us",
    "µs": "us",
    "град/с": "deg/s",
    "kN": "kN",
    "mJ": "mJ",
    "Ом": "ohm",
    "nF": "nF",
    "mH": "mH",
    "d": "day",
    "h": "h",
    "kW": "kW",
    "hPa": "hPa",
    "dm³": "dm^3",
    "g": "g",
    "кг": "kg",
    "mA": "mA",
    "K": "K",
    "″": "arcsecond",
}
BASE = {"length": "m", "time": "s", "mass": "kg", "current": "A", "temperature": "K"}


@pytest.fixture(scope="module")
def other() -> pint.UnitRegistry:
    return pint.UnitRegistry()


@pytest.mark.parametrize("written", UNITS)
def test_a_unit_is_what_another_program_says(written: str, other: pint.UnitRegistry) -> None:
    found, base = unit(written), other.Quantity(1, UNITS[written]).to_base_units()
    np.testing.assert_allclose(found.factor, base.magnitude, rtol=1e-12)
    expected = {BASE[str(name).strip("[]")]: int(power) for name, power in base.dimensionality.items()}
    assert {base: power for base, power in zip(BASES, found.dimension, strict=True) if power} == expected


@pytest.mark.parametrize(
    "written",
    ["", "/", "m/", "m//s", "q", "m^99", "((((((m))))))", "m)", "(m", "5", "m" * 70, "()", "m ()", "*m", "m5x"],
)
def test_what_is_no_unit_is_refused(written: str) -> None:
    with pytest.raises(UnitError, match="expected"):
        unit(written)


@pytest.mark.parametrize("written", ["m/s·s", "1/m² s", "1/m*s"])
def test_a_quotient_with_two_readings_is_refused(written: str) -> None:
    with pytest.raises(UnitError, match="two readings"):
        unit(written)


def test_units_of_several_elements_have_no_factor() -> None:
    assert coherent("m², m²/s") is None
    assert coherent("1") == unit("rad")


# Numbers ---------------------------------------------------------------------------------------------------------------

NUMBERS = {
    "0,523": 0.523,
    "0.523": 0.523,
    "-0,5": -0.5,
    "−0.5": -0.5,
    "+2": 2,
    ".5": 0.5,
    ",5": 0.5,
    "5.": 5,
    "1.2e-3": 1.2e-3,
    "1,2е-3": 1.2e-3,
    "1.2E-3": 1.2e-3,
    "1.2·10^-3": 1.2e-3,
    "1.2·10⁻³": 1.2e-3,
    "1.2 × 10⁻³": 1.2e-3,
    "1.2x10^-3": 1.2e-3,
    "1,2х10^-3": 1.2e-3,
    "1.2 10^-3": 1.2e-3,
    "1.2*10**-3": 1.2e-3,
    "10^-3": 1e-3,
    "1/3": 1 / 3,
    "√2/2": 0.5**0.5,
    "2√3": 12**0.5,
    "√0,25": 0.5,
    "sqrt(2)/2": 0.5**0.5,
    "π/4": np.pi / 4,
    "½": 0.5,
    "≈ 0.52": 0.52,
    "K = 0,52": 0.52,
    "1 234,5": 1234.5,
    "1 234 567": 1234567,
    "1,234": 1.234,
    r"\frac{1}{3}": 1 / 3,
    r"1.2\cdot 10^{-3}": 1.2e-3,
    "$0.5$": 0.5,
    "0.52.": 0.52,
    "[0.5]": 0.5,
    "[[0,5]]": 0.5,
    '"0,5"': 0.5,
    "exp(-0,5)": np.exp(-0.5),
    "atan2(1,2)": np.arctan2(1, 2),
    "(1 - 0.3)^2": 0.49,
    "2^3": 8,
    "e^-1": np.exp(-1),
    "１,５": 1.5,
    "1÷4": 0.25,
}


@pytest.mark.parametrize("written", NUMBERS)
def test_a_number_is_read_as_people_write_it(written: str) -> None:
    found = answer(written, ())
    assert found is not None
    assert found.unit is None
    np.testing.assert_allclose(found.values, NUMBERS[written], rtol=1e-14)


WITH_UNIT = {
    "5 %": (0.05, ""),
    "5%": (0.05, ""),
    "12 cm²": (12e-4, "m²"),
    "0.5m": (0.5, "m"),
    "30°": (np.pi / 6, "rad"),
    "17 deg": (17 * np.pi / 180, "rad"),
    "0,3 м²/с": (0.3, "m²/s"),
    "36 км/ч": (10, "m/s"),
    "5 1/s": (5, "1/s"),
    "1.5e-3m": (1.5e-3, "m"),
    "3·10^2 мм²": (3e-4, "m²"),
    "2*pi rad": (2 * np.pi, "rad"),
    "0.5 m s^-1": (0.5, "m/s"),
    "sqrt(2) mV": (2**0.5 * 1e-3, "V"),
    "1/3 (m/s)²": (1 / 3, "m²/s²"),
    "0,5 м2": (0.5, "m²"),
}


@pytest.mark.parametrize("written", WITH_UNIT)
def test_a_unit_is_converted(written: str) -> None:
    value, name = WITH_UNIT[written]
    found = answer(written, ())
    assert found is not None
    assert found.unit is not None
    np.testing.assert_allclose(found.values, value, rtol=1e-14)
    assert found.unit.dimension == (unit(name) if name else unit("%")).dimension


@pytest.mark.parametrize(
    "written",
    [
        "м²/с",
        "1½",
        "1,234.5",
        "1.234,5",
        "0.52 ± 0.01",
        "__import__('os')",
        "5 q",
        "9**9**9**9",
        "1e999",
        "1_000",
        "0x10",
        "٣",
        "1 2",
        "3(1)",
        "()1",
        "a.b",
        "lambda: 0",
        "x",
        "1;2",
        "((1)",
        "0.5 0.6",
        "2+",
        "open('/etc/passwd')",
        "sqrt(-1)",
        "1/0",
        "0,1,2",
    ],
)
def test_what_is_no_number_is_refused_in_words(written: str) -> None:
    with pytest.raises(AnswerError, match="expected"):
        answer(written, ())


@pytest.mark.parametrize("written", ["", " ", '""', "-", "—", "?", "...", "[]", "n/a"])
def test_nothing_is_no_answer(written: str) -> None:
    assert answer(written, ()) is None
    assert answer(written, (2, 2)) is None


@pytest.mark.parametrize(
    ("written", "value"), [("yes", True), ("Да", True), ("no.", False), ("НЕТ", False), ('"true"', True)]
)
def test_a_verdict_is_read_in_words(written: str, value: bool) -> None:
    found = answer(written, (), verdict=True)
    assert found is not None
    assert found.values.dtype == bool
    assert bool(found.values) is value


def test_a_verdict_that_is_a_number_is_refused() -> None:
    with pytest.raises(AnswerError, match="expected yes or no"):
        answer("0.5", (), verdict=True)


# Lists and matrices ----------------------------------------------------------------------------------------------------

LISTS = [
    ("[0,52; 0,61]", [0.52, 0.61]),
    ("[0.52, 0.61]", [0.52, 0.61]),
    ("0,52 0,61", [0.52, 0.61]),
    ("0,52, 0,61", [0.52, 0.61]),
    ("[0,52, 0,61]", [0.52, 0.61]),
    ("[1,2]", [1, 2]),
    ("[1,2, 3,4]", [1.2, 3.4]),
    ("[1,2, 3,4]", [1, 2, 3, 4]),
    ('["0,52", "0,61"]', [0.52, 0.61]),
    ("(0.1, 0.2)", [0.1, 0.2]),
    ("[1/3, √2/2]", [1 / 3, 0.5**0.5]),
    ("1 -2", [1, -2]),
    ("0,1\n0,2\n0,3", [0.1, 0.2, 0.3]),
    ("0.1|0.2|0.3", [0.1, 0.2, 0.3]),
    ("1.2·10^-3; 2·10⁻³", [1.2e-3, 2e-3]),
    ("[1, —, 3]", [1, np.nan, 3]),
    ("[0.1, 0.2] м²", [0.1, 0.2]),
    ("10 см², 0,2 м²", [1e-3, 0.2]),
    ("1, 2, 3 cm²", [1e-4, 2e-4, 3e-4]),
    ("0.1 m², 0.2 m²", [0.1, 0.2]),
    ("10 cm², 0", [1e-3, 0]),
    ("[[1],[2]]", [1, 2]),
    ("[1,\n2,\n3,]", [1, 2, 3]),
    ("[[1, 0.5],[0, 1]]", [[1, 0.5], [0, 1]]),
    ("1 0.5\n0 1", [[1, 0.5], [0, 1]]),
    ("1 0,5\n0 1", [[1, 0.5], [0, 1]]),
    ("1 0.5; 0 1", [[1, 0.5], [0, 1]]),
    ("1; 0,5; 0; 1", [[1, 0.5], [0, 1]]),
    ("1,0 0,5\n0,0 1,0", [[1, 0.5], [0, 1]]),
    ('["1 0,5", "0 1"]', [[1, 0.5], [0, 1]]),
    ("((1,2),(3,4))", [[1, 2], [3, 4]]),
    ("{{1,2},{3,4}}", [[1, 2], [3, 4]]),
    ("1 2 3\n4 5 6", [[1, 4], [2, 5], [3, 6]]),
    ("1 2 3\n4 5 6", [[1, 2, 3], [4, 5, 6]]),
    ("[[[1,2],[3,4]],[[5,6],[7,8]]]", [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]),
    ("1 2\n3 4\n\n5 6\n7 8", [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]),
]


@pytest.mark.parametrize(("written", "expected"), LISTS)
def test_a_list_is_read_as_people_write_it(written: str, expected: list[object]) -> None:
    wanted = np.array(expected)
    found = answer(written, wanted.shape)
    assert found is not None
    np.testing.assert_allclose(found.values, wanted, rtol=1e-14)


@pytest.mark.parametrize(
    ("written", "shape"),
    [
        ("[1,2,3]", (2,)),
        ("0,1,0,2", (2,)),
        ("yes no", (2,)),
        ("10 cm², 0.2", (2,)),
        ("[1 m, 2 s]", (2,)),
        ("[1 m, 2 m] m", (2,)),
        ("[1, 2] q", (2,)),
        ("[[1,0,5],[0,1]]", (2, 2)),
        ("1," * 15000, (2,)),
        ("[1, x]", (2,)),
    ],
)
def test_a_list_without_one_reading_is_refused_in_words(written: str, shape: tuple[int, ...]) -> None:
    with pytest.raises(AnswerError, match="expected"):
        answer(written, shape)


def spelled(value: float, rng: random.Random) -> str:
    """A number with three digits in one of the ways in which people write it."""
    plain = f"{value:.2e}"
    mantissa, exponent = plain.split("e")
    power = int(exponent)
    ways = [
        plain,
        f"{float(plain):.10g}",
        f"{mantissa}·10^{power}",
        f"{mantissa}*10^({power})",
        f"{mantissa} × 10{'⁻' * (power < 0)}{abs(power):d}",
    ]
    ways[-1] = f"{mantissa} × 10^{power}"
    written = rng.choice(ways).replace("-", rng.choice("-−"))
    return written.replace(".", ",") if rng.random() < 0.5 else written


@pytest.mark.parametrize("shape", [(2,), (5,), (2, 2), (3, 2), (2, 2, 2)])
def test_matrices_of_any_spelling_are_read_right_or_refused(shape: tuple[int, ...]) -> None:
    rng = random.Random(str(shape))
    read = 0
    for _ in range(150):
        values = np.array([rng.choice((-1, 1)) * 10 ** rng.uniform(-4, 4) for _ in range(int(np.prod(shape)))]).reshape(
            shape
        )
        rounded = np.vectorize(lambda x: float(f"{x:.2e}"))(values)
        comma = rng.random() < 0.5
        between, below = rng.choice(["; ", " ", ", "]), rng.choice(["\n", "\n\n"])
        rows = rounded.reshape(-1, shape[-1])
        text = below.join(between.join(f"{x:.10g}".replace(".", "," if comma else ".") for x in row) for row in rows)
        found = answer(text, shape)
        assert found is not None
        np.testing.assert_array_equal(found.values, rounded, text)
        read += 1
    assert read == 150


def test_spellings_of_numbers_are_read_right() -> None:
    rng = random.Random(5)
    for _ in range(2000):
        value = rng.choice((-1, 1)) * 10 ** rng.uniform(-9, 9)
        text = spelled(value, rng)
        np.testing.assert_allclose(scalar(text)[0], float(f"{value:.2e}"), rtol=1e-12, err_msg=text)


@pytest.mark.parametrize("seed", range(3))
def test_no_text_breaks_the_reader(seed: int) -> None:
    rng = random.Random(seed)
    alphabet = "0123456789,.;:-+*/^()[]{}\"'eEх×·√π%°²⁻ mсмs\n\t|=#$\\_\x00"
    for _ in range(700):
        text = "".join(rng.choice(alphabet) for _ in range(rng.randint(1, 60)))
        for shape in ((), (2,), (2, 2)):
            with contextlib.suppress(AnswerError):  # and nothing else
                found = answer(text, shape)
                assert found is None or found.values.shape == shape


# Files -----------------------------------------------------------------------------------------------------------------

NAMES = ("student", "lab", "gain_steady", "Phi", "prior_variance", "P0")
FORM = """# Лист ответов
student = "Иванов"
lab = "task07"

[answers]
# K: the steady gain
gain_steady = 0,523  # готово
Phi = \"\"\"
1 0,5
0 1
\"\"\"
prior_variance = [0.1,
  0.2, # second
  0.3]
Р0: "2,5 м²"
"""


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "cp1251", "utf-16", "utf-16-le", "utf-16-be", "koi8-r", "cp866"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_form_is_read_in_any_encoding(encoding: str, end: str) -> None:
    raw = FORM.replace("²", "2").replace("\n", end).encode(encoding)
    found = reading.parsed(raw, NAMES, "a.toml", ["Иванов"])
    assert not found.problems
    assert [found.text(name) for name in NAMES] == [
        "Иванов",
        "task07",
        "0,523",
        "1 0,5\n0 1",
        "[0.1,\n  0.2, \n  0.3]",
        "2,5 м2",
    ]
    assert found.entries["gain_steady"].line == 7


@pytest.mark.parametrize(
    ("encoding", "written"), [("cp1252", "0,5 m²"), ("cp1252", "2 × 10^-1 m²"), ("cp1251", "0,5 м^2")]
)
def test_signs_tell_encodings_of_one_byte_apart(encoding: str, written: str) -> None:
    found = reading.parsed(f"P0 = {written}\n".encode(encoding), NAMES, "a.toml")
    received = answer(found.text("P0"), ())
    assert received is not None
    assert received.unit == WrittenUnit(1.0, unit("m²").dimension)


def test_a_name_is_known_in_other_letters_and_a_wrong_one_is_named_with_its_line() -> None:
    found = reading.parsed(b"Gain Steady = 1\ngain_stedy = 2\nPhi = 1\nPhi = 2\n", NAMES, "a.toml")
    assert found.text("gain_steady") == "1"
    assert found.text("Phi") == "2"
    assert found.problems == (
        'a.toml: line 2: expected a name of the form, received "gain_stedy"; did you mean "gain_steady"?',
        "a.toml: line 4: expected Phi once, received it in lines 3 and 4; the last one counts",
    )


HOSTILE = {
    "binary": b"\x00\x01\x02\xff" * 100,
    "zip": b"PK\x03\x04" + b"x" * 100,
    "pdf": b"%PDF-1.4",
    "rtf": b"{\\rtf1 x}",
    "html": b"<!DOCTYPE html><p>",
    "cut": b"\xff\xfe\x00",
    "xls": b"\xd0\xcf\x11\xe0",
    "gz": b"\x1f\x8b\x08\x00",
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_what_is_no_text_is_refused_by_its_name(kind: str) -> None:
    with pytest.raises(ValueError, match=r"^a\.toml: expected a text file of answers, received"):
        reading.parsed(HOSTILE[kind], NAMES, "a.toml")


def test_links_folders_and_large_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"a" * (reading.LARGEST + 1))
    (tmp_path / "link").symlink_to(tmp_path / "large")
    (tmp_path / "folder").mkdir()
    for name, said in (
        ("large", "at most 1 MB"),
        ("link", "received a link"),
        ("folder", "received a folder"),
        ("none", "can be read"),
    ):
        with pytest.raises(ValueError, match=f"^{name}: expected .*{said}"):
            reading.read(tmp_path / name, NAMES)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"a = 1\n" * 50000,
        b"P0 = " + b"[" * 100000,
        b'P0 = """' + b"1\n" * 1000,
        b"= = =\n",
        b"#" * 1000,
        b"[[[[\n" * 1000,
    ],
)
def test_any_text_ends_with_entries_and_problems(raw: bytes) -> None:
    found = reading.parsed(raw, NAMES, "a.toml")
    assert len(found.problems) <= reading.ENTRIES + 2
    assert set(found.entries) <= set(NAMES)
