"""Flights by the planner of docs/example-planner, which flies at the goal through whatever is in the way."""

import pytest

from tests.flights.flown import fly, mission_named, reaches, stays_inside, touches_anything, true_places


def flight_by_beeline(packages, name):
    packages.install_example()
    mission = mission_named(name)
    planning = mission.planning.model_copy(update={"method": "beeline"})
    return fly(mission.model_copy(update={"planning": planning}), 1)


@pytest.mark.thorough
def test_a_path_through_walls_reaches_no_autopilot_and_safe_rrt_flies_instead(packages):
    flight = flight_by_beeline(packages, "paper-2d")
    kinds = [entry.kind for entry in flight.recorder.decisions]
    refused = [entry.text for entry in flight.recorder.decisions if entry.kind == "rejected"]
    assert any("(clearance)" in text for text in refused)
    assert kinds.index("rejected") < kinds.index("swap")
    places = true_places(flight)
    assert reaches(flight.mission, places)
    assert stays_inside(flight.mission, places)
    assert not touches_anything(flight.mission, places)


def test_a_path_that_the_check_passes_is_flown(packages):
    flight = flight_by_beeline(packages, "hills")
    decisions = [(entry.kind, entry.text) for entry in flight.recorder.decisions]
    assert next(text for kind, text in decisions if kind == "swap").startswith("first plan")
    assert "rejected" not in dict(decisions)
    assert reaches(flight.mission, true_places(flight))


@pytest.mark.parametrize("body", ["    raise ValueError('no idea')\n", "    return problem.goals\n"])
def test_a_planner_that_fails_in_flight_is_answered_by_safe_rrt(packages, body):
    text = "def find(problem, should_stop):\n" + body
    packages.install("failing-one", {"failing": "failing_one:find"}, {"failing_one": text})
    mission = mission_named("first-flight")
    planning = mission.planning.model_copy(update={"method": "failing"})
    flight = fly(mission.model_copy(update={"planning": planning}), 1)
    told = [entry.text for entry in flight.recorder.decisions if "failing-one 1.0" in entry.text]
    assert told
    places = true_places(flight)
    assert reaches(flight.mission, places)
    assert not touches_anything(flight.mission, places)
