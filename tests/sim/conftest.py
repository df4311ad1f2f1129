"""A client of the simulated autopilot that the test module is about."""

import pytest

from tests.sim.client import Client


@pytest.fixture
def client(request):
    """Connected; a module about PX4 names its kind of client as ``CLIENT``."""
    client = getattr(request.module, "CLIENT", Client)()
    client.step(0.1)
    return client


@pytest.fixture
def flying(client):
    """In AUTO, or AUTO.MISSION, on the way to item 1 of a mission of its own, 600 m ahead."""
    client.depart()
    return client
