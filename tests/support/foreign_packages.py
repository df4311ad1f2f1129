"""Packages of others, as an installer leaves them on Python's path, without an installer."""

import shutil
import sys
import tomllib
from pathlib import Path

from companion.planning.plugins import foreign_code, installed_planners, installed_threats

DOCS = Path(__file__).parents[2] / "docs"


class Packages:
    """Installs packages into a folder that is on the path as long as a test lasts."""

    def __init__(self, folder):
        self._folder = folder
        self._modules = set()

    def install(self, distribution, entries, modules=None, group=installed_planners.GROUP):
        """Install a package, version 1.0: its entry points of a group, and the text of its modules."""
        foreign_code.entries_of.cache_clear()
        info = self._folder / f"{distribution.replace('-', '_')}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n", encoding="utf-8"
        )
        told = "".join(f"{name} = {place}\n" for name, place in entries.items())
        (info / "entry_points.txt").write_text(f"[{group}]\n{told}", encoding="utf-8")
        for name, text in (modules or {}).items():
            self._modules.add(name)
            (self._folder / f"{name}.py").write_text(text, encoding="utf-8")

    def install_example(self, folder="example-planner"):
        """Install a package of docs; returns its entry points."""
        project = tomllib.loads((DOCS / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        (module,) = (DOCS / folder).glob("*.py")
        self._modules.add(module.stem)
        shutil.copy(module, self._folder)
        ((group, entries),) = project["entry-points"].items()
        self.install(project["name"], entries, group=group)
        return entries

    def forget(self):
        """Unload what was loaded."""
        for name in self._modules:
            sys.modules.pop(name, None)
        foreign_code.entries_of.cache_clear()
        installed_threats._log_once.cache_clear()
        installed_planners.installed_planner.cache_clear()
