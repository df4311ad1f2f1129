"""What the page on support says of versions is what the project says of them elsewhere."""

import re
import tomllib

from tests.docs.run_notebook import ROOT
from tests.packaging.test_locks import MACHINES, PYTHONS

PAGE = (ROOT / "docs" / "support.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def table_under(heading):
    """Rows of cells of the table in a section, without its head."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    rows = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row] for row in rows[2:]]


def test_the_pythons_are_those_of_the_project_and_of_its_tests():
    named = tuple(row[0] for row in table_under("Python"))
    classifiers = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert named == tuple(classifiers) == PYTHONS
    assert PROJECT["requires-python"] == f">={named[0]}"
    tried = re.search(r"^for version in (.*); do", (ROOT / ".ci" / "pythons").read_text("utf-8"), flags=re.M)
    assert tuple(tried[1].split()) == named
    image = re.search(r"^FROM python:(3\.\d+)-", (ROOT / "Dockerfile").read_text("utf-8"), flags=re.M)
    (ours,) = [row for row in table_under("Python") if "that of the image" in row[1]]
    assert ours[0] == image[1]


def test_each_autopilot_is_told_of_where_its_flights_are():
    measured = (ROOT / "docs" / "real-autopilots.md").read_text(encoding="utf-8")
    rows = table_under("Autopilots")
    assert {row[0] for row in rows} == {"ArduPlane", "PX4"}
    for autopilot, version, _ in rows:
        assert f"{autopilot} {version}" in measured
    flown = set(re.findall(r"(?:ArduPlane|PX4) \d\.\d+-\w+", measured))
    assert flown == {f"{autopilot} {version}" for autopilot, version, _ in rows}


def test_the_processors_are_those_that_packages_are_locked_for():
    supported = " ".join(
        row[0] for row in table_under("Processors and systems") if "not supported" not in row[1]
    )
    assert all(machine.replace("_", "-") in supported for machine in MACHINES)
