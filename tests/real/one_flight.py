"""One flight in a process of its own: ``python -m tests.real.one_flight KIND SCENARIO SEED FOLDER …``."""

import argparse
import json
import os
import subprocess
import traceback
from pathlib import Path

from tests.real.rig.autopilots import KINDS
from tests.real.rig.course import Course
from tests.real.rig.deck import Deck
from tests.real.scenarios import BY_NUMBER


def fly(arguments):
    """Fly, and write down what happened."""
    kind, scenario = KINDS[arguments.kind], BY_NUMBER[arguments.scenario]
    folder = Path(arguments.folder)
    folder.mkdir(parents=True)
    changes = {
        **scenario.changes,
        "vehicle": {**kind.vehicle, **scenario.changes.get("vehicle", {})},
        "origin": {"altitude_amsl_m": kind.altitude_amsl_m},
        **json.loads(arguments.sections),
    }
    course = Course(kind.factor, scenario.goal, changes)
    deck = Deck(
        kind, Path(arguments.binary), arguments.parameters, folder, arguments.instance, course,
        arguments.seed, loss=scenario.loss, wind=(arguments.wind, 240.0),
        autoland=arguments.autoland,
    )  # fmt: skip
    fault = ""
    try:
        deck.open()
        scenario.act(deck)
        deck.fly_to_end()
    except (AssertionError, OSError) as error:
        fault = f"{type(error).__name__}: {error}"
        (folder / "fault.txt").write_text(traceback.format_exc(), encoding="utf-8")
    finally:
        deck.close()
    station = deck.station
    document = {
        "kind": kind.name, "scenario": scenario.number, "seed": arguments.seed, "commit": commit(),
        "fault": fault, "events": deck.events, "passed": deck.relay.num_passed, "lost": deck.relay.num_lost,
        "texts": [] if station is None else list(station.texts),
        "path": [] if station is None else station.path,
    }  # fmt: skip
    (folder / "flight.json").write_text(json.dumps(document), encoding="utf-8")


def commit():
    """The project's, as far as it is known."""
    if "REAL_COMMIT" in os.environ:  # a copy of the project without its history
        return os.environ["REAL_COMMIT"]
    said = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    return said.stdout.strip()


def main():
    parser = argparse.ArgumentParser()
    for name in ("kind", "scenario"):
        parser.add_argument(name)
    parser.add_argument("seed", type=int)
    parser.add_argument("folder")
    parser.add_argument("--binary", required=True)
    parser.add_argument("--parameters", default="")
    parser.add_argument("--instance", type=int, default=0)
    parser.add_argument("--wind", type=float, default=0.0)
    parser.add_argument("--sections", default="{}")
    parser.add_argument("--autoland", type=int, default=4)
    fly(parser.parse_args())


if __name__ == "__main__":
    main()
