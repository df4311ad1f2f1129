"""What the return path costs the mission's own exchange over a serial line.

``python -m tests.returns.exchange_cost``: each flight is flown with the return path kept up to date, and
without. An exchange of a mission lasts from its begin until the mission is stored; the time for which it
waits until the exchange of a return path has ended is added.
"""

import argparse
import logging
import math
import statistics
import sys

from companion.config import load_mission
from companion.types.events import Dialect
from sim.faults import FaultyLink, LinkFaults
from tests.returns.return_flights import BY_PATH
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness
from tests.support.timed_link import TimedLink

BITS = 10  # A byte on a serial line takes a start and a stop bit, too.


class TimedFlight(SitlHarness):
    """A flight over a serial line; the times of its exchanges are kept."""

    def __init__(self, mission, baud, *, keeps_return_path, **more):
        mission = mission.model_copy(
            update={"authority": mission.authority.model_copy(update={"keep_return_path": keeps_return_path})}
        )
        super().__init__(mission, **more)
        self.link_kind = TimedLink
        parameter, value = BY_PATH[Dialect.ARDUPILOT]
        self.simulator.autopilot.parameters[parameter] = value
        faults = LinkFaults(bytes_per_s=baud / BITS if baud else math.inf)
        self.flight.wire = FaultyLink(self.simulator, faults, seed=1)


def exchanges(mission, baud, seed, until_s, *, keeps_return_path):
    """Seconds of each exchange of a mission, and the number of return paths stored."""
    harness = TimedFlight(mission, baud, seed=seed, keeps_return_path=keeps_return_path)
    durations, waits = [], []

    def note(harness):
        if not waits and harness.app is not None:
            waits.append(0.0)
            _note_waits(harness, waits)
        last = harness.app.state.mission_list.durations_s[-1:]
        if last and last[0] not in durations:
            durations.append(last[0])

    harness.fly(until_s, note)
    if durations:
        durations[0] += sum(waits)
    stored = [entry for entry in harness.recorder.decisions if entry.text.startswith("stored, ")]
    return durations, len(stored)


def _note_waits(harness, waits):
    """Add each time for which the service waits for the end of a return path's exchange."""
    way_home, clock = harness.app._way_home, harness.app._clock
    stop = way_home.stop

    async def timed():
        begun_s = clock.now_s()
        await stop()
        waits.append(clock.now_s() - begun_s)

    way_home.stop = timed


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.returns.exchange_cost", description=__doc__)
    parser.add_argument("-n", type=int, default=5, help="flights of each mission")
    parser.add_argument("--baud", type=int, default=57_600, help="0 for a line without a limit")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    found = {}
    for keeps in (True, False):
        durations, num_stored = [], 0
        for name in ("paper-2d", "paper-3d", "city-block"):
            mission = load_mission(CONFIGS / f"{name}.yaml")
            for seed in range(1, given.n + 1):
                more, stored = exchanges(mission, given.baud, seed, 120.0, keeps_return_path=keeps)
                durations += more
                num_stored += stored
        found[keeps] = durations
        sys.stdout.write(
            f"{'with' if keeps else 'without'} the return path: {len(durations)} exchanges, "
            f"median {statistics.median(durations):.2f} s, mean {statistics.fmean(durations):.2f} s, "
            f"longest {max(durations):.2f} s; {num_stored} return paths stored\n"
        )
    ratio = statistics.fmean(found[True]) / statistics.fmean(found[False])
    sys.stdout.write(f"with / without, mean: {ratio:.3f}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
