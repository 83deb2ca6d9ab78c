"""The web site of the documents: its pages, and links changed to what it has.  `make docs` builds it."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path, PurePosixPath
from types import ModuleType

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(CHECKOUT / "scripts"))
    module = importlib.import_module("build_docs")
    monkeypatch.setattr(module, "PAGES", tmp_path / "pages")
    monkeypatch.setattr(module, "PACKAGE", tmp_path / "package")
    return module


def test_links_lead_to_the_pages_of_the_site(site: ModuleType) -> None:
    known = site.places()
    text = "[a](docs/method.md#x) `[b](docs/c.md)` ![p](docs/pictures/heat_map.png) [e](examples) [w](https://a.b)"
    changed = site.site_text(f"{text} [l](LICENSE)", Path("README.md"), known)
    assert changed == (
        "[a](method.md#x) `[b](docs/c.md)` ![p](pictures/heat_map.png) e [w](https://a.b) [l](files/LICENSE.txt)"
    )
    assert (site.PAGES / "files" / "LICENSE.txt").read_bytes() == (CHECKOUT / "LICENSE").read_bytes()
    page = Path("docs/decisions/README.md")
    assert known[page] == PurePosixPath("decisions/index.md")
    changed = site.site_text("[r](../../README.md) [a](../accuracy.md)", page, known)
    assert changed == "[r](../index.md) [a](../accuracy.md)"


def test_every_page_is_in_the_menu_once_and_every_public_name_in_the_reference(site: ModuleType) -> None:
    site.stage_package()
    site.stage_pages()
    pages = [path for path in site.PAGES.rglob("*") if path.suffix in (".md", ".ipynb")]
    staged = {path.relative_to(site.PAGES).as_posix() for path in pages}
    listed = re.findall(r'"([\w/.-]+\.(?:md|ipynb))"', json.dumps(site.menu()))
    assert sorted(listed) == sorted(staged)
    reference = (site.PAGES / "reference.md").read_text(encoding="utf-8")
    names = importlib.import_module("sparse_surface.solver").__all__
    assert re.findall(r"^## (\w+)$", reference, re.MULTILINE) == sorted(names, key=str.lower)
    pictures = {path.name for path in (site.PAGES / "pictures").glob("*.png")}
    assert set(re.findall(r"\(pictures/(\w+\.png)\)", (site.PAGES / "gallery.md").read_text())) == pictures
