"""The times at which a member of a team sends: often until all agree, seldom otherwise, within a budget."""

from __future__ import annotations

import math
from collections.abc import Iterable

from companion.mission.team.team_settings import TeamSettings
from companion.token_bucket import TokenBucket

RETURN_S = 20.0  # Time between two sendings of the altitude of a return to launch.
BURST_S = 10.0  # A member may save up its share of this time, and send it at once.


class Pacing:
    """The times at which one member sends reports and plans.

    The share of a member is the channel's bytes a second divided by the number of members. What exceeds the
    share for longer than ten seconds waits.

    Parameters
    ----------
    settings : TeamSettings
        Times and bytes.
    num_members : int
        Number of members of the team.
    """

    def __init__(self, settings: TeamSettings, num_members: int) -> None:
        self._settings = settings
        rate = min(settings.member_bytes_s, settings.channel_bytes_s / num_members)
        self._bucket = TokenBucket(rate, rate * BURST_S)
        self._reported_s = self._planned_s = self._repeated_s = -math.inf
        self._has_news = self._is_wanted = False
        self._bid_s = self._return_s = -math.inf

    def note_proposal(self, now_s: float) -> None:
        """Send the new proposal at once, and ask who has not answered a while later."""
        self._planned_s, self._reported_s = -math.inf, now_s

    def note_news(self) -> None:
        """Report soon: the member's own numbers have changed."""
        self._has_news = True

    def note_wanted(self) -> None:
        """Repeat the committed plan: somebody does not have it."""
        self._is_wanted = True

    def takes_report(self, now_s: float, *, has_answers: bool, waits: bool) -> bool:
        """Return whether a report is sent now.

        Parameters
        ----------
        now_s : float
            UTC time [s].
        has_answers : bool
            True if others wait for answers.
        waits : bool
            True if this member waits for others.
        """
        each_s = self._settings.quiet_s
        if has_answers or self._has_news:
            each_s = self._settings.reply_s
        elif waits:
            each_s = self._settings.repeat_s
        if now_s - self._reported_s < each_s or not self._bucket.has_any(now_s):
            return False
        self._reported_s, self._has_news = now_s, False
        return True

    def takes_plan(self, now_s: float) -> bool:
        """Return whether the proposal is sent now."""
        if now_s - self._planned_s < self._settings.repeat_s or not self._bucket.has_any(now_s):
            return False
        self._planned_s = now_s
        return True

    def takes_repetition(self, now_s: float) -> bool:
        """Return whether the committed plan is repeated now."""
        is_late = now_s - self._repeated_s >= self._settings.repeat_s
        if not self._is_wanted or not is_late or not self._bucket.has_any(now_s):
            return False
        self._repeated_s, self._is_wanted = now_s, False
        return True

    def takes_bid(self, now_s: float, *, is_new: bool, is_recent: bool) -> bool:
        """Return whether what is said of shared goals is sent now.

        Parameters
        ----------
        now_s : float
            UTC time [s].
        is_new, is_recent : bool
            True if it was not sent before, or only a few times.
        """
        settings = self._settings
        each_s = settings.reply_s if is_new else settings.repeat_s if is_recent else settings.quiet_s
        if now_s - self._bid_s < each_s or not self._bucket.has_any(now_s):
            return False
        self._bid_s = now_s
        return True

    def takes_return(self, now_s: float) -> bool:
        """Return whether the altitude of a return to launch is sent now."""
        if now_s - self._return_s < RETURN_S or not self._bucket.has_any(now_s):
            return False
        self._return_s = now_s
        return True

    def spend(self, payloads: Iterable[bytes]) -> None:
        """Count the bytes of payloads that are sent, their frames included."""
        self._bucket.owe(sum(len(payload) + self._settings.frame_bytes for payload in payloads))
