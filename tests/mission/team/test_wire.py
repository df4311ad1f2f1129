"""Payloads: what is sent is read again, within what the tolerance covers, and nothing else is believed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.frames import LocalFrame
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.standing import PAYLOAD_BYTES, PayloadError, Standing
from companion.mission.team.wire import (
    ROWS_MAX,
    Fragment,
    Report,
    plan_payloads,
    read_payload,
    read_plan,
    report_payloads,
    return_payload,
    transmitted_plan,
)
from tests.mission.team.team_plans import BEGIN_S, FRAME, plan, zigzag

MEMBERS = tuple(range(1, 129))
STANDING = Standing(4, 5, is_pending=True)


def joined(payloads):
    return b"".join(read_payload(payload).data for payload in payloads)


def test_a_plan_of_ten_legs_fits_one_payload_with_its_circle():
    transmitted = transmitted_plan(plan(*zigzag(10)), FRAME)
    assert len(transmitted.rows) == 11
    (payload,) = plan_payloads(STANDING, transmitted, FRAME)
    assert len(payload) == 115 <= PAYLOAD_BYTES
    read = read_plan(joined([payload]), 1, 1, FRAME, BEGIN_S)
    assert (read.is_emergency, read.is_request) == (False, False)


@pytest.mark.parametrize("frame", [FRAME, LocalFrame(47.41, 8.48, 300.0)])
def test_a_long_plan_is_read_from_its_fragments(frame):
    transmitted = transmitted_plan(plan(*zigzag(40), is_emergency=True, room=3, is_request=True), FRAME)
    payloads = plan_payloads(STANDING, transmitted, FRAME)
    assert len(payloads) == 3
    assert max(map(len, payloads)) <= PAYLOAD_BYTES
    read = read_plan(joined(payloads), 1, 1, frame, BEGIN_S + 1e6)
    assert (read.is_emergency, read.is_request, read.room) == (True, True, 3)
    assert read.radius_m == transmitted.radius_m
    for instant in np.linspace(transmitted.start_s, transmitted.end_s + 10.0, 50):
        here, there = transmitted.place_at(instant), read.place_at(instant)
        assert frame.global_from_local(*there) == pytest.approx(FRAME.global_from_local(*here), abs=1e-2)
        east, north, up = frame.local_from_global(*FRAME.global_from_local(*here))
        assert (east, north, up) == pytest.approx(there, abs=0.1)


LENGTHS = st.floats(0.0, 30_000.0)


@st.composite
def plans(draw):
    num = draw(st.integers(1, 12))
    steps = [
        (draw(st.floats(1.0, 900.0)), *(draw(LENGTHS) for _ in "en"), draw(st.floats(-100.0, 3000.0)))
        for _ in range(num)
    ]
    rows = np.array(steps)
    sizes = [draw(st.floats(0.0, 200.0)) for _ in range(3)]
    first_radius_m = draw(st.sampled_from((0.0, 80.0))) if num > 2 else 0.0
    if first_radius_m:
        rows[1, 1:] = rows[0, 1:] + [0.0, first_radius_m, 0.0]
    if num > 2 and draw(st.booleans()):  # It enters its circle on the way to the centre.
        rows[-1] = [0.0, rows[-2, 1] + sizes[0], *rows[-2, 2:]]
    rows[:, 0] = BEGIN_S + np.cumsum(rows[:, 0])
    return SharedPlan(7, 9, rows, *sizes, first_radius_m=first_radius_m)


@settings(max_examples=200)
@given(plans(), st.floats(0.0, 1.0), st.floats(0.0, 6.3), st.floats(0.0, 50.0))
def test_who_keeps_the_tolerance_of_the_plan_keeps_that_of_the_plan_that_is_told(
    flown, part, angle, simplify_m
):
    transmitted = transmitted_plan(flown, FRAME, simplify_m)
    instant = flown.start_s + part * 1.2 * (flown.end_s - flown.start_s)
    east, north, up = flown.place_at(instant)
    off = flown.tolerance_m + flown.disc_at(instant)
    place = (east + off * np.sin(angle), north + off * np.cos(angle), up + flown.tolerance_up_m)
    assert transmitted.is_flown_at(place, instant)
    assert (
        transmitted_plan(transmitted, FRAME).tolerance_m <= transmitted.tolerance_m + 0.5
    )  # What was rounded hardly moves again.


NUMBERS = st.integers(0, 65_535)
ANSWERS = st.lists(st.tuples(st.integers(1, 128), NUMBERS), max_size=60).map(tuple)


@given(ANSWERS, ANSWERS, st.sets(st.integers(1, 128)), st.sets(st.sampled_from(MEMBERS)))
def test_reports_of_any_length_are_read_again(approved, refused, missing, awaited):
    report = Report(STANDING, approved, refused, tuple(sorted(missing)), frozenset(awaited))
    payloads = report_payloads(report)
    assert max(map(len, payloads)) <= PAYLOAD_BYTES
    read = [read_payload(payload) for payload in payloads]
    assert {each.standing for each in read} == {STANDING}
    for name in ("approved", "refused", "missing"):
        assert sum((getattr(each, name) for each in read), ()) == getattr(report, name)
    assert frozenset().union(*(each.awaited for each in read)) == report.awaited


def test_a_short_answer_takes_few_bytes():
    (payload,) = report_payloads(Report(STANDING, approved=((3, 7),)))
    assert len(payload) == 13


@given(st.floats(-1500.0, 17_000.0))
def test_the_altitude_of_a_return_takes_eight_bytes(altitude_m):
    """In steps of 0.25 m between -1,000 m and 15,383.75 m, the nearest one."""
    payload = return_payload(STANDING, altitude_m)
    assert len(payload) == 8
    found = read_payload(payload)
    assert found.standing == STANDING
    assert found.altitude_m == pytest.approx(min(max(altitude_m, -1000.0), 15_383.75), abs=0.125)


@pytest.mark.parametrize("size", [7, 9])
def test_the_altitude_of_a_return_has_two_bytes(size):
    payload = return_payload(STANDING, 700.0)
    with pytest.raises(PayloadError, match="return_length"):
        read_payload((payload + b"\0")[:size])


@settings(max_examples=500)
@given(st.binary(max_size=140))
def test_any_bytes_are_read_or_refused(payload):
    for start in (
        b"",
        b"\x11\x00\x00\x00\x00\x00",
        b"\x12\x06\x00\x00\x07\x00",
        b"\x12\x06\x00\x00\x07\x00\x07\x00\x01",
        b"\x14\x00\x00\x00\x00\x00",
    ):
        try:
            found = read_payload(start + payload)
        except PayloadError:
            continue
        if isinstance(found, Fragment):
            try:
                read_plan(found.data, 1, found.number, FRAME, BEGIN_S)
            except PayloadError:
                continue


@settings(max_examples=300)
@given(st.integers(0, 114), st.integers(0, 255))
def test_a_damaged_plan_is_read_or_refused(place, value):
    (payload,) = plan_payloads(STANDING, transmitted_plan(plan(*zigzag(10)), FRAME), FRAME)
    damaged = payload[:place] + bytes([value]) + payload[place + 1 :]
    try:
        found = read_payload(damaged)
        if isinstance(found, Fragment):
            read_plan(found.data, 1, found.number, FRAME, BEGIN_S)
    except PayloadError:
        pass


@pytest.mark.parametrize(
    "standing",
    [
        Standing(5, 5, is_pending=True),
        Standing(6, 5),
        Standing(5, None),
        Standing(None, None, is_pending=True),
    ],
)
def test_a_standing_that_no_member_can_have_is_refused(standing):
    (payload,) = report_payloads(Report(standing))
    with pytest.raises(PayloadError, match="standing"):
        read_payload(payload)


SAID = [  # One after the other.
    Standing(),
    Standing(None, 65_535, is_pending=True),
    Standing(65_535, 65_535),
    Standing(65_535, 0, is_pending=True),
    Standing(65_535, 0),
    Standing(65_535, 1, is_pending=True),
    Standing(1, 1),
]


@pytest.mark.parametrize("standing", [*SAID, Standing(None, 7)])
def test_a_standing_that_a_member_can_have_is_read_again(standing):
    (payload,) = report_payloads(Report(standing))
    assert read_payload(payload).standing == standing


def test_another_version_is_refused():
    (payload,) = report_payloads(Report(STANDING))
    with pytest.raises(PayloadError, match="version"):
        read_payload(bytes([payload[0] + 16]) + payload[1:])


def test_what_a_member_says_only_ever_moves_on():
    for n, one in enumerate(SAID):
        assert [one.is_later_than(other) for other in SAID] == [k < n for k in range(len(SAID))]
    assert Standing().is_later_than(None)


def test_a_plan_beyond_the_format_is_refused():
    with pytest.raises(ValueError, match="format"):
        transmitted_plan(plan((0, 0, 0), (1000, 0, 20_000)), FRAME)
    with pytest.raises(ValueError, match="rows"):
        plan_payloads(STANDING, plan(*zigzag(250)), FRAME)


def test_a_plan_with_too_many_rows_is_told_more_coarsely_and_whoever_flies_it_still_keeps_it():
    """It winds 6 m to either side every 100 m, for 60 km."""
    places = [(100.0 * n, 6.0 * (-1) ** n, 100.0) for n in range(600)]
    flown = plan(*places)
    transmitted = transmitted_plan(flown, FRAME, 2.0)
    assert 2 <= len(transmitted.rows) <= ROWS_MAX
    assert len(plan_payloads(STANDING, transmitted, FRAME)) <= 15
    assert flown.tolerance_m + 6.0 <= transmitted.tolerance_m <= flown.tolerance_m + 20.0
    for instant in np.linspace(flown.start_s, flown.end_s, 700):
        east, north, up = flown.place_at(instant)
        for side in (-flown.tolerance_m, flown.tolerance_m):
            assert transmitted.is_flown_at((east, north + side, up), instant)
