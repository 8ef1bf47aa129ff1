"""What a refusal offers puts it right; a mapping and its table [data] say the same; a large table is looked at as a small one is."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from ctlabs.files import fast, look, reading
from ctlabs.files.mapping import Mapping
from ctlabs.files.modelfile import ready
from ctlabs.files.remedies import changing, offered, said

TIMES = [f"2024-05-31T12:30:0{i}+02:00" for i in range(4)]
Z = np.array([1.5, 2.25, np.nan, 4.125])


def _cells(values: np.ndarray, mark: str = ".") -> list[str]:
    return ["" if np.isnan(v) else f"{v:g}".replace(".", mark) for v in values]


TABLES = {
    "another name": ("t,pos [m]\n" + "".join(f"{i + 1},{z}\n" for i, z in enumerate(_cells(Z))), Z),
    "dates": ("time;position\n" + "".join(f"{t};{z}\n" for t, z in zip(TIMES, _cells(Z, ","), strict=True)), Z),
    "milliseconds since 1970": (
        "stamp_ms,position\n" + "".join(f"{1717156801000 + 1000 * i},{z}\n" for i, z in enumerate(_cells(Z))), Z,
    ),
    "two readings of a mark": ('t;position\n1;1,120\n2;963\n3;1,160\n4;813\n', np.array([1120.0, 963, 1160, 813])),
    "blank lines": ("position\n1.5\n\n2.25\n\n4.125\n\n\n1\n", None),
    "a word": ("t,position\n1,1.5\n2,2.25\n3,lost\n4,4.125\n", Z),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_what_a_refusal_offers_leads_to_the_numbers_of_the_table(name: str) -> None:
    """Pressed one after the other, the first that is offered each time; at most four times."""
    model = ready("constant_velocity")
    text, values = TABLES[name]
    told = Mapping()
    for _ in range(5):
        try:
            record = reading.parsed([(text.encode(), "log.csv")], model, told)[0]
        except ValueError as why:
            refusal = str(why)
        else:
            break
        ways = changing(refusal, told)
        assert ways, refusal
        told = told.over(said(ways[0]))
    else:
        pytest.fail(refusal)
    if values is not None:
        np.testing.assert_array_equal(record.z[:, 0], values)


def test_a_remedy_keeps_its_words_whole() -> None:
    """Quotation marks, blanks, a value that is a mark, one that begins with a sign; explanations beside it are no part of it."""
    assert offered("x: expected a, received b; --column z='a b' --t0 first counts from the first row (--t0 model: as meant)") == (
        "--column z='a b' --t0 first", "--t0 model",
    )  # fmt: skip
    assert said('--column "lift force"="F [N]" --scale z=0.001 --missing=-9999 --missing n/a --skip 3') == Mapping(
        columns={"lift force": "F [N]"}, scale={"z": 0.001}, missing=("-9999", "n/a"), skip=3
    )
    assert said("--input u --input v --u0 0.5,1").inputs == ("u", "v")
    with pytest.raises(ValueError, match="--gate"):
        said("--gate 5")


def test_a_mapping_is_what_its_table_says() -> None:
    """Every field is in the table, and read from it again."""
    whole = Mapping(
        columns={"position": "pos [m]"}, time="stamp", unit="unix_ms", t0="first", inputs=("throttle",), u0=(0.5,),
        regressors={"hdop": "HDOP"}, record="run", missing=("-9999",), scale={"position": 0.001}, decimal=",", thousands=".",
        blank="skip", encoding="cp1252", skip=3, sheet="Log",
    )  # fmt: skip
    file = ready("constant_velocity").edit_all([(("data", key), value) for key, value in whole.table().items()])
    assert file.mapping == whole
    assert {"columns", "time_unit", *(f.name for f in fields(Mapping))} - set(whole.table()) == {"time", "unit", "dt", "standing"}
    assert Mapping().table() == {}


@pytest.mark.parametrize("mark", [".", ","])
def test_a_large_table_is_looked_at_as_a_small_one_is(monkeypatch: pytest.MonkeyPatch, mark: str) -> None:
    """Numbers, missing values, remarks, times, marks and the [data] that is proposed: by the parser in C as cell by cell."""
    rng = np.random.default_rng(3)
    pos = [f"{v:.4f}".replace(".", mark) for v in rng.normal(size=200)]
    rows = [(i + 1, v, "" if i % 7 == 3 else -9999 if i == 20 else i % 5) for i, v in enumerate(pos)]
    text = "t;pos;q\n" + "".join(f"{a};{b};{c}\n" for a, b, c in rows)
    slow = look.survey(text.encode(), "log.csv", Mapping(), ["pos"])
    monkeypatch.setattr(fast, "LEAST", 1)
    quick = look.survey(text.encode(), "log.csv", Mapping(), ["pos"])
    for field in ("separator", "line", "rows", "clock", "unit", "remarks", "data", "options", "decimal", "zone", "absent", "usual"):
        assert getattr(quick, field) == getattr(slow, field), field
    assert quick.decimal == mark
    assert quick.absent == ("",)
    for a, b in zip(quick.columns, slow.columns, strict=True):
        for field in ("number", "name", "kind", "missing", "first", "remarks", "range"):
            assert getattr(a, field) == getattr(b, field), (a.name, field)
        np.testing.assert_array_equal(a.values, b.values)


def test_an_excerpt_has_the_lines_of_the_file() -> None:
    """The top, the end, and those beside a line in the middle, with their numbers in the file; a preamble is not among them."""
    text = "# a logger\n# of ours\nt,z\n" + "".join(f'{i},"{i}.5"\n' for i in range(100))
    found = look.excerpt(text.encode(), "log.csv", Mapping(), ["z"], around=50)
    assert [line for line, _ in found] == [*range(3, 11), 48, 49, 50, 51, 52, 101, 102, 103]
    assert dict(found)[50] == ["46", "46.5"]
    assert found[0] == (3, ["t", "z"])
