"""Plans and reports of a team as payloads of MAVLink's TUNNEL message.

MAVLink has no message for this. TRAJECTORY_REPRESENTATION_WAYPOINTS carries five waypoints in an autopilot's
own local frame, without their times, to that autopilot. UTM_GLOBAL_POSITION carries one position and one next
waypoint. Neither has a plan number, an approval or room for them. TUNNEL carries 128 bytes of any content to
everybody, and routers pass it on. Its frame brings the sender, the CRC and, with a key, the signature and the
guard against replays, so none of these is repeated here.

Each payload begins with a version, a kind, and the sender's *standing*: the numbers of its committed and of
its latest plan, and whether the latest is proposed. So any payload that arrives brings the receiver up to
date.

A plan's first place is in 1e-7 degrees. The others are offsets from it in steps of 0.25 m, coarser if the
path is longer than 8 km. Times are in steps of 0.1 s. Ten legs take 115 bytes. What rounding moves the plan
by is measured and added to its tolerance, which is rounded up.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from companion.frames import M_PER_E7, FloatArray, LocalFrame, longitude_scale
from companion.mission.team.shared_plan import NUMBERS, SharedPlan, largest_distance, simplified
from companion.mission.team.standing import (
    CACHED,
    HEADER,
    PAYLOAD_BYTES,
    PayloadError,
    Standing,
    packed_header,
    read_header,
)

REPORT, PLAN, BID, RETURN = 1, 2, 3, 4
IS_EMERGENCY, IS_REQUEST = 1, 2

COUNTS = struct.Struct(
    "<BBBB"
)  # approvals, refusals, members whose plan is missing, bytes of awaited members
ANSWER = struct.Struct("<BH")  # member, plan number
FRAGMENT = struct.Struct("<HB")  # plan number, place among the fragments and their number
PLAN_HEAD = struct.Struct("<BBIiiBHHHHBH")
ROW = struct.Struct("<HhhH")  # time, east, north, altitude
ALTITUDE = struct.Struct("<H")
BID_HEAD = struct.Struct("<IiiBBH")  # time, latitude, longitude, airspeed, goal, time that it takes

FRAGMENT_BYTES = PAYLOAD_BYTES - HEADER.size - FRAGMENT.size
FRAGMENTS_MAX = 15
ROWS_MAX = 1 + (FRAGMENTS_MAX * FRAGMENT_BYTES - PLAN_HEAD.size) // ROW.size  # 220; their number is a byte.
COARSER_M = 1.0  # Rows of a longer plan that move it by this are left out, or by twice as much, and so on.
TICK_S = 0.1
ON_TICK = 1e-4  # Times this near to a tick, in ticks, are on it: they were rounded before.
TICKS = 1 << 32  # Start times begin again after thirteen years.
STEP_M = 0.25
ALTITUDE_STEP_M, ALTITUDE_MIN_M = 0.25, -1000.0
TENTH_M = 0.1
AIRSPEED_STEP_M_S, AIRSPEED_STEPS_MAX = 0.5, 255
NO_GOAL, NOT_AVAILABLE = 0, 255  # Stand for the goal in a bid; goal n is n + 1.
SHARED_GOALS_MAX = 200
SLACK_M = (
    0.1  # Receivers have origins of their own, and straight lines differ by less than this between them.
)


@dataclass(frozen=True, slots=True)
class Report:
    """A member's answers to others, and the answers that it waits for.

    Parameters
    ----------
    standing : Standing
        Numbers of its own plans.
    approved, refused : tuple of (int, int)
        Answers to proposals: member and number of each.
    missing : tuple of int
        Members whose committed plan it does not have.
    awaited : frozenset of int
        Members whose approval of its proposal it does not have.
    concerned : frozenset of int
        Members to whom the report says something in addition to the standing.
    """

    standing: Standing
    approved: tuple[tuple[int, int], ...] = ()
    refused: tuple[tuple[int, int], ...] = ()
    missing: tuple[int, ...] = ()
    awaited: frozenset[int] = frozenset()

    concerned: frozenset[int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        answered = (other for other, _ in (*self.approved, *self.refused))
        object.__setattr__(self, "concerned", self.awaited.union(self.missing, answered))


@dataclass(frozen=True, slots=True)
class Fragment:
    """A part of a plan.

    Parameters
    ----------
    standing : Standing
        Numbers of the sender's plans.
    number : int
        Number of the plan.
    index, count : int
        Place of this part among all parts of the plan, from 0, and how many there are.
    data : bytes
        The part.
    """

    standing: Standing
    number: int
    index: int
    count: int
    data: bytes


@dataclass(frozen=True, slots=True)
class GoalBid:
    """A member's bid in the auction of the shared goals.

    Parameters
    ----------
    tick : int
        UTC time of the bid in steps of 0.1 s, in 32 bits. A later bid replaces an earlier one.
    latitude_e7, longitude_e7 : int
        Where the member was then [1e-7 degrees].
    airspeed_steps : int
        Airspeed of the member in steps of 0.5 m/s.
    goal : int or None
        The goal that it flies to, from 0; None if it has none.
    takes_ticks : int
        Time from the bid to its arrival there, in steps of 0.1 s.
    is_available : bool
        False if others have to fly its goals: a pilot flies, or it returns home.
    flown : int
        Bit n is set if goal n is flown, by whomever.
    """

    tick: int
    latitude_e7: int
    longitude_e7: int
    airspeed_steps: int
    goal: int | None = None
    takes_ticks: int = 0
    is_available: bool = True
    flown: int = 0


@dataclass(frozen=True, slots=True)
class BidMessage:
    """A bid with the standing of its sender.

    Parameters
    ----------
    standing : Standing
        Numbers of the sender's plans.
    bid : GoalBid
        The bid.
    """

    standing: Standing
    bid: GoalBid


def bid_payload(standing: Standing, bid: GoalBid) -> bytes:
    """Return a bid as a payload: 22 bytes, and one for each eight goals up to the last that is flown."""
    goal = NOT_AVAILABLE if not bid.is_available else NO_GOAL if bid.goal is None else bid.goal + 1
    head = BID_HEAD.pack(
        bid.tick % TICKS, bid.latitude_e7, bid.longitude_e7, min(bid.airspeed_steps, AIRSPEED_STEPS_MAX),
        goal, min(bid.takes_ticks, 65_535),
    )  # fmt: skip
    return (
        packed_header(BID, standing) + head + bid.flown.to_bytes((bid.flown.bit_length() + 7) // 8, "little")
    )


@dataclass(frozen=True, slots=True)
class ReturnAltitude:
    """The altitude in which a member returns to launch, with its standing.

    Parameters
    ----------
    standing : Standing
        Numbers of the sender's plans.
    altitude_m : float
        Altitude above mean sea level [m].
    """

    standing: Standing
    altitude_m: float


def return_payload(standing: Standing, altitude_m: float) -> bytes:
    """Return the altitude above mean sea level [m] of a return to launch as a payload of 8 bytes."""
    steps = round((altitude_m - ALTITUDE_MIN_M) / ALTITUDE_STEP_M)
    return packed_header(RETURN, standing) + ALTITUDE.pack(min(max(steps, 0), 65_535))


def report_payloads(report: Report) -> list[bytes]:
    """Return a report as payloads; one is enough for up to 39 answers.

    Parameters
    ----------
    report : Report
        The report.
    """
    bits = sum(1 << member for member in report.awaited)
    awaited = bits.to_bytes((bits.bit_length() + 7) // 8, "little")
    answers = [(ANSWER.pack(*pair), 0) for pair in report.approved]
    answers += [(ANSWER.pack(*pair), 1) for pair in report.refused]
    answers += [(bytes([member]), 2) for member in report.missing]
    payloads: list[bytes] = []
    while not payloads or answers:
        left = PAYLOAD_BYTES - HEADER.size - COUNTS.size - len(awaited)
        counts, body = [0, 0, 0], b""
        while answers and len(body) + len(answers[0][0]) <= left:
            packed, kind = answers.pop(0)
            counts[kind] += 1
            body += packed
        payloads.append(
            packed_header(REPORT, report.standing) + COUNTS.pack(*counts, len(awaited)) + body + awaited
        )
        awaited = b""
    return payloads


def plan_payloads(standing: Standing, plan: SharedPlan, frame: LocalFrame) -> list[bytes]:
    """Return a plan that :func:`transmitted_plan` made as payloads."""
    body = _plan_body(plan, frame)
    parts = [body[at : at + FRAGMENT_BYTES] for at in range(0, len(body), FRAGMENT_BYTES)]
    head = packed_header(PLAN, standing)
    return [
        head + FRAGMENT.pack(plan.number, index << 4 | len(parts)) + part for index, part in enumerate(parts)
    ]


def transmitted_plan(plan: SharedPlan, frame: LocalFrame, simplify_m: float = 0.0) -> SharedPlan:
    """Return a plan exactly as the others will read it.

    Rows that matter little are left out, the rest is rounded, and the tolerance grows by what that moves it.
    More rows are left out of a plan that would have too many.

    Parameters
    ----------
    plan : SharedPlan
        The plan as it is flown.
    frame : LocalFrame
        Frame of its places.
    simplify_m : float
        Rows are left out where that moves the plan by less [m].

    Raises
    ------
    ValueError
        If the plan lies beyond what the format holds.
    """
    first = 1 if plan.discs_m[0] > 0.0 else 0
    while len(rows := simplified(plan.rows, simplify_m, first)) > ROWS_MAX:
        simplify_m = max(2.0 * simplify_m, COARSER_M)
    short = replace(plan, rows=rows)
    rounded = read_plan(_plan_body(short, frame), plan.member, plan.number, frame, plan.start_s)
    level, up = largest_distance(plan, rounded)
    widened = replace(
        short,
        tolerance_m=plan.tolerance_m + level + SLACK_M,
        tolerance_up_m=plan.tolerance_up_m + up + SLACK_M,
    )
    return read_plan(_plan_body(widened, frame), plan.member, plan.number, frame, plan.start_s)


@lru_cache(maxsize=CACHED)
def read_payload(payload: bytes) -> Report | Fragment | BidMessage | ReturnAltitude:
    """Return what a payload says.

    Parameters
    ----------
    payload : bytes
        Payload of a TUNNEL message of the team's type.

    Raises
    ------
    PayloadError
        If it cannot be what it says.
    """
    kind, standing = read_header(payload)
    body = payload[HEADER.size :]
    if kind == REPORT:
        return _read_report(standing, body)
    if kind == PLAN:
        return _read_fragment(standing, body)
    if kind == BID:
        return BidMessage(standing, _read_bid(body))
    if kind == RETURN:
        if len(body) != ALTITUDE.size:
            raise PayloadError("return_length")
        return ReturnAltitude(standing, ALTITUDE_MIN_M + ALTITUDE_STEP_M * ALTITUDE.unpack(body)[0])
    raise PayloadError("kind")


def read_plan(body: bytes, member: int, number: int, frame: LocalFrame, now_s: float) -> SharedPlan:
    """Return a plan of the joined data of its fragments.

    Parameters
    ----------
    body : bytes
        Data of all fragments, in their order.
    member, number : int
        Sender and number of the plan.
    frame : LocalFrame
        Frame in which the places are wanted.
    now_s : float
        Any UTC time within six years of the plan [s].

    Raises
    ------
    PayloadError
        If it cannot be a plan.
    """
    return _read_plan(body, member, number, frame, round(now_s, -6))


@lru_cache(maxsize=CACHED)
def _read_plan(body: bytes, member: int, number: int, frame: LocalFrame, near_s: float) -> SharedPlan:
    """Return a plan; its time is the one that is nearest to another, which changes every million seconds."""
    if len(body) < PLAN_HEAD.size or (len(body) - PLAN_HEAD.size) % ROW.size:
        raise PayloadError("plan_length")
    flags, room, tick, *place, scales, tolerance, up, radius, first_radius, num, altitude = (
        PLAN_HEAD.unpack_from(body)
    )
    if num < 1 or len(body) != PLAN_HEAD.size + (num - 1) * ROW.size or abs(place[0]) > 900_000_000:
        raise PayloadError("plan_rows")
    table = np.zeros((num, 4))
    if num > 1:
        table[1:] = list(ROW.iter_unpack(body[PLAN_HEAD.size :]))
    table[0, 3] = altitude
    if (np.diff(table[:, 0]) < 0.0).any():
        raise PayloadError("plan_times")
    start = tick_near(tick, round(near_s / TICK_S))
    step = STEP_M * 2.0 ** (scales & 0xF)
    latitude_e7, longitude_e7 = place
    scale = float(longitude_scale(np.array(latitude_e7 * 1e-7)))
    latitudes = (latitude_e7 + step * table[:, 2] / M_PER_E7) * 1e-7
    longitudes = (longitude_e7 + step * table[:, 1] / (M_PER_E7 * scale)) * 1e-7
    if (abs(latitudes) > 90.0).any():
        raise PayloadError("plan_places")
    rows = np.empty((num, 4))
    rows[:, 0] = (start + 2.0 ** (scales >> 4) * table[:, 0]) * TICK_S
    rows[:, 1], rows[:, 2] = frame.places_from_global(latitudes, longitudes)
    rows[:, 3] = ALTITUDE_MIN_M + ALTITUDE_STEP_M * table[:, 3] - frame.altitude_amsl_m
    if not np.isfinite(rows).all():
        raise PayloadError("plan_places")
    return SharedPlan(
        member, number, rows, radius * TENTH_M, tolerance * TENTH_M, up * TENTH_M,
        is_emergency=bool(flags & IS_EMERGENCY), room=room, first_radius_m=first_radius * TENTH_M,
        is_request=bool(flags & IS_REQUEST),
    )  # fmt: skip


def _read_report(standing: Standing, body: bytes) -> Report:
    if len(body) < COUNTS.size:
        raise PayloadError("report_length")
    num_approved, num_refused, num_missing, num_awaited = COUNTS.unpack_from(body)
    refused_at = COUNTS.size + num_approved * ANSWER.size
    missing_at = refused_at + num_refused * ANSWER.size
    awaited_at = missing_at + num_missing
    if len(body) != awaited_at + num_awaited:
        raise PayloadError("report_length")
    bits = int.from_bytes(body[awaited_at:], "little")
    return Report(
        standing,
        tuple(ANSWER.iter_unpack(body[COUNTS.size : refused_at])),
        tuple(ANSWER.iter_unpack(body[refused_at:missing_at])),
        tuple(body[missing_at:awaited_at]),
        frozenset(member for member in range(bits.bit_length()) if bits >> member & 1),
    )


def _read_fragment(standing: Standing, body: bytes) -> Fragment:
    if len(body) <= FRAGMENT.size:
        raise PayloadError("fragment_length")
    number, part = FRAGMENT.unpack_from(body)
    index, count = part >> 4, part & 0xF
    if index >= count:
        raise PayloadError("fragment_index")
    return Fragment(standing, number, index, count, body[FRAGMENT.size :])


def _read_bid(body: bytes) -> GoalBid:
    if not 0 <= len(body) - BID_HEAD.size <= SHARED_GOALS_MAX // 8:
        raise PayloadError("bid_length")
    tick, latitude_e7, longitude_e7, airspeed_steps, goal, takes_ticks = BID_HEAD.unpack_from(body)
    is_possible = abs(latitude_e7) <= 900_000_000 and airspeed_steps > 0
    if not is_possible or SHARED_GOALS_MAX < goal < NOT_AVAILABLE:
        raise PayloadError("bid")
    flown = int.from_bytes(body[BID_HEAD.size :], "little")
    is_available = goal != NOT_AVAILABLE
    own_goal = goal - 1 if is_available and goal != NO_GOAL else None
    return GoalBid(
        tick, latitude_e7, longitude_e7, airspeed_steps, own_goal, takes_ticks, is_available, flown
    )


def _plan_body(plan: SharedPlan, frame: LocalFrame) -> bytes:
    """Return the data of a plan; circles begin no later and end no sooner."""
    rows = plan.rows
    latitude, longitude = frame.places_from_local(rows[:, 1], rows[:, 2])
    latitude_e7, longitude_e7 = round(float(latitude[0]) * 1e7), round(float(longitude[0]) * 1e7)
    scale = float(longitude_scale(np.array(latitude_e7 * 1e-7)))
    around = (longitude - longitude_e7 * 1e-7 + 180.0) % 360.0 - 180.0
    east, north = around * 1e7 * M_PER_E7 * scale, (latitude * 1e7 - latitude_e7) * M_PER_E7
    coarse = _doublings(float(max(abs(east).max(), abs(north).max())), STEP_M * 32_767)
    times = rows[:, 0] / TICK_S
    times = np.where(abs(times - np.round(times)) < ON_TICK, np.round(times), times)
    start = math.floor(times[0])
    slow = _doublings(float(times[-1]) - start, 65_535.0)
    altitudes = np.round((rows[:, 3] + frame.altitude_amsl_m - ALTITUDE_MIN_M) / ALTITUDE_STEP_M)
    ticks = _ticks((times - start) / 2.0**slow, begins_in_circle=bool(plan.discs_m[0] > 0.0))
    lengths = (plan.tolerance_m, plan.tolerance_up_m, plan.radius_m, float(plan.discs_m[0]))
    sizes = [math.ceil(length / TENTH_M - 1e-6) for length in lengths]
    if altitudes.min() < 0.0 or altitudes.max() > 65_535.0 or max(sizes) > 65_535 or max(coarse, slow) > 15:
        raise ValueError("plan: expected heights, lengths and times that the format holds")
    if len(rows) > ROWS_MAX:
        raise ValueError(f"plan: {len(rows)} rows: expected at most {ROWS_MAX}")
    head = PLAN_HEAD.pack(
        IS_EMERGENCY * plan.is_emergency | IS_REQUEST * plan.is_request, min(max(plan.room, 0), 255),
        start % TICKS, latitude_e7, longitude_e7, slow << 4 | coarse, *sizes, len(rows),
        int(altitudes[0]),
    )  # fmt: skip
    step = STEP_M * 2.0**coarse
    table = np.column_stack([ticks, np.round(east / step), np.round(north / step), altitudes])[1:]
    return head + b"".join(ROW.pack(*row) for row in table.astype(int).tolist())


def _ticks(ticks: FloatArray, *, begins_in_circle: bool) -> FloatArray:
    """Round times ``ticks`` (N,) so that they never fall, and circles last no shorter, (N,)."""
    rounded = np.round(ticks)
    if begins_in_circle:
        rounded[1] = math.ceil(ticks[1])
        rounded[2:] = np.maximum(rounded[2:], rounded[1])
    return np.asarray(np.minimum(rounded, math.floor(ticks[-1])))


def tick_near(tick: int, near: int) -> int:
    """Return the time whose lowest 32 bits are ``tick`` and that is nearest to another [0.1 s]."""
    return near + (tick - near + TICKS // 2) % TICKS - TICKS // 2


def _doublings(size: float, most: float) -> int:
    return max(0, math.ceil(math.log2(max(size, 1.0) / most)))


def next_number(number: int) -> int:
    """Return the plan number after another."""
    return (number + 1) % NUMBERS
