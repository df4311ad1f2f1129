"""Pages that are made of the program and of notebooks, their order, and the check of every link.

This is the part of hooks.py that needs no mkdocs.
"""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

SOURCE = Path(__file__).resolve().parents[2]
INDEX = "docs/README.md"
REST = ["CHANGELOG.md", "SECURITY.md", "CONTRIBUTING.md"]
LISTED = re.compile(r"(?m)^\| \[([^\]]+)\]\(([^)]+)\)")
NOTEBOOK_LINK = re.compile(r"(\]\([^)\s]+)\.ipynb\b")
RANK = "---\nsearch: {boost: 0.3}\n---"  # what is written for readers is found before what is for programmers
LOADED = {"script": "src", "img": "src", "link": "href", "source": "src", "iframe": "src"}
NOT_LOADED = {"canonical", "edit", "next", "prev"}


def order() -> list[dict[str, Any]]:
    """Return the order of the pages: in the documentation that of the table in its README."""
    table = LISTED.findall((SOURCE / INDEX).read_text(encoding="utf-8"))
    listed = [{title: f"docs/{page_of(name)}"} for title, name in table if not name.startswith("..")]
    return [
        {"Overview": "README.md"},
        {"Documentation": [INDEX, *listed]},
        {"Reference": [reference_of(package) for package in packages()]},
        {"Project": REST},
    ]


def page_of(name: str) -> str:
    """Return the name of a notebook's page, and any other name as it is."""
    return f"{name.removesuffix('.ipynb')}.md" if name.endswith(".ipynb") else name


def packages() -> dict[str, list[str]]:
    """Return the program's packages, each with its public modules."""
    found = {}
    for init in sorted((SOURCE / "companion").rglob("__init__.py")):
        names = sorted(path.stem for path in init.parent.glob("[!_]*.py"))
        found[".".join(init.parent.relative_to(SOURCE).parts)] = names
    return found


def reference_of(package: str) -> str:
    """Return where the reference of a package lies: beside the pages that its docstrings link to."""
    return f"docs/{package}.md"


def reference_page(package: str, modules: list[str]) -> str:
    """Return the page of a package, as mkdocstrings reads it."""
    parts = [
        RANK,
        f"# {package}",
        f"::: {package}\n    options: {{members: false, show_root_heading: false}}",
    ]
    parts += [f"::: {package}.{module}" for module in modules]
    return "\n\n".join(parts) + "\n"


def notebook_page(notebook: dict[str, Any]) -> str:
    """Return a notebook as Markdown: its texts, its code, and what the code said."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "image/png" in data:
                picture = "".join(data["image/png"]).replace("\n", "")
                parts.append(f"![What the cell shows](data:image/png;base64,{picture})")
            else:
                parts.append(f"```text\n{''.join(data['text/plain']).rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


class Links(HTMLParser):
    """What a page links to, what it loads, and which places in it have a name."""

    def __init__(self) -> None:
        super().__init__()
        self.led_to: list[str] = []
        self.loaded: list[str] = []
        self.names: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        has = {key: value or "" for key, value in attrs}
        self.names.update(filter(None, (has.get("id"), has.get("name"))))
        if tag == "a" and "href" in has:
            self.led_to.append(has["href"])
        elif tag in LOADED and LOADED[tag] in has and has.get("rel") not in NOT_LOADED:
            self.loaded.append(has[LOADED[tag]])


def broken(site: Path) -> list[str]:
    """Return the links of a site that lead to no file or no place in it, or load from elsewhere."""
    pages = {}
    for path in sorted(site.rglob("*.html")):
        pages[path] = Links()
        pages[path].feed(path.read_text(encoding="utf-8"))
    found = []
    for path, links in pages.items():
        if path.name == "404.html":  # served at any address, so its links begin at the root
            continue
        for link in links.led_to + links.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                is_wrong = link in links.loaded and parts.scheme != "data"
            else:
                target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                target = target / "index.html" if target.is_dir() else target
                is_wrong = not target.is_file() or (
                    bool(parts.fragment) and target in pages and not _has(pages[target], parts.fragment)
                )
            if is_wrong:
                found.append(f"{path.relative_to(site)}: {link}")
    return found


def _has(links: Links, fragment: str) -> bool:
    return unquote(fragment) in links.names
