"""A small world, a plan and a flight in it, made up without planning anything."""

from __future__ import annotations

import numpy as np

from companion.assurance.encounters import Masks, ThreatHistory, encounter_with, radar_threats
from companion.config.models import MissionConfig
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace
from companion.types.record import Decision, FlightRecord, UploadedMission
from companion.types.threat import TrackState
from companion.world.snapshot import first_snapshot

BOUNDS = (0.0, 2000.0, 0.0, 1500.0, 50.0, 350.0)


def mission(dimension=3, *, radars=True, num_goals=1, dynamic_threats=True):
    wall = {
        "name": "wall",
        "polygon_enu_m": ((900.0, 600.0), (1000.0, 600.0), (1000.0, 900.0), (900.0, 900.0)),
        "base_m": 0.0,
        "top_m": 300.0,
    }
    hut = wall | {
        "name": "hut",
        "polygon_enu_m": ((300.0, 300.0), (500.0, 300.0), (400.0, 500.0)),
        "top_m": 60.0,
    }
    radar = {"name": "radar_1", "east_m": 1400.0, "north_m": 750.0, "max_threat_radius_m": 800.0}
    vehicle = {
        "name": "vehicle",
        "east_m": 1700.0,
        "north_m": 200.0,
        "speed_m_s": 20.0,
        "max_threat_radius_m": 250.0,
    }
    return MissionConfig.model_validate(
        {
            "name": "made-up",
            "description": "A <wall> & a radar",
            "dimension": dimension,
            "unit_m": 25.0,
            "origin": {"latitude_deg": -35.0, "longitude_deg": 149.0, "altitude_amsl_m": 584.0},
            "bounds": {"east_m": (0.0, 2000.0), "north_m": (0.0, 1500.0), "up_m": (50.0, 350.0)},
            "start": {"east_m": 100.0, "north_m": 750.0, "up_m": 120.0, "course_deg": 90.0},
            "goals": tuple(
                {"east_m": 1900.0, "north_m": 750.0 + 300.0 * index, "up_m": 120.0}
                for index in range(num_goals)
            ),
            "vehicle": {
                "airspeed_min_m_s": 12.5,
                "airspeed_max_m_s": 37.5,
                "airspeed_cruise_m_s": 25.0,
                "acceleration_max_m_s2": 0.5,
                "turn_radius_min_m": 125.0,
                "straight_length_min_m": 125.0,
                "penetration_speed_m_s": 25.0,
            },
            "planning": {"sensing_horizon_m": 600.0, "time_horizon_s": 15.0, "total_planning_time_s": 80.0},
            "radars": (radar,) if radars else (),
            "dynamic_threats": (vehicle,) if dynamic_threats else (),
            "obstacles": (wall, hut),
        }
    )


def snapshot_of(config):
    world = first_snapshot(
        dimension=config.dimension,
        unit_m=float(config.unit_m),
        bounds=BOUNDS,
        obstacles=config.obstacle_list,
        radars=config.radar_list,
    )
    tracks = [
        TrackState(
            0.0,
            threat.name,
            threat.position_enu_m,
            (0.0, 0.0, 0.0),
            np.eye(4),
            threat.speed_m_s,
            threat.max_threat_radius_m,
            threat.turn_radius_m,
            False,
            0.0,
        )
        for threat in config.dynamic_threat_list
    ]
    return world.with_tracks(0.0, tracks)


def path():
    times = np.linspace(0.0, 72.0, 37)
    east = 100.0 + 25.0 * times
    north = 750.0 - 250.0 * np.sin(np.pi * times / 72.0)
    ones = np.ones_like(times)
    return Path(
        times_s=times,
        positions_enu_m=np.column_stack([east, north, 120.0 + 30.0 * np.sin(times / 20.0)]),
        courses_rad=0.5 * np.pi * ones,
        climb_angles_rad=0.0 * ones,
        speeds_m_s=25.0 * ones,
        position_covariances_m2=np.tile(np.eye(3), (len(times), 1, 1)),
        collision_free=ones,
        threat_levels=0.3 * ones,
    )


def plan(*, found=True):
    line = path()
    num = len(line)
    trace = SearchTrace(
        tree_enu_m=line.positions_enu_m,
        tree_parents=np.arange(-1, num - 1),
        threat_tree_enu_m=np.array([[1700.0, 200.0], [1600.0, 250.0], [1500.0, 300.0]]),
        threat_tree_parents=np.array([-1, 0, 1]),
        reach_circles_enu_m=np.column_stack([line.positions_enu_m[20:, :2], np.full(num - 20, 250.0)]),
        sub_goals_enu_m=line.positions_enu_m[[12, 24]],
        horizon_centres_enu_m=line.positions_enu_m[[0, 12]],
    )
    status = PlanStatus.EXACT if found else PlanStatus.INVALID_START
    return Plan(
        status, line if found else None, Measures(), 3, "safe-rrt", 1, trace if found else SearchTrace()
    )


def record(start_s=1000.0):
    line = path()
    flown = np.column_stack(
        [
            line.times_s + start_s,
            line.positions_enu_m,
            line.courses_rad,
            line.climb_angles_rad,
            line.speeds_m_s,
        ]
    )
    vehicle = np.column_stack([flown[:, 0], 1700.0 - 8.0 * line.times_s, 200.0 + 4.0 * line.times_s])
    threats = [
        ThreatHistory("vehicle", 250.0, np.column_stack([vehicle, np.zeros(len(vehicle))])),
        *radar_threats(mission().radar_list, flown),
    ]
    masks = Masks(mission().obstacle_list)
    return FlightRecord(
        flown=flown,
        dt_paths=(vehicle,),
        dt_tracks=(vehicle[::4] + np.array([0.0, 5.0, -5.0]),),
        missions=tuple(
            UploadedMission(start_s + stamp, line.positions_enu_m[stamp // 2 :: 3], "better")
            for stamp in (0, 20, 40)
        ),
        decisions=(
            Decision(start_s - 5.0, "link", "heard <script>alert('x')</script> & more"),
            Decision(start_s + 125.0, "swap", "plan 2 is better", 210.4, 903.0),
        ),
        threat=np.column_stack([flown[:, 0], line.threat_levels]),
        plan_ms=(200.0, 220.0, 500.0),
        summary={
            "reached_goal": True,
            "closest_m": 123.456,
            "seed": 1,
            "autopilot": "<b>",
            "gap_s": float("nan"),
        },
        encounters=tuple(encounter_with(threat, flown, masks) for threat in threats),
    )


def empty_record():
    return FlightRecord(np.empty((0, 7)), (), (), (), (), np.empty((0, 2)), (), {})
