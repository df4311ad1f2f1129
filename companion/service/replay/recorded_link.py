"""Mission transfers in a replay: as recorded while the service sends the same, and modelled afterwards.

While the service sends the same as in flight, MAVSDK sends its messages and the recorded autopilot answers.
After the first difference there is no recorded answer, so a model of the autopilot's store answers.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from companion.clock import Clock
from companion.errors import LinkError, TransferError
from companion.link.messages.codec import Codec
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.missions.mission_items import as_sent
from companion.mission.mission_id import mission_id
from companion.types.events import MissionCurrent
from companion.types.mavlink_enums import MissionState
from companion.types.mission import Command, MavFrame, MissionItem

ITEM_S = 0.02  # Time for the transfer of an item, as measured on ArduPlane.
_HOME = MissionItem(0, Command.NAV_WAYPOINT, MavFrame.GLOBAL, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)

Items = tuple[MissionItem, ...]


class ReplayLink(AutopilotLink):
    """A link that can diverge from the recording.

    Parameters
    ----------
    codec : Codec
        Codec of the link.
    clock : Clock
        Clock of the replay.
    send : callable
        Passes bytes to the transport.
    held : callable
        Returns the recorded autopilot's list, None if it is unknown.

    Attributes
    ----------
    has_diverged : bool
        True if the recorded autopilot's answers are no longer valid.
    uploads : list
        Times and items of the missions stored in the model.
    """

    def __init__(
        self, codec: Codec, clock: Clock, send: Callable[[bytes], None], held: Callable[[], Items | None]
    ) -> None:
        super().__init__(codec, clock, send)
        self.has_diverged = False
        self.uploads: list[tuple[float, Items]] = []
        self._held = held
        self._items: Items = ()
        self._fence: Items = ()
        self._rally_points: Items = ()
        self._is_closing = False

    def part(self) -> None:
        """Answer from the model from now on; a call that is under way is repeated with the model."""
        if self.has_diverged:
            return
        self.has_diverged = True
        self.abandon()

    @property
    def current(self) -> MissionCurrent | None:
        """The current item; the model reports it all the time."""
        current = super().current
        return (
            replace(current, stamp_s=self._clock.now_s())
            if self.has_diverged and current is not None
            else current
        )

    @property
    def has_stored(self) -> bool:
        """Whether the model holds a mission of ours; before that it holds the recorded autopilot's."""
        return bool(self.uploads)

    @property
    def _swaps_whole_lists(self) -> bool:
        return self.dialect is not None and self.dialect.swaps_whole_lists

    def _stored(self) -> Items:
        held = self._items if self.has_stored else self._held()
        if held is None:
            return () if self._swaps_whole_lists else (_HOME,)
        return held

    @property
    def is_mavsdk_turn(self) -> bool:
        """Whether MAVSDK is about to send the next message, including its last one."""
        return self._is_closing or super().is_mavsdk_turn

    def end_mavsdk_turn(self) -> None:
        """Record that MAVSDK will send nothing."""
        self._is_closing = False
        super().end_mavsdk_turn()

    async def upload(
        self,
        items: Sequence[MissionItem],
        may_finish: Callable[[], bool] | None = None,
        *,
        gives_way: bool = False,
    ) -> int:
        """Replace the mission; after the divergence in the model."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().upload(items, may_finish, gives_way=gives_way)
        await self._wait_for_transfer(len(items))
        if may_finish is not None and not may_finish():
            raise TransferError("upload", "TRANSFER_CANCELLED")
        self._items = tuple(items)
        self.uploads.append((self._clock.now_s(), tuple(as_sent(item) for item in items)))
        if not self._swaps_whole_lists:
            self._report_current(0 if self.current is None else self.current.sequence)
            return 0
        self._report_current(next(item.sequence for item in items if item.is_current))
        return mission_id(items)

    async def write(self, items: Sequence[MissionItem]) -> None:
        """Overwrite a part of the list; after the divergence in the model."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().write(items)
        await self._wait_for_transfer(len(items))
        first = items[0].sequence
        stored = self._stored()
        self._items = (*stored[:first], *items, *stored[first + len(items) :])
        self.uploads.append((self._clock.now_s(), tuple(as_sent(item) for item in items)))

    async def read_back(self, *, gives_way: bool = False, num_left_out: int = 0) -> Items:
        """Read the list that was written; after the divergence from the model."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().read_back(gives_way=gives_way, num_left_out=num_left_out)
        await self._wait_for_transfer(len(self._stored()))
        return self._stored()

    async def download(self) -> Items:
        """Read the mission; after the divergence from the model."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().download()
        await self._wait_for_transfer(len(self._stored()))
        return self._stored()

    async def download_fence(self) -> Items:
        """Read the fence; after the divergence return the last one read."""
        if not self.has_diverged:
            with self._unless_diverged():
                self._fence = await super().download_fence()
                return self._fence
        return self._fence

    async def download_rally_points(self) -> Items:
        """Read the rally points; after the divergence return the last ones read."""
        if not self.has_diverged:
            with self._unless_diverged():
                self._rally_points = await super().download_rally_points()
                return self._rally_points
        return self._rally_points

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Fly to an item; after the divergence in the model."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().set_current(sequence, is_ahead)
        await self._wait_for_transfer(1)
        self._report_current(sequence)

    async def wait_for_mission_current(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
        """Return whether the autopilot reports an item in time; the model reports at once."""
        if not self.has_diverged:
            with self._unless_diverged():
                is_reported = await super().wait_for_mission_current(is_it, wait_s)
                if not self.has_diverged:
                    return is_reported
        return self.current is not None and is_it(self.current)

    async def set_mode(self, mode: str) -> None:
        """Select a mode; after the divergence the recorded modes stay."""
        if not self.has_diverged:
            with self._unless_diverged():
                return await super().set_mode(mode)

    @contextlib.contextmanager
    def _unless_diverged(self) -> Iterator[None]:
        """Suppress errors that the divergence causes, so that the model takes over."""
        try:
            yield
        except LinkError:
            if not self.has_diverged:
                raise

    async def _send_and_wait(
        self, data: bytes, is_answer: Callable[[object], bool], *, wait_s: float
    ) -> object | None:
        if self.has_diverged:
            raise TransferError("question", "the recorded autopilot answers no more")
        return await super()._send_and_wait(data, is_answer, wait_s=wait_s)

    async def _wait_for_transfer(self, num_items: int) -> None:
        self._is_closing = True
        await self.close()
        self._is_closing = False
        await self._clock.sleep_until(self._clock.now_s() + ITEM_S * num_items)

    def _report_current(self, sequence: int) -> None:
        items = self._stored()
        total = len(items) - (0 if self._swaps_whole_lists else 1)
        name = mission_id(items) if self._swaps_whole_lists else 0
        self._current = MissionCurrent(self._clock.now_s(), sequence, total, name, MissionState.ACTIVE)
