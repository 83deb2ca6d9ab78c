"""The documents: links and pictures are there, examples run, and commands are ones that the command line takes."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from dataclasses import fields
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest
from sparse_surface.solver import CloudSettings, Settings

CHECKOUT = Path(__file__).resolve().parent.parent
PAGES = sorted(
    path
    for folder in (CHECKOUT, CHECKOUT / "docs", CHECKOUT / "docs" / "decisions", CHECKOUT / "requirements")
    for path in folder.glob("*.md")
)
RUNNABLE = re.compile(r"<!-- runnable(?: after (\S+))? -->\n```python\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"(?:-m|--command) sparse_surface (\w+)( [^`\n]*)?")


def name_of(page: Path) -> str:
    return page.relative_to(CHECKOUT).as_posix()


def without_code(text: str) -> str:
    return re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)


def anchors(text: str) -> set[str]:
    """Return what a link may have behind `#`: the headings in lower case, spaces as hyphens, without punctuation."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(page: Path, text: str) -> list[str]:
    """Return the links and pictures of a page that lead nowhere in this checkout."""
    found = []
    for target in re.findall(r"\]\(([^)\s]+)[^)]*\)", without_code(text)):
        if re.match(r"[a-z]+:", target):
            if not target.startswith("https://"):
                found.append(target)
            continue
        place, _, anchor = unquote(target).partition("#")
        path = page.parent / place if place else page
        if not path.exists() or (anchor and anchor not in anchors(path.read_text(encoding="utf-8"))):
            found.append(target)
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_pictures_are_there(page: Path) -> None:
    assert broken_links(page, page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "link", ["[a](docs/nowhere.md)", "![a](docs/pictures/none.png)", "[a](README.md#no-such-heading)", "[a](http://x)"]
)
def test_the_check_of_links_sees_a_broken_one(link: str) -> None:
    assert len(broken_links(CHECKOUT / "README.md", f"{link} and [one](CONTRIBUTING.md#checks) that works")) == 1


def test_every_picture_is_shown_and_described() -> None:
    shown = set()
    for page in PAGES:
        for description, target in re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            assert len(description) > 20, (page.name, target)
            shown.add((page.parent / target).resolve())
    assert shown >= {path.resolve() for path in (CHECKOUT / "docs").rglob("*.png")}


def test_every_decision_is_listed_and_has_its_three_parts() -> None:
    folder = CHECKOUT / "docs" / "decisions"
    records = sorted(folder.glob("[0-9][0-9]-*.md"))
    listed = re.findall(r"^\| \[.*?\]\((\S+\.md)\)", (folder / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert listed == [record.name for record in records]
    for number, record in enumerate(records, 1):
        text = record.read_text(encoding="utf-8")
        assert text.startswith(f"# {number:02d} "), record.name
        assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequence"], record.name


def example(page: Path) -> str:
    """Return a page's runnable examples as one program, after those of the page that they name."""
    parts = []
    for before, code in RUNNABLE.findall(page.read_text(encoding="utf-8")):
        parts += [example(CHECKOUT / before), code] if before else [code]
    return "\n".join(parts)


WITH_EXAMPLES = [page for page in PAGES if RUNNABLE.search(page.read_text(encoding="utf-8"))]


def test_readme_has_an_example() -> None:
    assert CHECKOUT / "README.md" in WITH_EXAMPLES


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=name_of)
def test_examples_run(page: Path, tmp_path: Path) -> None:
    run = [sys.executable, "-W", "error::RuntimeWarning", "-c", example(page)]
    subprocess.run(run, check=True, cwd=tmp_path, stdout=subprocess.DEVNULL, timeout=120)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_python_example_is_python(page: Path) -> None:
    for code in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        ast.parse(code)


@cache
def options_of(command: str) -> frozenset[str]:
    """Return the options that the command line's help names for a command."""
    run = [sys.executable, "-m", "sparse_surface", command, "--help"]
    text = subprocess.run(run, check=True, capture_output=True, text=True, timeout=120).stdout
    return frozenset(re.findall(r"(?<![\w-])--?[a-z][\w-]*", text))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_have_options_that_exist(page: Path) -> None:
    for command, arguments in COMMAND.findall(page.read_text(encoding="utf-8")):
        used = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", arguments))
        assert used <= options_of(command), (command, used - options_of(command))


def test_user_guide_names_what_the_interface_has() -> None:
    paths = [path for folder in ("ui", "operators") for path in (CHECKOUT / folder).rglob("*.py")]
    sources = [path.read_text(encoding="utf-8") for path in paths]
    labels = set(re.findall(r'"([^"\n]+)"', "\n".join(sources)))
    labels |= {item.name.replace("_", " ").title() for kind in (Settings, CloudSettings) for item in fields(kind)}
    page = (CHECKOUT / "docs" / "user-guide.md").read_text(encoding="utf-8")
    named = {part.strip() for bold in re.findall(r"\*\*([^*]+)\*\*", page) for part in bold.split(" > ")}
    assert len(named) > 30
    assert named - labels == set()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_and_tests_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    folders = "benchmarks|command_line|examples|operators|scripts|solver|tests|ui"
    for path in re.findall(rf"(?<![\w/])(?:{folders})/[\w/]*\.(?:py|json|md)", text):
        assert (CHECKOUT / path).exists(), path
    tests = {path: path.read_text(encoding="utf-8") for path in (CHECKOUT / "tests").rglob("test_*.py")}
    names = {path.stem for path in tests} | set(re.findall(r"^def (test_\w+)", "\n".join(tests.values()), re.MULTILINE))
    assert set(re.findall(r"`(test_\w+)`", text)) <= names
