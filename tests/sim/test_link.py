"""The simulator on real sockets, with MAVSDK as its client."""

from __future__ import annotations

import asyncio
import math
import socket

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import LinkError
from sim.link import address_of, serve
from sim.simulator import Simulator
from tests.sim.client import plain_mission


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
