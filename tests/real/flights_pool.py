"""Many flights, several at once, each in a process and, where that is possible, a network of its own."""

import contextlib
import itertools
import json
import os
import queue
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from tests.real.flight_judge import FlightJudge
from tests.real.scenarios import SCENARIOS

ROOT = Path(__file__).parents[2]
FLIGHT_LIMIT_S = 1500.0
IN_NAMESPACE = ("unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh")
COLUMNS = (
    ("autopilot", "{:<9}"), ("scenario", "{:>3}"), ("seed", "{:>4}"), ("commit", "{:>8}"),
    ("takeover_s", "{:>10}"), ("takeover_up_m", "{:>8}"), ("entered_s", "{:>9}"), ("refused", "{:>7}"),
    ("uploads", "{:>7}"), ("swaps", "{:>5}"), ("clearance_m", "{:>9}"), ("goal_reached", "{:>5}"),
    ("landed", "{:>6}"), ("texts_per_min", "{:>9}"), ("flight_s", "{:>8}"), ("verdict", "{}"),
)  # fmt: skip
HEADS = (
    "autopilot", "no.", "seed", "commit", "takeover s", "at m", "entered s", "refused", "uploads", "swaps",
    "clear m", "goal", "landed", "texts/min", "flight s", "verdict",
)  # fmt: skip


@dataclass(frozen=True)
class Binaries:
    """The user's own autopilots, None where there is none."""

    arduplane: Path | None = None
    px4: Path | None = None
    parameters: str = ""

    @classmethod
    def named(cls, environment):
        """As the environment names them: ARDUPLANE, PARM and PX4."""
        paths = [environment.get(name, "") for name in ("ARDUPLANE", "PX4")]
        found = [Path(path).resolve() if path else None for path in paths]
        parameters = [str(Path(path).resolve()) for path in environment.get("PARM", "").split(",") if path]
        return cls(found[0], found[1], ",".join(parameters))

    def of(self, kind):
        """The binary of a kind of autopilot."""
        return self.arduplane if kind == "arduplane" else self.px4


@dataclass(frozen=True)
class Wanted:
    """A flight to be flown."""

    kind: str
    scenario: str
    seed: int

    @property
    def name(self):
        return f"{self.kind}-{self.scenario}-{self.seed}"


def all_wanted(binaries, seeds, scenarios=None, kinds=("arduplane", "px4")):
    """Every flight, the autopilots in turn; those without a binary are left out."""
    numbers = scenarios or [scenario.number for scenario in SCENARIOS]
    turns = itertools.product(seeds, numbers, kinds)
    return [Wanted(kind, number, seed) for seed, number, kind in turns if binaries.of(kind) is not None]


def has_namespaces():
    """Whether a process may be given a network of its own here."""
    with contextlib.suppress(OSError):
        return subprocess.run([*IN_NAMESPACE, "true"], capture_output=True, check=False).returncode == 0
    return False


def flown(binaries, wanted, folder, instance, *, wind=0.0, sections="{}", autoland=4):
    """Fly one; its row. ``sections`` of the mission file are set, as JSON."""
    place = folder / wanted.name
    before = IN_NAMESPACE if has_namespaces() else ()
    command = [
        *before, sys.executable, "-m", "tests.real.one_flight", wanted.kind, wanted.scenario,
        str(wanted.seed), str(place), "--binary", str(binaries.of(wanted.kind)),
        "--parameters", binaries.parameters if wanted.kind == "arduplane" else "",
        "--instance", str(instance), "--wind", str(wind), "--sections", sections,
        "--autoland", str(autoland),
    ]  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{wanted.name}.out").open("w") as out:
        subprocess.run(
            command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdout=out,
            stderr=subprocess.STDOUT, timeout=FLIGHT_LIMIT_S, check=False,
        )  # fmt: skip
    return judged(place)


def judged(place):
    """The row of a flight's folder, written beside it."""
    row = FlightJudge(place).row()
    (place / "row.json").write_text(json.dumps(row, indent=1), encoding="utf-8")
    return row


def fly_all(binaries, flights, folder, jobs, tell, *, instance=1, **choices):
    """Fly all, some at once, and tell each row as it comes."""
    waiting = queue.Queue()
    for wanted in flights:
        waiting.put(wanted)
    rows, lock = [], threading.Lock()

    def work(number):
        while True:
            try:
                wanted = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                row = flown(binaries, wanted, folder, number, **choices)
            except (OSError, ValueError, KeyError, subprocess.TimeoutExpired) as error:
                row = {"autopilot": wanted.kind, "scenario": wanted.scenario, "seed": wanted.seed,
                       "verdict": f"not flown: {error}"}  # fmt: skip
            with lock:
                rows.append(row)
                tell(row)

    threads = [threading.Thread(target=work, args=(instance + number,)) for number in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return rows


def told(value):
    """A value in a table."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.1f}" if isinstance(value, float) else str(value)


def line_of(row):
    """A row as a line of the table."""
    return " ".join(form.format(told(row.get(key))) for key, form in COLUMNS)


def head():
    """The table's head."""
    return " ".join(form.format(text) for (_, form), text in zip(COLUMNS, HEADS, strict=True))
