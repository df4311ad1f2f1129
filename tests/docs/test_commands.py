"""Every command on the pages in docs and in the README is run, as a reader would type it.

What a test computer has not is stood in for, and only that: the serial port by the simulator over TCP,
mavlink-router by the simulator over UDP, systemd's programs, ``apt`` and ``sudo`` by ones that take every
argument, the system's folders and the one that ``pip`` installs into by ones of the test's. The simulator
flies faster than real time, the doctor counts for a second, and the campaign has fewer runs. A program that
runs for ever is stopped once it has said what it should. A command that several pages have is run with the
first of them.
"""

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.service.process.processes import free_port

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
LIMIT_S = 400.0  # of one program; it is ended then, and the test fails
REAL = (
    "make real ARDUPLANE=/path/to/arduplane PARM=/path/to/plane.parm "
    "PX4=/path/to/build/px4_sitl_default/bin/px4 JOBS=2"
)
ELSEWHERE = {
    "make fly": "tests/flights",
    "make test": "this run",
    REAL: "tests/real, with binaries of the user's",
}
MAVPROXY = "PYTHONPATH=integrations/mavproxy mavproxy.py --master=udp:127.0.0.1:14550 --map --console"
ELSEWHERE[MAVPROXY] = "tests/integrations, with a MAVProxy of the user's"
SYSTEMD = ("systemctl", "journalctl", "apt")
SIM = "python -m sim mission_configs/first-flight.yaml --listen"
SERIAL, TCP = "serial:///dev/ttyAMA0:921600", "tcp://127.0.0.1:5760"
OFFLINE = "--quiet --disable-pip-version-check --no-index --no-build-isolation"
SPEED = 4  # simulated seconds a second


def blocks_of(page):
    """The page's shell blocks."""
    found = re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return [re.sub(r"\s+#.*|^\.venv/bin/", "", block, flags=re.M).strip() for block in found]


class Reader:
    """Somebody at a shell, in a checkout."""

    def __init__(self, folder):
        self._folder, self._port, self._udp = folder, free_port(), free_port()
        self._others = []
        self._simulated = set()
        for entry in ROOT.iterdir():
            if entry.name not in (".venv", ".git", "flights", "campaigns"):
                (folder / entry.name).symlink_to(entry)
        (folder / "campaigns").mkdir()
        small = (ROOT / "campaigns" / "small.yaml").read_text(encoding="utf-8")
        assert "seeds: 12" in small
        (folder / "campaigns" / "small.yaml").write_text(small.replace("seeds: 12", "seeds: 2"), "utf-8")
        self._make_venv(folder / ".venv")
        programs = folder / "programs"
        programs.mkdir()
        for name in SYSTEMD:
            self._program(programs / name, 'case "$*" in *companion*) ;; *) exit 1 ;; esac')
        self._program(programs / "sudo", 'exec "$@"')
        path = f"{folder / '.venv' / 'bin'}:{programs}:{os.environ['PATH']}"
        self._environment = os.environ | {"PATH": path, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
        self._packages = folder / "packages"
        self._environment["PYTHONPATH"] = str(self._packages)

    @staticmethod
    def _program(path, body):
        path.write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
        path.chmod(0o755)

    @staticmethod
    def _make_venv(venv):
        """This run's environment under the name that ``make`` gives it."""
        venv.mkdir()
        for name in ("bin", "lib", "pyvenv.cfg"):
            (venv / name).symlink_to(Path(sys.prefix) / name)
        (venv / "stamp").touch()

    def _adapted(self, command):
        command = command.replace(SERIAL, TCP).replace("127.0.0.1:5760", f"127.0.0.1:{self._port}")
        command = command.replace("127.0.0.1:14540", f"127.0.0.1:{self._udp}")
        command = re.sub(r"^(python -m sim .*)", rf"\1 --speed {SPEED}", command)
        command = re.sub(r"^(companion doctor .*)", r"\1 --seconds 1", command)
        command = re.sub(r"^pip install", f"pip install {OFFLINE} --target {self._packages}", command)
        root = self._folder / "system"
        return re.sub(r"packaging/install\.sh", f"packaging/install.sh --root {root} --no-program", command)

    def run(self, block):
        """Run a block; the first program in it that fails fails the test."""
        for line in block.splitlines() if "companion run" in block or "python -m sim" in block else [block]:
            command = self._adapted(line)
            if line.startswith("python -m sim"):
                self._simulate(command)
            elif line.startswith("mavlink-routerd"):
                self._simulate(self._adapted(f"{SIM} udpout://127.0.0.1:14540"))
            elif line.startswith("companion run"):
                self._need_autopilot(command)
                self._until(command, "swap:")
            else:
                self._need_autopilot(command)
                self._whole(command)

    def _need_autopilot(self, command):
        """Power an autopilot for a command that wants one, unless the page has."""
        if f"tcp://127.0.0.1:{self._port}" in command and "tcp" not in self._simulated:
            self._simulate(self._adapted(f"{SIM} {TCP}"))

    def _simulate(self, command):
        self._simulated.add("udp" if "udp" in command else "tcp")
        self._others.append(self._started(command))
        said = self._others[-1].stdout.readline()
        assert "flying" in said, said

    def _started(self, command):
        return subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self._folder, env=self._environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip

    def _until(self, command, words):
        """Run a program until it says something, then stop it as the service manager does."""
        program, said = self._started(command), []
        alarm = threading.Timer(LIMIT_S, program.kill)
        alarm.start()
        try:
            for line in program.stdout:
                said.append(line)
                if words in line:
                    program.send_signal(signal.SIGTERM)
            program.stdout.close()
            assert program.wait() == 0, f"{command}\n{''.join(said)}"
            assert any(words in line for line in said), f"{command}\n{''.join(said)}"
        finally:
            alarm.cancel()
            program.kill()

    def _whole(self, command):
        done = subprocess.run(
            ["bash", "-ec", command], cwd=self._folder, env=self._environment, text=True, timeout=LIMIT_S,
            capture_output=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"

    def leave(self):
        """Switch everything off."""
        for program in self._others:
            os.killpg(program.pid, signal.SIGKILL)
            program.communicate()


@pytest.fixture
def reader(tmp_path):
    reader = Reader(tmp_path)
    yield reader
    reader.leave()


def first_pages():
    """Blocks of each page that no page before it has, without what is run elsewhere."""
    known, found = set(), {}
    for page in PAGES:
        for block in blocks_of(page):
            lines = [line for line in block.splitlines() if line not in ELSEWHERE]
            kept = "\n".join(lines)
            words = {" ".join(sorted(line.replace(SERIAL, TCP).split())) for line in lines}
            if not words <= known:
                found.setdefault(page, []).append(kept)
            known |= words
    return found


BLOCKS = first_pages()


@pytest.mark.parametrize("page", BLOCKS, ids=lambda page: page.name)
@pytest.mark.thorough
def test_every_command_of_a_page_works(page, reader):
    for block in BLOCKS[page]:
        reader.run(block)


def test_the_pages_are_found_and_those_with_commands_have_them():
    names = {page.name for page in PAGES if blocks_of(page)}
    assert {"README.md", "first-flight.md", "connecting.md", "troubleshooting.md"} <= names
    assert {"README.md", "first-flight.md", "connecting.md"} <= {page.name for page in BLOCKS}


LINK = re.compile(r"\]\((?!https?:)([^)#]+)?(#[^)]*)?\)")


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    broken = []
    for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        file = page if not target else (page.parent / target)
        if not file.exists():
            broken.append(target)
        elif anchor:
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.M)
            made = {
                re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings
            }
            if anchor[1:] not in made:
                broken.append(target + anchor)
    assert broken == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    named = re.findall(
        r"`((?:tests|docs|packaging|mission_configs|companion|sim)/[\w./-]+)`", page.read_text("utf-8")
    )
    assert [name for name in named if not (ROOT / name).exists()] == []
