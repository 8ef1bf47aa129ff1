"""README.md and docs/ run: every Python block, every link, every command they name."""

import doctest
import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
#: Written by hand: what the site makes of the reports and the commands, and the sample course, are tested where they are made.
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(path for path in sorted(DOCS.rglob("*.md")) if path.relative_to(DOCS).parts[0] not in {"generated", "sample-course"}),
]
IDS = [path.relative_to(ROOT).as_posix() for path in PAGES]
every_page = pytest.mark.parametrize("page", PAGES, ids=IDS)

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path, *languages: str) -> list[str]:
    """The fenced blocks of a page in one of the ``languages``."""
    return [body for language, body in BLOCK.findall(page.read_text(encoding="utf-8")) if language in languages]


def commands(page: Path) -> list[list[str]]:
    """The shell commands of a page, split into words, without comments."""
    lines = [line for body in blocks(page, "sh", "bat") for line in body.splitlines()]
    found = [shlex.split(part, comments=True, posix="\\" not in part) for line in lines for part in line.split("&&")]
    return [words for words in found if words]


@every_page
def test_python_blocks_run(page: Path):
    """The examples of a page, read as one session, print what the page says."""
    examples = "\n".join(blocks(page, "python"))
    test = doctest.DocTestParser().get_doctest(examples, {}, page.name, str(page), 0)
    failed: list[str] = []
    doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS).run(test, out=failed.append)
    assert not failed, "".join(failed)


@every_page
def test_no_python_block_escapes_the_test(page: Path):
    """Every Python block is a session with prompts, or it would not have run above."""
    for body in blocks(page, "python"):
        assert body.startswith(">>> ")


@every_page
def test_links_lead_somewhere(page: Path):
    """A link or picture inside the repository points to a file, and its anchor to a heading."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        if "generated/" in path:  # a page that the site makes; the build checks it
            lab = re.fullmatch(r".*generated/labs/(\w+)\.md", path)
            assert lab is None or (ROOT / "reports" / lab[1] / "report.md").exists() or lab[1] == "lab0", f"{page.name} links to {target}"
            continue
        other = (page.parent / path) if path else page
        assert other.exists(), f"{page.name} links to {target}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", other.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@every_page
def test_commands_exist(page: Path):
    """Every ``make`` target and ``ctlabs`` command that a page types is one, with its options."""
    from ctlabs.cli import cli

    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for words in commands(page):
        if words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= targets
        elif words[0] == "ctlabs" or words[1:3] == ["-m", "ctlabs"]:
            name, *arguments = words[1:] if words[0] == "ctlabs" else words[3:]
            command = cli.commands[name]
            while arguments and arguments[0] in getattr(command, "commands", ()):  # of a group
                command = command.commands[arguments.pop(0)]
            command.make_context(name, arguments, resilient_parsing=True)
            known = {option for parameter in command.params for option in parameter.opts} | {"--help"}
            assert {word for word in arguments if word.startswith("--")} <= known


def test_the_pages_were_read():
    """The tests above see examples and commands: the patterns that find them are right."""
    assert sum(len(blocks(page, "python")) for page in PAGES) >= 5
    assert any(words[:2] == ["make", "labs"] for words in commands(ROOT / "README.md"))
    assert any(words[:2] == ["ctlabs", "run"] for page in PAGES for words in commands(page))
