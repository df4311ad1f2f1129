"""``python -m tests.energy.recorded_prediction FLIGHT…``: energy predicted at the takeover, and used.

A flight is a folder with a recording of a mission file with a section ``energy``. What was predicted for the
way from the first plan to the last goal is compared with what the battery's monitor reported for it.
"""

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from companion.recording.mcap_reader import messages_of


@dataclass(frozen=True)
class Prediction:
    """What a recorded flight was predicted to use up to its last goal, and what it used [Wh]."""

    predicted_wh: float
    used_wh: float

    @property
    def error(self):
        """Relative error of the prediction."""
        return self.predicted_wh / self.used_wh - 1.0


def prediction_of(flight):
    """The prediction of a folder's recording.

    Raises
    ------
    ValueError
        If no plan said what would be left, or the goal was not reached.
    """
    left_wh = begin_wh = at_goal_wh = None
    for topic, told in messages_of(Path(flight) / "flight.mcap", Counter()):
        if topic == "/energy" and told.get("left_wh") is not None:
            left_wh = float(told["left_wh"])
        elif topic == "/decision" and told["kind"] == "swap" and begin_wh is None:
            planned = told.get("why", {}).get("left_at_goal_wh")
            if planned is not None and left_wh is not None:
                begin_wh, at_goal_wh = left_wh, float(planned)
        elif topic == "/decision" and told["kind"] == "arrived" and begin_wh is not None:
            return Prediction(begin_wh - at_goal_wh, begin_wh - left_wh)
    raise ValueError(f"{flight}: no prediction, or the goal was not reached")


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.energy.recorded_prediction", description=__doc__)
    parser.add_argument("flights", nargs="+", type=Path)
    for flight in parser.parse_args().flights:
        found = prediction_of(flight)
        words = (
            f"{found.predicted_wh:.1f} Wh predicted, {found.used_wh:.1f} used: {100.0 * found.error:+.1f} %"
        )
        sys.stdout.write(f"{flight.name}: {words}\n")


if __name__ == "__main__":
    main()
