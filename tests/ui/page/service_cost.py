"""``python -m tests.ui.page.service_cost``: a flying service's processor time, with the page and without.

Pairs of flights of SECONDS each, in real time beside ``python -m sim``, one with ``--page`` and three viewers
that read everything, one without; processor seconds of the service's process are the system's.
"""

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.ui.page.cost import VIEWER
from tests.ui.page.wire_flight import WireFlight

SECONDS, SETTLED_S, PAIRS, NUM_VIEWERS = 90.0, 10.0, 2, 3
_USER, _SYSTEM = 11, 12  # of /proc/PID/stat, counted behind the name's bracket


def used_s(process_id):
    """Processor seconds of a process so far, its threads' included."""
    entries = Path(f"/proc/{process_id}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(entries[_USER]) + int(entries[_SYSTEM])) / os.sysconf("SC_CLK_TCK")


def share(num_viewers):
    """Processor seconds a second of a flight; without the page where nobody looks."""
    with (
        tempfile.TemporaryDirectory() as folder,
        WireFlight(Path(folder), page=num_viewers > 0) as flight,
        contextlib.ExitStack() as viewers,
    ):
        for _ in range(num_viewers):
            viewer = subprocess.Popen([sys.executable, "-c", VIEWER, str(flight.page_port)])
            viewers.callback(viewer.wait)
            viewers.callback(viewer.kill)
        time.sleep(SETTLED_S)
        began, before = time.monotonic(), used_s(flight.service.pid)
        time.sleep(SECONDS)
        return (used_s(flight.service.pid) - before) / (time.monotonic() - began)


def main():
    pairs = []
    for number in range(PAIRS):
        pair = {count: 100.0 * share(count) for count in ((0, NUM_VIEWERS), (NUM_VIEWERS, 0))[number % 2]}
        sys.stdout.write(f"without {pair[0]:.2f} % of a core, with three viewers {pair[NUM_VIEWERS]:.2f} %\n")
        sys.stdout.flush()
        pairs.append(pair[NUM_VIEWERS] - pair[0])
    sys.stdout.write(f"the page and three viewers: {statistics.median(pairs):+.2f} % of a core\n")


if __name__ == "__main__":
    main()
