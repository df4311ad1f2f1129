"""The layout of the kernels' arrays.

Structures of plain arrays and numbers, which kernels are handed by one address. All arrays are C-contiguous
float64, float32 or int64; an annotation says how many axes they have. Lengths are metres, angles radians,
``theta`` counter-clockwise from east.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.kernels.native.kinds import Array
from companion.kernels.native.struct import Struct

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Float1D = Annotated[FloatArray, Array("f", 1)]
Float2D = Annotated[FloatArray, Array("f", 2)]
Single2D = Annotated[NDArray[np.float32], Array("s", 2)]
Float3D = Annotated[FloatArray, Array("f", 3)]
Float4D = Annotated[FloatArray, Array("f", 4)]
Float5D = Annotated[FloatArray, Array("f", 5)]
Int1D = Annotated[IntArray, Array("i", 1)]
Int2D = Annotated[IntArray, Array("i", 2)]


NUM_CELLS = 48  # Cells along each side of the grid that finds near nodes.


class Ground(Struct):
    """The ground in square cells; without any it lies too deep to matter.

    ``high``, ``low`` (GX, GY) the highest and the lowest ground of each cell; ``grid`` (3,) x0 y0 of the
    first cell's corner and the side of a cell. ``least``, ``wanted`` and ``most`` are heights over ground [m]
    that an aircraft keeps: not lower, rather not lower, and not higher. Vehicles drive up to the slope
    ``drivable``, a tangent.
    """

    high: Single2D
    low: Single2D
    grid: Float1D
    least: float
    wanted: float
    most: float
    drivable: float


class FollowedGround(Struct):
    """The ground by which an autopilot flies heights over ground.

    ``up`` (GX, GY) heights at nodes [m], bilinear in between; ``grid`` (3,) x0 y0 of the first node and the
    spacing. The autopilot climbs ahead of ground that rises faster than at ``climb_rate``: it looks every
    ``step`` along its leg, up to ``look_ahead`` [m]. A ``step`` of 0 stands for heights that do not follow
    the ground.
    """

    up: Float2D
    grid: Float1D
    step: float
    look_ahead: float
    climb_rate: float


class Obstacles(Struct):
    """Upright prisms, their edges one after another, and the ground.

    ``edges`` (E, 4) x0 y0 x1 y1; ``offsets`` (O + 1,) first edge of each; ``heights`` (O, 2) base
    and top; ``boxes`` (O, 4) x_min y_min x_max y_max; ``field`` (NX, NY, NZ) distance to the nearest
    prism at the grid's nodes; ``grid`` (6,) x0 y0 z0 and the spacings dx dy dz.
    """

    edges: Float2D
    offsets: Int1D
    heights: Float2D
    boxes: Float2D
    field: Float3D
    grid: Float1D
    ground: Ground


class Threats(Struct):
    """Static threats and the shadows obstacles cast over them.

    ``radars`` (R, 5) x y z r_max k_r; ``known`` (R,) 1 where the planner may use it; ``shadows``
    (R, NX, NY) up coordinate below which an obstacle hides the grid's node from the radar;
    ``grid`` (3,) x0 y0 and the spacing.
    """

    radars: Float2D
    known: Int1D
    shadows: Float3D
    grid: Float1D


class ThreatModel(Struct):
    """Parameters of the A-IFS model (paper 3.1). ``form``: 0 shifted, 1 literal, 2 probabilistic."""

    weight_count: float
    weight_delta: float
    exponent: float
    form: int
    v_min: float
    v_max: float
    v_penetration: float
    unit: float


class Limits(Struct):
    """Constraints of motion (paper 2.2), and the box the aircraft stays in.

    ``bounds`` (6,) x_min x_max y_min y_max z_min z_max [m]. ``wind_x``, ``wind_y``: velocity of the air over
    the ground [m/s]; ``r_min`` at cruise and the climb angles are those over the ground in it.
    ``sideways_max`` is the acceleration in a turn as tight as the bank allows [m/s²].
    """

    v_min: float
    v_max: float
    v_cruise: float
    a_max: float
    r_min: float
    sideways_max: float
    straight_min: float
    climb_max: float
    descent_max: float
    pitch_rate_max: float
    margin: float
    tau: float
    dimension: int
    bounds: Float1D
    wind_x: float
    wind_y: float


class Uncertainty(Struct):
    """LQG-MP: noise and the tabulated controller.

    ``process`` (3,) variances of a, turn rate, climb rate; ``measurement`` (5,) variances of
    x y z theta phi; ``gains`` (NV, NW, NC, 3, 6) the LQR gains at direction 0 over speed, turn rate
    and climb angle; ``axes`` (3, 2) first value and spacing of each; ``normals`` (M, 3) the common
    standard-normal points.
    """

    process: Float1D
    measurement: Float1D
    gains: Float5D
    axes: Float2D
    normals: Float2D


class Tree(Struct):
    """The PathTree. Row i is a node; ``count`` (1,) how many are in use.

    ``state`` (N, 6) x y z theta phi v; ``parent`` (N,); ``time`` (N,) TS; ``turn`` (N,) sign of the
    in-edge's turn; ``straight`` (N,) straight length flown since the last turn; ``rate`` (N, 2) the
    in-edge's turn and climb rate; ``cov_error``, ``cov_estimate`` (N, 6, 6) P and Λ; ``delta`` (N,) δ_q;
    ``clear`` (N,) p_c; ``level`` (N,) TI; ``domain`` (N,) TUDD; ``cost`` (N,) sum of (9) from the
    root; ``active`` (N,) searched at present; ``threat_point`` (N, D, 4) estimated position of each
    DT when the node is reached and 1 where that is known, 2 where it only passes; ``children`` (N,)
    live children; ``blocked`` (N,) 1 after a failed extension; ``to_go`` (N,) distance round obstacles to
    the sub goal [m]; ``threatened`` (N,) 1 where a DT could threaten the node by then.
    """

    state: Float2D
    parent: Int1D
    time: Float1D
    turn: Int1D
    straight: Float1D
    rate: Float2D
    cov_error: Float3D
    cov_estimate: Float3D
    delta: Float1D
    clear: Float1D
    level: Float1D
    domain: Float1D
    cost: Float1D
    active: Int1D
    threat_point: Float3D
    children: Int1D
    blocked: Int1D
    to_go: Float1D
    threatened: Int1D
    count: Int1D


class DistanceField(Struct):
    """The distance field of a point: how far it is from everywhere, round obstacles.

    ``field`` (N, M) the distance [m] from every cell of a grid, infinite where no way leads; ``origin``
    (2,) the first cell's centre [m]; ``cell`` the spacing [m]; ``share`` of the samples that follow it;
    ``ahead`` how far along it they lie at most [m].
    """

    field: Float2D
    origin: Float1D
    cell: float
    share: float
    ahead: float


class Game(Struct):
    """The game in which moving threats know the path (:mod:`companion.kernels.threat.pursuit_game`).

    ``vehicles`` (D, 8): x y z [m] and when it was there [s], speed, RD_max, how much nearer it may be than it
    was seen [m], and its kind: 0 drives, 1 flies, 2 pursues nobody. ``arrival`` (G, NX, NY) earliest arrival
    at a grid's cells [s], ``least`` (G, BX, BY) the earliest in each block of them, for all up to the last
    that drives; ``tops`` (NX, NY) height of the wall there, minus infinity where there is none [m];
    ``lowest`` the least of these heights, infinite without any wall and minus infinity over ground [m];
    ``grid`` (3,) x0 y0 and the spacing [m]; ``is_plane`` 1 where threats are at the aircraft's height;
    ``slack`` by which a place has to be passed before it is under threat [s]; ``ground`` that vehicles drive
    on, and that hides the aircraft from them.
    """

    vehicles: Float2D
    arrival: Float3D
    least: Float3D
    tops: Float2D
    lowest: float
    grid: Float1D
    is_plane: int
    slack: float
    ground: Ground


class Branches(Struct):
    """The links of the PathTree while RRT* rearranges it.

    ``first``, ``following`` (N,) first child and next sibling, -1 where there is none; ``upper`` (N,)
    UB of paper 4.4.3; ``stage`` (N,) goals passed on the way to the node; ``goals`` (G, 4) x y z and
    radius [m] of the goals to be passed in order.
    """

    first: Int1D
    following: Int1D
    upper: Float1D
    stage: Int1D
    goals: Float2D


class GridIndex(NamedTuple):
    """An index of places by square cells (see :mod:`companion.kernels.printed.grid_index`).

    ``cells`` (C·C,) the newest row in each cell, ``chain`` (M,) the next older row in the same cell, -1
    where there is none; ``places`` (M, 2) where each row was when it was taken in [m]; ``extent`` (4,)
    first and last cell in each direction that may hold rows; ``filled`` (1,) how many rows are in.
    """

    cells: Int1D
    chain: Int1D
    places: Float2D
    extent: Int1D
    filled: Int1D


class GridIndices(Struct):
    """A :class:`GridIndex` of each of D trees: its arrays with a leading axis D."""

    cells: Int2D
    chain: Int2D
    places: Float3D
    extent: Int2D
    filled: Int2D


class NearAircraft(Struct):
    """For each square of the world in each bin of time, which aircraft that fly on may endanger it.

    ``west``, ``south`` the corner of the first square [m]; ``width`` of a square [m]; ``first`` the beginning
    of the first bin [s]; ``columns``, ``rows`` of squares; ``bins`` of time. The aircraft of cell ``c`` are
    ``listed`` from ``ends[c]`` to ``ends[c + 1]``, which is (C + 1,).
    """

    west: float
    south: float
    width: float
    first: float
    columns: int
    rows: int
    bins: int
    ends: Int1D
    listed: Int1D


class Pursuers(Struct):
    """The DTs' trees (TTree), one a row of the leading axis.

    ``position`` (D, N, 3) [m]; ``heading`` (D, N) [rad]; ``parent`` (D, N); ``time`` (D, N) TS [s]; ``count``
    (D,) nodes in use; ``model`` (D, 12) speed, RD_max, turn radius, airborne flag, step length, and three
    more of an aircraft that flies on, whose airborne flag is 2: the vertical separation that it must have
    [m], the deviation of its height [m], and 1 if it keeps its route for certain. Its rows say where it is
    now and will be every second. One row more says where it would be in a second if it flew straight. In
    place of its turn radius and step length stand the deviations of its place [m] and of its velocity [m/s].
    Two columns say from when on it circles about its place [s], and with what radius [m]. The last two are
    the east and north of the direction in which its wrong side lies, no longer than 1. ``reach`` (D,) RD_max
    once more, by itself [m]; ``bounds`` (4,) x_min x_max y_min y_max of where they drive; ``corners`` (D, 2)
    first row and number of the nodes at corners of obstacles
    (:func:`~companion.kernels.printed.threat_tree.add_corners`), and ``by_corner`` (D, C·C) through which of
    them a cell's centre is reached earliest: -1 none, -2 not looked at yet; ``index`` of the TTrees' nodes,
    ``path_index`` of the PathTree's; ``near`` the lists of the aircraft that fly on, by square and time.
    """

    position: Float3D
    heading: Float2D
    parent: Int2D
    time: Float2D
    count: Int1D
    model: Float2D
    reach: Float1D
    bounds: Float1D
    corners: Int2D
    by_corner: Int2D
    index: GridIndices
    path_index: GridIndex
    near: NearAircraft


class Search(Struct):
    """Weights and switches of the local search (paper 4.4) and of the RS estimator (3.2.2).

    ``k_clear``, ``k_threat``, ``domain``: k_c, k_T and DD [m] of (7); ``cost_distance``,
    ``cost_turn``, ``cost_threat``: D_γ of (9); ``unit`` metres in a planning unit; ``zoom``
    probability of GoalZoom; ``use_k_near``, ``use_domain``, ``use_uncertainty``, ``no_fly`` switches
    (1 on); ``secondary`` n_q; ``tolerance`` distance at which a sub goal is reached [m];
    ``certain`` p_c from which a node never blocked has no limit for uncertainty; ``estimator`` of
    RS: 0 ExRRT, 1 RRT-Reach, 2 RRT; ``p_tid`` of Algorithm 1; ``k_pursuer`` of its operators;
    ``level_max`` threat level above which a node is not kept; ``straight_in`` (1 on) connects greedily
    to a sub goal that lies in a new node's domain; ``bars_pursued`` (1 on) grows no node that a DT could
    threaten, but out of a threat entered already. A node costs ``cost_collision`` times -log p_c more.
    """

    k_clear: float
    k_threat: float
    domain: float
    cost_distance: float
    cost_turn: float
    cost_threat: float
    unit: float
    zoom: float
    use_k_near: int
    use_domain: int
    use_uncertainty: int
    no_fly: int
    secondary: int
    tolerance: float
    certain: float
    estimator: int
    p_tid: float
    k_pursuer: int
    level_max: float
    straight_in: int
    bars_pursued: int
    cost_collision: float


class Scene(Struct):
    """All that the search of one sub task reads.

    ``obstacles`` the aircraft keeps clear of; ``walls``, those of them that hide and stop a DT, too.
    """

    pursuers: Pursuers
    obstacles: Obstacles
    walls: Obstacles
    threats: Threats
    model: ThreatModel
    limits: Limits
    tables: Uncertainty
    search: Search
    distances: DistanceField
    game: Game


def empty_tree(capacity: int, num_threats: int) -> Tree:
    """Return a tree with room for ``capacity`` nodes and ``num_threats`` DTs."""
    zeros: Any = np.zeros
    return Tree(
        state=zeros((capacity, 6)),
        parent=np.full(capacity, -1, dtype=np.int64),
        time=zeros(capacity),
        turn=zeros(capacity, dtype=np.int64),
        straight=zeros(capacity),
        rate=zeros((capacity, 2)),
        cov_error=zeros((capacity, 6, 6)),
        cov_estimate=zeros((capacity, 6, 6)),
        delta=zeros(capacity),
        clear=np.ones(capacity),
        level=zeros(capacity),
        domain=np.full(capacity, np.inf),
        cost=zeros(capacity),
        active=zeros(capacity, dtype=np.int64),
        threat_point=zeros((capacity, max(num_threats, 1), 4)),
        children=zeros(capacity, dtype=np.int64),
        blocked=zeros(capacity, dtype=np.int64),
        to_go=np.full(capacity, np.inf),
        threatened=zeros(capacity, dtype=np.int64),
        count=zeros(1, dtype=np.int64),
    )


def empty_index(capacity: int) -> GridIndex:
    """Return an index with room for ``capacity`` rows."""
    return GridIndex(**_index_arrays(capacity, ()))


def empty_indices(capacity: int, trees: int) -> GridIndices:
    """Return an index with room for ``capacity`` rows of each tree."""
    return GridIndices(**_index_arrays(capacity, (trees,)))


def _index_arrays(capacity: int, leading: tuple[int, ...]) -> dict[str, Any]:
    return {
        "cells": np.full((*leading, NUM_CELLS**2), -1, dtype=np.int64),
        "chain": np.full((*leading, capacity), -1, dtype=np.int64),
        "places": np.zeros((*leading, capacity, 2)),
        "extent": np.zeros((*leading, 4), dtype=np.int64),
        "filled": np.zeros((*leading, 1), dtype=np.int64),
    }


def empty_pursuers(capacity: int, models: FloatArray, bounds: FloatArray, path_capacity: int = 0) -> Pursuers:
    """Return trees with room for ``capacity`` nodes, one a row of ``models`` (D, 5 or 10).

    They stay inside ``bounds`` (≥ 4,) [m].

    ``path_capacity`` is that of the PathTree they are to be used with; with a smaller one its nearest
    nodes are found by looking at all.
    """
    num = len(models)
    model = np.zeros((num, 12))
    model[:, 8] = np.inf
    model[:, : np.shape(models)[1]] = models
    return Pursuers(
        position=np.zeros((num, capacity, 3)),
        heading=np.zeros((num, capacity)),
        parent=np.full((num, capacity), -1, dtype=np.int64),
        time=np.zeros((num, capacity)),
        count=np.zeros(num, dtype=np.int64),
        model=model,
        reach=model[:, 1].copy(),
        bounds=np.ascontiguousarray(bounds[:4], dtype=np.float64),
        corners=np.zeros((num, 2), dtype=np.int64),
        by_corner=np.full((num, NUM_CELLS**2), -2, dtype=np.int64),
        index=empty_indices(capacity, num),
        path_index=empty_index(path_capacity),
        near=NearAircraft(0.0, 0.0, 1.0, 0.0, 1, 1, 1, np.zeros(2, np.int64), np.empty(0, np.int64)),
    )


def empty_branches(capacity: int, goals: FloatArray) -> Branches:
    """Lists of children for a tree of ``capacity`` nodes; ``goals`` (G, 4) x y z and radius [m]."""
    return Branches(
        first=np.full(capacity, -1, dtype=np.int64),
        following=np.full(capacity, -1, dtype=np.int64),
        upper=np.full(capacity, np.inf),
        stage=np.zeros(capacity, dtype=np.int64),
        goals=goals,
    )
