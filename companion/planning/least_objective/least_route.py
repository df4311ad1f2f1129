"""The search for the path with the least objective J."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from companion.kernels.objective.cost_to_go import CostField
from companion.kernels.objective.row_costs import Objective
from companion.planning.comparators import Optimiser
from companion.planning.explore import Exploration
from companion.planning.least_objective.cost_field import (
    MOST_DANGER,
    cost_to_go_of,
    field_before_pursuers,
    is_near_ground,
    least_s,
)
from companion.planning.least_objective.prices import objective_between, objective_of
from companion.planning.least_objective.short_cuts import loses_well_clear, shortened_route
from companion.planning.least_objective.tree_growth import GrowthRules, ObjectiveTree
from companion.planning.route import Route, finished_route, route_from_tree
from companion.types.plan import SearchTrace

# A higher airspeed is tried if other aircraft make the path at cruise cost this many times as much. At a
# lower factor, airspeeds would change because of turns that the other aircraft often does not continue.
FASTER_FROM = 2.0
# If V led into a gap that cannot be flown, a second V closes gaps that exceed the margin by less than this.
GAP_M = 25.0
NEXT_TO_NOTHING = 1.005  # If others raise a path's cost by less than this factor, one search is enough.
FINISHING_S = 5.0  # A path to the goal's centre may cost this much more than straight flight to there.


class Patience(NamedTuple):
    """The growth of one tree.

    ``weight`` multiplies V. At most ``most`` nodes are extended for each goal. If ``avoids_gaps``, V leads
    through no gap that is nearly too narrow. ``stride`` is the number of steps of a motion, and of a cell
    that needs only one node.
    """

    weight: float
    most: int
    avoids_gaps: bool = False
    stride: int = 1


class Effort(NamedTuple):
    """The trees that one search grows.

    Those of ``finding`` are grown in turn until one comes to the goal. Then ``improving``, if there is one,
    is to find a cheaper path.
    """

    finding: tuple[Patience, ...]
    improving: Patience | None

    @property
    def at_first(self) -> Effort:
        """The least that may find a path, for a search that is followed by another one."""
        return Effort(self.finding[:1], self.improving and PURSUED.improving)


FINDING = (Patience(1.15, 2_000), Patience(2.0, 8_000), Patience(4.0, 10_000))
# Before pursuers, a longer improvement gains nothing measurable; two of 50 flights under faults then flew out
# of the bounds.
PURSUED = Effort(FINDING, Patience(1.02, 2_000))
# Where nothing pursues, gaps are avoided before the last tree. Else another airspeed is tried.
ALONE = Effort((*FINDING[:2], Patience(1.15, 8_000, True), FINDING[2]), Patience(1.02, 8_000))
# Over ground, where the aircraft climbs and sinks all the time, short motions make a tree far too large. Its
# motions are about as long as the cells of V. Short ones that follow V closely find the way through the rest.
# Improving costs more time there than it gains.
NEAR_GROUND = Effort(
    (Patience(1.2, 3_000, stride=3), Patience(2.0, 10_000, stride=4), Patience(3.0, 40_000)), None
)


@dataclass(frozen=True, slots=True)
class Searched:
    """The result of a search.

    Parameters
    ----------
    route : Route
        A path to the last goal, or the branch that came nearest to it.
    cost_s : float
        J of the path; infinite where it does not lead to the last goal.
    objective : Objective
        J, with the limits of the airspeed at which it is flown.
    trace : SearchTrace
        The tree that it comes from.
    num_nodes : int
        Nodes of all trees at this airspeed, of the search that found the path.
    notes : tuple of str
        What had to be given up, and how often the path was shortened.
    """

    route: Route
    cost_s: float
    objective: Objective
    trace: SearchTrace
    num_nodes: int
    notes: tuple[str, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the route leads to the last goal."""
        return math.isfinite(self.cost_s)


@dataclass(frozen=True, slots=True)
class _AtAirspeed:
    """The objective and the lower bound at one airspeed, known before any search.

    Parameters
    ----------
    airspeed_m_s : float
        The airspeed, constant over the flight [m/s].
    objective : Objective
        J with the limits of motion at this airspeed.
    bound_s : float
        V at the start without pursuers, minus the error of V [s].
    """

    airspeed_m_s: float
    objective: Objective
    bound_s: float


class LeastRouteSearch:
    """One plan's search.

    Parameters
    ----------
    exploration : Exploration
        The start, and the counters of work. At the end it has the airspeed of the path.
    should_stop : callable
        Asked between bursts of extensions whether the time is over.
    timer : callable
        Returns seconds, for measures only.

    Attributes
    ----------
    bound_s : float
        Lower bound of J: V at the start without pursuers, minus the error of V [s].
    shortening_s : float
        Time spent on shortening paths, which does not count as search [s].
    """

    def __init__(
        self, exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float]
    ) -> None:
        self._exploration, self._should_stop, self._timer = exploration, should_stop, timer
        self._place = exploration.problem.start.position_enu_m
        tried = exploration.airspeeds_m_s if exploration.is_pursued else exploration.airspeeds_m_s[:1]
        self._airspeeds = [self._at(airspeed) for airspeed in tried]
        self.bound_s = min(each.bound_s for each in self._airspeeds)
        self.shortening_s = 0.0

    def run(self) -> Searched:
        """Return the path of least J that is found, or the branch that comes nearest to the last goal.

        With pursuers, each airspeed has its own V and its own trees. A path that pursuers cannot bar is
        preferred to one that they can bar, whatever it costs.
        """
        if math.isinf(self.bound_s):
            return self._to_goals_before()
        if not self._exploration.is_pursued:
            return self._past_others()
        found = self._at_best_airspeed(self._airspeeds, self._exploration.danger_max)
        if found is None or not found.reached:
            found = self._at_best_airspeed(self._airspeeds, MOST_DANGER)
            assert found is not None  # Nothing is barred, so that the airspeed tried first has a result.
        self._exploration.start_afresh(found.objective.limits.v_cruise)
        return found

    def _past_others(self) -> Searched:
        """Return the cheapest path past aircraft that fly on, at cruise or faster.

        V includes their predicted positions only if they add to the cost of a path that is first sought
        without them. A higher airspeed is tried, too, if they make the flight at cruise much more expensive.
        """
        cruise, alone = self._airspeeds[0], self._field_alone()
        if not len(self._exploration.game.vehicles):
            return self._search(cruise, alone, MOST_DANGER)
        best = self._search(cruise, alone, MOST_DANGER, self._effort.at_first)
        if self._is_hardly_affected(best):
            return best
        problem, enough_s, untried = self._exploration.problem, FASTER_FROM * cruise.bound_s, [cruise]
        field = field_before_pursuers(problem, cruise.objective, MOST_DANGER, best.cost_s)
        if least_s(field, self._place) < enough_s:
            best, untried = _least_cost(best, self._search(cruise, field, MOST_DANGER)), []
        if best.cost_s >= enough_s and not self._should_stop():
            untried += [self._at(airspeed) for airspeed in self._exploration.airspeeds_m_s[1:]]
            self.bound_s = min([self.bound_s, *(each.bound_s for each in untried)])
            best = self._at_best_airspeed(untried, MOST_DANGER, best) or best
        self._exploration.start_afresh(best.objective.limits.v_cruise)
        return best

    def _is_hardly_affected(self, found: Searched) -> bool:
        """Return whether a path reaches the goal and other aircraft hardly add to its cost."""
        if not found.reached or loses_well_clear(found.objective, found.route):
            return False
        without = found.objective._replace(prices=found.objective.prices._replace(pursued=0.0))
        return found.cost_s <= NEXT_TO_NOTHING * objective_between(without, found.route)

    def _to_goals_before(self) -> Searched:
        """Return a path to as many goals, in their order, as can be reached: the last one cannot be."""
        exploration, whole = self._exploration, self._exploration.problem
        searched = Searched(
            route_from_tree(exploration, 0), math.inf, self._airspeeds[0].objective, SearchTrace(), 1
        )
        for num in range(len(whole.goals) - 1, 0, -1):
            exploration.problem = replace(whole, goals=whole.goals[:num])
            if math.isfinite(least_s(self._field_alone(), self._place)):
                found = self._search(self._airspeeds[0], self._field_alone(), MOST_DANGER)
                searched = replace(found, cost_s=math.inf)
                break
        exploration.problem = whole
        return searched

    def _field_alone(self) -> CostField:
        """Return V at cruise without pursuers."""
        return cost_to_go_of(self._exploration.problem, self._airspeeds[0].objective).fine

    def _at(self, airspeed_m_s: float) -> _AtAirspeed:
        """Return the objective and the lower bound at an airspeed."""
        self._exploration.start_afresh(airspeed_m_s)
        objective = objective_of(self._exploration)
        known = cost_to_go_of(self._exploration.problem, objective)
        return _AtAirspeed(airspeed_m_s, objective, known.bound_s(self._place))

    def _at_best_airspeed(
        self, airspeeds: list[_AtAirspeed], danger_max: float, best: Searched | None = None
    ) -> Searched | None:
        """Return the cheapest path at any of these airspeeds, or ``best``; V at the start gives their order.

        Airspeeds are skipped once V, reduced by what it falls by on the fine field, is no less than the cost
        of a path that was found. The result is None if pursuers bar all paths: at the highest airspeed on the
        fine field, and at the others on coarse ones. A slower aircraft arrives later, apart from its tighter
        first turn.
        """
        share = 0.0
        for coarse_s, known in self._in_order(airspeeds, danger_max):
            likely_s = max(known.bound_s, share * coarse_s if math.isfinite(coarse_s) else 0.0)
            if best is not None and (likely_s >= best.cost_s or self._should_stop()):
                continue
            field = field_before_pursuers(self._exploration.problem, known.objective, danger_max)
            fine_s = least_s(field, self._place)
            if math.isinf(fine_s) and known is airspeeds[-1] and danger_max < MOST_DANGER:
                break
            if 0.0 < coarse_s < math.inf:
                share = max(share, min(1.0, fine_s / coarse_s))
            best = _least_cost(best, self._search(known, field, danger_max))
        return best

    def _in_order(self, airspeeds: list[_AtAirspeed], danger_max: float) -> list[tuple[float, _AtAirspeed]]:
        """Return V at the start on coarse fields and the airspeeds: least V first, then the fastest."""
        problem, known = self._exploration.problem, list[tuple[float, _AtAirspeed]]()
        for each in airspeeds:
            field = field_before_pursuers(problem, each.objective, danger_max, is_coarse=True)
            known.append((least_s(field, self._place), each))
        return sorted(known, key=lambda entry: (entry[0], -entry[1].airspeed_m_s))

    def _search(
        self, known: _AtAirspeed, field: CostField, danger_max: float, effort: Effort | None = None
    ) -> Searched:
        """Grow trees at one airspeed; return the cheapest path, shortened, or the nearest branch."""
        exploration, objective = self._exploration, known.objective
        exploration.start_afresh(known.airspeed_m_s)
        if math.isinf(least_s(field, self._place)):
            return Searched(route_from_tree(exploration, 0), math.inf, objective, SearchTrace(), 1)
        grown = self._grown(objective, field, danger_max, effort or self._effort)
        best, num_nodes = min(grown, key=lambda tree: tree.cost_s), sum(tree.num_nodes for tree in grown)
        route = best.route()
        if best.end < 0:
            return Searched(route, math.inf, objective, best.trace(), num_nodes)
        route, num_cuts = self._shortened(objective, route)
        cost_s = objective_between(objective, route)
        notes = (*self._notes_about(known, danger_max), f"{num_cuts} short cuts")
        return Searched(route, cost_s, objective, best.trace(), num_nodes, notes)

    @property
    def _effort(self) -> Effort:
        """The trees that a search grows in this world."""
        if is_near_ground(self._exploration.problem):
            return NEAR_GROUND
        return PURSUED if self._exploration.is_pursued else ALONE

    def _grown(
        self, objective: Objective, field: CostField, danger_max: float, effort: Effort
    ) -> list[ObjectiveTree]:
        """Grow trees, each greedier, until one reaches the goal, and then one more for a cheaper path."""
        grown, finding = list[ObjectiveTree](), effort.finding
        if self._should_stop():
            finding = finding[:: max(1, len(finding) - 1)]  # The first and the last.
        for asked in finding:
            along = self._field_without_gaps(objective) if asked.avoids_gaps else field
            grown.append(self._tree(objective, along, danger_max, asked, math.inf))
            if math.isfinite(found_s := grown[-1].cost_s):
                break
        if math.isfinite(found_s) and effort.improving is not None and not self._should_stop():
            grown.append(self._tree(objective, along, danger_max, effort.improving, found_s))
        return grown

    def _tree(
        self, objective: Objective, field: CostField, danger_max: float, asked: Patience, cost_max: float
    ) -> ObjectiveTree:
        """Grow a tree, and return it."""
        rules = GrowthRules(
            weight=asked.weight,
            danger_max=danger_max,
            most=asked.most,
            cost_max=cost_max,
            stride=asked.stride,
        )
        tree = ObjectiveTree(self._exploration, objective, field, rules)
        tree.grow(self._should_stop)
        return tree

    def _field_without_gaps(self, objective: Objective) -> CostField:
        """Return V for an aircraft that keeps a wider margin."""
        limits, problem = objective.limits, self._exploration.problem
        wide = objective._replace(limits=limits._replace(margin=limits.margin + GAP_M))
        return cost_to_go_of(problem, wide).fine

    def _finished(self, objective: Objective, route: Route) -> Route:
        """Lead a path to the goal's centre, unless that costs much more than straight flight on to there."""
        centre = np.array(self._exploration.problem.goals[-1].position_enu_m)
        left_s = float(np.linalg.norm(centre - route.states[-1, :3])) / objective.limits.v_cruise
        enough_s = objective_between(objective, route) + left_s + FINISHING_S
        return finished_route(
            self._exploration, route, centre, lambda found: objective_between(objective, found) <= enough_s
        )

    def _shortened(self, objective: Objective, route: Route) -> tuple[Route, int]:
        """Lead a path to the goal's centre and shorten it; return it with the number of short cuts."""
        exploration, began = self._exploration, self._timer()
        route = self._finished(objective, route)
        num_cuts = 0
        if exploration.problem.settings.strategies.optimiser is Optimiser.RRT_STAR:
            route, num_cuts = shortened_route(exploration, objective, route, self._should_stop)
        self.shortening_s += self._timer() - began
        return route, num_cuts

    def _notes_about(self, known: _AtAirspeed, danger_max: float) -> tuple[str, ...]:
        """Return notes about the airspeed and about paths that pursuers can bar."""
        notes = []
        if known.airspeed_m_s > self._airspeeds[0].airspeed_m_s:
            why = "ahead of pursuers" if self._exploration.is_pursued else "to keep well clear of aircraft"
            notes.append(f"flown at {known.airspeed_m_s:.0f} m/s, {why}")
        if danger_max == MOST_DANGER and self._exploration.is_pursued:
            notes.append("no path that pursuers could not bar was found")
        return tuple(notes)


def _least_cost(*found: Searched | None) -> Searched:
    """Return the cheapest of what was found, the first of several."""
    return min((each for each in found if each is not None), key=lambda each: each.cost_s)
