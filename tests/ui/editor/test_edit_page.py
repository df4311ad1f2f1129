"""The editor's page in headless Chromium: draw, drag, undo, plan, fly, save. Run by make page-test."""

import shutil
import sys

import numpy as np
import pytest
from pyproj import Transformer

from companion.config import load_mission
from companion.ui.editor.edit_server import EditServer
from companion.ui.editor.edit_session import EditSession
from companion.ui.page.access import Access
from tests.ui.page import browser

pytestmark = [pytest.mark.page, pytest.mark.xdist_group("page")]
TOKEN = "correct horse"
OWN = ("chrome:", "data:", "blob:", "about:")
CONTROL, SHIFT = 2, 8
SOON_MS = 120.0  # The page waits so long for another change before it asks for a plan.
GLIDE = """\
glide:
  ratio: 9
  airspeed_m_s: 20
  fields:
    - {name: strip, east_m: 400, north_m: 300, up_m: 0, radius_m: 80}   # mown
  people:
    - {name: village, polygon_enu_m: [[1500, 200], [1700, 200], [1700, 400], [1500, 400]]}
"""
ROUTE = "behaviour: drive, route_enu_m: [[950, 900], [1200, 900]]"


class Editing(browser.Browser):
    """Somebody with mouse and keyboard at the page of one mission file."""

    def begin(self, server):
        self.host = server.access.address(server.port)
        self.open(server.address)
        self.until("window.companionPage?.figures.firstPictureMs")
        self.settled()

    def settled(self):
        """Wait until all that was asked of the server is answered, and drawn."""
        self.run("return window.companionPage.editor.waiting.then(() => new Promise(requestAnimationFrame))")

    def state(self, expression):
        return self.run(f"const {{ editor, figures }} = window.companionPage; return {expression}")

    def element(self, name):
        return self.run(
            "return window.companionPage.editor.elements.find((one) => one.name === arguments[0])", name
        )

    def pixel(self, place):
        return self.run(
            "const box = document.querySelector('#ground').getBoundingClientRect();"
            "const [x, y] = window.companionPage.editor.map.pixelOf(arguments[0]);"
            "return [x + box.x, y + box.y]",
            place,
        )

    def mouse(self, kind, at, clicks=1):
        self.cdp(
            "Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", clickCount=clicks,
            buttons=0 if kind == "mouseReleased" else 1,
        )  # fmt: skip

    def point(self, place):
        """Click a place of the map."""
        at = self.pixel(place)
        self.cdp("Input.dispatchMouseEvent", type="mouseMoved", x=at[0], y=at[1])
        self.mouse("mousePressed", at)
        self.mouse("mouseReleased", at)

    def drag(self, begin, end):
        """Drag from one place of the map to another."""
        begin, end = self.pixel(begin), self.pixel(end)
        self.mouse("mousePressed", begin)
        for share in (0.3, 0.7, 1.0):
            self.mouse("mouseMoved", [a + share * (b - a) for a, b in zip(begin, end, strict=True)])
        self.mouse("mouseReleased", end)
        self.settled()

    def type_key(self, key, modifiers=0):
        self.cdp("Input.dispatchKeyEvent", type="keyDown", key=key, modifiers=modifiers)
        self.cdp("Input.dispatchKeyEvent", type="keyUp", key=key, modifiers=modifiers)
        self.settled()

    def write(self, number, text):
        self.run(
            "const input = document.getElementById(arguments[0]); input.value = arguments[1];"
            "input.dispatchEvent(new Event('change', { bubbles: true }))",
            f"number-{number}", text,
        )  # fmt: skip
        self.settled()

    def is_content(self):
        """Nothing complained, nothing of another host was asked for."""
        bad = [entry for entry in self.complaints() if entry["level"] == "SEVERE"]
        asked = [url for url in self.asked() if not url.startswith((self.host, *OWN))]
        assert (bad, asked, self.state("window.companionPage.figures.errors")) == ([], [], 0)
        return True


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mission.yaml"
    shutil.copy("mission_configs/first-flight.yaml", path)
    return path


def with_everything(file):
    """The mission with each kind of element, and its text."""
    text = file.read_text(encoding="utf-8").replace(
        "max_threat_radius_m: 250}", "max_threat_radius_m: 250, " + ROUTE + "}"
    )
    file.write_text(text.replace("simulation:", GLIDE + "simulation:"), encoding="utf-8")
    return file.read_text(encoding="utf-8")


@pytest.fixture
def page(file):
    if not browser.is_installed():
        pytest.fail("chromium and chromedriver are needed: apt-get install chromium chromium-driver")
    opened = []

    def open_one(**named):
        server = EditServer(Access(0, token=TOKEN, cookie="companion-edit-1"), EditSession(file))
        window = Editing(**named)
        opened.extend((window, server))
        window.begin(server)
        return window

    yield open_one
    for one in opened:
        one.close()


def test_each_kind_of_element_is_dragged_and_put_back(page, file):
    text = with_everything(file)
    window = page()
    assert window.state("editor.state.faults") == []
    moves = {
        "start": (40, 60),
        "goal 1": (-100, 50),
        "radar_1": (60, -50),
        "parked_vehicle": (-50, 30),
        "strip": (50, 20),
    }
    for name, by in moves.items():
        east, north, _ = window.element(name)["place_m"]
        window.drag([east, north], [east + by[0], north + by[1]])
        assert window.element(name)["place_m"][:2] == pytest.approx([east + by[0], north + by[1]], abs=4.0), (
            name
        )
    for name in ("wall", "village"):
        before = np.array(window.element(name)["polygon_enu_m"])
        window.point(before.mean(axis=0).tolist())
        window.drag(before.mean(axis=0).tolist(), (before.mean(axis=0) + np.array([-40, 30])).tolist())
        after = np.array(window.element(name)["polygon_enu_m"])
        np.testing.assert_allclose(after - before, [[-40, 30]] * 4, atol=4.0, err_msg=name)
    assert window.state("editor.state.is_changed")
    for _ in range(7):
        window.type_key("z", CONTROL)
    assert not window.state("editor.state.can_undo")
    assert not window.state("editor.state.is_changed")
    for _ in range(7):
        window.type_key("z", CONTROL | SHIFT)
    window.type_key("s", CONTROL)
    assert not window.state("editor.state.is_changed")
    saved = file.read_text(encoding="utf-8")
    changed = [(a, b) for a, b in zip(text.splitlines(), saved.splitlines(), strict=True) if a != b]
    assert len(changed) == 7
    assert all(a.partition("#")[2] == b.partition("#")[2] for a, b in changed), "comments stay"
    load_mission(file)
    assert window.is_content()


def test_corners_routes_radii_the_course_and_bounds_are_taken_hold_of(page, file):
    with_everything(file)
    window = page()
    window.point([1150, 1075])
    window.drag([1300, 1050], [1360, 1020])
    assert window.element("wall")["polygon_enu_m"][1] == pytest.approx([1360, 1020], abs=4.0)
    window.drag([1000, 1075], [960, 1075])
    assert len(window.element("wall")["polygon_enu_m"]) in (4, 5)
    window.point([950, 750])
    window.drag([1200, 900], [1230, 860])
    assert window.element("parked_vehicle")["route_enu_m"][1] == pytest.approx([1230, 860], abs=4.0)
    window.drag([1200, 750], [1150, 750])
    assert window.element("parked_vehicle")["values"]["max_threat_radius_m"] == pytest.approx(200, abs=5.0)
    window.point([150, 750])
    handle = window.state("editor.map.handles().find((one) => one.part === 'course').place")
    window.drag(handle, [150, 950])
    assert window.element("start")["values"]["course_deg"] == pytest.approx(0, abs=2)
    window.point([2000, 400])
    assert window.state("editor.selected.kind") == "bounds"
    window.drag([2000, 750], [2100, 750])
    assert window.state("editor.state.bounds_m")[:4] == pytest.approx([0, 2100, 0, 1500], abs=4.0)
    assert window.is_content()


@pytest.mark.parametrize(
    ("tool", "places", "name", "kind"),
    [
        ("goal", [[1000, 300]], "goal 2", "goals"),
        ("radar", [[300, 1200]], "radar 1", "radars"),
        ("vehicle", [[600, 1200]], "vehicle 1", "dynamic_threats"),
        ("obstacle", [[600, 200], [800, 200], [800, 350]], "obstacle 1", "obstacles"),
        ("noFly", [[600, 200], [800, 200], [800, 350]], "no-fly area 1", "obstacles"),
        ("fence", [[20, 20], [1980, 30], [1900, 1480], [30, 1400]], "fence wall 1", "obstacles"),
        ("people", [[600, 1300], [800, 1300], [800, 1400]], "people 1", "glide.people"),
        ("field", [[200, 200]], "field 1", "glide.fields"),
    ],
)
def test_each_kind_of_element_is_drawn_undone_and_saved(page, file, tool, places, name, kind):
    text = with_everything(file)
    window = page()
    window.click(f"button[data-tool={tool}]")
    for place in places:
        window.point(place)
    if len(places) > 1:
        window.type_key("Enter")
    window.until(f"window.companionPage.editor.elements.some((one) => one.name === '{name}')")
    window.settled()
    one = window.element(name)
    assert one["kind"] == kind
    if tool != "fence":
        drawn = one.get("polygon_enu_m", [one.get("place_m", [])[:2]])
        np.testing.assert_allclose(drawn, places, atol=4.0)
        assert window.state("editor.selected.name") == name
        assert window.state("editor.state.faults") == []
        window.type_key("Delete")
        assert window.element(name) is None
        window.click("#undo")
        window.settled()
    window.click("#save")
    window.settled()
    assert name.rpartition(" ")[0] in file.read_text(encoding="utf-8")
    window.until("window.companionPage.editor.state.can_undo")
    window.click("#undo")
    window.settled()
    window.click("#save")
    window.settled()
    assert file.read_text(encoding="utf-8") == text
    assert window.is_content()


def test_a_route_is_drawn_for_a_vehicle(page, file):
    window = page()
    window.point([950, 750])
    window.click("button[data-tool=route]")
    window.point([950, 900])
    window.point([1200, 900])
    window.type_key("Enter")
    one = window.element("parked_vehicle")
    np.testing.assert_allclose(one["route_enu_m"], [[950, 900], [1200, 900]], atol=4.0)
    assert one["values"]["behaviour"] == "drive"
    assert window.is_content()


def test_goals_change_places(page, file):
    window = page()
    window.click("button[data-tool=goal]")
    window.point([1000, 300])
    window.until("window.companionPage.editor.selected?.name === 'goal 2'")
    window.click("#earlier")
    window.until("window.companionPage.editor.elements[2].place_m[0] === 1750")
    assert window.state("editor.selected.name") == "goal 1"
    assert window.run("return document.querySelector('#earlier').disabled")
    window.click("#save")
    window.settled()
    assert [goal.east_m for goal in load_mission(file).goals] == [pytest.approx(1000, abs=4), 1750]
    assert window.is_content()


def test_numbers_by_hand_and_errors_beside_them(page, file):
    window = page()
    window.point([1150, 1075])
    window.write("top_m", "-10")
    assert window.text("#standing") == "1 error"
    assert "expected below top_m, -10" in window.text("#numbers .entry[data-state=danger] p")
    assert "obstacles.0.base_m: got 0" in window.text("#faults")
    assert window.run("return document.querySelector('#plan').disabled")
    window.type_key("Escape")
    assert window.state("editor.selected") is None
    window.click("#faults button")
    assert window.state("editor.selected.name") == "wall"
    assert window.run("return document.activeElement.id") == "number-base_m"
    window.write("top_m", "250")
    assert window.text("#standing") == "not saved yet"
    window.write("polygon_enu_m", "1000, 1050; 1300, 1050; 1300, 1150")
    assert len(window.element("wall")["polygon_enu_m"]) == 3
    window.run("document.querySelector('#number-top_m').focus()")
    window.type_key("z", CONTROL)
    assert len(window.element("wall")["polygon_enu_m"]) == 4, "nothing is being typed"
    window.write("top_m", "high")
    assert "expected a number (metres)" in window.text("#numbers")
    window.click("#undo")
    window.state("editor.goTo(['planning', 'price_seen'])")
    window.write("price_seen", "7.5")
    window.write("threat_level_max", "")
    window.click("#save")
    window.settled()
    planning = load_mission(file).planning
    assert (planning.price_seen, planning.threat_level_max) == (7.5, 1.0)
    assert window.is_content()


ENERGY = {
    "power_cruise_w": "120", "power_max_airspeed_w": "300", "climb_energy_j_m": "30", "capacity_wh": "200",
    "reserve_wh": "40",
}  # fmt: skip
SECTIONS = {
    "glide": (
        {"ratio": "9", "airspeed_m_s": "20"},
        lambda found: (found.ratio, found.airspeed_m_s) == (9.0, 20.0),
    ),
    "energy": (ENERGY, lambda found: (found.power_cruise_w, found.reserve_wh) == (120.0, 40.0)),
    "terrain.generated": (
        {"kind": "hills", "relief_m": "20"},
        lambda found: found.generated.relief_m == 20.0,
    ),
}


@pytest.mark.parametrize("kind", SECTIONS)
def test_a_section_that_the_file_lacks_is_made_by_numbers_undone_and_removed(page, file, kind):
    text = file.read_text(encoding="utf-8").replace("up_m: [60, 160]", "up_m: [60, 400]")
    file.write_text(text, encoding="utf-8")
    values, is_right = SECTIONS[kind]
    window = page()
    path = kind.split(".")
    window.state(f"editor.goTo({path!r})")
    assert window.state("editor.selected.isAbsent")
    assert "Not in the file yet" in window.run("return document.querySelector('#chosen').innerHTML")
    assert window.run("return document.querySelector('#remove').disabled")
    for name, value in values.items():
        window.write(name, value)
    assert window.text("#standing") == "not saved yet", window.text("#faults")
    assert not window.state("editor.selected.isAbsent")
    window.click("#save")
    window.settled()
    assert is_right(getattr(load_mission(file), path[0]))
    for _ in values:
        window.click("#undo")
        window.settled()
    assert window.state("editor.selected.isAbsent")
    for _ in values:
        window.click("#redo")
        window.settled()
    window.click("#remove")
    window.settled()
    assert kind in window.state("editor.state.absent")
    window.state(f"editor.goTo([{path[0]!r}])")
    if len(path) > 1:
        window.click("#remove")
        window.settled()
    window.click("#save")
    window.settled()
    assert file.read_text(encoding="utf-8") == text, "with all comments"
    assert window.is_content()


def test_a_place_in_utm_is_dragged_and_stays_so(page, file):
    text = file.read_text(encoding="utf-8")
    mission = load_mission(file)
    assert "{east_m: 1750, north_m: 750, up_m: 100, acceptance_radius_m: 60}" in text
    frame = mission.frame
    latitude, longitude, _ = frame.global_from_local(1750.0, 750.0, 0.0)
    zone = 1 + int((longitude + 180.0) // 6.0)
    easting, northing = Transformer.from_crs(4326, 32700 + zone, always_xy=True).transform(
        longitude, latitude
    )
    utm = f"{{utm: {{zone: {zone}H, easting_m: {easting:.1f}, northing_m: {northing:.1f}}}, up_m: 100, "
    file.write_text(text.replace("{east_m: 1750, north_m: 750, up_m: 100, ", utm), encoding="utf-8")
    window = page()
    (goal,) = window.state("editor.elements.filter((one) => one.kind === 'goals')")
    assert goal["place_m"][:2] == pytest.approx([1750.0, 750.0], abs=0.2)
    window.drag([1750, 750], [1600, 900])
    (moved,) = window.state("editor.elements.filter((one) => one.kind === 'goals')")
    assert moved["place_m"][:2] == pytest.approx([1600.0, 900.0], abs=6.0)  # It goes to round numbers.
    assert moved["written"] == "utm"
    assert moved["values"]["utm"]["zone"] == f"{zone}H"
    assert "UTM" in window.text("#written")
    window.write("utm.easting_m", str(round(easting)))
    window.click("#save")
    window.settled()
    saved = file.read_text(encoding="utf-8")
    assert f"easting_m: {round(easting)}, northing_m: " in saved
    assert len(saved.splitlines()) == len(text.splitlines())
    assert load_mission(file).goals[0].north_m == pytest.approx(900.0, abs=10.0)
    while window.state("editor.state.can_undo"):
        window.click("#undo")
        window.settled()
    (back,) = window.state("editor.elements.filter((one) => one.kind === 'goals')")
    assert back["place_m"][:2] == pytest.approx([1750.0, 750.0], abs=0.2)
    assert window.is_content()


def test_arrows_and_corners_by_keyboard(page, file):
    window = page()
    window.run("document.querySelector('#ground').focus()")
    window.type_key("n")
    assert window.state("editor.selected.name") == "start"
    window.type_key("ArrowRight")
    window.type_key("ArrowUp", SHIFT)
    assert window.element("start")["place_m"][:2] == [160, 751]
    window.point([1150, 1075])
    window.point([1300, 1100])
    window.type_key("Delete")
    assert len(window.element("wall")["polygon_enu_m"]) == 3
    window.type_key("z", CONTROL)
    assert len(window.element("wall")["polygon_enu_m"]) == 4
    assert window.is_content()


def test_a_plan_follows_each_change_and_another_price_stands_beside_it(page, file):
    window = page()
    window.until("document.querySelector('#compared tbody')")
    took = []
    for step in range(8):
        count = window.state("window.companionPage.figures.planMs.length")
        window.drag([950, 750 - 20 * step], [950, 730 - 20 * step])
        window.until(f"window.companionPage.figures.planMs.length > {count}")
        window.until("!window.companionPage.editor.planning.file.isOld")
        parts = window.state("[figures.changeMs, figures.planMs].map((entries) => entries.at(-1))")
        took.append(sum(parts) + SOON_MS)
    sys.stdout.write(
        f"from a change to its plan: median {np.median(took):.0f} ms, at most {max(took):.0f} ms\n"
    )
    window.run(
        "const slider = document.querySelector('#slider-price_energy'); slider.value = 0;"
        "slider.dispatchEvent(new Event('input', { bubbles: true }))"
    )
    window.until("window.companionPage.editor.planning.other")
    heads = window.run(
        "return [...document.querySelectorAll('#compared thead th')].map((one) => one.innerText)"
    )
    assert heads == ["", "as in the file", "what if"]
    [file_s, other_s] = window.state("['file', 'other'].map((side) => editor.planning[side].arrival_s)")
    assert other_s < file_s
    assert "price_energy" not in window.state("JSON.stringify(editor.state.sections.planning)")
    window.click("#take")
    window.settled()
    assert window.state("editor.state.sections.planning.price_energy") == 0
    assert window.is_content()


def test_a_flight_is_seen_in_the_same_view(page, file):
    window = page()
    window.click("#fly")
    window.until("window.companionPage.editor.store.rows.length > 5", seconds=90.0)
    window.until(
        "document.querySelector('#flown').innerText.startsWith('The goal was reached')", seconds=90.0
    )
    end = window.state("editor.store.ownship.position_enu_m")
    assert np.hypot(end[0] - 1750, end[1] - 750) < 150.0
    window.run(
        "const slider = document.querySelector('#moment'); slider.value = 20;"
        "slider.dispatchEvent(new Event('input', { bubbles: true }))"
    )
    assert window.state("editor.store.ownship.position_enu_m[0]") < 900.0
    window.click("#forget")
    assert window.state("editor.store.ownship") is None
    assert window.is_content()


def test_a_file_that_others_changed_is_loaded_anew(page, file):
    window = page()
    window.drag([950, 750], [950, 700])
    file.write_text(
        file.read_text(encoding="utf-8").replace(
            "north_m: 750, up_m: 100, course", "north_m: 800, up_m: 100, course"
        )
    )
    window.click("#save")
    window.until("document.querySelector('#refused button')")
    assert "a file that was changed meanwhile" in window.text("#refused")
    window.click("#refused button")
    window.until("window.companionPage.editor.elements[0].place_m[1] === 800")
    window.click("#undo")
    window.settled()
    assert window.element("start")["place_m"][1] == 750
    assert window.is_content()


def test_words_are_seen_on_a_telephone_and_in_the_dark(page, tmp_path):
    for name, named in (("phone", {"size": (390, 844), "is_phone": True}), ("dark", {"is_dark": True})):
        window = page(**named)
        window.until("document.querySelector('#compared tbody')")
        widest = window.run("return [document.documentElement.scrollWidth, innerWidth]")
        assert widest[0] <= widest[1], name
        nameless = window.run(
            "return [...document.querySelectorAll('button, input, select')].filter((one) =>"
            " !one.textContent.trim() && !one.labels?.length && !one.getAttribute('aria-label'))"
            ".map((one) => one.id)"
        )
        assert nameless == [], name
        assert window.is_content()
