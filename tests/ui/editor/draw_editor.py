"""``python -m tests.ui.editor.draw_editor``: docs/img/edit*.png, the editor while somebody works with it."""

import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image

from companion.ui.editor.edit_server import EditServer
from companion.ui.editor.edit_session import EditSession
from companion.ui.page.access import Access
from tests.ui.editor.test_edit_page import Editing

ROOT = Path(__file__).parents[3]
TARGET = ROOT / "docs" / "img"
COLOURS = 256


def kept(page, name):
    """Keep what is seen, small enough for a repository."""
    file = TARGET / f"{name}.png"
    page.run("return new Promise((done) => setTimeout(done, 1500))")
    page.picture(file)
    picture = Image.open(file).convert("RGB").quantize(COLOURS, kmeans=2, dither=Image.Dither.NONE)
    picture.save(file, optimize=True)
    sys.stdout.write(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1000:.0f} kB\n")


def slide(page, key, value):
    """Move a slider of the prices and limits."""
    page.run(
        "const slider = document.getElementById(`slider-${arguments[0]}`); slider.value = arguments[1];"
        "slider.dispatchEvent(new Event('input', { bubbles: true }))",
        key, value,
    )  # fmt: skip


def main():
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "paper-2d.yaml"
        shutil.copy(ROOT / "mission_configs" / mission.name, mission)
        server = EditServer(Access(0, token="correct horse"), EditSession(mission))
        with Editing(size=(1440, 900)) as page:
            page.begin(server)
            page.run("document.querySelector('#about').textContent = 'my-mission.yaml'")
            page.run("document.querySelector('#what-if').open = true")
            page.until("window.companionPage.editor.planning.file")
            slide(page, "price_seen", 20)
            page.until("window.companionPage.editor.planning.other")
            kept(page, "edit-what-if")
            page.click("#drop")
            page.run("document.querySelector('#what-if').open = false")
            page.state("editor.goTo(['goals', 0])")
            page.write("up_m", "2000")
            page.run("document.querySelector('#about').textContent = 'my-mission.yaml'")
            kept(page, "edit-error")
        server.close()


if __name__ == "__main__":
    main()
