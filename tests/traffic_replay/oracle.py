"""What reports of one aircraft can be true, and what the pilot should be told of it.

This shares no code with the service. It sees all reports at once, later ones as well.

A *fix* is a report of a new place. Fixes of which one can be reached from the one before form a *chain*. Who
reports two places in turn has two chains. A chain that begins where no other one goes on is believable from
the beginning, any other one from its third fix on: a place in which an aircraft appears for one or two
reports, while it is somewhere else, is one where it cannot have been.
"""

import math
from dataclasses import dataclass, field

import numpy as np

FAST_M_S = 350.0  # Nothing that was recorded flies faster.
CLIMB_MAX_M_S = 130.0  # Nor climbs or descends faster: a parabolic flight does at 110 m/s.
ALTITUDES_M = (-500.0, 20_000.0)
TIME_ERROR_S, PLACE_ERROR_M, HEIGHT_ERROR_M = 1.0, 100.0, 60.0  # Times of recordings are whole seconds.
CHAIN_ENDS_S = 60.0
FIXES_BELIEVED = 3
WELL_CLEAR_M, WELL_CLEAR_UP_M = 610.0, 76.2  # ASTM F3442: 2000 ft and 250 ft.
AHEAD_S, TURNS_S = 45.0, 30.0  # What docs/encounters.md says of alerts, and of turns that are foreseen.
KNOWN_S = 20.0  # Between fixes farther apart nobody knows where the aircraft was.
RECENT_S = 20.0  # Rates of turning and climbing are taken from the fixes of so long.
ROOM = 1.25  # An alert about what passes this much farther away than well clear counts as justified.
ROOM_UP_M = 25.0  # Two steps of an altitude that is reported in steps, and the height of the aircraft itself.
TIME, AGE, EAST, NORTH, UP, SPEED, COURSE, CLIMB = range(8)  # Columns of a piece.


@dataclass
class Chain:
    """Fixes that one aircraft can have flown, as rows of a piece, with the times at which each was true."""

    rows: list = field(default_factory=list)
    times_s: list = field(default_factory=list)
    is_first: bool = False

    def believed_from_s(self, piece):
        """When it becomes believable; never, for one that is too short [s]."""
        if self.is_first:
            return piece[self.rows[0], TIME]
        return piece[self.rows[FIXES_BELIEVED - 1], TIME] if len(self.rows) >= FIXES_BELIEVED else math.inf


def is_absurd(row, sea_m):
    """Whether a report's own numbers cannot be true; ``sea_m`` is the altitude of the frame's origin."""
    too_fast = row[SPEED] > FAST_M_S or abs(row[CLIMB]) > CLIMB_MAX_M_S
    return bool(too_fast or not ALTITUDES_M[0] <= row[UP] + sea_m <= ALTITUDES_M[1])


def chains_of(piece, sea_m=0.0):
    """The chains of a piece (N, 8), and of each row the chain to which it belongs, or None."""
    chains, belongs, last_place = [], [None] * len(piece), None
    for number, row in enumerate(piece):
        if not np.isfinite(row[[EAST, NORTH, UP]]).all():
            continue
        if last_place == (row[EAST], row[NORTH]):
            continue  # A position of before is no news.
        last_place = (row[EAST], row[NORTH])
        if is_absurd(row, sea_m):
            continue
        then = row[TIME] - row[AGE]
        fitting = [(_excess(piece, chain, row, then), index) for index, chain in enumerate(chains)]
        excess, index = min(fitting, default=(math.inf, -1))
        if excess > 1.0:
            is_alive = [abs(then - chain.times_s[-1]) <= CHAIN_ENDS_S for chain in chains]
            chains.append(Chain(is_first=not any(is_alive)))
            index = len(chains) - 1
        chains[index].rows.append(number)
        chains[index].times_s.append(then)
        belongs[number] = index
    return chains, belongs


def _excess(piece, chain, row, then):
    """How far a fix is from the last of a chain, over what an aircraft can have flown since."""
    last, elapsed = piece[chain.rows[-1]], abs(then - chain.times_s[-1])
    if elapsed > CHAIN_ENDS_S:
        return math.inf
    elapsed += TIME_ERROR_S
    flat = math.hypot(row[EAST] - last[EAST], row[NORTH] - last[NORTH])
    up = abs(row[UP] - last[UP])
    return max(flat / (FAST_M_S * elapsed + PLACE_ERROR_M), up / (CLIMB_MAX_M_S * elapsed + HEIGHT_ERROR_M))


def impossible_rows(piece, sea_m=0.0):
    """Rows whose report cannot be true: absurd, or of a chain that never becomes believable."""
    chains, belongs = chains_of(piece, sea_m)
    return [
        number
        for number, row in enumerate(piece)
        if is_absurd(row, sea_m)
        or (belongs[number] is not None and math.isinf(chains[belongs[number]].believed_from_s(piece)))
    ]


def leaps(piece, sea_m=0.0):
    """Rows in which an aircraft appears where it cannot have come, for once or for good."""
    begun = {chain.rows[0] for chain in chains_of(piece, sea_m)[0] if not chain.is_first}
    return sorted(begun.union(impossible_rows(piece, sea_m)))


def losses(piece, path, sea_m=0.0):
    """When an aircraft that was plausibly reported is not well clear of a flight.

    Returns rows: when that begins [s], how long before it the aircraft was first reported there [s], and the
    greatest time between two fixes in the last minute before [s].
    """
    found = []
    for chain in chains_of(piece, sea_m)[0]:
        begins_s = chain.believed_from_s(piece)
        is_inside_before = False
        order = np.argsort(chain.times_s, kind="stable")
        times = np.array(chain.times_s)[order]
        rows = piece[np.array(chain.rows)[order]]
        for first in range(len(times) - 1):
            if not 0.0 < times[first + 1] - times[first] <= KNOWN_S or times[first] < begins_s:
                is_inside_before = False
                continue
            seconds = np.arange(times[first], times[first + 1], 0.2)
            there = _between(seconds, times[first : first + 2], rows[first : first + 2, EAST : UP + 1])
            own = np.column_stack([np.interp(seconds, path[:, 0], path[:, axis]) for axis in (1, 2, 3)])
            is_flying = (seconds >= path[0, 0]) & (seconds <= path[-1, 0])
            inside = _is_inside(there - own, 1.0, 0.0) & is_flying
            if inside.any() and not is_inside_before:
                when = float(seconds[inside.argmax()])
                heard = [piece[row, TIME] for row in chain.rows if begins_s <= piece[row, TIME] <= when]
                if heard:
                    recent = np.append([stamp for stamp in heard if stamp > when - 60.0], when)
                    found.append((when, when - heard[0], float(np.diff(recent).max(initial=0.0))))
            is_inside_before = bool(inside[-1])
    return sorted(found)


def _between(seconds, times, places):
    share = (seconds - times[0]) / (times[1] - times[0])
    return places[0] + share[:, None] * (places[1] - places[0])


def _is_inside(away, room, room_up_m):
    flat = np.hypot(away[:, 0], away[:, 1])
    return (flat <= room * WELL_CLEAR_M) & (np.abs(away[:, 2]) <= WELL_CLEAR_UP_M + room_up_m)


def is_justified(piece, path, now_s, sea_m=0.0, *, room=ROOM, room_up_m=ROOM_UP_M, ahead_s=AHEAD_S):
    """Whether an alert at ``now_s`` is about what would come near.

    It is if the aircraft, from any of its believable chains, would come within well clear and some room of
    the flight, which keeps its velocity, when it goes on straight, or turning or climbing at any rate up to
    those that it lately had.
    """
    own, before, sooner = (
        np.array([np.interp(stamp_s, path[:, 0], path[:, axis]) for axis in (1, 2, 3)])
        for stamp_s in (now_s, now_s - 0.3, now_s - 3.0)
    )
    ahead = np.arange(0.0, ahead_s + 1.0)
    # The aircraft's own velocity, of this moment and of the last seconds: gusts change it.
    flown = [own + np.outer(ahead, moved) for moved in ((own - before) / 0.3, (own - sooner) / 3.0)]
    for chain in chains_of(piece, sea_m)[0]:
        if chain.believed_from_s(piece) > now_s:
            continue
        known = [number for number in chain.rows if piece[number, TIME] <= now_s]
        then = np.array(chain.times_s[: len(known)])
        if now_s - piece[known[-1], TIME] > CHAIN_ENDS_S:
            continue
        for there in _continued(piece[known], then, now_s + ahead):
            if any(_is_inside(there - mine, room, room_up_m).any() for mine in flown):
                return True
    return False


def _continued(rows, then, times):
    """Places (M, 3) at ``times`` of an aircraft with fixes ``rows``, for each way in which it may go on."""
    recent = then >= then[-1] - RECENT_S
    rows, then = rows[recent], then[recent]
    last = rows[-1]
    velocities, climbs = [], [0.0]
    if np.isfinite(last[[SPEED, COURSE]]).all():
        velocities.append(last[SPEED] * np.exp(1j * (0.5 * math.pi - last[COURSE])))
    elapsed = then[-1] - then
    for begin in np.flatnonzero(elapsed >= 1.0):
        moved = (last[EAST] - rows[begin, EAST]) + 1j * (last[NORTH] - rows[begin, NORTH])
        velocities.append(moved / elapsed[begin])
        climbs.append((last[UP] - rows[begin, UP]) / elapsed[begin])
    measured = (min(climbs) - 8.0, max(climbs) + 8.0)
    if np.isfinite(last[CLIMB]) and (len(climbs) == 1 or measured[0] <= last[CLIMB] <= measured[1]):
        climbs.append(last[CLIMB])
    if not velocities:
        velocities = [0j]
    turned = np.diff(np.unwrap(rows[:, COURSE]))
    steps = np.diff(then)
    rates = np.abs(turned[steps > 0.0] / steps[steps > 0.0])
    rates = rates[np.isfinite(rates)]
    fastest = min(math.radians(8.0), float(rates.max(initial=math.radians(1.0))))
    since = times - then[-1]
    turning = np.clip(since, 0.0, since[0] + TURNS_S)
    for velocity in velocities[:1] + velocities[-1:]:
        for rate in np.linspace(-fastest, fastest, 9):
            way = np.cumsum(velocity * np.exp(1j * rate * turning) * np.diff(since, prepend=0.0))
            for climb in {min(climbs), 0.0, max(climbs), climbs[-1]}:
                up = last[UP] + climb * turning
                yield np.column_stack([last[EAST] + way.real, last[NORTH] + way.imag, up])
