"""Runners that need no planner: what comes of a run is worked out of its seed."""

import hashlib
import os
import signal
import time

from companion.research.campaign.engines.runners import Outcome

ROUNDS = 20_000  # a few milliseconds


class Quick:
    """A number a run, and now and then a fault."""

    def __init__(self, campaign, known):
        self.campaign, self.known = campaign, known

    def warm_up(self):
        pass

    def outcome(self, run):
        digest = f"{run.mission} {run.setting} {run.method} {run.seed}".encode()
        for _ in range(ROUNDS):
            digest = hashlib.sha256(digest).digest()
        if run.method == "rrt" and run.seed % 3 == 0:
            raise ValueError(f"no plan of seed {run.seed}")
        value = int.from_bytes(digest[:4], "big") / 2**32
        measures = {"success": digest[5] > 50, "PC": 100.0 * value, "Q": float("nan")}
        return Outcome(measures, {"PST": time.perf_counter()}, {"path": [[value]]})


class Deadly(Quick):
    """Some runs take their process with them."""

    def outcome(self, run):
        if run.seed == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        if run.seed == 3:
            os._exit(7)
        return super().outcome(run)


class Unready(Quick):
    """Comes to nothing before its first run."""

    def warm_up(self):
        os._exit(5)
