"""The layout in which the service's and the operator's items share the autopilot's list.

ArduPlane overwrites a mission list in place while it flies it, so a new path never overwrites the flown one.
The list consists of home, the operator's own items, bank A and bank B. The flown bank is sent again
unchanged, and the other bank receives the new path. Each bank ends in a loiter, or jumps to the operator's
items that follow the goal. The list never gets shorter. An upload that stops at any item leaves the flown
bank intact. Behind the banks lie two return banks, once there is a return path
(:mod:`companion.mission.return_bank`).

PX4 replaces its list in one step. The list consists of the operator's items up to the goal, the service's
items, and the operator's items that follow the goal. The service's items end in a loiter, or continue with
the operator's. A return to launch with RTL_TYPE 2 flies past the loiter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.mission.operator import (
    FIRST_WITHOUT_PLACE,
    Operator,
    banks_in,
    shifted_jumps,
)
from companion.mission.return_bank import RETURN_ITEMS, num_return_items
from companion.mission.waypoints import MissionPart
from companion.types.mission import Command, MavFrame, Mission, MissionItem

BANK_ITEMS, TEAM_BANK_ITEMS = 20, 40  # Items of a bank; in a team, missions cover twice the time.
BANK_EXTRAS = 3  # A bank also holds the airspeed, a jump, and the loiter at the end.
WHOLE_WAYPOINTS_MAX = 200  # A mission on a PX4 has at most this many waypoints.
# The service's items on a PX4 take at least this many items, and this multiple of the first mission's: so
# later, longer missions fit as well.
WHOLE_ITEMS_MIN, WHOLE_SHARE = 16, 1.5
_FOR_EVER = -1.0  # The repeat count of a DO_JUMP that repeats without end.
_HALF_CENTIMETRE_M = 0.004  # Just under half a centimetre: the truncation then restores the stored altitude.


@dataclass(frozen=True, slots=True)
class TwoBankLayout:
    """The positions of the banks in an ArduPlane's list.

    Parameters
    ----------
    prefix : tuple of MissionItem
        Home and the operator's own items, as read.
    size : int
        Number of items of a bank.
    flown : tuple of MissionItem or None
        The flown bank as sent; None before the first.
    flown_index : int
        Which bank is flown, 0 or 1.
    tail : int or None
        Index of the operator's item that follows the goal; the prefix's length if there is none.
    returns : tuple of MissionItem
        Both return banks as sent; empty before the first return path.
    """

    prefix: tuple[MissionItem, ...]
    size: int
    flown: tuple[MissionItem, ...] | None = None
    flown_index: int = 1
    tail: int | None = None
    returns: tuple[MissionItem, ...] = ()

    @property
    def max_waypoints(self) -> int:
        """Largest number of waypoints of a path, not counting the operator's actions."""
        return self.size - BANK_EXTRAS

    @property
    def num_items(self) -> int:
        """Length of the list after the next swap; the first mission may omit the idle bank."""
        return self.return_span[1]

    @property
    def flown_span(self) -> tuple[int, int]:
        """Sequence of the first item of the flown bank, and the sequence after its last."""
        first = self.first_of(self.flown_index)
        return first, first + self.size

    @property
    def tail_span(self) -> tuple[int, int]:
        """Sequence of the operator's first item after the goal, and the sequence after the last."""
        end = len(self.prefix)
        return end if self.tail is None else self.tail, end

    @property
    def return_span(self) -> tuple[int, int]:
        """Sequence of the first item of the return banks, and the sequence after their last."""
        first = len(self.prefix) + (1 if self.flown is None else 2) * self.size
        return first, first + len(self.returns)

    def first_of(self, index: int) -> int:
        """Return the sequence of a bank's first item."""
        return len(self.prefix) + index * self.size

    def items_for(self, part: MissionPart) -> tuple[MissionItem, ...]:
        """Return a bank that contains a mission part."""
        has_tail = self.tail is not None and self.tail < len(self.prefix)
        jumps = part.continues_with_operator_items and has_tail
        return bank_items(part, self.size, jump_to=self.tail if jumps else None)

    def with_new(self, bank: tuple[MissionItem, ...], plan_number: int) -> tuple[Mission, TwoBankLayout]:
        """Return the list with a new path in the idle bank, and the layout once that bank is flown."""
        index = 1 - self.flown_index
        banks: list[tuple[MissionItem, ...] | None] = [None, None]
        banks[index], banks[self.flown_index] = bank, self.flown
        items = list(self.prefix)
        for content in (*banks, self.returns):
            items += content or ()
        numbered = tuple(
            replace(item, sequence=n, is_current=n == self.first_of(index)) for n, item in enumerate(items)
        )
        after = replace(self, flown=bank, flown_index=index)
        return Mission(numbered, self.first_of(index), plan_number), after


@dataclass(frozen=True, slots=True)
class SingleListLayout:
    """The layout of a PX4's list.

    Parameters
    ----------
    head : tuple of MissionItem
        The operator's items before the service's.
    tail : tuple of MissionItem
        The operator's items after the service's.
    flown : tuple of MissionItem or None
        The service's items as sent; None before the first.
    size : int
        Fixed number of the service's items: the last item is repeated up to it. A PX4 does not notice that a
        count has changed if the message comes before any item (read in its source). A count that a bad link
        delays could therefore truncate a longer list; lists of one length are safe.
    """

    head: tuple[MissionItem, ...]
    tail: tuple[MissionItem, ...]
    flown: tuple[MissionItem, ...] | None = None
    size: int = 0

    @property
    def max_waypoints(self) -> int:
        """Largest number of waypoints of a path."""
        return WHOLE_WAYPOINTS_MAX

    @property
    def num_items(self) -> int:
        """Length of the list."""
        return len(self.head) + len(self.flown or ()) + len(self.tail)

    @property
    def flown_span(self) -> tuple[int, int]:
        """Sequence of the first of the service's items, and the sequence after their last."""
        return len(self.head), len(self.head) + len(self.flown or ())

    @property
    def tail_span(self) -> tuple[int, int]:
        """Sequence of the operator's first item after the goal, and the sequence after the last."""
        first = self.flown_span[1]
        return first, first + len(self.tail)

    @property
    def return_span(self) -> tuple[int, int]:
        """The list has no return banks: the same sequence twice."""
        return self.num_items, self.num_items

    def items_for(self, part: MissionPart) -> tuple[MissionItem, ...]:
        """Return the service's items for a part: they end in a loiter, or in the airspeed twice.

        Behind the loiter a way on to the operator's items may follow, which only a return to launch flies
        (RTL_TYPE 2). It ends in the airspeed twice, too.
        """
        way_on = (*part.way_on, *(part.speed,) * 2) if part.way_on and self.tail else ()
        goes_on = part.continues_with_operator_items and self.tail
        ours = (*part.items, *((part.speed,) * 2 if goes_on else (part.loiter,)))
        needed = len(ours) + len(way_on)
        size = max(self.size or int(WHOLE_SHARE * needed), len(self.flown or ()), WHOLE_ITEMS_MIN)
        return ours + ours[-1:] * (size - needed) + way_on

    def with_new(self, ours: tuple[MissionItem, ...], plan_number: int) -> tuple[Mission, SingleListLayout]:
        """Return the list with another mission part, and the layout once it is flown."""
        behind, by = len(self.head), len(ours)
        items = [*shifted_jumps(self.head, behind, by), *ours, *shifted_jumps(self.tail, behind, by)]
        numbered = tuple(replace(item, sequence=n, is_current=n == behind) for n, item in enumerate(items))
        return Mission(numbered, behind, plan_number), replace(self, flown=ours, size=len(ours))


Layout = TwoBankLayout | SingleListLayout


def marked(mission: Mission, sequence: int) -> tuple[MissionItem, ...]:
    """Return the list with the entry as its only current item."""
    return tuple(replace(item, is_current=item.sequence == sequence) for item in mission.items)


def bank_items(part: MissionPart, size: int, *, jump_to: int | None = None) -> tuple[MissionItem, ...]:
    """Return a bank: waypoints, the airspeed, and loiters at the last waypoint up to the bank's size.

    With ``jump_to`` the autopilot jumps to the operator's item of that sequence instead of the loiter.
    """
    items = part.items
    if jump_to is not None:
        parameters = (float(jump_to), _FOR_EVER, 0.0, 0.0)
        items = (*items, MissionItem(0, Command.DO_JUMP, MavFrame.MISSION, parameters, 0, 0, 0.0))
    return items + (part.loiter,) * (size - len(items))


def new_banks(
    existing: Sequence[MissionItem], tail: int | None = None, *, size: int = BANK_ITEMS
) -> TwoBankLayout:
    """Return a layout behind the autopilot's present items, with banks of a size."""
    return TwoBankLayout(prefix=with_stable_height(existing), size=size, tail=tail)


def with_stable_height(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Return items as read from an ArduPlane, changed so that sending them again stores the same altitudes.

    ArduPlane truncates altitudes to centimetres in single precision: 80.12 m read back may be stored as
    80.11 m. A list that is sent again at every swap would lose a centimetre each time.
    """
    return tuple(
        replace(item, altitude_m=item.altitude_m + math.copysign(_HALF_CENTIMETRE_M, item.altitude_m))
        if item.command < FIRST_WITHOUT_PLACE and item.altitude_m != 0.0 and item.sequence > 0
        else item
        for item in items
    )


def two_bank_layout_of(
    read: Sequence[MissionItem], operator: Operator, current: int, new_size: int = BANK_ITEMS
) -> TwoBankLayout:
    """Return the layout of an ArduPlane's list as read; after a restart, the existing one.

    Parameters
    ----------
    read : sequence of MissionItem
        The autopilot's list.
    operator : Operator
        The operator's part of it.
    current : int
        Sequence of the item being flown. The bank that contains it is not written to.
    new_size : int
        Items of a bank if there is none yet.
    """
    ours = without_returns(read)
    banks = banks_in(ours)
    if banks is None:
        return new_banks(operator.items, operator.tail, size=new_size)
    first, size = banks
    kept = [tuple(read[begin : begin + size]) for begin in range(first, len(ours), size)]
    index = 1 if len(kept) == 2 and current >= first + size else 0
    if current < first:
        index = len(kept) - 1  # The first bank is written next; a second bank keeps the list's length.
    flown = tuple(replace(item, sequence=1, is_current=False) for item in kept[index])
    has_returns = len(read) - len(ours) == 2 * RETURN_ITEMS
    return TwoBankLayout(
        with_stable_height(operator.items), size, with_stable_height(flown), index, operator.tail,
        with_stable_height(read[len(ours) :]) if has_returns else (),
    )  # fmt: skip


def without_returns(items: Sequence[MissionItem]) -> Sequence[MissionItem]:
    """Return a list as read, without the return banks at its end."""
    return items[: len(items) - num_return_items(items)]


def single_list_layout_of(operator: Operator) -> SingleListLayout:
    """Return the layout of a PX4's list: the service's items after the operator's items up to the goal."""
    return SingleListLayout(head=operator.items[: operator.tail], tail=operator.items[operator.tail :])
