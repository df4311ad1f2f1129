"""``python -m tests.ui.page.draw_page``: docs/img/page-*.png, of flights while they are flown."""

import contextlib
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from PIL import Image

from companion.config import load_mission
from companion.ui.page.access import Access
from companion.ui.page.page_server import PageServer
from companion.ui.page.playback import recorded_playback
from tests.service.process.processes import free_port
from tests.ui.page.browser import Browser
from tests.ui.page.made_ground import write_ground

ROOT = Path(__file__).parents[3]
TARGET = ROOT / "docs" / "img"
COLOURS = 256


def kept(page, name):
    """Keep what is seen, small enough for a repository."""
    file = TARGET / f"page-{name}.png"
    page.run("return new Promise((done) => setTimeout(done, 1500))")
    page.picture(file)
    picture = Image.open(file).convert("RGB").quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE)
    picture.save(file, optimize=True)
    sys.stdout.write(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1000:.0f} kB\n")


def opened(url, **look):
    page = Browser(**look)
    page.open(url)
    page.until("window.companionPage?.figures.firstPictureMs", seconds=120.0)
    return page


@contextlib.contextmanager
def flying(mission, port, folder, *more):
    """A flight in the simulator, at twice its speed, with a page."""
    flight = subprocess.Popen(
        [
            sys.executable, "-m", "companion", "sitl", str(mission), "--page", str(port), "--speed", "2",
            "--flights", folder, *more,
        ],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert any("page: " in line for line in flight.stdout)
        threading.Thread(target=flight.stdout.read, daemon=True).start()
        yield
    finally:
        flight.terminate()
        flight.wait()
        flight.stdout.close()


def live(folder):
    """Pictures of the flight while it goes on."""
    port = free_port()
    with flying("mission_configs/paper-3d.yaml", port, folder):
        url = f"http://127.0.0.1:{port}/"
        with opened(url) as page:
            page.until("window.companionPage.page.store.now > 70", seconds=300.0)
            kept(page, "live")
        with opened(url, is_dark=True) as page:
            page.until("window.companionPage.page.store.now > 95", seconds=300.0)
            kept(page, "dark")
        with opened(url, size=(390, 844), ratio=1.5, is_phone=True) as page:
            kept(page, "phone")
        with opened(url) as page:
            page.press("3")
            page.until("window.companionPage.page.store.now > 150", seconds=300.0)
            kept(page, "3d")
            page.until("window.companionPage.page.store.standing?.mode === 'arrived'", seconds=600.0)


def over_ground(folder):
    """The same over ground of local files, made up for the valley."""
    valley = Path("mission_configs") / "valley.yaml"
    write_ground(load_mission(ROOT / valley), folder)
    port = free_port()
    with flying(valley, port, folder, "--page-ground", folder), opened(f"http://127.0.0.1:{port}/") as page:
        page.until("window.companionPage.page.store.now > 35", seconds=300.0)
        kept(page, "ground")


def from_the_side(folder):
    """A flight in the lee of a ridge, hidden from the radar on it."""
    leeward = "mission_configs/leeward.yaml"
    command = [sys.executable, "-m", "companion", "sitl", leeward, "--speed", "0", "--flights", folder]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    [flight] = Path(folder).iterdir()
    playback = recorded_playback(flight)
    playback.name = "leeward"
    server = PageServer(Access(0), None, [playback])
    with opened(f"{server.address}?t=50") as page:
        page.until("window.companionPage.page.side.floors.length")
        kept(page, "side")
    server.close()


def replayed(folder):
    [flight] = Path(folder).iterdir()
    playback = recorded_playback(flight)
    playback.name = "paper-3d"
    server = PageServer(Access(0), None, [playback])
    with opened(f"{server.address}?t=207") as page:
        kept(page, "replay")
    server.close()


def main():
    for draw in (lambda folder: (live(folder), replayed(folder)), over_ground, from_the_side):
        with tempfile.TemporaryDirectory(prefix="page-") as folder:
            draw(folder)


if __name__ == "__main__":
    main()
