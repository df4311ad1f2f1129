"""From a plan, a KML and a table to a flight; the same drawn in the browser: python -m tests.ui.editor.walk

Commands and mouse are the program's; a person reads and thinks besides. Prints the seconds of each step.
"""

import argparse
import logging
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from companion.config import load_mission
from companion.ui.editor.edit_server import EditServer
from companion.ui.editor.edit_session import EditSession
from companion.ui.page.access import Access
from tests.ui.editor.test_edit_page import TOKEN, Editing

FILES = [f"docs/own-mission/{name}" for name in ("field.plan", "buildings.kml", "radars.csv")]
FLIGHT_S = 300.0
log = logging.getLogger("walk")


class Watch:
    """A stop-watch that names each of its steps."""

    def __init__(self):
        self._begun = self._last = time.monotonic()

    def lap(self, what):
        now = time.monotonic()
        log.info("%7.1f s  %s", now - self._last, what)
        self._last = now

    def total(self, what):
        log.info("%7.1f s  altogether: %s", time.monotonic() - self._begun, what)


def companion(*words):
    subprocess.run(
        [sys.executable, "-m", "companion", *map(str, words)], check=True, stdout=subprocess.DEVNULL
    )


class Page:
    """The editor's page of a mission file."""

    def __init__(self, file):
        self._server = EditServer(Access(0, token=TOKEN, cookie="companion-edit-1"), EditSession(file))
        self.window = Editing()
        self.window.begin(self._server)

    def __enter__(self):
        return self.window

    def __exit__(self, *_):
        self.window.close()
        self._server.close()


def fly(window, watch):
    """Fly in the page, to the goal."""
    window.until("window.companionPage.editor.planning.file", seconds=60.0)
    watch.lap("a plan is shown")
    window.click("#fly")
    is_over = "document.querySelector('#flown').innerText.startsWith('The goal')"
    window.until(is_over, seconds=FLIGHT_S)
    watch.lap("flown in the page: " + window.text("#flown").splitlines()[0])


def imported(folder):
    """Import the three files, check, and fly by command."""
    watch, mission = Watch(), folder / "imported.yaml"
    companion("import", *FILES, "-o", mission)
    watch.lap("companion import")
    companion("check", mission)
    watch.lap("companion check")
    companion("sitl", mission, "--headless", "--flights", folder / "flights")
    watch.lap("companion sitl")
    watch.total("imported")
    return mission


def drawn(folder, like):
    """Draw what was imported, on the map of an empty mission, save it and fly there."""
    watch, mission, wanted = Watch(), folder / "drawn.yaml", load_mission(like)
    origin, goal = wanted.origin, wanted.goals[-1]
    latitude, longitude, _ = wanted.frame.global_from_local(goal.east_m, goal.north_m, 0.0)
    home = f"{origin.latitude_deg},{origin.longitude_deg},{origin.altitude_amsl_m}"
    companion(
        "new", mission, "--home", home, "--aircraft", "medium", "--goal", f"{latitude},{longitude}",
        "--height", str(wanted.start.up_m),
    )  # fmt: skip
    watch.lap("companion new")
    with Page(mission) as window:
        watch.lap("the editor is open")
        (west, east), (south, north) = wanted.bounds.east_m, wanted.bounds.north_m
        buildings = [one for one in wanted.obstacles if "fence" not in one.name]
        shapes = [("obstacle", [list(corner) for corner in one.polygon_enu_m]) for one in buildings]
        shapes += [("radar", [[radar.east_m, radar.north_m]]) for radar in wanted.radars]
        corners = [
            [west + 30, south + 30],
            [east - 30, south + 30],
            [east - 30, north - 30],
            [west + 30, north - 30],
        ]
        for tool, places in [*shapes, ("fence", corners)]:
            window.click(f"button[data-tool={tool}]")
            for place in places:
                window.point(place)
            if len(places) > 1:
                window.type_key("Enter")
            window.settled()
        counts = window.state("[editor.elements.length, editor.state.faults.length]")
        watch.lap(f"{len(shapes) + 1} shapes are drawn: {counts[0]} elements, {counts[1]} errors")
        if counts[1]:
            raise SystemExit(window.text("#faults"))
        window.click("#save")
        window.settled()
        fly(window, watch)
        watch.total("drawn")


def main():
    """Walk both ways."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    folder = Path(tempfile.mkdtemp())
    try:
        mission = imported(folder)
        with Page(shutil.copy(mission, folder / "again.yaml")) as window:
            fly(window, Watch())
        drawn(folder, mission)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
