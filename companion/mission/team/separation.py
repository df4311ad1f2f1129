"""The separation of two plans of a team."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from companion.kernels.geometry.plan_separation import first_conflict, least_margin
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.team_settings import TeamSettings

Margin = Callable[[SharedPlan, SharedPlan, float], float]
WORSE_M = 15.0  # The announced path is rounded, and its tolerances differ, by no more than this.


def margin_between(one: SharedPlan, other: SharedPlan, settings: TeamSettings, since_s: float) -> float:
    """Return the least margin of two plans from an instant on [m]; negative if they conflict.

    Both tolerances are added to the distances that are to be kept. It suffices to keep the horizontal
    distance or the vertical one. Of the two margins the larger counts, the vertical one in proportion to the
    distances: a half of the vertical distance is as good as a half of the horizontal one.

    Parameters
    ----------
    one, other : SharedPlan
        The plans.
    settings : TeamSettings
        Distances to be kept.
    since_s : float
        UTC time from which on the plans are compared [s].
    """
    apart_m = settings.apart_m + one.tolerance_m + other.tolerance_m
    apart_up_m = settings.apart_up_m + one.tolerance_up_m + other.tolerance_up_m
    scales = np.array([1.0, 1.0, 1.0, apart_m / apart_up_m])
    return least_margin(
        one.rows * scales, one.discs_m, other.rows * scales, other.discs_m, since_s, apart_m, apart_m
    )


def margin_of(settings: TeamSettings) -> Margin:
    """Return :func:`margin_between` with the distances of settings; infinity for plans that are never near.

    Parameters
    ----------
    settings : TeamSettings
        Distances to be kept.
    """

    def margin(one: SharedPlan, other: SharedPlan, since_s: float) -> float:
        is_far = are_far_apart(one, other, settings)
        return math.inf if is_far else margin_between(one, other, settings, since_s)

    return margin


def is_too_near(
    margin: Margin, plan: SharedPlan, replaced: SharedPlan | None, other: SharedPlan, since_s: float
) -> bool:
    """Return whether a plan conflicts with another one, and nearer than what it replaces.

    Two members that are too near to each other can part only so: all their plans conflict from now on.

    Parameters
    ----------
    margin : callable
        Least margin of two plans from an instant on, negative if they conflict [m].
    plan : SharedPlan
        The plan.
    replaced : SharedPlan or None
        What its member is committed to now.
    other : SharedPlan
        The plan of another member.
    since_s : float
        UTC time from which on the plans are compared [s].
    """
    margin_m = margin(plan, other, since_s)
    if margin_m >= 0.0 or replaced is None:
        return margin_m < 0.0
    before_m = margin(replaced, other, since_s)
    return before_m >= 0.0 or margin_m < before_m - WORSE_M


def are_far_apart(one: SharedPlan, other: SharedPlan, settings: TeamSettings) -> bool:
    """Return whether the boxes about two plans alone show that the plans never conflict.

    Parameters
    ----------
    one, other : SharedPlan
        The plans.
    settings : TeamSettings
        Distances to be kept.
    """
    apart_m = settings.apart_m + one.tolerance_m + other.tolerance_m
    apart_up_m = settings.apart_up_m + one.tolerance_up_m + other.tolerance_up_m
    east, north, up, east_end, north_end, up_end = one.box_m
    other_east, other_north, other_up, other_east_end, other_north_end, other_up_end = other.box_m
    return (
        max(other_east - east_end, east - other_east_end) > apart_m
        or max(other_north - north_end, north - other_north_end) > apart_m
        or max(other_up - up_end, up - other_up_end) > apart_up_m
    )


class PackedPlans:
    """Many plans laid out for a kernel, for one who compares many candidates with all of them.

    Parameters
    ----------
    plans : sequence of SharedPlan
        The plans.
    settings : TeamSettings
        Distances to be kept.
    """

    def __init__(self, plans: Sequence[SharedPlan], settings: TeamSettings) -> None:
        self._plans, self._settings = plans, settings
        self._rows = np.concatenate([plan.rows for plan in plans]) if plans else np.empty((0, 4))
        self._offsets = np.cumsum([0, *(len(plan.rows) for plan in plans)], dtype=np.int64)
        sizes = [(*plan.discs_m, plan.tolerance_m, plan.tolerance_up_m) for plan in plans]
        self._limits = np.array(sizes, dtype=np.float64).reshape(-1, 4)

    def first_conflict(self, plan: SharedPlan, since_s: float) -> SharedPlan | None:
        """Return the first plan with which another one conflicts from an instant on [s]."""
        apart_m = self._settings.apart_m + plan.tolerance_m
        limits = self._limits + np.array([0.0, 0.0, apart_m, self._settings.apart_up_m + plan.tolerance_up_m])
        found = first_conflict(plan.rows, plan.discs_m, self._rows, self._offsets, limits, since_s)
        return None if found < 0 else self._plans[found]
