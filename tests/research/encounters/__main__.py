"""``make encounters``: other aircraft pass flights without and with the service, and the risk ratios."""

import argparse
import json
import logging
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from companion.config import mission_from_text
from companion.kernels.native.ready import make_ready
from companion.research.encounters.encounter_model import model_from_text, read_model
from companion.research.evidence.intervals import risk_ratio
from sim.bench.encounter_flights import VOLUMES, flown_encounter
from tests.research.encounters.made_model import text

MISSION = """
name: passing
dimension: 3
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [-3000, 6000], north_m: [-3500, 3500], up_m: [40, 500]}
start: {east_m: 0, north_m: 0, up_m: 250, course_deg: 90}
goals:
  - {east_m: 3000, north_m: 0, up_m: 250, acceptance_radius_m: 60}
vehicle: {airspeed_min_m_s: 12.5, airspeed_max_m_s: 37.5, airspeed_cruise_m_s: 25,
  acceleration_max_m_s2: 0.5, turn_radius_min_m: 125, straight_length_min_m: 125, penetration_speed_m_s: 30}
planning: {sensing_horizon_m: 1500, time_horizon_s: 15, total_planning_time_s: 200}
simulation: {wind_speed_m_s: 3, wind_from_deg: 240, turbulence: light}
"""

DETOUR_S = 3.0


def row_of(seed, *, model_file, spread):
    """The row of one encounter."""
    model = model_from_text(text(), "the tests' own model") if model_file is None else read_model(model_file)
    return {
        "seed": seed,
        **flown_encounter(mission_from_text(MISSION, "passing"), model, seed, spread=spread),
    }


def lines_of(rows):
    """The table: events with the service and without, and the ratio of their numbers."""
    yield f"{'event':22} {'with':>5} {'without':>8}  risk ratio (95 %)   of {len(rows)} encounters"
    for name in VOLUMES:
        happened, would = (np.array([float(row[key]) for row in rows]) for key in (name, f"without.{name}"))
        ratio = risk_ratio(happened, would)
        yield (
            f"{name:22} {happened.sum():5.0f} {would.sum():8.0f}  "
            f"{ratio.value:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"
        )
    idle = [row["detour_s"] for row in rows if not row["without.lowc"]]
    detours = sum(abs(late_s) > DETOUR_S for late_s in idle)
    yield f"{detours} of {len(idle)} that would have stayed well clear detour by more than {DETOUR_S:.0f} s"


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.research.encounters", description=__doc__)
    parser.add_argument("-n", type=int, default=20, help="encounters")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--model", type=Path, help="a model file of Lincoln Laboratory; by default a made one"
    )
    parser.add_argument("--spread", type=float, default=1.5, help="largest miss distances over well clear")
    parser.add_argument(
        "--out", type=Path, default=Path("flights/encounters.jsonl"), help="file of JSON lines"
    )
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    make_ready()
    seeds, rows = range(given.first_seed, given.first_seed + given.n), []
    quiet = {"initializer": logging.disable, "initargs": (logging.CRITICAL,)}
    with given.out.open("w", encoding="utf-8") as out, ProcessPoolExecutor(given.jobs, **quiet) as pool:
        for row in pool.map(partial(row_of, model_file=given.model, spread=given.spread), seeds):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
    sys.stdout.write("\n".join(lines_of(rows)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
