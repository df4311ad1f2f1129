"""``python -m tests.ui.editor.latency``: how long a change with its check takes, and its plan."""

import sys
import time
from pathlib import Path

import numpy as np

from companion.kernels.native.ready import make_ready
from companion.ui.editor.edit_session import EditSession

ROOT = Path(__file__).parents[3]
CHANGES = 9


def timed(session, *request):
    """The answer to a request, and how long it took [ms]."""
    began = time.perf_counter()
    answer = session.post(*request)
    return answer, 1e3 * (time.perf_counter() - began)


def main():
    make_ready()
    for file in sorted((ROOT / "mission_configs").glob("*.yaml")):
        session = EditSession(file)
        session.state()
        session.post("plan", {})
        rows, stopped = [], 0
        for step in range(CHANGES):
            move = {"do": "move", "path": ["goals", 0], "value": [(-1) ** step * (1.0 + 0.1 * step), 0.0]}
            _, change_ms = timed(session, "change", {"changes": [move]})
            plan, plan_ms = timed(session, "plan", {})
            rows.append((change_ms, plan_ms))
            stopped += plan["is_stopped"]
        change_ms, plan_ms = np.median(rows, axis=0)
        most = np.sum(rows, axis=1).max()
        sys.stdout.write(
            f"{file.stem:16} change {change_ms:4.0f} ms, plan {plan_ms:4.0f} ms, "
            f"together at most {most:5.0f} ms, stopped {stopped} of {CHANGES}\n"
        )


if __name__ == "__main__":
    main()
