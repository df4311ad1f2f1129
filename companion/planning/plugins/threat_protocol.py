"""The contract of a model of static threats of another package."""

from __future__ import annotations

from typing import Protocol

from companion.frames import FloatArray
from companion.types.threat import Radar, SightFloor


class ThreatModel(Protocol):
    """A model of a radar's sight: a class, or a function that returns what its objects are.

    An entry point of the group ``safe_rrt_companion.threats`` gives it the name that a radar's ``model`` has
    in the mission file. It is called once for each such radar.
    """

    def __call__(self, radar: Radar, /, *values: float) -> SightFloor:
        """Return the sight of one radar.

        Parameters
        ----------
        radar : Radar
            The radar: its place, east, north and up [m], its range [m] and its boundary coefficient.
        *values : float
            The radar's ``model_values`` in the mission file, in their order.

        Returns
        -------
        SightFloor
            What can be called with places and returns from which height on the radar sees there.
        """
        ...


class Sight(Protocol):
    """The sight of one radar."""

    def __call__(self, places_enu_m: FloatArray, /) -> FloatArray:
        """Return from which height on the radar sees the aircraft over each place.

        Equal places must give equal heights. The program asks once for the planner's field, and again
        whenever a path is checked or a flight is judged. Obstacles, ground, range and boundary hide the
        aircraft besides.

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2)
            East and north [m].

        Returns
        -------
        ndarray, shape (N,)
            Up coordinates [m]: minus infinity where nothing is hidden, plus infinity where everything is.
        """
        ...
