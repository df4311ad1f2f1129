"""The settings that all members of a team must share before they fly."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TeamSettings:
    """Distances, times and bytes of a team; all members have the same.

    Parameters
    ----------
    apart_m : float
        Horizontal distance between two members, in addition to their tolerances [m].
    apart_up_m : float
        Vertical distance that suffices where the horizontal one is not kept [m].
    lost_after_s : float
        A member of which nothing is received for this time counts as lost [s].
    deviating_after_s : float
        A member that is off its plan for this time counts as deviating [s].
    reply_s : float
        Least time between two reports that answer others [s].
    repeat_s : float
        Time between two sendings of a proposal that some member has not answered [s].
    quiet_s : float
        Time between two reports while nothing is to be agreed [s].
    channel_bytes_s : float
        Bytes a second that the whole team may send on average; each member may send its share [B/s].
    member_bytes_s : float
        Bytes a second that one member may send at most on average, however small the team is [B/s].
    simplify_m : float
        Rows are left out of an announced plan where that moves it by less [m]; its tolerance grows by that.
    frame_bytes : int
        Bytes around each payload: 12 of a MAVLink 2 frame and 5 of TUNNEL; 13 more if it is signed.
    """

    apart_m: float
    apart_up_m: float
    lost_after_s: float = 120.0
    deviating_after_s: float = 5.0
    reply_s: float = 1.0
    repeat_s: float = 3.0
    quiet_s: float = 8.0
    channel_bytes_s: float = 12_800.0
    member_bytes_s: float = 400.0
    simplify_m: float = 2.0
    frame_bytes: int = 17
