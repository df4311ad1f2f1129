"""The page in headless Chromium: what is seen, how soon, and what is asked of whom. Run by make page-test."""

import json
import math
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.compose import world_of
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.ground import ground_at
from companion.ui.page.page_server import PageServer
from companion.ui.page.playback import Playback
from companion.ui.reports.report import write_report
from companion.world.pursuit import pursuit_game
from tests.service.process.processes import free_port
from tests.ui.page import browser, made_ground
from tests.ui.page.flown import Told, ownship, track
from tests.ui.page.wire_flight import WATCH, WireFlight, measured
from tests.ui.reports.flights import mission, record, snapshot_of

pytestmark = [pytest.mark.page, pytest.mark.xdist_group("page")]
ROOT = Path(__file__).parents[3]
PHONE, PAPER = (390, 844), (718, 1047)
FIRST_PICTURE_MS, TO_PIXEL_MS, FRAME_MS = 1_000.0, 150.0, 1_000.0 / 60.0
GROWTH_MAX_MB = 20.0
OWN = ("chrome:", "data:", "blob:", "about:")


class Window(browser.Browser):
    """A browser that watches its console and what is asked of other hosts."""

    def look(self, server, path=""):
        self.host = server.address
        self.open(self.host + path)
        self.until("window.companionPage?.figures.firstPictureMs")

    def figures(self):
        return self.run("return window.companionPage.figures")

    def is_content(self):
        """Nothing complained, nothing of another host was asked for."""
        bad = [entry for entry in self.complaints() if entry["level"] == "SEVERE"]
        asked = [url for url in self.asked() if not url.startswith((self.host, *OWN))]
        assert (bad, asked, self.figures()["errors"]) == ([], [], 0)
        return True


@pytest.fixture
def window():
    if not browser.is_installed():
        pytest.fail("chromium and chromedriver are needed: apt-get install chromium chromium-driver")
    opened = []

    def open_one(*arguments, **named):
        opened.append(Window(*arguments, **named))
        return opened[-1]

    yield open_one
    for one in opened:
        one.close()


@pytest.fixture
def live():
    """A flight's feed, who tells it, and its server."""
    feed = Feed()
    told = Told(feed.tell)
    told.fly(20)
    server = PageServer(Access(0), feed)
    yield told, server
    server.close()


@pytest.fixture
def played():
    """Two recordings: the second is decided otherwise from 30 s on."""
    playbacks = []
    for name, last in (
        ("flown", "cost 99.0, flown 100.0"),
        ("what would be decided now", "cost 50.0, flown 100.0"),
    ):
        playback = Playback(name)
        told = Told(playback.tell)
        told.fly(60)
        for stamp, text in ((20.0, "cost 98.0, flown 99.0"), (30.0, last)):
            told.recorder.decide(stamp, "keep", text, 80.0)
        playbacks.append(playback)
    return playbacks


def test_a_mission_over_ground_is_seen_from_the_side(window):
    """The ground is flat at 0 m up but for a metre, and the path 120 m up."""
    feed = Feed()
    ground = "terrain: {generated: {kind: hills, relief_m: 1.0}, height_min_m: 60}\n"
    told = Told(feed.tell, more=ground)
    told.fly(20)
    server = PageServer(Access(0), feed)
    page = window()
    page.look(server)
    page.until("document.querySelector('.side b')?.innerText === 'lowest 119 m over ground'")
    drawn = page.run(
        "const canvas = document.querySelector('.side canvas');"
        "const pixels = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;"
        "return new Set(pixels.filter((_, index) => index % 4 === 3)).size"
    )
    assert drawn > 2, "ground, paths and limits"
    assert page.is_content()
    server.close()


def test_the_view_from_the_side_shows_where_a_radar_sees(window):
    """The wall ends 1,000 m east, 400 m before the radar, and hides the path until there."""
    feed = Feed()
    told = Told(feed.tell, more="terrain: {generated: {kind: hills, relief_m: 1.0}, height_min_m: 60}\n")
    told.fly(20)
    server = PageServer(Access(0), feed)
    page = window()
    page.look(server)
    page.until("document.querySelector('.side i')?.innerText.startsWith('in sight of radar_1 in ')")
    [east, words] = page.run(
        "return [window.companionPage.page.store.ownship.position_enu_m[0],"
        " document.querySelector('.side i').innerText]"
    )
    assert words == f"in sight of radar_1 in {(1000.0 - east) / 1000.0:.1f} km"
    tints = page.run(
        "const canvas = document.querySelector('.side canvas');"
        "const ratio = window.devicePixelRatio;"
        "const width = canvas.width / ratio;"
        "const at = (away) => ratio * (42 + ((away + 500) / 2500) * (width - 52));"
        "return arguments[0].map((away) => canvas.getContext('2d').getImageData(at(away), 12, 1, 1).data[3])",
        [850.0 - east, 1100.0 - east, 1300.0 - east],
    )
    assert tints[0] == 0, "hidden"
    assert min(tints[1:]) > 20, "tinted"
    assert page.is_content()
    server.close()


def test_without_a_map_there_is_no_view_from_the_side(window, live):
    page = window()
    page.look(live[1])
    page.until("document.querySelector('#strips b').innerText.endsWith('up')")
    assert page.run("return document.querySelector('.side').hidden")


def member(system, place, plan, goals, **more):
    told = {
        "system": system, "is_own": False, "is_lost": False, "place_enu_m": place, "plan_enu_m": plan,
        "circle_m": 100.0, "goals": goals,
    }  # fmt: skip
    return told | more


def colour_at(page, place):
    """Red, green and blue of the map's pixel at a place [m]."""
    return page.run(
        "const map = window.companionPage.page.map;"
        "const [x, y] = map.pixelOf(arguments[0]);"
        "const picture = map.canvas.getContext('2d').getImageData(x * map.ratio, y * map.ratio, 1, 1);"
        "return [...picture.data].slice(0, 3)",
        place,
    )


def test_members_of_a_team_are_seen_with_their_plans_and_whose_goal_is_whose(window, live, tmp_path):
    told, server = live
    plan = [[400.0, 1200.0, 120.0], [700.0, 1200.0, 120.0]]
    team = {
        "members": [
            member(1, None, [], [1], is_own=True),
            member(2, [500.0, 1300.0, 120.0], plan, [2]),
            member(3, None, [[1200.0, 400.0, 120.0]], [], is_lost=True),
        ],
        "flown": [],
    }  # fmt: skip
    page = window()
    page.look(server)
    told.standing(21.0, team=team)
    page.until("window.companionPage.page.store.others.length === 2")
    assert page.run("return window.companionPage.page.store.goalNames")[0] == "goal 1, system 1"
    page.until("document.getElementById('ground') && window.companionPage.page.map.scale > 0")
    page.picture(tmp_path / "team.png")
    place = [500.0, 1300.0]  # Where system 2 is.
    shown = colour_at(page, place)
    page.run("window.companionPage.page.map.layers.team = false; window.companionPage.page.map.draw()")
    assert shown[0] < 60
    assert colour_at(page, place) != shown
    told.standing(22.0, team=team | {"flown": [1]})
    page.until("window.companionPage.page.store.goalNames[0] === 'goal 1, flown'")
    told.standing(23.0, team=team | {"flown": None})
    page.until("window.companionPage.page.store.goalNames[0] === 'goal'")
    assert page.is_content()


# --- a running flight


def test_a_live_flight(window, tmp_path):
    """A whole flight of the simulator's, looked at from its beginning."""
    port = free_port()
    flight = subprocess.Popen(
        [
            sys.executable, "-m", "companion", "sitl", "mission_configs/first-flight.yaml",
            "--page", str(port), "--speed", "4", "--flights", str(tmp_path),
        ],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert any(f"127.0.0.1:{port}" in line for line in flight.stdout)
        drained = threading.Thread(target=flight.stdout.read, daemon=True)
        drained.start()
        page = window()
        page.host = f"http://127.0.0.1:{port}/"
        page.open(page.host)
        page.until("window.companionPage?.page.store.mission", seconds=120.0)
        page.open(page.host)  # once more: how soon is a flight seen that goes on
        page.until("window.companionPage?.figures.firstPictureMs")
        assert page.figures()["firstPictureMs"] < FIRST_PICTURE_MS
        assert page.text("#mission") == "first-flight"
        assert page.text("#connection") == "live"
        page.until("window.companionPage.figures.toPixelMs.length > 60", seconds=60.0)
        to_pixel = np.median(page.figures()["toPixelMs"])
        first = page.figures()["firstPictureMs"]
        sys.stdout.write(f"first picture {first:.0f} ms, to the pixel {to_pixel:.0f} ms\n")
        assert to_pixel < TO_PIXEL_MS
        page.until("window.companionPage.page.store.standing?.mode === 'arrived'", seconds=180.0)
        page.until("document.querySelector('#verdict-word').innerText === 'Arrived'")
        assert page.is_content()
    finally:
        flight.terminate()
        flight.wait()
        flight.stdout.close()


def test_from_the_wire_to_the_pixel(window, tmp_path):
    """Of a service that flies in real time: vehicles that are detected, and the pilot's switch."""
    with WireFlight(tmp_path) as flight:
        page = window()
        page.host = f"http://127.0.0.1:{flight.page_port}/"
        page.open(page.host)
        page.until("window.companionPage?.page.store.mission", seconds=120.0)
        page.run(WATCH)
        tracks, modes, colours = measured(flight, page)
        for name, found in (("vehicle", tracks), ("pilot's switch", modes)):
            sys.stdout.write(
                f"from the wire to the pixel, {name}: median {np.median(found):.0f} ms, "
                f"at most {max(found):.0f} ms, of {len(found)}\n"
            )
        assert (len(tracks), len(modes)) == (60, 10)
        assert colours == {"85,97,109"}, "what was seen is a vehicle that hunts nobody, where it is"
        assert np.median(tracks) < TO_PIXEL_MS
        assert np.median(modes) < TO_PIXEL_MS
        assert page.is_content()


def in_view(page, selector):
    return page.run(
        "const box = document.querySelector(arguments[0]).getBoundingClientRect();"
        "return box.top >= 0 && box.bottom <= innerHeight && box.left >= 0 && box.right <= innerWidth",
        selector,
    )


def test_the_first_screen_answers(window, live):
    _, server = live
    page = window()
    page.look(server)
    for selector in ("#mission", "#verdict", "#next", "#fears", "#pilot"):
        assert in_view(page, selector), selector
    assert page.text("#mission") == "made-up"
    assert "A <wall> & a radar" in page.text("#about"), "what stands in a file is text"
    assert page.text("#verdict-word") == "Safe"
    assert page.text("#next").startswith("Flies to the goal, 1.3 km to the east")
    assert "straight on, level" in page.text("#next")
    assert "vehicle, ground pursuer: 1.0 km to the right" in page.text("#fears")
    assert "On the way that is flown it never can." in page.text("#fears")
    assert page.text("#pilot").startswith("Take over at any time")
    assert page.text("#decisions").split()[:4] == ["00:00", "New", "way", "flown:"]
    assert page.is_content()


@pytest.mark.parametrize(
    ("told", "word", "why"),
    [
        ({"is_heard": False}, "No autopilot", "flies on as it was told last"),
        ({"is_warm": False}, "Getting ready", "nothing is planned yet"),
        ({"is_in_trouble": True}, "Flying blind", "missing or too old"),
        ({"emergency": "return to launch"}, "Emergency", "No plan passes: return to launch."),
        ({"emergency": "keep the flown plan"}, "Take care", "No plan passes"),
        ({"mode": "arrived", "next_goal": 1}, "Arrived", "the last goal is reached"),
        (
            {"mode": "suspended", "handback": {"is_safe": False, "text": "NOT safe: wall 12"}},
            "Pilot flies", "Handing back here and now is NOT safe: wall 12.",
        ),
    ],
)  # fmt: skip
def test_what_is_not_well_is_said_first(window, live, told, word, why):
    teller, server = live
    page = window()
    page.look(server)
    teller.standing(21.0, **({"mode": "active"} | told))
    page.until("document.querySelector('#verdict-word').innerText === arguments[0]", word)
    assert why in page.text("#verdict-why")


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            {"left_wh": 40.6, "home_wh": 25.0, "margin_wh": 5.6, "turn_back_in_s": 83.0},
            "battery: 41 Wh left, way home 25 Wh, turn back in 83 s",
        ),
        (
            {"left_wh": 40.6, "home_wh": 25.0, "margin_wh": 5.6, "turn_back_in_s": math.inf},
            "battery: 41 Wh left, way home 25 Wh",
        ),
        (
            {"left_wh": 30.0, "home_wh": 25.0, "margin_wh": -5.0, "turn_back_in_s": 0.0},
            "battery: 30 Wh left, way home 25 Wh, turn back now",
        ),
        (
            {"left_wh": 30.0, "home_wh": None, "margin_wh": None, "turn_back_in_s": None},
            "battery: 30 Wh left, way home not known",
        ),
    ],
)
def test_the_battery_and_the_way_home_are_said(window, live, message, words):
    told, server = live
    page = window()
    page.look(server)
    told.recorder.energy(21.0, {"ratio": 1.0} | message)
    page.until("document.querySelector('#health').innerText.includes(arguments[0])", words)


def test_a_threat_is_told_by_its_level_and_its_time(window, live):
    told, server = live
    page = window()
    page.look(server)
    told.plan(2, 21.0, first_s=500.0, flown_first_s=81.0)
    told.state(21.0)
    page.until("document.querySelector('#verdict-why').innerText.includes('could threaten it in 60 s')")
    page.until("document.querySelector('#strips figure:nth-child(4) b').innerText === '60 s'")
    told.state(22.0, level=0.3)
    page.until("document.querySelector('#verdict-why').innerText.includes('threat level 0.30')")
    assert page.text("#verdict-word") == "Take care"
    told.state(23.0, level=1.1)
    page.until("document.querySelector('#verdict-word').innerText === 'In danger'")
    assert page.text("#verdict-why") == (
        "Under threat now: level 1.10, more than the 1.00 that the mission allows."
    )


def test_a_threat_on_the_way_ahead_is_told_with_when_it_begins(window, live):
    _, server = live
    page = window()
    page.look(server)
    page.run(
        "const {page} = window.companionPage; const {plan} = page.store;"
        "const here = page.store.ahead(Infinity)[0].row;"
        "plan.threat_levels = plan.path.map((_, row) => row >= here + 10 && row < here + 14 ? 0.4 : 0);"
        "page.drawnAt.panels = -Infinity; page.changed({panels: true})"
    )
    page.until("document.querySelector('#verdict-word').innerText === 'Take care'")
    assert page.text("#verdict-why") == (
        "The way ahead comes under threat in 10 s: up to level 0.40, the mission allows 1.00."
    )


def test_who_comes_later_sees_the_same(window, live):
    """A plan that was handed over, seen at once and by one that opens the page behind it."""
    told, server = live
    early, late = window(), window()
    early.look(server)
    told.plan(2, 21.0, first_s=100.0, flown_first_s=50.0)
    told.state(21.2)
    told.swap(2, 21.5)
    told.state(22.0)
    told.state(23.0)
    early.until("window.companionPage.page.store.now > 22.9")
    late.look(server)
    seen = (
        "const s = window.companionPage.page.store; return [s.safeUntil, s.plan.number, s.candidateOnly, "
        "s.mission.stamp_s, s.rows.at(-1)[6], s.tracks, s.level, s.decisions.length]"
    )
    assert late.run(seen) == early.run(seen)
    assert late.run(seen)[:3] == [100.0, 2, None]
    assert late.run(seen)[4] == pytest.approx(77.0)


def pixel(page, place):
    """Colour of the map at a place, as it was drawn last."""
    return page.run(
        "const {map} = window.companionPage.page; const [x, y] = map.pixelOf(arguments[0]);"
        "const picture = map.canvas.getContext('2d').getImageData(x * map.ratio, y * map.ratio, 1, 1);"
        "return [...picture.data].slice(0, 3)",
        place,
    )


def test_what_is_told_is_drawn(window, live):
    told, server = live
    page = window()
    page.look(server)
    empty = pixel(page, [600.0, 1300.0])
    told.state(21.0, east=590.0)
    told.recorder.state(21.2, _at(21.2, 600.0, 1300.0), (track(21.2),), 0.0)
    page.until("window.companionPage.page.store.now > 21.1")
    page.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    drawn = pixel(page, [600.0, 1300.0])
    assert drawn != empty
    assert drawn == [10, 79, 163], "the aircraft's blue"
    assert pixel(page, [950.0, 700.0]) == [91, 103, 115], "an obstacle"


def test_ground_of_local_files_is_drawn(window, tmp_path):
    """One red tile, and heights that rise to the east."""
    config = mission()
    place = 500.0, 1_250.0  # where nothing else is drawn
    middle = config.frame.global_from_local(*place, 0.0)
    tile = made_ground.tile_at(17, *middle[:2])
    made_ground.write_tiles(
        tmp_path / "a.mbtiles", {(17, *tile): made_ground.picture("red")}, attribution="© somebody"
    )
    made_ground.write_heights(
        tmp_path, *middle[:2],
        lambda _, longitude: 40.0 + config.origin.altitude_amsl_m + 8_000.0 * (longitude - middle[1]),
    )  # fmt: skip
    feed = Feed()
    Told(feed.tell).fly(20)
    server = PageServer(Access(0), feed, ground=ground_at(tmp_path))
    page = window()
    page.look(server)
    page.until("document.querySelector('#layer-tiles') && document.querySelector('#layer-relief')")
    assert page.text("#credit") == "© somebody"
    page.run("const {page} = window.companionPage; page.show('relief', false)")
    page.until("[...window.companionPage.page.map.ground.pictures.values()].some((kept) => kept?.isLoaded)")
    page.run("return new Promise((done) => setTimeout(done, 300))")
    width = 40_075_016.686 * math.cos(math.radians(middle[0])) / 2**17
    u, v = made_ground.mercator(*middle[:2])
    centre = [
        place[0] + ((tile[0] + 0.5) - u * 2**17) * width,
        place[1] - ((tile[1] + 0.5) - v * 2**17) * width,
    ]
    for right, up in ((-0.4, -0.4), (-0.4, 0.4), (0.4, -0.4), (0.4, 0.4)):
        inside = pixel(page, [centre[0] + right * width, centre[1] + up * width])
        assert inside[0] > inside[1] + 60, (right, up, inside)
        beyond = pixel(page, [centre[0] + 1.3 * right * width / 0.8, centre[1] + 1.3 * up * width / 0.8])
        assert abs(beyond[0] - beyond[1]) < 40, (right, up, beyond)
    page.run("window.companionPage.page.show('relief', true)")
    told = page.run(
        "return window.companionPage.page.map.named(...window.companionPage.page.map.pixelOf([500, 900]))"
    )
    assert told == "ground: 40 m up"
    page.press("3")
    page.until("window.companionPage.page.solid?.groups.ground?.children.length === 1", seconds=60.0)
    assert page.is_content()
    server.close()


def test_without_files_the_map_has_no_ground(window, live):
    _, server = live
    page = window()
    page.look(server)
    boxes = "return [...document.querySelectorAll('#layer-tiles, #layer-relief')].length"
    assert page.run(boxes) == 0
    assert page.run("return document.querySelector('#credit').hidden")
    assert not [url for url in page.asked() if "/ground/" in url or "/tiles/" in url]


def _at(stamp_s, east, north):
    return replace(ownship(stamp_s), position_enu_m=(east, north, 120.0))


def test_frames_with_five_thousand_edges(window, live):
    told, server = live
    page = window()
    told.plan(2, 21.0, num_edges=5_000)
    page.look(server)
    page.until("window.companionPage.page.store.trees.tree_parents.length === 5001")
    page.run("window.companionPage.page.show('tree', true)")
    measured = page.run("return window.companionPage.page.measure(4)")
    sys.stdout.write(f"5,000 edges: {measured}\n")
    assert measured["frameMs"] < FRAME_MS, "what a picture takes leaves room for sixty a second"
    assert page.is_content()


def test_it_comes_back_after_a_restart_of_the_service(window):
    feed = Feed()
    Told(feed.tell).fly(5)
    server = PageServer(Access(0), feed)
    port, page = server.port, window()
    page.look(server)
    server.close()
    page.until("document.querySelector('#connection').innerText.startsWith('no answer')")
    page.until("document.querySelector('#verdict-word').innerText === 'Not known'")
    feed = Feed()
    told = Told(feed.tell)
    told.fly(9)
    server = PageServer(Access(port), feed)
    try:
        page.until("document.querySelector('#connection').innerText === 'live'")
        page.until("window.companionPage.page.store.now > 8.5")
        stamps = page.run("return window.companionPage.page.store.rows.map((row) => row[0])")
        assert stamps == sorted(stamps)
        assert len(stamps) in (9, 10), "nothing of the flight before"
        assert page.figures()["errors"] == 0
    finally:
        server.close()


def test_memory_over_two_hours_of_flights(window):
    """Two hours of one flight's messages: 5 Hz, a plan with its trees every 25 s, a decision each."""
    feed = Feed()
    told = Told(feed.tell)
    told.fly(20)
    server = PageServer(Access(0), feed)
    page = window()
    page.look(server)

    def fly(begin_s, end_s):
        for second in range(begin_s, end_s):
            for tick in range(5):
                told.state(second + 0.2 * tick, 100.0 + (5.0 * second) % 1500.0)
            told.standing(float(second))
            if second % 25 == 0:
                told.plan(second, float(second), num_edges=1_500)
                told.recorder.decide(
                    float(second), "keep", "cost 99.0, flown 100.0", 80.0, why={"occasion": "25 s"}
                )
            if second % 60 == 0:
                page.until("window.companionPage.page.store.now > arguments[0]", second - 30.0)

    def used_mb():
        page.cdp("HeapProfiler.collectGarbage")
        return page.run("return performance.memory.usedJSHeapSize") * 1e-6

    try:
        fly(20, 600)  # by when everything has been made once
        before = used_mb()
        fly(600, 7_800)
        page.until("window.companionPage.page.store.now > 7798")
        grown = used_mb() - before
        sys.stdout.write(f"memory: {before:.1f} MB after ten minutes, {grown:+.1f} MB after two hours more\n")
        assert grown < GROWTH_MAX_MB
        assert server.num_dropped == 0
        assert page.is_content()
    finally:
        server.close()


# --- recordings


@pytest.fixture
def replayed(played):
    server = PageServer(Access(0), None, played)
    yield server
    server.close()


def at(page):
    return page.run("return window.companionPage.page.store.now")


def test_a_recording_is_gone_through_with_slider_and_keys(window, replayed):
    page = window()
    page.look(replayed, "?source=0")
    page.run(
        "const slider = document.querySelector('#slider'); slider.value = 40;"
        "slider.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    assert at(page) == pytest.approx(40.0, abs=0.2)
    page.until("document.querySelector('#clock').innerText === '00:40'")
    page.until("document.querySelectorAll('#decisions li').length === 3")
    page.press("[")
    assert at(page) == pytest.approx(30.0)
    page.press("[")
    assert at(page) == pytest.approx(20.0)
    page.until("document.querySelector('#decisions li.now b').innerText === 'Kept the way being flown'")
    page.until("document.querySelectorAll('#decisions li').length === 2")
    page.press("ArrowRight")
    assert at(page) == pytest.approx(25.0)
    page.press("]")
    assert at(page) == pytest.approx(30.0)
    east = page.run("return window.companionPage.page.store.ownship.position_enu_m[0]")
    assert east == pytest.approx(100.0 + 25.0 * 30.0)
    page.run("document.querySelector('#speed').value = '10'")
    page.press(" ")
    page.until("window.companionPage.page.store.now > 50")
    page.press(" ")
    still = at(page)
    page.run("return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert at(page) == still
    assert page.is_content()


def test_back_and_forth_is_the_same_as_straight(window, replayed):
    page = window()
    page.look(replayed, "?source=0")
    told = (
        "const {page} = window.companionPage; const s = page.store;"
        " for (const t of arguments[0]) page.seek(t);"
        "return JSON.stringify([s.now, s.ownship, s.tracks, s.level, s.decisions, s.candidate?.number,"
        " s.mission?.stamp_s, s.safeUntil])"
    )
    straight = page.run(told, [33.3])
    assert page.run(told, [5.0, 59.0, 0.0, 41.0, 33.3]) == straight
    assert json.loads(straight)[1]["stamp_s"] == pytest.approx(33.2)


def test_side_by_side(window, replayed):
    page = window((1500, 900))
    page.open(replayed.address)
    page.until("location.pathname === '/beside.html' && document.querySelector('#apart')?.hidden === false")
    assert "apart from 00:30 on (Kept the way being flown: cost 99.0" in page.text("#about")
    page.click("#apart")
    both = "[...document.querySelectorAll('iframe')].map((one) => one.contentWindow.companionPage.page.store"
    page.until(f"{both}.now).every((now) => Math.abs(now - 30) < 0.01)")
    page.until(f"{both}.decisions.length).every((count) => count === 3)")
    texts = page.run(f"return {both}.decisions.at(-1).text)")
    assert texts == ["cost 99.0, flown 100.0", "cost 50.0, flown 100.0"]
    assert [entry for entry in page.complaints() if entry["level"] == "SEVERE"] == []


# --- whoever looks, and however


def test_on_a_telephone(window, live):
    _, server = live
    page = window(PHONE, 2.0, is_phone=True)
    page.look(server)
    assert page.run("return document.documentElement.scrollWidth") <= PHONE[0]
    assert in_view(page, "#mission")
    assert in_view(page, "#verdict")
    sizes = page.run(
        "return [...document.querySelectorAll('button')].filter((one) => one.offsetParent).map((one) => {"
        "const box = one.getBoundingClientRect(); return [one.id, box.width, box.height]})"
    )
    assert [name for name, width, height in sizes if min(width, height) < 34] == []
    assert page.is_content()


def test_the_report_fits_on_paper(window, tmp_path):
    """A4 upright with margins, as a browser prints it: nothing is wider, and nothing has to be scrolled."""
    config = mission()
    file, _ = write_report(tmp_path, config, snapshot_of(config), record())
    page = window(PAPER)
    page.cdp("Emulation.setEmulatedMedia", media="print")
    page.open(file.as_uri())
    assert page.run("return document.documentElement.scrollWidth") <= PAPER[0]
    hidden = page.run(
        "return [...document.querySelectorAll('.scroll, figure > div')].filter((one) =>"
        "one.scrollHeight > one.clientHeight + 1 || one.scrollWidth > one.clientWidth + 1).length"
    )
    assert hidden == 0
    assert page.complaints() == []


@pytest.mark.parametrize("is_dark", [False, True])
def test_dark_and_light(window, live, is_dark):
    _, server = live
    page = window(is_dark=is_dark)
    page.look(server)
    ground = page.run("return getComputedStyle(document.body).backgroundColor")
    dark, light = "rgb(22, 27, 33)", "rgb(255, 255, 255)"
    assert ground == (dark if is_dark else light)
    page.press("d")
    assert page.run("return getComputedStyle(document.body).backgroundColor") == (light if is_dark else dark)
    contrast = page.run(CONTRAST)
    assert contrast == [], "words that are hard to read"
    assert page.is_content()


# Words whose contrast with what is behind them is below WCAG's 4.5.
CONTRAST = """
const shade = (text) => {
  const parts = text.match(/[\\d.]+/g).map(Number);
  return parts.length > 3 && parts[3] === 0 ? null : parts;
};
const linear = (part) => (part <= 0.03928 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
const light = ([r, g, b]) => 0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
const behind = (one) => {
  for (; one; one = one.parentElement) {
    const found = shade(getComputedStyle(one).backgroundColor);
    if (found) return found;
  }
  return [255, 255, 255];
};
const says = (one) => [...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
const all = document.querySelectorAll('p, li, small, b, h1, h2, button, span, label, figcaption, summary');
return [...all].filter((one) => one.offsetParent && !one.closest('.legend') && says(one)).filter((one) => {
  const pair = [light(shade(getComputedStyle(one).color)), light(behind(one))];
  return (Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05) < 4.5;
}).map((one) => one.textContent.slice(0, 40));
"""


def test_everything_that_can_be_used_has_a_name(window, live):
    _, server = live
    page = window()
    page.look(server)
    tree = page.cdp("Accessibility.getFullAXTree")["nodes"]
    used = {"button", "checkbox", "combobox", "slider", "link", "image", "img"}
    nameless = [
        node["role"]["value"]
        for node in tree
        if not node.get("ignored")
        and node.get("role", {}).get("value") in used
        and not node.get("name", {}).get("value")
    ]
    assert nameless == []
    names = {node["name"]["value"] for node in tree if node.get("role", {}).get("value") in ("image", "img")}
    assert any(
        name.startswith("Map of made-up: Safe; the aircraft 595, 750, 120 metres") for name in names
    ), names


def test_three_dimensions_have_what_the_map_has(window, live):
    """Each layer that is switched off takes something away, and so does the way that is offered back."""
    told, server = live
    page = window()
    page.look(server)
    page.press("3")
    way = [[600.0, 750.0, 120.0], [900.0, 900.0, 130.0], [1900.0, 750.0, 120.0]]
    items = [[0.0, 0.0, 100.0], [900.0, 0.0, 100.0]]

    def parts():
        return page.run(
            "const {page} = window.companionPage; page.solid.draw();"
            "return Object.values(page.solid.groups).reduce((sum, group) => sum + group.children.length, 0)"
        )

    page.until("window.companionPage.page.solid?.isShown")
    page.run("window.companionPage.page.show('threatTree', true)")
    told.standing(
        21.0, operator_enu_m=items, returns={"is_safe": True, "text": "flies straight home", "way_enu_m": way}
    )
    page.until("window.companionPage.page.store.standing.operator_enu_m.length === 2")
    words = "RTL here flies straight home. Choosing AUTO"
    page.until(f"document.body.innerText.includes('{words}')")
    page.until("window.companionPage.page.map.field && window.companionPage.page.map.reach.lines.length")
    whole = parts()
    for layer in (
        "flown",
        "mission",
        "ahead",
        "operator",
        "returns",
        "tracks",
        "reach",
        "field",
        "radars",
        "obstacles",
        "horizon",
    ):
        page.run("window.companionPage.page.show(arguments[0], false)", layer)
        assert parts() < whole, layer
        page.run("window.companionPage.page.show(arguments[0], true)", layer)
        assert parts() == whole, layer
    told.standing(
        22.0, "suspended", operator_enu_m=items, handback={"is_safe": True, "text": "safe", "way_enu_m": way}
    )
    page.until("window.companionPage.page.store.standing.handback.way_enu_m")
    page.run("window.companionPage.page.show('mission', false)")
    without = parts()
    told.standing(23.0, "suspended", operator_enu_m=items)
    page.until("!window.companionPage.page.store.standing.handback.way_enu_m")
    assert parts() < without
    assert page.is_content()


def test_keys_switch_trees_and_three_dimensions(window, live):
    _, server = live
    page = window()
    page.look(server)
    assert page.run("return window.companionPage.page.map.layers.tree")
    page.press("t")
    assert not page.run("return window.companionPage.page.map.layers.tree")
    page.press("3")
    page.until(
        "window.companionPage.page.solid?.isShown && document.querySelectorAll('#labels span').length >= 4"
    )
    painted = page.run(
        "const {solid} = window.companionPage.page; solid.draw(); const gl = solid.renderer.getContext();"
        "const at = new Uint8Array(4 * 64 * 64);"
        "const [x, y] = [gl.drawingBufferWidth / 2 - 32, gl.drawingBufferHeight / 2 - 32];"
        "gl.readPixels(x, y, 64, 64, gl.RGBA, gl.UNSIGNED_BYTE, at);"
        "return new Set(Array.from({length: 4096}, (_, i) => at.slice(4 * i, 4 * i + 3).join())).size"
    )
    assert painted > 3, "more than the ground"
    page.press("3")
    page.until("!document.querySelector('#ground').hidden")
    assert page.is_content()


@pytest.mark.parametrize("name", ["paper-2d", "paper-3d", "valley"])
def test_its_isochrones_are_the_planners(window, live, name):
    """What it works out by itself, against the planner's kernel on the same grid."""
    _, server = live
    config = load_mission(ROOT / "mission_configs" / f"{name}.yaml")
    snapshot = world_of(config)
    west, east = snapshot.bounds[:2]
    vehicle = track(7.0, east=0.7 * east + 0.3 * west)
    plane_up = config.start.up_m if config.dimension == 2 else None
    game = pursuit_game((vehicle,), snapshot.walls, plane_up, snapshot.bounds, 0.0)
    page = window()
    page.look(server)
    world = {
        "bounds_m": snapshot.bounds, "dimension": config.dimension,
        "start_enu_m": [config.start.east_m, config.start.north_m, config.start.up_m],
    }  # fmt: skip
    walls = [
        {"polygon_enu_m": wall.polygon_enu_m.tolist(), "base_m": wall.base_m, "top_m": wall.top_m}
        for wall in config.obstacle_list
    ]
    told = {
        "position_enu_m": vehicle.position_enu_m, "covariance": vehicle.covariance.tolist(),
        "speed_max_m_s": vehicle.speed_max_m_s,
    }  # fmt: skip
    found = page.run(
        "const [world, walls, track] = arguments; return import('/reach.js').then((reach) => {"
        "const grid = reach.gridOf(world, 256); const blocked = reach.wallsOn(grid, world, walls);"
        "const found = [...reach.arrivals(track, grid, blocked)].map((v) => Number.isFinite(v) ? v : -1);"
        "return [grid.columns, grid.rows, found]})",
        world, walls, told,
    )  # fmt: skip
    columns, rows, seconds = found
    assert (columns, rows) == game.arrival.shape[1:]
    expected = np.where(np.isfinite(game.arrival[0]), game.arrival[0] - 7.0, -1.0)
    np.testing.assert_allclose(np.array(seconds).reshape(rows, columns).T, expected, atol=1e-6)
