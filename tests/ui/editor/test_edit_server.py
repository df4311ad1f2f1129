"""The editor's server under real sockets: who may change a file, wrong requests, plans and flights."""

import contextlib
import http.client
import json
import threading
from pathlib import Path

import pytest

from companion.ui.editor import plan_answers, watched_flight
from companion.ui.editor.edit_server import CONNECTIONS_MAX, EditServer
from companion.ui.editor.edit_session import EditSession
from companion.ui.page.access import Access

TEXT = Path("mission_configs/first-flight.yaml").read_text(encoding="utf-8")
TOKEN, COOKIE = "correct horse", "companion-edit-1"
PATIENCE_S = 60.0
NORTH = {"do": "move", "path": ["start"], "value": [0, 10]}


class Asking:
    """A browser's requests."""

    def __init__(self, server):
        self.host = f"127.0.0.1:{server.port}"
        _, headers, _ = self.ask("GET", "/?token=correct%20horse")
        self.cookie = headers["set-cookie"].partition(";")[0]

    def ask(self, method, path, body=None, **headers):
        line = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        line.request(method, path, body, headers)
        answer = line.getresponse()
        data = answer.read()
        line.close()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, data

    def got(self, path):
        status, _, data = self.ask("GET", path, Cookie=self.cookie)
        assert status == 200, data
        return json.loads(data)

    def posted(self, name, body=None, **headers):
        known = {"Cookie": self.cookie, "Content-Type": "application/json", "Origin": f"http://{self.host}"}
        data = body if isinstance(body, bytes) else json.dumps(body or {}).encode()
        status, _, told = self.ask("POST", f"/edit/{name}", data, **(known | headers))
        return status, json.loads(told)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


@pytest.fixture
def served(file):
    server = EditServer(Access(0, token=TOKEN, cookie=COOKIE), EditSession(file))
    yield server
    server.close()


@pytest.fixture
def asking(served):
    return Asking(served)


def test_a_change_is_checked_undone_redone_and_saved(asking, file):
    assert asking.got("/edit/state")["faults"] == []
    status, state = asking.posted(
        "change", {"changes": [NORTH, {"do": "set", "path": ["start", "up_m"], "value": 500}]}
    )
    assert status == 200
    assert (state["is_changed"], state["can_undo"], state["can_redo"]) == (True, True, False)
    assert [fault["key"] for fault in state["faults"]] == ["start.up_m", "goals.0.up_m"]
    assert asking.posted("undo")[1]["faults"] == []
    assert asking.posted("redo")[1]["sections"]["start"]["up_m"] == 500
    assert file.read_text(encoding="utf-8") == TEXT
    assert asking.posted("save")[1]["is_changed"] is False
    assert "start: {east_m: 150, north_m: 760, up_m: 500, course_deg: 90}" in file.read_text(encoding="utf-8")


def test_a_window_that_has_not_seen_the_last_change_is_refused(asking):
    assert asking.posted("change", {"changes": [NORTH], "number": 0})[1]["number"] == 1
    told = asking.posted("change", {"changes": [NORTH], "number": 0})[1]
    assert told["error"] == "request: number: got 0; expected 1: another window has changed the mission"
    assert asking.got("/edit/state")["number"] == 1


def test_the_page_and_what_it_is_made_of(asking):
    status, headers, data = asking.ask("GET", "/edit/edit.html", Cookie=asking.cookie)
    assert (status, headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert "default-src 'none'" in headers["content-security-policy"]
    assert b"/edit/edit.js" in data
    for name in ("edit/edit.js", "edit/edit.css", "map.js", "kinds.js"):
        assert asking.ask("GET", f"/{name}", Cookie=asking.cookie)[0] == 200, name
    status, headers, _ = asking.ask("GET", "/", Cookie=asking.cookie)
    assert (status, headers["location"]) == (303, "/edit/edit.html")
    tables = asking.got("/edit/tables")
    assert [slider["key"] for slider in tables["sliders"]][:2] == ["price_seen", "price_pursued"]
    radius = next(key for key in tables["keys"]["goals"] if key["key"] == "acceptance_radius_m")
    assert radius == {
        "key": "acceptance_radius_m", "unit": "m", "allowed": "number > 0, ≤ 100000", "default": "`60.0`",
        "meaning": "The goal is reached within this distance.",
    }  # fmt: skip


def test_ground_and_field_are_of_the_mission_as_it_is_now(asking):
    assert asking.got("/edit/ground") == {}
    field = asking.got("/edit/field/100")
    while field.get("is_later"):
        field = asking.got("/edit/field/100")
    assert field["height_m"] == 100.0
    asking.posted("change", {"changes": [{"do": "remove", "path": ["radars", 0]}]})
    assert asking.got("/edit/field/100") == {"is_later": False}


# --- who may


@pytest.mark.parametrize("cookie", [{}, {"Cookie": f"{COOKIE}=wrong"}, {"Cookie": "companion-page=x"}])
def test_without_the_token_nothing_is_told_or_changed(asking, file, cookie):
    for path in ("/", "/edit/state", "/edit/edit.html", "/?token=wrong", "/edit/flight/0"):
        status, _, data = asking.ask("GET", path, **cookie)
        assert status == 401, path
        assert b"first-flight" not in data
    body = json.dumps({"changes": [NORTH]})
    status, _, _ = asking.ask("POST", "/edit/change", body, **{"Content-Type": "application/json"}, **cookie)
    assert status == 401
    assert asking.got("/edit/state")["is_changed"] is False
    assert file.read_text(encoding="utf-8") == TEXT


def test_requests_of_other_pages_are_refused(asking):
    for headers, expected in (
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content-Length": "99999999"}, 413),
    ):
        assert asking.posted("change", {"changes": [NORTH]}, **headers)[0] == expected, headers
    assert asking.got("/edit/state")["is_changed"] is False
    for method in ("PUT", "DELETE", "OPTIONS", "PATCH"):
        assert asking.ask(method, "/edit/state", Cookie=asking.cookie)[0] == 501


def test_one_connection_too_many_is_closed(served):
    lines = []
    for _ in range(CONNECTIONS_MAX):
        line = http.client.HTTPConnection(f"127.0.0.1:{served.port}", timeout=PATIENCE_S)
        line.connect()
        lines.append(line)
    over = http.client.HTTPConnection(f"127.0.0.1:{served.port}", timeout=PATIENCE_S)
    with contextlib.suppress(OSError):  # It may be closed before all is sent.
        over.request("GET", "/")
    with pytest.raises(OSError):  # noqa: PT011 - The system says it in more than one way.
        over.getresponse()
    for line in [*lines, over]:
        line.close()


# --- wrong requests


@pytest.mark.parametrize(
    ("name", "body", "message"),
    [
        ("change", b"{", "request: body: got 1 bytes; expected a mapping in JSON"),
        ("change", b"[1]", "request: body: got 3 bytes; expected a mapping in JSON"),
        ("change", b"[" * 100_000, "request: body: got 100000 bytes"),
        ("change", {}, "request: changes: got None; expected a list of at most"),
        ("change", {"changes": [{"do": "set", "path": ["goals", 9, "up_m"], "value": 1}]}, "goals.9.up_m"),
        ("change", {"changes": [{"do": "set", "path": ["name"], "value": {"a": [{}]}}]}, ""),
        (
            "plan",
            {"settings": {"price": 1}},
            "request: price: got 1; expected one of price_seen, price_pursued",
        ),
        (
            "plan",
            {"settings": {"price_seen": -1}},
            "planning.price_seen: got -1; expected a number of at least 0",
        ),
        ("plan", {"settings": 5}, "request: settings: got 5; expected keys of planning"),
        ("plan", {"side": "left"}, "request: side: got 'left'; expected file or other"),
        ("fly", {"pace": -1}, "request: pace: got -1; expected simulated seconds a second up to 1000"),
        ("fly", {"seed": 1.5}, "request: seed: got 1.5; expected a whole number from 0"),
    ],
)
def test_a_wrong_request_says_key_value_and_what_was_expected(asking, name, body, message):
    status, told = asking.posted(name, body)
    if message:
        assert status == 200
        assert message in told["error"]
    assert asking.got("/edit/state")["number"] in (0, 1)
    assert asking.posted("burn")[0] == 404


def test_what_is_wrong_is_neither_planned_nor_flown(asking):
    asking.posted("change", {"changes": [{"do": "set", "path": ["start", "up_m"], "value": 500}]})
    status, told = asking.posted("plan")
    assert (status, told["key"], told["path"]) == (200, "start.up_m", ["start", "up_m"])
    _, told = asking.posted("fly")
    assert "a mission without errors" in told["error"]
    asking.posted("undo")
    asking.posted("change", {"changes": [{"do": "set", "path": ["goals"], "value": "from_autopilot"}]})
    assert "expected a list of goals" in asking.posted("plan")[1]["error"]
    assert "expected a list of goals" in asking.posted("fly")[1]["error"]


# --- plans


def test_plans_of_the_file_and_with_other_prices_beside_it(asking, file):
    status, plan = asking.posted("plan")
    assert status == 200
    assert plan["reaches_goal"]
    assert plan["path"][0][:3] == [0.0, 150.0, 750.0]
    assert plan["length_m"] > 1600.0
    assert plan["J_s"] > 0.0
    assert plan["settings"]["threat_level_max"] == 0.2
    body = {"side": "other", "settings": {"price_energy": 0, "seen_max_s": None}}
    _, other = asking.posted("plan", body)
    assert other["settings"]["price_energy"] == 0.0
    assert other["arrival_s"] < plan["arrival_s"], "fast flight has no price"
    assert asking.got("/edit/state")["is_changed"] is False
    assert file.read_text(encoding="utf-8") == TEXT


def test_a_newer_plan_of_the_same_side_breaks_the_older_one_off(asking, monkeypatch):
    begun, solve = threading.Event(), plan_answers.solve

    def slow(problem, rule):
        if not begun.is_set():
            begun.set()
            while not rule.is_broken_off:
                pass
        return solve(problem, rule)

    monkeypatch.setattr(plan_answers, "solve", slow)
    found = []
    older = threading.Thread(target=lambda: found.append(asking.posted("plan")))
    older.start()
    assert begun.wait(PATIENCE_S)
    assert asking.posted("plan")[1]["reaches_goal"]
    older.join()
    assert found == [(200, {"error": "a newer plan is asked for", "is_superseded": True})]


def test_a_plan_to_its_end_makes_way_for_the_other_side(asking, monkeypatch):
    begun, solve = threading.Event(), plan_answers.solve

    def slow(problem, rule):
        if rule.is_whole:
            begun.set()
            while not rule.is_broken_off:
                pass
        return solve(problem, rule)

    monkeypatch.setattr(plan_answers, "solve", slow)
    found = []
    whole = threading.Thread(target=lambda: found.append(asking.posted("plan", {"is_whole": True})))
    whole.start()
    assert begun.wait(PATIENCE_S)
    assert asking.posted("plan", {"side": "other", "settings": {"price_seen": 1}})[1]["reaches_goal"]
    whole.join()
    assert found[0][1]["is_superseded"]


# --- flights


def flown(asking):
    """All messages of a flight, and the end of it."""
    lines, news = [], {"next": 0, "is_over": False}
    while not news["is_over"]:
        news = asking.got(f"/edit/flight/{news['next']}")
        lines += news["lines"]
    return lines, news


def test_a_flight_is_told_as_it_goes(asking):
    assert asking.got("/edit/flight/0") == {"lines": [], "next": 0, "is_over": True}
    assert asking.posted("fly") == (200, {"is_begun": True})
    lines, end = flown(asking)
    topics = {line.partition(" ")[0] for line in lines}
    assert {"/ownship", "/tracks", "/decision", "/plan", "/swap"} <= topics
    assert end["measures"]["success"] is True
    assert end["fault"] == ""
    assert asking.got(f"/edit/flight/{end['next']}")["lines"] == []


def test_a_flight_is_stopped(asking):
    asking.posted("fly", {"pace": 1})
    while not asking.got("/edit/flight/0")["lines"]:
        pass
    assert asking.posted("stop") == (200, {})
    end = asking.got("/edit/flight/0")
    assert end["is_over"]
    assert end["measures"] == {}


def test_without_a_simulator_it_is_said(asking, monkeypatch):
    monkeypatch.setattr(watched_flight, "places", dict)
    asking.posted("fly")
    assert "no simulator installed; expected pip install" in flown(asking)[1]["fault"]


# --- the command


def test_the_command_serves_a_file_until_it_is_interrupted(companion_command, file, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("companion.ui.page.playback_page.wait_for_interrupt", lambda: None)
    companion_command("edit", str(file))
    [address] = opened
    assert address.startswith("http://127.0.0.1:")
    assert len(address.partition("?token=")[2]) >= 16
    companion_command("edit", str(file), "--no-browser")
    assert len(opened) == 1


def test_what_the_command_cannot_do(companion_command, file, served, tmp_path):
    none = companion_command("edit", tmp_path / "none.yaml", "--no-browser")
    assert (none.code, "no such file or directory" in none.err) == (2, True)
    short = companion_command("edit", file, "--no-browser", "--page-token", "abc")
    assert (short.code, "--page-token: got 3 characters" in short.err) == (2, True)
    taken = companion_command("edit", file, "--no-browser", "--page", served.port)
    assert (taken.code, f"page on 127.0.0.1:{served.port}" in taken.err) == (3, True)
