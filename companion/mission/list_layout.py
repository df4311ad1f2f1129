"""How ours and the operator's items share the autopilot's list.

On ArduPlane a mission list is overwritten in place while it is flown, so a new path never goes where
the flown one stands. The list is: home, the operator's own items, bank A, bank B. The bank being
flown is sent again unchanged, the other carries the new path; each ends in a loiter, or jumps to the
operator's items that follow the goal; the list never gets shorter. An upload broken off at any item
leaves the flown bank whole.

PX4 switches over in one step. The list is: the operator's items up to the goal, ours, the operator's
that follow the goal; ours end in a loiter, or run on into those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.mission.operator import (
    BANK_ITEMS_LIMITS,
    FIRST_WITHOUT_PLACE,
    Operator,
    banks_in,
    shifted_jumps,
)
from companion.mission.waypoints import MissionPart
from companion.types.mission import Command, MavFrame, Mission, MissionItem

BANK_ITEMS_MIN, BANK_ITEMS_MAX = BANK_ITEMS_LIMITS
BANK_EXTRAS = 3  # the airspeed, a jump, and the loiter at the end
WHOLE_WAYPOINTS_MAX = 200
WHOLE_ITEMS_MIN, WHOLE_SHARE = 16, 1.5  # of the first mission, with room for longer ones
_FOR_EVER = -1.0
_HALF_CENTIMETRE_M = 0.004


@dataclass(frozen=True, slots=True)
class TwoBankLayout:
    """Where the banks lie in an ArduPlane's list.

    Parameters
    ----------
    prefix : tuple of MissionItem
        Home and the operator's own items, kept as read.
    size : int
        Items a bank.
    flown : tuple of MissionItem or None
        The bank being flown, as sent; None before the first.
    flown_index : int
        0 or 1: which one it is.
    tail : int
        Index of the operator's item that follows the goal; the prefix's length if none does.
    """

    prefix: tuple[MissionItem, ...]
    size: int
    flown: tuple[MissionItem, ...] | None = None
    flown_index: int = 1
    tail: int | None = None

    @property
    def max_waypoints(self) -> int:
        """Most waypoints of a path that it carries, the operator's actions not counted."""
        return self.size - BANK_EXTRAS

    @property
    def num_items(self) -> int:
        """Length of the list with the next mission in it; the first one may leave the idle bank out."""
        return len(self.prefix) + (1 if self.flown is None else 2) * self.size

    @property
    def flown_span(self) -> tuple[int, int]:
        """First sequence of the part flown, and the one behind its last."""
        first = self.first_of(self.flown_index)
        return first, first + self.size

    @property
    def tail_span(self) -> tuple[int, int]:
        """First sequence of the operator's items that follow the goal, and the one behind their last."""
        end = len(self.prefix)
        return end if self.tail is None else self.tail, end

    def first_of(self, index: int) -> int:
        """Sequence of a bank's first item."""
        return len(self.prefix) + index * self.size

    def items_for(self, part: MissionPart) -> tuple[MissionItem, ...]:
        """A bank that carries a part."""
        has_tail = self.tail is not None and self.tail < len(self.prefix)
        jumps = part.continues_with_operator_items and has_tail
        return bank_items(part, self.size, jump_to=self.tail if jumps else None)

    def with_new(self, bank: tuple[MissionItem, ...], plan_number: int) -> tuple[Mission, TwoBankLayout]:
        """The list with a new path in the idle bank, and the banks once that is flown."""
        index = 1 - self.flown_index
        banks: list[tuple[MissionItem, ...] | None] = [None, None]
        banks[index], banks[self.flown_index] = bank, self.flown
        items = list(self.prefix)
        for content in banks:
            items += content or ()
        numbered = tuple(
            replace(item, sequence=n, is_current=n == self.first_of(index)) for n, item in enumerate(items)
        )
        after = replace(self, flown=bank, flown_index=index)
        return Mission(numbered, self.first_of(index), plan_number), after


@dataclass(frozen=True, slots=True)
class SingleListLayout:
    """A PX4's list.

    Parameters
    ----------
    head, tail : tuple of MissionItem
        The operator's items before ours and behind them.
    flown : tuple of MissionItem or None
        Ours, as sent; None before the first.
    size : int
        Items that ours always take: the last one is repeated up to it. A PX4 overlooks that a count has
        changed when it comes before any item (read in its source), so that a count which a bad link
        has kept for a while could cut a longer list off; lists of one length cannot be.
    """

    head: tuple[MissionItem, ...]
    tail: tuple[MissionItem, ...]
    flown: tuple[MissionItem, ...] | None = None
    size: int = 0

    @property
    def max_waypoints(self) -> int:
        """Most waypoints of a path that it carries."""
        return WHOLE_WAYPOINTS_MAX

    @property
    def num_items(self) -> int:
        """Length of the list."""
        return len(self.head) + len(self.flown or ()) + len(self.tail)

    @property
    def flown_span(self) -> tuple[int, int]:
        """First sequence of the part flown, and the one behind its last."""
        return len(self.head), len(self.head) + len(self.flown or ())

    @property
    def tail_span(self) -> tuple[int, int]:
        """First sequence of the operator's items that follow the goal, and the one behind their last."""
        first = self.flown_span[1]
        return first, first + len(self.tail)

    def items_for(self, part: MissionPart) -> tuple[MissionItem, ...]:
        """Ours, for a part: at its end a loiter, or the airspeed twice and what follows the goal."""
        goes_on = part.continues_with_operator_items and self.tail
        ours = (*part.items, *((part.speed,) * 2 if goes_on else (part.loiter,)))
        size = max(self.size or int(WHOLE_SHARE * len(ours)), len(self.flown or ()), WHOLE_ITEMS_MIN)
        return ours + ours[-1:] * (size - len(ours))

    def with_new(self, ours: tuple[MissionItem, ...], plan_number: int) -> tuple[Mission, SingleListLayout]:
        """The list with another part of ours, and the layout once that is flown."""
        behind, by = len(self.head), len(ours)
        items = [*shifted_jumps(self.head, behind, by), *ours, *shifted_jumps(self.tail, behind, by)]
        numbered = tuple(replace(item, sequence=n, is_current=n == behind) for n, item in enumerate(items))
        return Mission(numbered, behind, plan_number), replace(self, flown=ours, size=len(ours))


Layout = TwoBankLayout | SingleListLayout


def marked(mission: Mission, sequence: int) -> tuple[MissionItem, ...]:
    """The list with the item at which it is entered as the only current one."""
    return tuple(replace(item, is_current=item.sequence == sequence) for item in mission.items)


def bank_items(part: MissionPart, size: int, *, jump_to: int | None = None) -> tuple[MissionItem, ...]:
    """A bank: waypoints, the airspeed, and loiters at the last waypoint up to the bank's size.

    With ``jump_to`` the operator's item of that sequence is flown next instead of the loiter.
    """
    items = part.items
    if jump_to is not None:
        parameters = (float(jump_to), _FOR_EVER, 0.0, 0.0)
        items = (*items, MissionItem(0, Command.DO_JUMP, MavFrame.MISSION, parameters, 0, 0, 0.0))
    return items + (part.loiter,) * (size - len(items))


def new_banks(existing: Sequence[MissionItem], num_waypoints: int, tail: int | None = None) -> TwoBankLayout:
    """TwoBankLayout behind what the autopilot holds now, with room for paths half as long again."""
    size = min(BANK_ITEMS_MAX, max(BANK_ITEMS_MIN, int(1.5 * num_waypoints) + BANK_EXTRAS))
    return TwoBankLayout(prefix=held_height(existing), size=size, tail=tail)


def held_height(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Items as read from an ArduPlane, so that sending them again stores the same altitudes.

    It cuts altitudes to centimetres in single precision: 80.12 m read back may be stored as 80.11 m, and
    a list sent again at every swap would sink a centimetre each time.
    """
    return tuple(
        replace(item, altitude_m=item.altitude_m + math.copysign(_HALF_CENTIMETRE_M, item.altitude_m))
        if item.command < FIRST_WITHOUT_PLACE and item.altitude_m != 0.0 and item.sequence > 0
        else item
        for item in items
    )


def two_bank_layout_of(read: Sequence[MissionItem], operator: Operator, current: int) -> TwoBankLayout:
    """How ours are to stand in an ArduPlane's list as read; after a restart, as they stand already.

    Parameters
    ----------
    read : sequence of MissionItem
        What the autopilot holds.
    operator : Operator
        What in it is the operator's.
    current : int
        Sequence of the item being flown: the bank in which it lies is not written to.
    """
    banks = banks_in(read)
    if banks is None:
        return new_banks(operator.items, 0, operator.tail)
    first, size = banks
    kept = [tuple(read[begin : begin + size]) for begin in range(first, len(read), size)]
    index = 1 if len(kept) == 2 and current >= first + size else 0
    if current < first:
        index = len(kept) - 1  # the first is written next; a second one keeps the list's length
    flown = tuple(replace(item, sequence=1, is_current=False) for item in kept[index])
    return TwoBankLayout(held_height(operator.items), size, held_height(flown), index, operator.tail)


def single_list_layout_of(operator: Operator) -> SingleListLayout:
    """How ours are to stand in a PX4's list: between the operator's items up to the goal and the others."""
    return SingleListLayout(head=operator.items[: operator.tail], tail=operator.items[operator.tail :])
