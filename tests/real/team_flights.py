"""Flights of two real autopilots from both sides through a gap: ``python -m tests.real.team_flights``.

ARDUPLANE, PARM and PX4 name binaries of your own. ``--how`` says what they share: their plans, their goals
as well, or nothing. ``barred`` shares plans, and the first one's goal lies in the gap that the other has to
pass; that is for ArduPlane, because a PX4 arms only with a landing, to which it would go on. ``landings``
shares plans in the open, and the flight goes on until both have landed, or for five minutes.
"""

import argparse
import json
import math
import os
import sys
import time
from pathlib import Path

import numpy as np

from tests.real.flights_pool import Binaries
from tests.real.rig.autopilots import KINDS
from tests.real.rig.mapped_ground import BEFORE_FIX_M
from tests.real.rig.team_rig import Member, Radio

LIMIT_S = 420.0
LANDING_S = 300.0  # Landings take less.
SHARED_LIMIT_S = 900.0  # One of them may have to fly all goals.
APART_M, APART_UP_M = 40.0, 20.0
REACHED_M = 75.0  # A goal is reached within 60 m; positions are reported each 0.1 s.
BEGIN_M = 15.0  # So high above home a member has taken off.
TEAMS = {"plans": {}, "goals": {"share_goals": True}, "barred": {}, "landings": {}, "nothing": None}
SCENES = {"barred": "barred", "landings": "open"}


def flown_team(kind, binaries, folder, instance, *, team=None, scene="", loss=0.2, seed=1):
    """Fly two aircraft to their goals, in the open up to their landings; the row of the flight.

    Parameters
    ----------
    kind : Kind
        Of autopilot.
    binaries : Binaries
        The user's own.
    folder : Path
        Of everything that the flight leaves behind.
    instance : int
        Number that the ports of the first aircraft follow from.
    team : dict or None
        The section ``team`` of the mission files without the members; None for aircraft that are no team.
    scene : str
        As for :class:`tests.real.rig.team_rig.MemberCourse`.
    loss : float
        Share of the radio's frames that is lost.
    seed : int
        Of what is random.
    """
    ids = [instance + number + 1 for number in range(2)]
    team = {} if team is None else {"members": ids, **team}
    members = [
        Member(kind, binaries, folder / f"{ids[number]}", number, instance + number, team, scene=scene)
        for number in range(2)
    ]
    ports = {member.system_id: member.autopilot.radio_port for member in members}
    radio = Radio(ports, loss=loss if team else 1.0, seed=seed)
    fault = ""
    try:
        radio.start()
        for member in members:
            member.open()
        for member in members:
            member.station.fly()
        shares_goals = team.get("share_goals", False)
        end_s = time.monotonic() + (SHARED_LIMIT_S if shares_goals else LIMIT_S)
        have_arrived = False
        while time.monotonic() < end_s and any(is_flying(member) for member in members):
            time.sleep(0.5)
            assert all(member.station.is_armed or member.has_arrived() for member in members), "disarmed"
            if not have_arrived and all(member.has_arrived() for member in members):
                have_arrived = True
                end_s = time.monotonic() + (LANDING_S if scene == "open" else 0.0)
    except (AssertionError, OSError) as error:
        fault = f"{type(error).__name__}: {error}"
    finally:
        for member in members:
            member.close()
        radio.end()
    row = {
        "kind": kind.name, "seed": seed, "team": team, "fault": fault,
        "arrived": [member.has_arrived() for member in members], **measures(members),
        "bytes": list(radio.num_bytes.values()),
        "paths": [member.path for member in members],
    }  # fmt: skip
    (folder / "flight.json").write_text(json.dumps(row), encoding="utf-8")
    return row


def is_flying(member):
    """Whether a member has not both arrived and landed."""
    return member.station.is_armed or not member.has_arrived()


def measures(members):
    """How near the two came to each other, and each to an obstacle, once both had taken off."""
    rows = [np.array(member.path).reshape(-1, 4) for member in members]
    airborne = [
        path[(path[:, 3] > BEGIN_M) & (np.abs(path[:, 1:3]).max(axis=1) < BEFORE_FIX_M)] for path in rows
    ]
    if not all(len(path) > 1 for path in airborne):
        return {
            "nearest_m": math.inf, "nearest_up_m": math.inf, "clearance_m": math.inf, "goals_missed": [],
        }  # fmt: skip
    begin, end = max(path[0, 0] for path in airborne), min(path[-1, 0] for path in airborne)
    times = np.arange(begin, end, 0.1)
    one, other = (
        np.column_stack([np.interp(times, path[:, 0], path[:, axis]) for axis in (1, 2, 3)])
        for path in airborne
    )
    flat, up = np.hypot(*(one - other)[:, :2].T), np.abs(one - other)[:, 2]
    nearest = int(np.maximum(flat / APART_M, up / APART_UP_M).argmin())
    clear = [
        min(member.course.clearance_m(place) for place in path[:, 1:])
        for member, path in zip(members, airborne, strict=True)
    ]
    return {
        "nearest_m": float(flat[nearest]),
        "nearest_up_m": float(up[nearest]),
        "nearest_flat_m": float(flat.min()),
        "clearance_m": min(clear),
        "goals_missed": [
            goal
            for goal in dict.fromkeys(goal for member in members for goal in member.course.goals)
            if all(np.linalg.norm(path[:, 1:] - goal, axis=1).min() > REACHED_M for path in airborne)
        ],
    }


def is_good(row):
    """Whether both arrived, each goal was flown by one, they kept apart, and touched nothing."""
    apart = row["nearest_m"] >= APART_M or row["nearest_up_m"] >= APART_UP_M
    is_done = not row["fault"] and all(row["arrived"]) and not row["goals_missed"]
    return is_done and apart and row["clearance_m"] > 0.0


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.real.team_flights", description=__doc__)
    parser.add_argument("--kind", default="arduplane", choices=sorted(KINDS))
    parser.add_argument("--how", default="plans", choices=sorted(TEAMS), help="what they share")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--instance", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("flights/real-team"))
    given = parser.parse_args()
    num_bad = 0
    for seed in range(given.first_seed, given.first_seed + given.seeds):
        folder = given.out.resolve() / f"{given.kind}-{given.how}-{seed}"
        row = flown_team(
            KINDS[given.kind], Binaries.named(os.environ), folder, given.instance,
            team=TEAMS[given.how], scene=SCENES.get(given.how, ""), seed=seed,
        )  # fmt: skip
        num_bad += not is_good(row)
        sys.stdout.write(f"{ {name: value for name, value in row.items() if name != 'paths'} }\n")
        sys.stdout.flush()
    return int(num_bad > 0)


if __name__ == "__main__":
    sys.exit(main())
