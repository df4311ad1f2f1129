"""The module in MAVProxy itself, on a screen of its own: make mavproxy-test."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from PIL import Image

from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.page_server import PageServer
from tests.docs.test_commands import free_port
from tests.ui.page.flown import Told

pytestmark = pytest.mark.mavproxy
FOLDER = Path(__file__).parents[2] / "integrations" / "mavproxy"
TRIES = 120  # pictures, each of which takes a moment
RADAR, HUNTER, FLOWN, REACH = (255, 60, 60), (255, 0, 120), (190, 80, 255), (255, 120, 180)
UNSENSED = (150, 80, 80)
DISPLAY = ":78"


@pytest.fixture
def screen():
    """An X server without a screen."""
    server = subprocess.Popen(["Xvfb", DISPLAY, "-screen", "0", "1000x700x24"], stderr=subprocess.DEVNULL)
    yield {**os.environ, "DISPLAY": DISPLAY}
    server.terminate()
    server.wait()


def colours(screen, file):
    """How many pixels of each colour the screen shows; none before it is there."""
    shot = subprocess.run(
        ["import", "-window", "root", str(file)], env=screen, check=False, capture_output=True, timeout=30.0
    )
    if shot.returncode:
        return {}
    return {colour: count for count, colour in Image.open(file).convert("RGB").getcolors(2**24)}


def test_a_flight_is_on_mavproxys_map(screen, tmp_path):
    feed = Feed()
    server = PageServer(Access(0), feed)
    told = Told(feed.tell)
    told.fly(2)
    place = told.mission.origin
    commands = [
        "map zoom 6000", f"map center {place.latitude_deg} {place.longitude_deg}",
        "module load mavproxy_companion", f"companion open {server.address}",
    ]  # fmt: skip
    proxy = subprocess.Popen(
        [
            os.environ.get("MAVPROXY") or shutil.which("mavproxy.py"),
            f"--master=udpin:127.0.0.1:{free_port()}",
            "--map", "--daemon", "--no-state", f"--cmd={'; '.join(commands)}",
        ],
        env={**screen, "PYTHONPATH": str(FOLDER), "HOME": str(tmp_path)},
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    wanted = {HUNTER, FLOWN, REACH}
    try:
        for _ in range(TRIES):
            seen = colours(screen, tmp_path / "shot.png")
            if all(seen.get(colour, 0) > 50 for colour in wanted):
                break
            assert proxy.poll() is None
        assert seen.get(RADAR, 0) + seen.get(UNSENSED, 0) > 50
        assert all(seen.get(colour, 0) > 50 for colour in wanted)
    finally:
        proxy.terminate()
        words, _ = proxy.communicate()
        server.close()
    assert "Loaded module mavproxy_companion" in words
