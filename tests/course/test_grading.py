"""A whole grading run: marks by the rule, copies, hostile files, and grades that are whole or as before."""

from __future__ import annotations

import csv
import datetime as dt
import io
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ctlabs.course import copies, grades, pages, submissions
from ctlabs.course.asked import AskedValue
from ctlabs.course.folder import Course, open_course
from ctlabs.course.grades import Graded
from ctlabs.course.marking import Kind
from tests.course import a_course

LABS = ("task01", "task07", "task11", "task16")


@dataclass(frozen=True)
class Case:
    """A course, what was handed in, its grades."""

    course: Course
    root: Path
    graded: Graded

    def result(self, student: int, lab: str) -> object:
        return self.graded.results[self.course.students[student].id][lab]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Thirty students: 3 has the answers of 2; 4 mixes conventions; 5 is 2 % off; 6 has no record; 7 is late; 8's record is of another."""
    course = a_course.made(tmp_path_factory.mktemp("course"))
    root = course.folder / "in"
    keys, rng = a_course.keys(course), random.Random(1)
    encodings = ("utf-8", "utf-8-sig", "utf-16")
    for k, student in enumerate(course.students):
        for lab in LABS:
            own = keys[lab][student.id]

            def change(each: AskedValue, k: int = k) -> np.ndarray | None:
                if k == 4 and each.others:
                    return next(iter(each.others.values()))
                return each.value * 1.02 if k == 5 and each.relative else each.value + (k == 5)

            theirs = keys[lab][course.students[2].id] if k == 3 else own
            answers = a_course.texts(theirs, rng, change)
            date = "2026-10-02" if k == 7 else "2026-10-20" if k == 9 else "2026-09-30"
            text = a_course.form(course, student.id, lab, answers, date)
            table = "" if k == 6 else a_course.experiment(own, 2 if k in (2, 8) else k, scale=1.5 if k == 10 else 1.0)
            a_course.hand_in(course, root, student.id, lab, text, table, encodings[k % 3])
    (root / "junk.toml").write_bytes(b"\x00\x01\x02")
    (root / "other.txt").write_text("hello = 5\n", encoding="utf-8")
    (root / "huge.toml").write_bytes(b"x = 1\n" * 200_000)
    (root / "link.toml").symlink_to(root / "junk.toml")
    return Case(course, root, grades.grade(course, root))


def test_right_answers_get_all_points(case: Case) -> None:
    for k in (0, 1, 2, 11, 29):
        student = case.course.students[k].id
        assert all(each.done and each.points == 1 for each in case.graded.results[student].values())
        assert case.graded.totals[student] == grades.Total(4, (), 2.7, 3)


def test_an_error_of_two_per_cent_gets_none(case: Case) -> None:
    for lab in LABS:
        found = case.graded.results[case.course.students[5].id][lab]
        marks = [mark for mark in found.marks if mark.asked.relative and "transfer" not in mark.asked.name]  # of which a factor is free
        assert not any(mark.kind == Kind.RIGHT and np.any(mark.asked.value) for mark in marks)
        assert not found.done


def test_conventions_get_half(case: Case) -> None:
    found = case.graded.results[case.course.students[4].id]["task07"]
    assert {mark.kind for mark in found.marks} == {Kind.RIGHT, Kind.OTHER}
    assert found.items["c"] == 0.5


def test_a_neighbours_answers_are_found_among_thirty_and_nobody_elses(case: Case) -> None:
    ids = [each.id for each in case.course.students]
    found = {(each.lab, each.student, each.other) for each in case.graded.copies if each.values != ("record",)}
    assert found == {(lab, ids[3], ids[2]) for lab in LABS}
    assert all(each.chance < 1e-5 for each in case.graded.copies)


def test_another_students_record_is_found(case: Case) -> None:
    ids = [each.id for each in case.course.students]
    found = {(each.student, each.other) for each in case.graded.copies if each.values == ("record",)}
    # Records of one seed are multiples of each other, and the same only where the variances are.
    assert found <= {(ids[2], ids[8]), (ids[8], ids[2])}
    own = a_course.experiment(a_course.keys(case.course)["task07"][ids[8]], 2)
    copy = case.root.parent / "again"
    for k in (2, 8):
        text = a_course.form(case.course, ids[k], "task07", {})
        a_course.hand_in(case.course, copy, ids[k], "task07", text, own)
    again = grades.grade(case.course, copy)
    assert {(each.student, each.other) for each in again.copies} == {(ids[2], ids[8]), (ids[8], ids[2])}


def test_a_late_report_is_not_counted_and_late_theory_takes_the_experiment(case: Case) -> None:
    late, theory = (case.graded.results[case.course.students[k].id]["task07"] for k in (9, 7))
    assert not late.source
    assert late.notes == ("handed in on 2026-10-20, after the last day, 2026-10-15: not counted",)
    assert (theory.experiment, theory.admitted, theory.done) == (0.0, False, True)
    assert theory.notes == ("the theory part was in on 2026-10-02, after 2026-10-01: the experiment does not count",)


def test_a_record_of_another_variance_fails(case: Case) -> None:
    found = case.graded.results[case.course.students[10].id]["task07"]
    assert found.experiment == 0.0
    assert found.outcomes[0].words.startswith("disagrees with theory: the mean square of the error")
    assert case.graded.results[case.course.students[6].id]["task07"].notes == ("no record of the experiment",)


def test_hostile_files_are_named_and_stop_nobody(case: Case) -> None:
    assert [each.split(":")[0] for each in case.graded.problems] == ["huge.toml", "junk.toml", "link.toml", "other.txt"]
    assert all("expected" in each and "received" in each for each in case.graded.problems)


def test_the_same_folder_gives_the_same_bytes_with_any_number_of_workers(case: Case) -> None:
    once = pages.files(case.graded)
    again = pages.files(grades.grade(open_course(case.course.folder), case.root, workers=2))
    assert once == again


def test_tables_can_be_read_by_other_programs(case: Case) -> None:
    files = pages.files(case.graded)
    rows = list(csv.DictReader(io.StringIO(files["grades.csv"].removeprefix("\ufeff"))))
    assert [row["name"] for row in rows] == [each.name for each in case.course.students]
    assert (rows[0]["task07"], rows[0]["labs done"], rows[0]["mark"], rows[0]["grade"]) == ("1", "4", "2.7", "3")
    assert rows[3]["like another's"] == "4"
    moodle = list(csv.DictReader(io.StringIO(files["moodle.csv"])))
    assert moodle[5]["Email address"] == "s5@example.org"
    assert moodle[0]["Lab 7. The scalar system: limits of the optimal filter"] == "100"
    assert moodle[9]["Lab 7. The scalar system: limits of the optimal filter"] == ""


def test_feedback_names_no_other_student_and_escapes_what_students_wrote(case: Case, tmp_path: Path) -> None:
    files = pages.files(case.graded)
    for k in (3, 5):
        text = files[f"feedback/{case.course.students[k].id}.html"]
        assert sum(each.name in text for each in case.course.students) == 1
    student = case.course.students[0].id
    text = a_course.form(case.course, student, "task16", {"settling_time": "<script>x"})
    a_course.hand_in(case.course, tmp_path, student, "task16", text)
    page = pages.files(grades.grade(case.course, tmp_path))[f"feedback/{student}.html"]
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


def test_an_interrupted_run_leaves_the_grades_before_whole(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    place = grades.write(case.graded, pages.files)
    before = {path.relative_to(place): path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert len(before) == 5 + len(case.course.students)

    def broken(graded: Graded) -> dict[str, str]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        grades.write(case.graded, broken)
    rename = Path.rename

    def fails(self: Path, target: Path) -> Path:
        if Path(target).name == grades.GRADES and not self.name.endswith("-old"):
            raise KeyboardInterrupt
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails)
    with pytest.raises(KeyboardInterrupt):
        grades.write(case.graded, pages.files)
    monkeypatch.undo()
    assert {path.relative_to(place): path.read_bytes() for path in place.rglob("*") if path.is_file()} == before
    place.rename(place.with_name(f".{grades.GRADES}-x-old"))  # killed between two renames
    grades.write(case.graded, pages.files)
    assert {path.relative_to(place): path.read_bytes() for path in place.rglob("*") if path.is_file()} == before
    assert not [path for path in case.course.folder.iterdir() if path.name.startswith(".") or path.name.endswith("-old")]


# Who handed in what, and when ------------------------------------------------------------------------------------------


@pytest.fixture
def small(tmp_path: Path) -> Course:
    return a_course.made(tmp_path / "course", 2)


def test_the_last_file_in_time_counts_and_the_first_theory(small: Course, tmp_path: Path) -> None:
    student = small.students[0].id
    asked = a_course.keys(small)["task07"][student]
    answers = a_course.texts(asked, random.Random(1))
    some = dict(list(answers.items())[: len(answers) - 2])
    for name, date, told in (("a", "2026-09-20", some), ("b", "05.10.2026", answers), ("c", "2026-11-01", {})):
        text = a_course.form(small, student, "task07", told, date)
        a_course.hand_in(small, tmp_path / "in" / name, student, "task07", text, a_course.experiment(asked, 1))
    found = grades.grade(small, tmp_path / "in").results[student]["task07"]
    assert (found.points, found.date, found.experiment, found.admitted) == (1.0, dt.date(2026, 10, 5), 1.0, True)
    assert found.notes == ("3 files; b/Anna_Weiss_Aa/task07/answers.toml counts",)


def test_the_teachers_table_has_the_last_word(small: Course, tmp_path: Path) -> None:
    student = small.students[0]
    asked = a_course.keys(small)["task07"][student.id]
    text = a_course.form(small, student.id, "task07", a_course.texts(asked, random.Random(1)), "2026-09-20")
    a_course.hand_in(small, tmp_path / "in", student.id, "task07", text, a_course.experiment(asked, 1))
    said = (("2026-10-02;;", 0.0, True), (";;no", 1.0, False), (";2026-10-16;", 0.0, False), ("01.10.2026;;да", 1.0, True))
    for row, experiment, done in said:
        (small.folder / submissions.HANDED_IN).write_text(f"student;lab;theory;report;defence\n{student.name};7;{row}\n", encoding="utf-8")
        found = grades.grade(small, tmp_path / "in").results[student.id]["task07"]
        assert (found.experiment or 0.0, found.done) == (experiment, done), row
    wrong = {"Nobody;7;;;": "a student of the roster", f"{student.name};3;;;": "a lab of", f"{student.name};7;5/10/26;;": "a date"}
    for row, words in wrong.items():
        (small.folder / submissions.HANDED_IN).write_text(f"student;lab;theory;report;defence\n{row}\n", encoding="utf-8")
        with pytest.raises(ValueError, match=f"handed_in.csv: line 2: expected {words}"):
            grades.grade(small, tmp_path / "in")


def test_a_form_of_another_student_is_noticed(small: Course, tmp_path: Path) -> None:
    one, other = small.students
    text = a_course.form(small, one.id, "task16", {}).replace(one.id, other.id, 1)
    a_course.hand_in(small, tmp_path, other.id, "task16", text)
    found = grades.grade(small, tmp_path).results[one.id]["task16"]
    assert f'the form of {one.name} with the name "{other.id}"' in found.notes


def test_a_form_without_its_number_is_known_by_its_words(small: Course, tmp_path: Path) -> None:
    one = small.students[1]
    (tmp_path / "x.txt").write_bytes(f"student: {one.name}\nlab: 16\nform: 12345678\n".encode("cp1251"))
    assert "the form's number is that of nobody" in grades.grade(small, tmp_path).results[one.id]["task16"].notes
    (tmp_path / "y.txt").write_text("student: Nobody\nlab: 16\n", encoding="utf-8")
    assert 'y.txt: line 1: expected a student of the roster, received "Nobody"' in grades.grade(small, tmp_path).problems


def test_nothing_handed_in_is_a_mark_too(small: Course, tmp_path: Path) -> None:
    graded = grades.grade(small, tmp_path)
    assert graded.totals[small.students[0].id] == grades.Total(0, (1, 2), 0.0, 2)
    assert "Nothing handed in" in pages.files(graded)[f"feedback/{small.students[0].id}.html"]
    with pytest.raises(ValueError, match="expected a folder"):
        grades.grade(small, tmp_path / "none")


def test_equal_wrong_digits_are_found(small: Course) -> None:
    """Of two students, in three values; what is known as a confusion is no evidence."""
    keys = a_course.keys(small)["task07"]
    results = {}
    for student in small.students:
        found = {"gain_steady": "0.98765", "posterior_variance_steady": "3.21987", "prior_variance_steady": "7.65432"}
        text = a_course.form(small, student.id, "task07", found)
        path = a_course.hand_in(small, small.folder / "in", student.id, "task07", text)
        assert path.exists()
    results = grades.grade(small, small.folder / "in")
    assert [(each.student, each.other) for each in results.copies] == [(a.id, b.id) for a, b in (small.students, small.students[::-1])]
    assert "the same wrong digits: gain_steady" in results.copies[0].why
    assert copies.copies("task07", keys, {}) == []
