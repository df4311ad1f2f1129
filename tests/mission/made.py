"""Paths with rows on the ends of their turns, banks, and a link that does what a script says."""

import math
from dataclasses import replace

import numpy as np

from companion.errors import TransferError
from companion.frames import LocalFrame
from companion.mission.waypoints import Waypoints
from companion.types.mission import Command, MavFrame, MissionItem
from tests.support.paths import path_of

FRAME = LocalFrame(-35.363261, 149.165230, 584.0)
SPEED_M_S = 25.0


def path_along(*segments, up=100.0, course=0.0):
    """Straight pieces (length, rows) and turns (radius, angle, rows); a positive angle turns right."""
    places, courses = [np.zeros(2)], [course]
    for segment in segments:
        if len(segment) == 2:
            length, rows = segment
            step = length / rows * np.array([math.sin(course), math.cos(course)])
            for _ in range(rows):
                places.append(places[-1] + step)
                courses.append(course)
            continue
        radius, angle, rows = segment
        side, begin, start = math.copysign(1.0, angle), course, places[-1]
        centre = start + side * radius * np.array([math.cos(begin), -math.sin(begin)])
        for k in range(1, rows + 1):
            course = begin + angle * k / rows
            places.append(centre - side * radius * np.array([math.cos(course), -math.sin(course)]))
            courses.append(course)
    flat = np.array(places)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(flat, axis=0), axis=1))])
    heights = np.array([up(at) for at in travelled]) if callable(up) else np.full(len(flat), up)
    return path_of(travelled / SPEED_M_S, np.column_stack([flat, heights]), np.mod(courses, 2.0 * math.pi))


def waypoints(*positions, **changes):
    points = np.array(positions, dtype=float)
    steps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    return Waypoints(points, np.concatenate([[0.0], np.cumsum(steps)]), SPEED_M_S, **changes)


def item(sequence=0, command=Command.NAV_WAYPOINT, **changes):
    values = {
        "sequence": sequence,
        "command": command,
        "frame": MavFrame.GLOBAL_INT,
        "parameters": (0.0, 0.0, 0.0, None),
        "latitude_e7": -353_632_610 + 1000 * sequence,
        "longitude_e7": 1_491_652_300,
        "altitude_m": 684.0,
    }
    return MissionItem(**{**values, **changes})


def renumbered(items):
    return tuple(replace(entry, sequence=n) for n, entry in enumerate(items))


class ScriptedLink:
    """Stores what is uploaded; a call named in ``faults`` raises that, ``alter`` changes what is read."""

    def __init__(self, alter=lambda items: items, **faults):
        self.alter = alter
        self.faults = faults
        self.stored = ()
        self.current = None
        self.calls = []

    def _call(self, name):
        self.calls.append(name)
        fault = self.faults.get(name)
        if fault is not None:
            raise fault if isinstance(fault, Exception) else TransferError(name, fault)

    async def upload(self, items):
        if self.faults.get("upload") != "TIMEOUT before anything":
            self.stored = tuple(items)
        self._call("upload")
        return 0

    async def write(self, items):
        first = items[0].sequence
        self.stored = (*self.stored[:first], *items, *self.stored[first + len(items) :])
        self._call("write")

    async def read_back(self, *, num_left_out=0):
        self._call("read_back")
        return self.alter(self.stored[: len(self.stored) - num_left_out])

    async def set_current(self, sequence, is_ahead=None):
        self._call("set_current")
        self.current = sequence
