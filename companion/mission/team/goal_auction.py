"""The auction that divides a team's shared goals among its members; each member computes all of it.

A member tells its bid: where it was at a time, which goal it flies to, and when it arrives there. It tells
also which goals are flown. All members compute the same outcome from the same bids. A goal belongs to the
available member that flies to it and arrives first. The other goals are auctioned one at a time: the member
that would be at a goal first wins it, and its next way begins there. This is a sequential single-item
auction. The bid is the time of arrival, as in the rule BidMaxPath, and a goal that is won comes last.

What is known only grows: a later bid replaces an earlier one, and a goal that is flown stays flown. So lost,
late and repeated messages, and their order, make no difference once the latest of each member has arrived.
``docs/team-agreement.md`` says why nothing oscillates and why each goal ends flown.

References
----------
Koenig, Tovey, Lagoudakis, Markakis, Kempe, Keskinocak, Kleywegt, Meyerson and Jain, "The Power of Sequential
Single-Item Auctions for Agent Coordination", AAAI 2006.
Lagoudakis, Markakis, Kempe, Keskinocak, Kleywegt, Koenig, Tovey, Meyerson and Jain, "Auction-Based
Multi-Robot Routing", RSS 2005: the rules of bidding.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.mission.team.pacing import Pacing
from companion.mission.team.standing import Standing
from companion.mission.team.wire import (
    AIRSPEED_STEP_M_S,
    AIRSPEED_STEPS_MAX,
    TICK_S,
    GoalBid,
    bid_payload,
    tick_near,
)

TRANSMISSIONS = 4  # A new bid is sent this many times at short intervals.
# A member that is so late bids again. It says then that it will be late by as much again. So the goals behind
# one that it does not reach are given to others.
LATE_TICKS = 300
FOREVER = np.iinfo(np.int64).max


@dataclass(frozen=True, slots=True)
class PlacedBid:
    """A bid as its receiver uses it.

    Parameters
    ----------
    bid : GoalBid
        The bid.
    tick : int
        Time of the bid, UTC in steps of 0.1 s.
    place_m : tuple of float
        Where the member was, east and north [m].
    """

    bid: GoalBid
    tick: int
    place_m: tuple[float, float]

    @property
    def arrives(self) -> int:
        """Time at which the member arrives at the goal to which it flies, UTC in steps of 0.1 s."""
        return self.tick + self.bid.takes_ticks


Lists = dict[int, tuple[int, ...]]  # goals of each member in their order, by system id


class GoalAuction:
    """One member's part in the auction. Times are UTC seconds and come in as arguments.

    Parameters
    ----------
    member : int
        System id of this member.
    goals_m : ndarray, shape (G, 2)
        East and north of the goals, the same for all members [m].
    frame : LocalFrame
        Frame of these places.
    airspeed_m_s : float
        Airspeed at which this member flies to them [m/s].
    """

    def __init__(self, member: int, goals_m: FloatArray, frame: LocalFrame, airspeed_m_s: float) -> None:
        self._member, self._goals_m, self._frame = member, np.asarray(goals_m, dtype=np.float64), frame
        self._airspeed_steps = min(max(round(airspeed_m_s / AIRSPEED_STEP_M_S), 1), AIRSPEED_STEPS_MAX)
        self._all = (1 << len(self._goals_m)) - 1
        self._bids: dict[int, PlacedBid] = {}
        self._flown = 0
        self._transmissions_left = 0
        self._lists: tuple[frozenset[int], Lists] | None = None

    @property
    def is_over(self) -> bool:
        """Whether all goals are flown."""
        return self._flown == self._all

    @property
    def flown(self) -> tuple[int, ...]:
        """The goals that are known to be flown."""
        return tuple(goal for goal in range(len(self._goals_m)) if self._flown >> goal & 1)

    def lists(self, living: Collection[int]) -> Lists:
        """Return the goals of each member that is available, in the order in which it flies them.

        Parameters
        ----------
        living : collection of int
            The members that are not lost, this one among them.
        """
        among = frozenset(living)
        if self._lists is None or self._lists[0] != among:
            bids = {member: self._bids[member] for member in sorted(among & self._bids.keys())}
            self._lists = among, self._auctioned(bids)
        return self._lists[1]

    def receive(self, sender: int, bid: GoalBid, now_s: float) -> None:
        """Take in what another member says.

        Parameters
        ----------
        sender : int
            System id of the member.
        bid : GoalBid
            What it says.
        now_s : float
            UTC time [s].
        """
        self._note_flown(bid.flown & self._all)
        tick, known = tick_near(bid.tick, round(now_s / TICK_S)), self._bids.get(sender)
        if known is None or tick > known.tick:
            self._place(sender, bid, tick)

    def look(
        self,
        now_s: float,
        place_m: tuple[float, float],
        living: Collection[int],
        *,
        reached: Iterable[int] = (),
        is_available: bool = True,
    ) -> tuple[int, ...]:
        """Note what this member has reached, and bid if it has no goal; return its goals in their order.

        Parameters
        ----------
        now_s : float
            UTC time [s].
        place_m : tuple of float
            Where it is, east and north [m].
        living : collection of int
            The members that are not lost, this one among them.
        reached : iterable of int
            Goals that it has flown.
        is_available : bool
            False while a pilot flies it, or it returns home: others fly its goals then.
        """
        self._note_flown(sum(1 << goal for goal in set(reached)))
        own = self._bids.get(self._member)
        if not is_available:
            if own is not None and own.bid.is_available:
                self._bid(now_s, place_m, None, is_available=False)
            return ()
        if own is None or not own.bid.is_available:
            own = self._bid(now_s, place_m, None)
        mine = self.lists(living)[self._member]
        late = round(now_s / TICK_S) - own.arrives
        if mine[:1] != ((own.bid.goal,) if own.bid.goal is not None else ()):
            # From here on, and not from where it bid before: another one may be nearer now.
            self._bid(now_s, place_m, None)
            mine = self.lists(living)[self._member]
            if mine:
                self._bid(now_s, place_m, mine[0])
        elif mine and late > LATE_TICKS:
            self._bid(now_s, place_m, mine[0], late=late)
        return self.lists(living).get(self._member, ())

    def payloads(self, standing: Standing, pacing: Pacing, now_s: float) -> list[bytes]:
        """Return what is to be broadcast now.

        Parameters
        ----------
        standing : Standing
            Numbers of this member's plans.
        pacing : Pacing
            Says when it may be sent.
        now_s : float
            UTC time [s].
        """
        own, is_new = self._bids.get(self._member), self._transmissions_left == TRANSMISSIONS
        if own is None or not pacing.takes_bid(now_s, is_new=is_new, is_recent=self._transmissions_left > 0):
            return []
        self._transmissions_left = max(self._transmissions_left - 1, 0)
        return [bid_payload(standing, self.transmitted)]

    @property
    def transmitted(self) -> GoalBid:
        """The bid that this member sends; it must have bid before."""
        return replace(self._bids[self._member].bid, flown=self._flown)

    def _bid(
        self,
        now_s: float,
        place_m: tuple[float, float],
        goal: int | None,
        *,
        late: int = 0,
        is_available: bool = True,
    ) -> PlacedBid:
        """Replace this member's bid; ``late`` is in steps of 0.1 s."""
        latitude, longitude = self._frame.places_from_local(np.array([place_m[0]]), np.array([place_m[1]]))
        known = self._bids.get(self._member)
        tick = round(now_s / TICK_S) if known is None else max(round(now_s / TICK_S), known.tick + 1)
        takes = 0
        if goal is not None:
            away_m = math.dist(place_m, self._goals_m[goal])
            takes = late + round(away_m / (AIRSPEED_STEP_M_S * self._airspeed_steps) / TICK_S)
        bid = GoalBid(
            tick, round(float(latitude[0]) * 1e7), round(float(longitude[0]) * 1e7), self._airspeed_steps,
            goal, min(takes, 65_535), is_available,
        )  # fmt: skip
        self._transmissions_left = TRANSMISSIONS
        return self._place(self._member, bid, tick)

    def _place(self, member: int, bid: GoalBid, tick: int) -> PlacedBid:
        """Keep a bid, at a time [0.1 s]; a member uses its own as the others read it."""
        east, north = self._frame.places_from_global(
            np.array([bid.latitude_e7 * 1e-7]), np.array([bid.longitude_e7 * 1e-7])
        )
        placed = PlacedBid(bid, tick, (float(east[0]), float(north[0])))
        self._bids[member], self._lists = placed, None
        return placed

    def _note_flown(self, flown: int) -> None:
        if flown | self._flown != self._flown:
            self._flown |= flown
            self._transmissions_left, self._lists = TRANSMISSIONS, None

    def _auctioned(self, bids: Mapping[int, PlacedBid]) -> Lists:
        """Return the outcome for some bids: first the goals that members fly to, then one goal at a time."""
        newest = max((placed.tick for placed in bids.values()), default=0)
        bids = {member: placed for member, placed in bids.items() if placed.bid.is_available}
        auction = AuctionRound(self._goals_m, self._flown, bids, newest)
        for member, placed in sorted(bids.items(), key=lambda item: (item[1].arrives, item[0])):
            goal = placed.bid.goal
            if goal is not None and goal < len(self._goals_m) and auction.is_open[goal]:
                auction.win(member, goal, max(placed.arrives, newest))
        while bids and auction.is_open.any():
            auction.win(*auction.first_arrival())
        return {member: tuple(goals) for member, goals in auction.lists.items()}


class AuctionRound:
    """The auction of all goals that are left, one goal at a time.

    Parameters
    ----------
    goals_m : ndarray, shape (G, 2)
        East and north of the goals [m].
    flown : int
        Bit n is set if goal n is flown.
    bids : mapping of int to PlacedBid
        Bids of the members that are available, by system id.
    begin : int
        Members without a goal can leave at this time, UTC in steps of 0.1 s.

    Attributes
    ----------
    lists : dict of int to list of int
        Goals that each member has won until now.
    is_open : ndarray of bool, shape (G,)
        Goals that nobody has won.
    """

    def __init__(self, goals_m: FloatArray, flown: int, bids: Mapping[int, PlacedBid], begin: int) -> None:
        self.lists: dict[int, list[int]] = {member: [] for member in bids}
        self.is_open = np.array([not flown >> goal & 1 for goal in range(len(goals_m))])
        self._goals_m, self._members = goals_m, list(bids)
        steps = np.array([placed.bid.airspeed_steps for placed in bids.values()])
        self._rates = AIRSPEED_STEP_M_S * TICK_S * steps[:, None]  # metres in a tenth of a second
        self._free = dict.fromkeys(bids, begin)  # when a member has flown what it has won
        self._places_m = {member: placed.place_m for member, placed in bids.items()}

    def win(self, member: int, goal: int, arrives: int) -> None:
        """Give a goal to the member that arrives there at a time."""
        east_m, north_m = self._goals_m[goal].tolist()
        self.lists[member].append(goal)
        self.is_open[goal] = False
        self._free[member], self._places_m[member] = arrives, (east_m, north_m)

    def first_arrival(self) -> tuple[int, int, int]:
        """Return which member would be first at an open goal, which goal, and when."""
        places = np.array([self._places_m[member] for member in self._members])
        free = np.array([self._free[member] for member in self._members], dtype=np.int64)
        away_m = np.hypot(*(self._goals_m[None] - places[:, None]).transpose(2, 0, 1))
        arrives = free[:, None] + np.rint(away_m / self._rates).astype(np.int64)
        row, goal = divmod(int(np.where(self.is_open, arrives, FOREVER).argmin()), len(self.is_open))
        return self._members[row], goal, int(arrives[row, goal])
