"""Models of static threats that other packages install: where their radars see.

A model that fails in flight is replaced by the built-in one, whose radar sees all around: no path is taken
for safer because a package has a fault.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from companion.errors import ThreatModelError
from companion.frames import FloatArray
from companion.planning.plugins.foreign_code import blamed, named, origin_of, the_entry
from companion.planning.plugins.threat_protocol import Sight, ThreatModel
from companion.types.threat import Radar

GROUP = "safe_rrt_companion.threats"

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class InstalledSight:
    """The sight of a radar by another package's model.

    Parameters
    ----------
    sight : Sight
        What the model made of the radar.
    origin : str
        The distribution, its version and the entry point, for errors and for the rows of campaigns.
    """

    sight: Sight
    origin: str

    def __call__(self, places_enu_m: FloatArray) -> FloatArray:
        """Return the heights of :meth:`lowest_seen_m`; minus infinity, and an error in the log, if it fails.

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2)
            East and north [m].
        """
        try:
            return self.lowest_seen_m(places_enu_m)
        except ThreatModelError as error:
            _log_once(f"{error}; this radar now counts as one that sees all around")
            return np.full(len(places_enu_m), -np.inf)

    def lowest_seen_m(self, places_enu_m: FloatArray) -> FloatArray:
        """Return from which height on the radar sees the aircraft over each place.

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2)
            East and north [m].

        Returns
        -------
        ndarray, shape (N,)
            Up coordinates [m]; infinite where all or nothing is seen.

        Raises
        ------
        ThreatModelError
            If the model fails or returns something else.
        """
        expected = f"{len(places_enu_m)} heights"
        with blamed(self.origin, expected, ThreatModelError):
            found = np.array(self.sight(places_enu_m.copy()), dtype=np.float64)
        if found.shape != (len(places_enu_m),):
            raise ThreatModelError(self.origin, f"an array of shape {found.shape}", expected)
        if np.isnan(found).any():
            raise ThreatModelError(self.origin, "heights that are not numbers", expected)
        return found


def with_sight(radar: Radar, model: str, values: Sequence[float]) -> Radar:
    """Return a radar that sees as a model of another package says.

    Parameters
    ----------
    radar : Radar
        The radar.
    model : str
        Name of the model; with '' the radar sees all around.
    values : sequence of float
        What the model needs to know of the radar.

    Raises
    ------
    ThreatModelError
        If there is no such model, or it cannot be loaded or takes other values.
    """
    if not model:
        return radar
    entry = the_entry(GROUP, model, ThreatModelError)
    origin = origin_of(entry)
    with blamed(origin, f"a model of a radar that takes {len(values)} values", ThreatModelError):
        sight = cast("ThreatModel", entry.load())(radar, *values)
    if not callable(sight):
        raise ThreatModelError(origin, type(sight).__name__, "what can be called with places")
    return replace(radar, lowest_seen_m=InstalledSight(sight, origin))


def sight_origin(model: str) -> str:
    """Return the package of a model, its version and its entry point; '' if there is none."""
    return "; ".join(map(origin_of, named(GROUP, model)))


@functools.cache
def _log_once(text: str) -> None:
    _log.error("%s", text)
