"""``make real``: flights beside real autopilots, one row each; ends with 1 where a flight went wrong."""

import argparse
import json
import os
import sys
from pathlib import Path

from tests.real.flights_pool import Binaries, all_wanted, fly_all, head, judged, line_of

PX4_INSTANCE_MAX = 9  # those above speak to the port of the ninth


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.real", description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--seeds", type=int, default=1, help="how many of each")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--scenarios", default="", help="numbers, with commas; left out, all")
    parser.add_argument("--kinds", default="arduplane,px4")
    parser.add_argument("--instance", type=int, default=1, help="lowest number that ports follow from")
    parser.add_argument("--wind", type=float, default=0.0, help="of ArduPlane's simulator [m/s]")
    parser.add_argument(
        "--autoland",
        type=int,
        default=4,
        choices=(0, 2, 4),
        help="RTL_AUTOLAND of ArduPlanes that are sent home; with 0 RTL_TYPE of PX4 is 0, too",
    )
    parser.add_argument(
        "--sections", default="{}", help='of the mission file, to be set, as JSON: {"energy": {…}}'
    )
    parser.add_argument("--out", type=Path, default=Path("flights/real"), help="folder of the results")
    parser.add_argument("--judge", type=Path, nargs="*", help="judge these folders again, and fly nothing")
    given = parser.parse_args()
    say = sys.stdout.write
    if given.judge is not None:
        say(head() + "\n")
        for place in given.judge:
            say(line_of(judged(place)) + "\n")
        return 0
    binaries = Binaries.named(os.environ)
    for name, binary in (("ARDUPLANE", binaries.arduplane), ("PX4", binaries.px4)):
        if binary is None:
            say(f"{name} is not named: its half is left out\n")
        elif not os.access(binary, os.X_OK):
            say(f"{name}: {binary} is no program\n")
            return 2
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    flights = all_wanted(
        binaries, seeds, given.scenarios.split(",") if given.scenarios else None, given.kinds.split(",")
    )
    if binaries.px4 is not None and given.instance + given.jobs - 1 > PX4_INSTANCE_MAX:
        say(f"--instance {given.instance}, {given.jobs} at once: PX4 is heard up to {PX4_INSTANCE_MAX}\n")
        return 2
    say(head() + "\n")

    def tell(row):
        say(line_of(row) + "\n")
        sys.stdout.flush()

    rows = fly_all(
        binaries, flights, given.out.resolve(), given.jobs, tell, instance=given.instance, wind=given.wind,
        sections=given.sections, autoland=given.autoland,
    )  # fmt: skip
    (given.out / "rows.json").write_text(json.dumps(rows, indent=1), encoding="utf-8") if rows else None
    num_bad = sum(row["verdict"] != "ok" for row in rows)
    say(f"{len(rows)} flights, {num_bad} not as they should be; recordings in {given.out}\n")
    return int(num_bad > 0)


if __name__ == "__main__":
    sys.exit(main())
