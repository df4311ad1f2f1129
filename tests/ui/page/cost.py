"""``python -m tests.ui.page.cost FLIGHT``: what the page costs the service, with no viewer and with three.

The messages of a recorded flight are told again at PACE times their rate, in a process of its own: into a
recorder's files alone, and with the page beside. Its processor time is told per second of flight.
"""

import itertools
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from companion.recording import mcap_schema as channels
from companion.recording.mcap_reader import messages_of
from companion.recording.mcap_writer import FlightLog, encoded
from companion.recording.reader import stamp_of
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.page_server import PageServer
from companion.ui.page.world_document import WorldDocument

PACE = 10.0
VIEWER = """
import socket, sys
line = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
line.sendall(b"GET /stream HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n")
while line.recv(1 << 16):
    pass
"""


def told_again(flight, num_viewers):
    """Processor seconds of this process a second of flight; ``num_viewers`` -1 is without the page."""
    recorded = messages_of(Path(flight) / "flight.mcap", Counter())
    messages = [(stamp_of(told), topic, told) for topic, told in recorded if topic != channels.LOCATION]
    about = next(told for _, topic, told in messages if topic == channels.MISSION)
    WorldDocument(str(about["mission_file"]), "warm").finish()  # loads what a service has for its plans
    feed, server, viewers = Feed(), None, []
    if num_viewers >= 0:
        server = PageServer(Access(0), feed)
        viewers = [
            subprocess.Popen([sys.executable, "-c", VIEWER, str(server.port)]) for _ in range(num_viewers)
        ]
        while sum(viewer.is_stream for viewer in list(server._viewers)) < num_viewers:
            time.sleep(0.05)
        feed.tell(channels.MISSION, 0.0, about, encoded(0.0, about))
        while feed.world is None:
            time.sleep(0.05)
        feed.world.finish()  # once a flight, and not what it costs from then on
    messages = [entry for entry in messages if entry[1] != channels.MISSION]
    log = FlightLog(Path(tempfile.mkdtemp()) / "flight.mcap", 0.0)
    begun, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
    for stamp, together in itertools.groupby(messages, lambda entry: entry[0]):
        time.sleep(max(0.0, begun + (stamp - messages[0][0]) / PACE - time.monotonic()))
        for _, topic, told in together:
            data = encoded(stamp, told)
            if server is not None:
                feed.tell(topic, stamp, told, data)
            log.write(topic, stamp, data)
    after = resource.getrusage(resource.RUSAGE_SELF)
    log.close()
    for viewer in viewers:
        viewer.kill()
        viewer.wait()
    if server is not None:
        server.close()
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return used / (messages[-1][0] - messages[0][0])


def main():
    if len(sys.argv) == 3:
        sys.stdout.write(json.dumps(told_again(sys.argv[1], int(sys.argv[2]))))
        return
    found = {}
    for number, name in ((-1, "recording alone"), (0, "with the page, no viewer"), (3, "with three viewers")):
        command = [sys.executable, "-m", "tests.ui.page.cost", sys.argv[1], str(number)]
        runs = [
            100.0 * float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            for _ in range(2)
        ]
        found[number] = statistics.median(runs)
        every = ", ".join(f"{run:.2f}" for run in runs)
        sys.stdout.write(f"{name}: {found[number]:.2f} % of a core ({every})\n")
    sys.stdout.write(f"three viewers cost {found[3] - found[-1]:.2f} % of a core\n")


if __name__ == "__main__":
    main()
