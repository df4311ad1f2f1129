"""What mkdocs does not do by itself: the order of the pages, the reference, the notebook, the check of links.

The pages are the repository's own. One page of the reference is made for each package of the program.
"""

from __future__ import annotations

import json
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pages import NOTEBOOK_LINK, broken, notebook_page, order, packages, page_of, reference_of, reference_page


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Set the order of the pages."""
    config.nav = order()
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the reference, and a page for each notebook."""
    for package, modules in packages().items():
        text = reference_page(package, modules)
        files.append(File.generated(config, reference_of(package), content=text))
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        text = notebook_page(json.loads(file.content_string))
        files.append(File.generated(config, page_of(file.src_uri), content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Let links to a notebook lead to its page."""
    return NOTEBOOK_LINK.sub(r"\1.md", markdown)


def on_post_build(config: MkDocsConfig) -> None:
    """Check every link of what was built.

    Raises
    ------
    PluginError
        If one leads nowhere, or something is loaded from another host.
    """
    if found := broken(Path(config.site_dir)):
        raise PluginError(f"{len(found)} broken links: " + "; ".join(found[:10]))
