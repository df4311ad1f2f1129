"""The command line as a user meets it: arguments in, output and exit code out."""

import subprocess
import sys
from dataclasses import dataclass

from companion import cli
from tests.sim.client import CONFIGS

FIRST_FLIGHT = CONFIGS / "first-flight.yaml"
GOOD = FIRST_FLIGHT.read_text(encoding="utf-8")


@dataclass
class Result:
    code: int
    out: str
    err: str


def in_a_process(*arguments, timeout_s=120, without=None):
    """The installed entry, in a process of its own; ``without`` names a module that is not there."""
    absent = "" if without is None else f"sys.modules[{without!r}] = None; "
    start = f"import sys; {absent}from companion.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", start, *map(str, arguments)],
        capture_output=True, text=True, timeout=timeout_s, check=False,
    )  # fmt: skip
    return Result(done.returncode, done.stdout, done.stderr)


class Caller:
    """The same entry in this process."""

    def __init__(self, monkeypatch, capsys):
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments):
        self._monkeypatch.setattr(sys, "argv", ["companion", *map(str, arguments)])
        self._monkeypatch.setattr(cli, "console", cli.Console(width=200))
        self._capsys.readouterr()
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = stop.code or 0
        said = self._capsys.readouterr()
        return Result(code, said.out, said.err)


def changed(tmp_path, old, new):
    """The first mission with one thing changed, as a file; and the line on which it stands."""
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    path = tmp_path / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    return path, 1 + GOOD[: GOOD.index(old)].count("\n")
