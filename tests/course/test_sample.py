"""The sample course in docs/: what a course of five students gives, kept as it is made.

``python -m tests.course.test_sample`` writes it anew.
"""

import re
from dataclasses import replace
from pathlib import Path

from ctlabs.course import folder, statement, variants

DOCS = Path(__file__).parents[2] / "docs" / "sample-course"
#: Who takes it, and the secret, which a real course keeps to itself.
ROSTER = "name;group;variant\nAnna Weiss;G1;a\nIvan Petrov;G1;b\nMaria Rossi;G1;c\nJan Novák;G2;a\nSofia Lind;G2;b\n"
SECRET = "a sample keeps no secret"


def made(place):
    """The files of the sample, by name."""
    folder.new(place)
    path = place / folder.COURSE
    text = path.read_text(encoding="utf-8")
    for name, value in (("secret", SECRET), ("term", "autumn 2026")):
        text = re.sub(rf"^{name} = .*$", f'{name} = "{value}"', text, flags=re.MULTILINE)
    path.write_text(text, encoding="utf-8")
    (place / folder.ROSTER).write_text(ROSTER, encoding="utf-8")
    course = folder.open_course(place)
    anna = course.students[0]
    lab = next(each for each in course.labs(anna) if each.lab == "task07")
    mine = variants.drawn(course, "task07")[anna.id]
    return {
        folder.COURSE: text,
        folder.ROSTER: ROSTER,
        statement.TEXT: statement.statement(replace(course, folder=place), anna, lab, mine.parameters, mine.answers),
        statement.FORM: statement.form(course, anna, "task07", mine.answers),
    }


def test_the_sample_course_is_what_is_made(tmp_path):
    found = made(tmp_path / "course")
    assert {path.name for path in DOCS.iterdir()} == set(found)
    for name, text in found.items():
        assert (DOCS / name).read_text(encoding="utf-8") == text, name


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as made_in:
        DOCS.mkdir(exist_ok=True)
        for name, text in made(Path(made_in) / "course").items():
            (DOCS / name).write_text(text, encoding="utf-8")
