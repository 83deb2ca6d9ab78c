"""Build the documents as a web site into dist/docs, from the pages that the checkout has; a warning is an error.

    .venv-docs/bin/python scripts/build_docs.py

The pages are written for readers of the checkout: they link to files beside them.  Here they are copied, their links
changed to what the site has.  The notebooks are run, and the reference is made from docstrings.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path, PurePosixPath

from build_extension import CHECKOUT, package_files

DOCS = CHECKOUT / "docs"
WORK = CHECKOUT / "build" / "docs"
SITE = CHECKOUT / "dist" / "docs"
PAGES, PACKAGE = WORK / "pages", WORK / "package"

ELSEWHERE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "requirements/README.md": "requirements.md",
}
"""Where the site has pages that are not in docs/."""

SECTIONS = {
    "Guide": (
        *("user-guide.md", "gallery.md", "settings.md", "denoising.md", "point-clouds.md", "measure.md"),
        *("representation.md", "formats.md", "scaling.md"),
    ),
    "Notebooks": tuple(f"notebooks/{name}.ipynb" for name in ("denoise-a-scan", "measure-a-part", "explain-a-patch")),
    "Library": ("api.md", "reference.md", "format.md"),
    "Method": ("method.md", "paper.md", "accuracy.md", "performance.md", "reliability.md"),
    "Project": ("changelog.md", "contributing.md", "requirements.md", "architecture.md"),
}
"""What the menu shows beside the first page and the decisions."""

LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s]+)\)")
PICTURE = re.compile(r"!\[([^\]]+)\]\(([^)\s]+\.png)\)")


def main() -> int:
    shutil.rmtree(WORK, ignore_errors=True)
    stage_package()
    stage_pages()
    settings = WORK / "mkdocs.yml"  # JSON is YAML
    inherited = {"INHERIT": str(DOCS / "site.yml"), "docs_dir": str(PAGES), "site_dir": str(SITE), "nav": menu()}
    settings.write_text(json.dumps(inherited, indent=1), encoding="utf-8")
    environment = {**os.environ, "DOCS_PACKAGE": str(PACKAGE), "NO_MKDOCS_2_WARNING": "1"}
    build = [sys.executable, "-m", "mkdocs", "--quiet", "build", "--strict", f"--config-file={settings}"]
    done = subprocess.run(build, env=environment).returncode
    if not done:
        print(f"{SITE.relative_to(CHECKOUT)}: {sum(1 for _ in SITE.rglob('*.html'))} pages")
    return done


def stage_package() -> None:
    """Copy the package to where the reference finds it by its name."""
    for path in package_files():
        place = PACKAGE / "sparse_surface" / path
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CHECKOUT / path, place)


def places() -> dict[Path, PurePosixPath]:
    """Return where the site has each file of the checkout, both as relative paths."""
    found = {Path(source): PurePosixPath(target) for source, target in ELSEWHERE.items()}
    for path in sorted(DOCS.rglob("*")):
        if path.suffix in (".md", ".png", ".ipynb"):
            target = PurePosixPath(path.relative_to(DOCS).as_posix())
            found[path.relative_to(CHECKOUT)] = target.with_name("index.md") if target.name == "README.md" else target
    return found


def stage_pages() -> None:
    """Copy pages, pictures and notebooks, and make the gallery and the reference."""
    known = places()
    for source, target in list(known.items()):
        place = PAGES / target
        place.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix == ".md":
            text = (CHECKOUT / source).read_text(encoding="utf-8")
            place.write_text(site_text(text, source, known), encoding="utf-8")
        else:
            shutil.copyfile(CHECKOUT / source, place)
    (PAGES / "gallery.md").write_text(gallery(known), encoding="utf-8")
    (PAGES / "reference.md").write_text(reference(), encoding="utf-8")


def site_text(text: str, source: Path, known: dict[Path, PurePosixPath]) -> str:
    """Return a page with its links changed to where the site has their files; a folder's name stays without a link."""

    def changed(found: re.Match[str]) -> str:
        title, target = found.groups()
        path, hash_sign, anchor = target.partition("#")
        if not path or re.match(r"[a-z]+:", path):
            return found[0]
        file = Path(os.path.normpath(source.parent / path))
        if (CHECKOUT / file).is_dir():
            return title[1:-1]
        place = known.get(file) or add_file(file)
        return f"{title}({relative(place, known[source])}{hash_sign}{anchor})"

    # not in code
    parts = re.split(r"(^```.*?^```|`[^`\n]*`)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(part if at % 2 else LINK.sub(changed, part) for at, part in enumerate(parts))


def add_file(file: Path) -> PurePosixPath:
    """Copy a file that is not a page beside the pages; returns where."""
    place = PurePosixPath("files", *file.parts)
    if not place.suffix:
        place = place.with_name(f"{place.name}.txt")
    (PAGES / place).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(CHECKOUT / file, PAGES / place)
    return place


def relative(target: PurePosixPath, page: PurePosixPath) -> str:
    """Return the path from a page's folder to a file of the site."""
    return PurePosixPath(os.path.relpath(target, page.parent)).as_posix()


def gallery(known: dict[Path, PurePosixPath]) -> str:
    """Return a page with every picture of the guide, each with its description and a link to where it is explained."""
    lines, seen = ["# Gallery", ""], set()
    for source, target in known.items():
        if source.suffix != ".md" or target.name == "paper.md":  # the paper's figures stand side by side there
            continue
        for description, picture in PICTURE.findall((CHECKOUT / source).read_text(encoding="utf-8")):
            place = known[Path(os.path.normpath(source.parent / picture))]
            if place not in seen:
                seen.add(place)
                lines += [f"![{description}]({place})", "", f"*{description}.* [{title_of(source)}]({target})", ""]
    return "\n".join(lines)


def title_of(page: Path) -> str:
    return (CHECKOUT / page).read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")


def reference() -> str:
    """Return a page that names every public object of the library; mkdocstrings puts its docstring there."""
    solver = import_module("sparse_surface.solver")  # the environment has the checkout installed
    lines = ["# Reference", "", "Made from the docstrings. [The Python interface](api.md) lists all in short.", ""]
    for name in sorted(solver.__all__, key=str.lower):
        found = getattr(solver, name)
        home = f"sparse_surface.solver.{solver._HOME[name]}.{name}"
        if callable(found):  # where it is defined: some names are methods of a class
            home = f"{found.__module__}.{found.__qualname__}"
        lines += [f"## {name}", "", f"::: {home}", ""]
    return "\n".join(lines)


def menu() -> list[dict[str, object]]:
    decisions = [f"decisions/{path.name}" for path in sorted((DOCS / "decisions").glob("[0-9]*.md"))]
    parts: list[dict[str, object]] = [{"Sparse Surface": "index.md"}]
    parts += [{title: list(pages)} for title, pages in SECTIONS.items()]
    return [*parts, {"Decisions": ["decisions/index.md", *decisions]}]


if __name__ == "__main__":
    sys.exit(main())
