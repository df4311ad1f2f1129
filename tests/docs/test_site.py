"""The documentation as a site, as far as no mkdocs is needed. ``make site`` builds it."""

import json

import pytest

from tests.docs.run_notebook import ROOT
from tests.packaging.tools import loaded

pages = loaded("pages", "packaging/site")


def test_every_page_of_docs_has_its_place():
    _, documentation, reference, project = (next(iter(entry.values())) for entry in pages.order())
    listed = {documentation[0]} | {name for entry in documentation[1:] for name in entry.values()}
    assert listed == {f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")} | {"docs/offline.md"}
    assert all((ROOT / name).is_file() for name in project)
    assert reference[0] == "docs/companion.md"


def test_a_package_has_its_public_modules():
    found = pages.packages()
    assert {"offline", "errors"} <= set(found["companion"])
    assert not any(name.startswith("_") for names in found.values() for name in names)
    assert "\n::: companion.types.path\n" in pages.reference_page("companion.types", found["companion.types"])


def test_a_notebook_becomes_a_page_with_what_its_cells_said():
    notebook = json.loads((ROOT / "docs" / "offline.ipynb").read_text(encoding="utf-8"))
    text = pages.notebook_page(notebook)
    assert text.startswith("# ")
    assert text.count("```python\n") == sum(cell["cell_type"] == "code" for cell in notebook["cells"])
    assert "data:image/png;base64," in text
    assert (
        pages.NOTEBOOK_LINK.sub(r"\1.md", "[a](x/offline.ipynb) `b.ipynb`") == "[a](x/offline.md) `b.ipynb`"
    )


@pytest.mark.parametrize(
    "link",
    ['<a href="none.html">', '<a href="b.html#none">', '<a href="#none">', '<img src="none.png">',
     '<script src="https://example.org/x.js"></script>', '<link rel="stylesheet" href="//x.org/x.css">'],
)  # fmt: skip
def test_a_link_that_leads_nowhere_or_loads_from_elsewhere_is_found(tmp_path, link):
    (tmp_path / "b.html").write_text('<h1 id="here">', encoding="utf-8")
    good = '<a href="b.html#here"><a href="https://example.org"><link rel="canonical" href="https://example.org">'
    (tmp_path / "a.html").write_text(good, encoding="utf-8")
    assert pages.broken(tmp_path) == []
    (tmp_path / "a.html").write_text(good + link, encoding="utf-8")
    (found,) = pages.broken(tmp_path)
    assert found.startswith("a.html: ")
