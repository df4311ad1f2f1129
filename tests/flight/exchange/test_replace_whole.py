"""Replacing a PX4's mission: each way in which it can end, and what then is known."""

import asyncio

import pytest

from companion.errors import TransferError
from companion.flight.exchange.swap_px4 import replace_whole
from companion.mission.mission_id import mission_id
from companion.mission.swap import SwapOutcome
from companion.types.events import MissionCurrent
from companion.types.mission import Mission
from tests.mission.made import item

ITEMS = tuple(item(n) for n in range(5))
MISSION = Mission(ITEMS, 1, 7)
IDENTITY = mission_id(ITEMS)
OTHER = 0x0BAD_CAFE
ACTIVE, NONE = 3, 1


class ScriptedPx4:
    """Takes an upload, or raises; then tells what ``tells`` says."""

    def __init__(self, *, fault=None, given=IDENTITY, tells=None, flown=OTHER, is_stored=True):
        self.fault = fault
        self.given = given
        self.tells = tells if tells is not None else MissionCurrent(2.0, 3, 5, IDENTITY, ACTIVE)
        self.current = MissionCurrent(0.0, 2, 5, flown, ACTIVE)
        self.is_stored = is_stored
        self.sent = None
        self.is_over = False
        self.calls = []

    async def upload(self, items, may_finish=None):
        self.calls.append("upload")
        self.is_over = self.fault != "never acknowledged"
        if may_finish is not None and not may_finish():
            raise TransferError("upload", "TRANSFER_CANCELLED")
        self.sent = items
        if self.fault == "never acknowledged":
            self.is_over = True
            await asyncio.Event().wait()
        if self.fault:
            raise TransferError("upload", self.fault)
        return self.given

    async def download(self):
        self.calls.append("download")
        return ITEMS if self.is_stored else ITEMS[:-1]

    async def set_current(self, sequence, is_ahead=None):
        self.calls.append(f"set_current {sequence}")

    async def wait_for_mission_current(self, is_it, wait_s):
        while not self.is_over:  # noqa: ASYNC110 nothing else happens here
            await asyncio.sleep(0)
        self.current = self.tells
        return is_it(self.tells)


def replaced(link, entries=(3,), acts=(True,)):
    """Entries and leave to act are what is answered each time that is asked, the last for ever."""
    entry, act = list(entries), list(acts)
    return asyncio.run(
        replace_whole(
            link,
            MISSION,
            lambda: entry.pop(0) if len(entry) > 1 else entry[0],
            lambda: act.pop(0) if len(act) > 1 else act[0],
        )
    )


def test_the_entry_alone_is_marked_and_the_id_is_believed():
    link = ScriptedPx4()
    outcome, reason = replaced(link)
    assert outcome is SwapOutcome.FLOWN
    assert [entry.sequence for entry in link.sent if entry.is_current] == [3]
    assert f"{IDENTITY:08x}" in reason
    assert link.calls == ["upload"]


def test_a_pilot_who_took_over_before():
    link = ScriptedPx4()
    assert replaced(link, acts=(False,))[0] is SwapOutcome.WITHDRAWN
    assert link.calls == []


def test_nothing_ahead():
    link = ScriptedPx4()
    assert replaced(link, entries=(None,))[0] is SwapOutcome.STALE
    assert link.calls == []


@pytest.mark.parametrize("later", [4, None])
def test_an_entry_passed_during_the_upload_holds_the_last_item_back(later):
    link = ScriptedPx4(tells=MissionCurrent(2.0, 2, 5, OTHER, ACTIVE))
    assert replaced(link, entries=(3, later))[0] is SwapOutcome.STALE
    assert link.sent is None


def test_a_pilot_who_takes_over_during_the_upload_holds_the_last_item_back():
    link = ScriptedPx4()
    assert replaced(link, acts=(True, False))[0] is SwapOutcome.WITHDRAWN
    assert link.sent is None


def test_the_same_mission_is_not_sent_again_since_its_flag_would_be_ignored():
    link = ScriptedPx4(flown=IDENTITY)
    assert replaced(link)[0] is SwapOutcome.FLOWN
    assert link.calls == ["set_current 3"]


@pytest.mark.parametrize("fault", ["TIMEOUT", "never acknowledged"])
def test_a_lost_acknowledgement_is_made_good_by_what_is_told(fault):
    assert replaced(ScriptedPx4(fault=fault))[0] is SwapOutcome.FLOWN


def test_an_upload_that_failed():
    link = ScriptedPx4(fault="ERROR", tells=MissionCurrent(2.0, 2, 5, OTHER, ACTIVE))
    outcome, reason = replaced(link)
    assert outcome is SwapOutcome.REFUSED
    assert "ERROR" in reason


def test_something_else_was_stored():
    outcome, reason = replaced(ScriptedPx4(given=OTHER))
    assert outcome is SwapOutcome.DIFFERS
    assert f"{OTHER:08x}" in reason


def test_accepted_does_not_mean_flown():
    outcome, reason = replaced(ScriptedPx4(tells=MissionCurrent(2.0, 3, 5, IDENTITY, NONE)))
    assert outcome is SwapOutcome.REFUSED
    assert "not flown" in reason


@pytest.mark.parametrize(("is_stored", "outcome"), [(True, SwapOutcome.FLOWN), (False, SwapOutcome.DIFFERS)])
def test_one_that_names_no_missions_is_read_back(is_stored, outcome):
    link = ScriptedPx4(given=0, is_stored=is_stored, tells=MissionCurrent(2.0, 3, 5, 0, ACTIVE))
    assert replaced(link)[0] is outcome
    assert link.calls == ["upload", "download"]
