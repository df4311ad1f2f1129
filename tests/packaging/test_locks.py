"""The lock files: all that is installed is in them as pyproject.toml wants it, each package with hashes."""

import re
import tomllib
from importlib import metadata
from itertools import product
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]
GROUPS = PROJECT["dependency-groups"]
NAME = canonicalize_name(PROJECT["project"]["name"])
# What each file is for: extras, whose dependencies come with those of the project itself, and groups.
FILES = {
    "dev": (("dev", "sim", "metrics", "plot", "terrain", "dask"), ("build",)),
    "service": (("metrics", "plot"), ("build",)),
    "rerun": (("rerun",), ()),
    "fuzz": ((), ("fuzz",)),
    "sbom": ((), ("sbom",)),
    "site": ((), ("site",)),
}
PYTHONS, MACHINES = ("3.11", "3.12", "3.13"), ("x86_64", "aarch64")
ENVIRONMENTS = [
    default_environment()
    | {"python_version": python, "python_full_version": f"{python}.0", "platform_machine": machine,
       "platform_system": "Linux", "sys_platform": "linux", "extra": ""}
    for python, machine in product(PYTHONS, MACHINES)
]  # fmt: skip
INSTALLS = re.compile(r"(pip install|\$\(PIP\)|\"\$\{install\[@\]\}\") +-")
DEFINES = re.compile(r":=|=\(")
HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")


def read(name):
    """Each package of a lock file: what is required of it, and its hashes."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    entries = re.sub(r"\\\n", " ", text).splitlines()
    return [
        (Requirement(re.split(r"\s--hash", entry)[0].strip()), HASH.findall(entry))
        for entry in entries
        if entry
    ]


LOCKS = {name: read(name) for name in FILES}


def wanted(name):
    """Requirements that pyproject.toml has of what a lock file is for."""
    extras, groups = FILES[name]
    rows = [*PROJECT["project"]["dependencies"]] if extras else []
    rows += [row for extra in extras for row in EXTRAS[extra]] + [
        row for group in groups for row in GROUPS[group]
    ]
    return [found for found in map(Requirement, rows) if canonicalize_name(found.name) != NAME]


def locked(name, environment):
    """Versions by package, as they are installed in an environment."""
    return {
        canonicalize_name(row.name): next(iter(row.specifier)).version
        for row, _ in LOCKS[name]
        if row.marker is None or row.marker.evaluate(environment)
    }


def test_there_is_no_other_lock_file():
    assert {path.name for path in (ROOT / "requirements").iterdir()} == {f"{name}.txt" for name in FILES}


def test_every_extra_and_group_is_locked_somewhere():
    assert {extra for extras, _ in FILES.values() for extra in extras} == EXTRAS.keys()
    assert {group for _, groups in FILES.values() for group in groups} == GROUPS.keys()
    assert PROJECT["build-system"]["requires"] == GROUPS["build"]


@pytest.mark.parametrize("name", FILES)
def test_every_package_has_one_version_and_hashes(name):
    for row, hashes in LOCKS[name]:
        assert [specifier.operator for specifier in row.specifier] == ["=="], row
        assert hashes, row
        assert not row.url, row


@pytest.mark.parametrize(
    "environment", ENVIRONMENTS, ids=["-".join(pair) for pair in product(PYTHONS, MACHINES)]
)
@pytest.mark.parametrize("name", FILES)
def test_what_is_wanted_is_locked_in_a_version_that_will_do(name, environment):
    versions = locked(name, environment)
    for row in wanted(name):
        if row.marker is None or row.marker.evaluate(environment):
            assert row.specifier.contains(versions[canonicalize_name(row.name)]), row


@pytest.mark.parametrize("name", FILES)
def test_what_the_locked_packages_want_is_locked_too(name):
    """As far as they are installed here, and say what they want.

    Older pip versions, as the one of Python 3.11's venv, take a locked version for `package[extra]` only if
    its row names the extra, and the newest one, of no known hash, if not.
    """
    versions, num_asked = locked(name, default_environment() | {"extra": ""}), 0
    extras = {canonicalize_name(row.name): row.extras for row, _ in LOCKS[name]}
    for package, version in versions.items():
        try:
            rows = metadata.requires(package) if metadata.version(package) == version else None
        except metadata.PackageNotFoundError:
            continue
        for row in map(Requirement, rows or ()):
            if row.marker is None or any(row.marker.evaluate({"extra": e}) for e in ("", *extras[package])):
                num_asked += 1
                found = canonicalize_name(row.name)
                assert row.specifier.contains(versions[found]), f"{package} wants {row}"
                assert row.extras <= extras[found], f"{package} wants {row}"
    assert num_asked or name in ("fuzz", "sbom", "site")


@pytest.mark.parametrize("name", [name for name in FILES if name != "dev"])
def test_no_package_has_another_version_or_other_hashes_in_another_file(name):
    first = {canonicalize_name(row.name): (row.specifier, hashes) for row, hashes in LOCKS["dev"]}
    for row, hashes in LOCKS[name]:
        assert first.get(canonicalize_name(row.name), (row.specifier, hashes)) == (row.specifier, hashes)


@pytest.mark.parametrize("name", FILES)
def test_no_file_says_where_packages_come_from(name):
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    assert not re.search(r"https?:|file:|index-url|find-links|@", text)


@pytest.mark.parametrize(
    ("file", "least"), [("Makefile", 1), ("Dockerfile", 2), ("packaging/install.sh", 2), (".ci/install", 3)]
)
def test_every_installation_is_by_hashes_or_of_the_project_alone(file, least):
    text = re.sub(r"\\\n\s*", "", (ROOT / file).read_text(encoding="utf-8"))
    commands = (command for line in text.splitlines() for command in line.split("&&"))
    calls = [command for command in commands if INSTALLS.search(command) and not DEFINES.search(command)]
    assert len(calls) >= least
    for call in calls:
        assert ("--require-hashes -r " in call) != ("--no-deps --no-build-isolation" in call), call
