"""What a teacher does before the semester: a roster, everybody's own numbers, hand-outs that hold no answer, keys that are true."""

import hashlib
import re
import shutil
import tomllib
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from ctlabs.cli.course import course as commands
from ctlabs.course import edition, issue, statement, trial, variants
from ctlabs.course import folder as folders
from ctlabs.course.folder import Course, LabPlace, Rule
from ctlabs.course.key import key, questions
from ctlabs.course.roster import Student, folder_name, read, students
from ctlabs.labs import catalogue as labs
from ctlabs.labs.sheets import sheet
from ctlabs.reporting import draws
from ctlabs.reporting.params import LabParameters, Positive, given

LABS = list(labs.catalogue())
#: Labs whose keys take some milliseconds.
QUICK = ["task01", "task06", "task07", "task14", "task16", "task17", "task20", "task22"]


def a_class(*names, lab="task16", folder=Path(), secret="a secret of twenty characters"):
    """A course of one lab."""
    people = tuple(Student(folder_name(name), name) for name in names)
    return Course(folder, "A course", "autumn 2026", secret, "a", people, {"a": (LabPlace(lab, True, 1),)})


@cache
def defaults(lab):
    return key(lab, labs.load(labs.catalogue()[lab]).Parameters())


def number(text):
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", text)]


class TestQuestions:
    @pytest.mark.parametrize("lab", LABS)
    def test_every_lab_asks_for_values_of_its_items(self, lab):
        """Letters are the sheet's, names and units those of the report, and a key exists for the default parameters."""
        assert {each.item for each in defaults(lab)} <= set(labs.catalogue()[lab].parts)
        assert len(defaults(lab)) >= 3
        assert len({each.name for each in defaults(lab)}) == len(defaults(lab))
        for each in defaults(lab):
            assert each.value.ndim <= 3
            assert np.isfinite(each.value).all()
            assert each.meaning
            assert each.symbol

    @pytest.mark.parametrize("lab", LABS)
    def test_a_confusion_gives_another_number(self, lab):
        """Else it could not be told from the right answer."""
        for each in defaults(lab):
            for words, other in each.others.items():
                assert other.shape == each.value.shape, words
                assert (abs(other - each.value) > each.allowed).any(), words

    def test_the_known_confusions_of_a_filter_are_there(self):
        """Φ K for K, P⁻ for P⁺ and the strength for the covariance, of an example with numbers by hand."""
        p = labs.load(labs.catalogue()["task03"]).Parameters(sigma_w2=2.0, tau=0.5)
        found = {each.name: each for each in key("task03", p)}
        K, P = found["gain_steady"], found["posterior_covariance_steady"]
        np.testing.assert_allclose(K.others["predictor for filter gain"], [K.value[0] + 0.5 * K.value[1], K.value[1]])
        np.testing.assert_array_equal(found["Qd"].others["strength for covariance"], [[0, 0], [0, 2]])
        np.testing.assert_array_equal(P.others["P⁻ for P⁺"], found["prior_covariance_steady"].value)
        assert (found["posterior_covariance"].others["P⁻ for P⁺"][0] == [[102.5 + 1 / 12, 5.25], [5.25, 11]]).all()

    def test_what_is_allowed(self):
        """Rounding to three digits is; 2 % are not; a count is right or wrong; a zero may be a residue."""
        for lab in LABS:
            for each in defaults(lab):
                rounded = np.vectorize(lambda x: float(f"{x:.3g}"))(each.value)
                assert (abs(rounded - each.value) <= each.allowed * (1 + 1e-12)).all() or not each.relative
                nonzero = each.value != 0
                assert (0.02 * abs(each.value) > each.allowed)[nonzero].all()
                assert each.relative == 0 or (each.allowed > 0).all()

    def test_a_value_that_does_not_exist_is_refused(self):
        """A gain for which the steady variance diverges."""
        p = labs.load(labs.catalogue()["task07"]).Parameters(Phi=1.3, K_star=0.1)
        with pytest.raises(ValueError, match=r"^task07: suboptimal_variance_ratio: expected parameters for which it exists"):
            key("task07", p)


class TestDraws:
    def test_sets(self):
        """Every member is there once, and is written as a person would write it."""
        assert draws.span(0.1, 0.5, 0.1).axes == ((0.1, 0.2, 0.3, 0.4, 0.5),)
        both = draws.each(draws.one_of(1, 2), draws.span(1, 3, 1))
        assert sorted(both[i] for i in range(len(both))) == [[a, b] for a in (1, 2) for b in (1, 2, 3)]
        assert draws.diagonal(draws.one_of(1), draws.one_of(2, 3))[1] == [[1, 0], [0, 3]]
        with pytest.raises(IndexError):
            both[6]
        with pytest.raises(ValueError, match="draw: expected a step > 0 and low <= high"):
            draws.span(2, 1, 0.1)

    @pytest.mark.parametrize("lab", LABS)
    def test_every_member_is_legal(self, lab):
        """The ends of all sets, one at a time, are parameters of the lab."""
        cls = labs.load(labs.catalogue()[lab]).Parameters
        assert cls.draws()
        assert set(cls.draws()) <= set(cls.model_fields)
        for name, draw in cls.draws().items():
            for index in (0, len(draw) - 1):
                if (name, index) != ("x1_mean", len(draw) - 1) and (name, index) != ("x1_second_moment", 0):  # Var x(t1) ≥ 0
                    cls.parse(lab, {name: draw[index]})

    def test_a_lab_without_sets_is_named(self, monkeypatch):
        class Parameters(LabParameters):
            R: Positive = given(1.0, unit="m²", meaning="…")

        monkeypatch.setattr(variants, "load", lambda _lab: type("M", (), {"Parameters": Parameters}))
        with pytest.raises(ValueError, match=r"^task16: expected sets to draw a student's numbers from"):
            variants.chosen("task16", len)

    @pytest.mark.parametrize("lab", QUICK)
    def test_thirty_students_have_problems_of_their_own(self, lab):
        """No two have the same parameters, nor the same answers but for values that are the same for everybody."""
        found = variants.drawn(a_class(*(f"Student {chr(65 + i)}" for i in range(26)), lab=lab), lab)
        plain = [repr(each.parameters.plain()) for each in found.values()]
        assert len(set(plain)) == len(plain)
        for one, other in combinations(found.values(), 2):
            pairs = zip(one.answers, other.answers, strict=True)
            assert any(a.value.shape != b.value.shape or (abs(a.value - b.value) > a.allowed + b.allowed).any() for a, b in pairs)

    def test_numbers_follow_from_secret_term_student_and_lab(self):
        """And from nothing else: not from the folder, the title, or those after a student in the roster."""
        def of(course, lab="task16"):
            return variants.parameters(course, course.students[0], lab)

        mine = of(a_class("Anna Weiss"))
        assert of(a_class("Anna Weiss", "Ivan Petrov", folder=Path("/elsewhere"))) == mine
        assert of(replace(a_class("Anna Weiss"), title="Another")) == mine
        assert of(a_class("Anna Weiss", secret="another secret of characters")) != mine
        assert of(replace(a_class("Anna Weiss"), term="spring 2027")) != mine
        assert of(a_class("Anna Weisz")) != mine

    def test_a_degenerate_problem_is_drawn_anew(self):
        """A value that is 0 or equals another though it need not, one that could be guessed, one that does not exist."""
        cls = labs.load(labs.catalogue()["task16"]).Parameters
        assert variants.tried("task16", {})[2] == ""
        limit = cls(Q=4.0, R=16.0, P0=8.0)
        assert variants.degenerate("task16", limit, key("task16", limit)) == "settling_time is 0"
        assert "equals" in variants.tried("task15", {"w0": 2.0, "wn": 2.0})[2]
        assert "exists" in variants.tried("task07", {"Phi": 1.3, "K_star": 0.1})[2]
        assert "uncorrelated" in variants.tried("task05", {"D": 1000.0, "sigma_D": 10.0, "sigma_theta": 0.011})[2]
        assert "1, which could be guessed" in variants.tried("task07", {"Phi": 0.78, "Q": 8.0, "R": 0.5})[2]

    def test_one_who_has_another_s_answers_is_drawn_anew(self):
        """Nothing may be copied: answers that agree in more than half are alike."""
        one = key("task16", labs.load(labs.catalogue()["task16"]).Parameters(Q=4.0, R=16.0))
        assert variants.alike("task16", one, one)
        other = key("task16", labs.load(labs.catalogue()["task16"]).Parameters(Q=5.0, R=10.0, P0=30.0, dt=0.5))
        assert not variants.alike("task16", one, other)

    def test_too_small_sets_are_refused(self, monkeypatch):
        """More students than problems."""
        monkeypatch.setattr(variants, "chosen", lambda _lab, number: {"Q": [3.0, 5.0][number("Q") % 2]})
        with pytest.raises(ValueError, match=r"^task16: expected sets that hold a problem of C's own, received none in 300 draws"):
            variants.drawn(a_class("A", "B", "C", secret="a secret for three of them"), "task16")


#: Labs whose key is held against a run in the quick suite: a schedule, a limit, an alarm, an ensemble's form, continuous time.
QUICK = ("task01", "task07", "task12", "task16", "task19")


@pytest.mark.parametrize("lab", QUICK)
def test_a_key_equals_a_real_run(lab):
    """Of a student's variant: all checks of the report pass, and it says what the key says."""
    course = a_class("Anna Weiss", lab=lab)
    mine = variants.drawn(course, lab)["Anna_Weiss"]
    assert trial.against_report(lab, mine.parameters, mine.answers, 10) == []


@pytest.mark.slow
@pytest.mark.parametrize("lab", LABS)
def test_keys_equal_real_runs(lab, request):
    """Of as many variants as are asked for; 20 of each lab are those of a release."""
    names = [f"Student {chr(65 + i)}" for i in range(request.config.getoption("--variants"))]
    for mine in variants.drawn(a_class(*names, lab=lab), lab).values():
        assert trial.against_report(lab, mine.parameters, mine.answers, 10) == []


def test_a_false_key_is_noticed():
    """Every value of it, when it is wrong by a part in 10⁵."""
    course = a_class("Anna Weiss", lab="task16")
    mine = variants.drawn(course, "task16")["Anna_Weiss"]
    false = tuple(replace(each, value=each.value * (1 + 1e-5) + (0 if each.relative else 1)) for each in mine.answers)
    wrong = trial.against_report("task16", mine.parameters, false, 10)
    assert len(wrong) == len(false)
    assert all("is not what the report says" in each for each in wrong)


class TestRoster:
    @pytest.mark.parametrize("mark", [";", ",", "\t", "|"])
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1251"])
    @pytest.mark.parametrize("head", ["name,group,variant", "ФИО,Группа,Вариант", ""])
    def test_of_any_program(self, tmp_path, mark, encoding, head):
        rows = [head, "Иванов Семён,ИС-31,А", "Smith Anna,ИС-32,b", ""]
        text = "\r\n".join(row.replace(",", mark) for row in rows if row or row is rows[-1])
        (tmp_path / "roster.csv").write_bytes(text.encode(encoding))
        found = read(tmp_path / "roster.csv")
        assert [(each.name, each.group, each.variant) for each in found] == [("Иванов Семён", "ИС-31", "a"), ("Smith Anna", "ИС-32", "b")]

    def test_columns_by_name_in_any_order(self):
        found = students("Group\tFirst name\tSurname\nG1\tAnna\tO’Neill-Smith\n", "roster.csv")
        assert [(each.id, each.name, each.group) for each in found] == [("ONeill-Smith_Anna", "O’Neill-Smith Anna", "G1")]

    def test_names_alone(self):
        assert [each.id for each in students("Anna Weiss\nIvan Petrov\n", "roster.csv")] == ["Anna_Weiss", "Ivan_Petrov"]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "received none"),
            ("name;group;variant\n", "expected 1 to 5000 students, received none"),
            ("name\nAnna Weiss\nanna  weiss\n", "line 3: expected a name that nobody else has .*, received anna weiss as in line 2"),
            ("name\nA. B\nA B\n", "line 3: expected a name that nobody else has"),
            ("name\n../../etc/passwd\n", "line 2: expected a name of letters"),
            ("name\n<script>alert(1)</script>\n", "line 2: expected a name of letters"),
            ("name\n=HYPERLINK(1)\n", "line 2: expected a name of letters"),
            ("name\n" + "A" * 81 + "\n", "line 2: expected a name of letters"),
            ("name;group\nAnna;<b>\n", "line 2: expected a group of letters"),
            ("name;group;variant\nAnna;G;a b\n", "line 2: expected a variant of one word"),
            ("name;group\n;G1\n", "line 2: expected a name of letters"),
            ("name;group;variant\nAnna;G;а\nIvan;G;б\nMaria;G;в\n", "variant в beside б is the third of the alphabet, or the Latin b"),
        ],
    )
    def test_bad_lines_are_named(self, text, message):
        with pytest.raises(ValueError, match=rf"^roster\.csv: .*{message}"):
            students(text, "roster.csv")

    @pytest.mark.parametrize("name", ["Con", "aux.", "A/B".replace("/", " "), "Ž. Ö'Brien"])
    def test_folder_names_are_safe(self, name):
        found = folder_name(name)
        assert re.fullmatch(r"[\w-]+", found)
        assert not re.fullmatch(r"(?i)con|aux|nul|prn", found)


class TestFolder:
    def course(self, tmp_path, edit=lambda text: text, roster="name;group;variant\nAnna Weiss;G1;a\nIvan Petrov;G1;b\n"):
        folders.new(tmp_path / "c")
        path = tmp_path / "c" / "course.toml"
        path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
        (tmp_path / "c" / "roster.csv").write_text(roster, encoding="utf-8")
        return folders.open_course(tmp_path / "c")

    def test_a_new_course_is_the_practicum(self, tmp_path):
        found = self.course(tmp_path)
        assert [place.lab for place in found.labs(found.students[0])] == [name for name, _star in labs.variant("a")]
        assert [place.control for place in found.labs(found.students[1])] == [star for _name, star in labs.variant("b")]
        assert {place.part for place in found.labs(found.students[0])} == {1, 2}
        assert found.rule == Rule()
        assert found.rule.marks[:4] == (1.7, 2.0, 2.3, 2.7)
        assert len(found.secret) >= 32

    def test_what_is_there_is_left_alone(self, tmp_path):
        self.course(tmp_path)
        with pytest.raises(ValueError, match=r"expected a folder without a course\.toml"):
            folders.new(tmp_path / "c")

    def test_dates_and_variants(self, tmp_path):
        def edit(text):
            return text.replace("# 1 =", "7 =").replace("[variants]", '[variants]\nz = ["7* 16"]').replace('variant = "a"', 'variant = "z"')

        found = self.course(tmp_path, edit, "Anna Weiss\n")
        first, second = found.labs(found.students[0])
        assert (first.lab, first.control, str(first.theory), str(first.report)) == ("task07", True, "2026-09-21", "2026-10-05")
        assert (second.lab, second.control, second.report) == ("task16", False, None)

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('language = "en"', 'language = "fr"', r"course\.toml: line \d+: language: expected \"en\""),
            ("control = 0.5", "control = -1", r"course\.toml: line \d+: grading\.control: expected a number from 0"),
            ("control = 0.5", 'control = "half"', r"grading\.control"),
            ("done = 0.6", "dome = 0.6", r"grading\.dome: expected keys among marks, control, done, theory_first"),
            ('a = ["1 2*', 'a = ["1 77*', r"line \d+: variants\.a: expected labs as in `ctlabs list`, received 77"),
            ('a = ["1 2*', 'a = ["1 1*', r"variants\.a: expected each lab once"),
            ("# 1 = {", "1 = 5 # {", r"dates\.1: expected \{ theory"),
            ("secret = ", 'secret = "short" # ', r"secret: expected 16 characters or more"),
            ("[grading]", "[grading", r"expected TOML in UTF-8"),
            ('variant = "a"', 'variant = "q"', r"roster\.csv: line 2: expected one of the variants a, b, c, received q"),
        ],
    )
    def test_bad_files_are_named_with_their_line(self, tmp_path, old, new, message):
        with pytest.raises(ValueError, match=message):
            self.course(tmp_path, lambda text: text.replace(old, new, 1), "name\nAnna Weiss\n")

    def test_no_course(self, tmp_path):
        with pytest.raises(ValueError, match="expected the file of a course"):
            folders.open_course(tmp_path)


def files(folder):
    there = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in there}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A course of three students and four quick labs, issued."""
    place = tmp_path_factory.mktemp("course")
    run = CliRunner()
    assert run.invoke(commands, ["new", str(place / "c")]).exit_code == 0
    path = place / "c" / "course.toml"
    text = path.read_text(encoding="utf-8").replace("[variants]", '[variants]\nq = ["7* 16", "17 22*"]').replace('"a"', '"q"')
    text = re.sub(r'(?m)^secret = ".*"', 'secret = "the secret of a small course"', text)  # with another one other variants are refused
    path.write_text(text, encoding="utf-8")
    (place / "c" / "roster.csv").write_text("name;group\nAnna Weiss;G1\nИван Петров;G1\nJosé Ruiz (2);G2\n", encoding="utf-8")
    done = run.invoke(commands, ["issue", str(place / "c"), "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert "12 hand-outs" in done.output
    return place / "c"


class TestHandouts:
    def test_each_student_has_each_lab(self, small):
        assert {path.relative_to(small / "handouts").as_posix() for path in (small / "handouts").glob("*/*")} == {
            f"{student}/{lab}"
            for student in ("Anna_Weiss", "Иван_Петров", "José_Ruiz_2")
            for lab in ("task07", "task16", "task17", "task22")
        }
        assert {path.name for path in (small / "handouts").glob("*/*/*")} == {"statement.md", "statement.html", "answers.toml"}

    def test_the_same_folder_gives_the_same_bytes(self, small, tmp_path):
        shutil.copytree(small, tmp_path / "copy")
        shutil.rmtree(tmp_path / "copy" / "handouts")
        variants.of_class.cache_clear()
        assert CliRunner().invoke(commands, ["issue", str(tmp_path / "copy"), "--workers", "2"]).exit_code == 0
        assert files(tmp_path / "copy" / "handouts") == files(small / "handouts")

    def test_no_file_of_a_student_holds_an_answer(self, small):
        """Neither a number of the key, with four digits or more, nor the secret."""
        course = folders.open_course(small)
        for student in course.students:
            for place in course.labs(student):
                mine = variants.drawn(course, place.lab)[student.id]
                folder = course.handout(student, place.lab)
                text = "\n".join((folder / name).read_text(encoding="utf-8") for name in (statement.TEXT, statement.FORM))
                assert course.secret not in text
                there = {f"{x:.4g}" for x in number(text)}
                for each in mine.answers:
                    for x in np.ravel(each.value):
                        if len(f"{abs(x):.4g}".replace(".", "").strip("0")) >= 4:
                            assert f"{x:.4g}" not in there, (place.lab, each.name)

    def test_the_sheet_and_the_student_s_numbers_are_there(self, small):
        course = folders.open_course(small)
        anna = course.students[0]
        text = (course.handout(anna, "task16") / "statement.md").read_text(encoding="utf-8")
        p = variants.parameters(course, anna, "task16")
        assert "Anna Weiss · G1 · Variant Q, part 1 · form " in text
        for words in sheet("task16").items.values():
            assert words in text
        assert f"| $Q$ | {p.Q:g} | m²/s |" in text
        assert all(f"`{name}`" in text for name in questions("task16"))
        assert "## Plan of the experiment" in text
        assert "{" not in re.sub(r"\$[^$]*\$", "", text)

    def test_the_form_is_toml_with_every_value_empty(self, small):
        course = folders.open_course(small)
        for student in course.students:
            for place in course.labs(student):
                form = tomllib.loads((course.handout(student, place.lab) / "answers.toml").read_text(encoding="utf-8"))
                assert (form["student"], form["lab"], form["form"]) == (student.id, place.lab, course.form(student, place.lab))
                assert set(form) == {"course", "term", "student", "lab", "form", "date", *questions(place.lab)}
                assert all(form[name] == "" for name in questions(place.lab))

    def test_pages_ask_no_other_machine_and_show_all_equations(self, small):
        for path in (small / "handouts").glob("*/*/statement.html"):
            page = path.read_text(encoding="utf-8")
            assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", page)
            assert "<math" in page
            assert "merror" not in page

    def test_an_interrupted_issue_leaves_whole_handouts(self, small, tmp_path, monkeypatch):
        shutil.copytree(small, tmp_path / "c")
        before = files(tmp_path / "c" / "handouts")
        course = replace(folders.open_course(tmp_path / "c"), title="Another title")

        def stop(*_args):
            raise KeyboardInterrupt

        monkeypatch.setattr(issue, "swap", stop)
        with pytest.raises(KeyboardInterrupt):
            issue.issue(course, "task16")
        assert files(tmp_path / "c" / "handouts") == before

    def test_words_of_a_person_are_words(self):
        hostile = "<script>alert(1)</script> [a](b) $x$ `c`"
        course = replace(a_class("Anna Weiss"), title=hostile)
        anna, (place,) = course.students[0], course.labs(course.students[0])
        mine = variants.drawn(course, "task16")["Anna_Weiss"]
        text = statement.statement(course, anna, place, mine.parameters, mine.answers)
        page = issue.page("t", text)
        assert "<script>" not in page
        assert "&lt;script&gt;alert(1)&lt;/script&gt; [a](b) $x$ `c`" in page
        assert tomllib.loads(statement.form(course, anna, "task16", mine.answers))["course"] == hostile

    def test_one_student_and_one_lab(self, small, tmp_path):
        shutil.copytree(small, tmp_path / "c", ignore=shutil.ignore_patterns("handouts"))
        done = CliRunner().invoke(commands, ["issue", str(tmp_path / "c"), "--lab", "16", "--student", "anna weiss"])
        assert "1 hand-outs" in done.output
        assert [path.parent.name for path in (tmp_path / "c" / "handouts").glob("*/*")] == ["Anna_Weiss"]
        done = CliRunner().invoke(commands, ["issue", str(tmp_path / "c"), "--student", "nobody"])
        assert "expected one of roster.csv" in done.output

    @pytest.mark.slow
    def test_on_paper(self, small, tmp_path):
        """A PDF of each, and the same bytes as long as the text is the same."""
        shutil.copytree(small, tmp_path / "c")
        command = ["issue", str(tmp_path / "c"), "--lab", "16", "--pdf"]
        assert "3 of them as PDF" in CliRunner().invoke(commands, command).output
        first = files(tmp_path / "c" / "handouts")
        assert sum(name.endswith(".pdf") for name in first) == 3
        assert CliRunner().invoke(commands, command).exit_code == 0
        assert files(tmp_path / "c" / "handouts") == first


class TestEdition:
    def test_the_teacher_has_every_answer(self, small, tmp_path):
        shutil.copytree(small, tmp_path / "c")
        done = CliRunner().invoke(commands, ["key", str(tmp_path / "c"), "--workers", "1"])
        assert done.exit_code == 0, done.output
        course = folders.open_course(tmp_path / "c")
        anna = course.students[0]
        own = tomllib.loads((tmp_path / "c" / "key" / "Anna_Weiss" / "task16.toml").read_text(encoding="utf-8"))
        for each in variants.drawn(course, "task16")["Anna_Weiss"].answers:
            assert np.array_equal(own[each.name]["value"], each.value)
        page = (tmp_path / "c" / "key" / "Anna_Weiss" / "task16.html").read_text(encoding="utf-8")
        assert "± 0.5 %" in page
        assert course.form(anna, "task16") in page
        rows = (tmp_path / "c" / "key" / "key.csv").read_text(encoding="utf-8").splitlines()
        assert rows[0] == ",".join(edition.COLUMNS)
        assert len(rows) == 1 + 3 * sum(len(questions(place.lab)) for place in course.labs(anna))

    def test_full_reports_on_request(self, small, tmp_path):
        shutil.copytree(small, tmp_path / "c")
        done = CliRunner().invoke(
            commands, ["key", str(tmp_path / "c"), "--lab", "17", "--student", "Anna Weiss", "--reports", "--runs", "10", "--workers", "1"]
        )
        assert done.exit_code == 0, done.output
        assert (tmp_path / "c" / "key" / "Anna_Weiss" / "task17" / "report.html").is_file()


class TestTrial:
    def test_all_is_well(self, small):
        done = CliRunner().invoke(commands, ["test", str(small), "--lab", "17", "--runs", "10", "--workers", "1"])
        assert done.exit_code == 0, done.output
        assert "3 problems tried: all checks passed" in done.output

    def test_an_offender_is_drawn_anew(self, small, tmp_path, monkeypatch):
        """Named, written down, and what the next issue gives."""
        shutil.copytree(small, tmp_path / "c")
        course = folders.open_course(tmp_path / "c")
        bad = variants.parameters(course, course.students[1], "task17")
        monkeypatch.setattr(trial, "against_report", lambda _lab, p, *_rest: ["check failed: all of it"] if p == bad else [])
        done = CliRunner().invoke(commands, ["test", str(tmp_path / "c"), "--lab", "17", "--workers", "1"])
        assert done.exit_code == 0, done.output
        assert "Иван_Петров task17: check failed: all of it" in done.output
        assert "1 drawn anew" in done.output
        after = folders.open_course(tmp_path / "c")
        assert after.redrawn == {("Иван_Петров", "task17"): 1}
        assert variants.parameters(after, after.students[1], "task17") != bad
        assert variants.parameters(after, after.students[0], "task17") == variants.parameters(course, course.students[0], "task17")
