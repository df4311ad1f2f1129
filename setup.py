"""Gives the simulator a name of its own where the project is installed; pyproject.toml says the rest.

The directory ``sim`` is the package ``companion_sim`` in a wheel, so that no environment gets a package
called ``sim``. An editable installation leaves the name, because Python finds the directory itself there.
"""

from setuptools import find_namespace_packages, setup
from setuptools.command.editable_wheel import editable_wheel

DIRECTORY = "sim"
PREFIX = "companion_"


class EditableWheel(editable_wheel):
    """Installs the checkout with its directories as they are."""

    def finalize_options(self) -> None:
        """Take the new name out of packages and entry points."""
        super().finalize_options()
        self.dist_info_dir = None  # An installer may hand in what was prepared, and that is of a wheel.
        self.distribution.package_dir = {}
        self.distribution.packages = [name.removeprefix(PREFIX) for name in self.distribution.packages]
        self.distribution.entry_points = {
            group: [entry.replace(PREFIX + DIRECTORY, DIRECTORY) for entry in entries]
            for group, entries in self.distribution.entry_points.items()
        }


setup(
    packages=[
        *find_namespace_packages(include=["companion", "companion.*"]),
        *(PREFIX + name for name in find_namespace_packages(include=[DIRECTORY, f"{DIRECTORY}.*"])),
    ],
    package_dir={PREFIX + DIRECTORY: DIRECTORY},
    cmdclass={"editable_wheel": EditableWheel},
)
