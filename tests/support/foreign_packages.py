"""Packages of others, as an installer leaves them on Python's path, without an installer."""

import shutil
import sys
import tomllib
from pathlib import Path

from companion.planning.plugins import installed_planners

EXAMPLE = Path(__file__).parents[2] / "docs" / "example-planner"
GROUP = "safe_rrt_companion.planners"


class Packages:
    """Installs packages into a folder that is on the path as long as a test lasts."""

    def __init__(self, folder):
        self._folder = folder
        self._modules = set()

    def install(self, distribution, entries, modules=None):
        """Install a package, version 1.0: its planners' entry points, and the text of its modules."""
        installed_planners._all_entries.cache_clear()
        info = self._folder / f"{distribution.replace('-', '_')}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n", encoding="utf-8"
        )
        told = "".join(f"{name} = {place}\n" for name, place in entries.items())
        (info / "entry_points.txt").write_text(f"[{GROUP}]\n{told}", encoding="utf-8")
        for name, text in (modules or {}).items():
            self._modules.add(name)
            (self._folder / f"{name}.py").write_text(text, encoding="utf-8")

    def install_example(self):
        """Install the package of docs/example-planner; returns its entry points."""
        project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        (module,) = EXAMPLE.glob("*.py")
        self._modules.add(module.stem)
        shutil.copy(module, self._folder)
        self.install(project["name"], project["entry-points"][GROUP])
        return project["entry-points"][GROUP]

    def forget(self):
        """Unload what was loaded."""
        for name in self._modules:
            sys.modules.pop(name, None)
        installed_planners._all_entries.cache_clear()
        installed_planners.installed_planner.cache_clear()
