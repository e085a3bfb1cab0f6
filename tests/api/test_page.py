"""The page in a browser: what people do, without an error in the console or a request to another host."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import httpx
import numpy as np
import pytest
import uvicorn
from PIL import Image

import api.app
from api.settings import Settings
from tests.api.conftest import LASER, ROOM, IdleJobs, InlinePool, finish, ready_field, small_settings
from tests.api.routes.test_places import HALL

driver = pytest.importorskip("playwright.sync_api", reason="the driver is missing: pip install playwright")
CHROMIUM = os.environ.get("SUREPATH_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
if CHROMIUM is None:
    pytest.skip("no Chromium here; SUREPATH_CHROMIUM names one", allow_module_level=True)
# Service and test share a process here, and filters of warnings are not made for two threads.
pytestmark = pytest.mark.filterwarnings("ignore")
SOON_MS = 60_000  # where nothing is compiled yet


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A service with a room and a ready field, on a port of its own; the test does what workers do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api.app, "JobRunner", IdleJobs)
        app = api.app.create_app(small_settings(tmp_path_factory.mktemp("page")), pool=InlinePool())
        running = serving(app)
        base = running.__enter__()
    try:
        with httpx.Client(base_url=base) as client:
            client.app = app
            field = ready_field(client, client.post("/v1/maps", json=ROOM).json()["map"])
        yield SimpleNamespace(base=base, app=app, **vars(field))
    finally:
        running.__exit__(None, None, None)


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """The service as it is, with a worker process."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("real"), preload=False, workers=1)
    with serving(api.app.create_app(settings)) as base, httpx.Client(base_url=base) as client:
        until = time.monotonic() + 280  # the first worker of a machine compiles
        while client.get("/readyz").status_code != 200:
            assert time.monotonic() < until, "the worker did not start"
            time.sleep(0.1)
        yield SimpleNamespace(base=base, client=client)


@contextmanager
def serving(app):
    """The address of a running server."""
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None, access_log=False))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until = time.monotonic() + 20
    while not server.started and time.monotonic() < until:
        time.sleep(0.02)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(20)


def hall_of(real, name, x, sensor=LASER, **more):
    """A small hall with a field, both of their own by where landmark E stands; the fragment that shows them."""
    features = [
        {**f, "geometry": {"type": "Point", "coordinates": [x, 6]}} if f["properties"].get("id") == "E" else f
        for f in HALL["features"]
    ]
    map_id = real.client.post("/v1/maps", json={**HALL, "name": name, "features": features}).json()["map"]
    order = {"map": map_id, "sensor": sensor, "resolution_m": 0.5, **more}
    ordered = real.client.post("/v1/fields", json=order).json()
    until = time.monotonic() + 60
    while real.client.get(ordered["links"]["field"]).json()["status"] != "ready":
        assert time.monotonic() < until
        time.sleep(0.05)
    return f"#map={map_id}&field={ordered['field']}"


@pytest.fixture(scope="module")
def browser():
    with driver.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def page(browser):
    """An open page; the test fails on what the console complains about and on requests elsewhere."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    opened = context.new_page()
    opened.set_default_timeout(SOON_MS)
    complaints: list[str] = []
    opened.expected = []
    opened.base = ""  # whoever loads the page says what is not foreign
    opened.on("console", lambda m: complaints.append(m.text) if m.type in {"error", "warning"} else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on(
        "request",
        lambda r: None if r.url.startswith((opened.base, "data:", "blob:")) else complaints.append(r.url),
    )
    yield opened
    context.close()
    assert [c for c in complaints if not any(re.search(e, c) for e in opened.expected)] == []


def load(page, served, fragment=""):
    page.base = f"{served.base}/"
    page.goto(f"{page.base}{fragment}")
    page.wait_for_selector("#bar", state="visible")
    page.wait_for_url("**view=*")


def at(page, x, y):
    """Where a place of the map is on the screen, by the permalink."""
    page.wait_for_timeout(300)  # the link follows the view a moment later
    cx, cy, scale = (float(v) for v in re.search(r"view=([\d.,-]+)", page.url)[1].split(","))
    box = page.locator("#map").bounding_box()
    return (
        box["x"] + box["width"] / 2 + (x - cx) * scale,
        box["y"] + box["height"] / 2 - (y - cy) * scale,
    )


def figures(page):
    page.wait_for_selector("#figures", state="visible")
    rows = page.locator("#figure-rows tr").all()
    return {row.locator("th").inner_text(): row.locator("td").all_inner_texts() for row in rows}


def test_two_clicks_to_a_path(page, served):
    load(page, served)
    page.mouse.click(*at(page, 1, 3))
    with page.expect_response("**/v1/plans") as answered:
        page.mouse.click(*at(page, 7, 3))
    answer = answered.value.json()
    shown = figures(page)
    best, shortest = answer["routes"][0], answer["shortest_baseline"]
    assert shown["Length"] == [f"{best['length_m']:.2f} m", f"{shortest['length_m']:.2f} m"]
    assert all(re.fullmatch(r"[\d.]+ m?m", cell) for cell in shown["Mean r95"] + shown["Worst r95"])
    assert "best effort" in page.locator("#verdict").inner_text()
    assert answer["unmet"][0]["message"] in page.locator("#plan-notes").inner_text()
    assert "Length" in page.locator("#said").text_content()
    assert page.locator("#profile path").count() == 2
    assert answer["plan"] in page.locator("#get-plan").get_attribute("href")


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("exact", "The best path"),
        ("approximate", "not proven"),
        ("risk_unmet", "No path keeps the bounds"),
        ("timeout", "time ran out"),
        ("no_path", "There is no path"),
    ],
)
def test_every_outcome_is_said_in_words(page, served, status, words):
    def changed(route):
        answer = route.fetch().json()
        routes = [] if status == "no_path" else answer["routes"]
        route.fulfill(json={**answer, "status": status, "routes": routes})

    page.route("**/v1/plans", changed)
    load(page, served, "#start=1,3&goal=7,3")
    page.locator("#verdict", has_text=words).wait_for()
    assert page.locator("#figures").is_visible() == (status != "no_path")
    assert words in page.locator("#said").text_content()


def test_a_place_tells_its_ellipse_and_its_triplet(page, served):
    load(page, served)
    page.locator("#tools").get_by_text("Inspect").click()
    page.mouse.click(*at(page, 1.25, 3.25))
    page.locator("#place-values").get_by_text("Best triplet").wait_for()
    assert "A fix is possible" in page.locator("#place-words").inner_text()
    page.mouse.click(*at(page, 1.25, 0.25))  # blind there
    page.locator("#place-words").get_by_text("No fix here").wait_for()
    assert "needs three" in page.locator("#place-why").inner_text()


def test_the_link_brings_everything_back(page, served):
    fragment = (
        f"#map={served.map}&field={served.id}&metric=r95_m&colors=cividis&start=1,3&goal=7,3&plan=weight=9"
    )
    load(page, served, fragment)
    figures(page)
    assert page.input_value("#weight") == "9"
    assert page.locator("#bar-title").inner_text() == "r95 [m]"
    assert page.input_value("#goal-x") == "7.00"
    for part in ("metric=r95_m", "colors=cividis", "start=1.000,3.000"):
        assert part in page.url


def test_every_metric_has_colours_in_its_unit(page, served):
    load(page, served)
    page.locator("summary", has_text="Display").click()
    for name, title, scale in (
        ("n_visible", "n_visible", "linear"),
        ("sigma_theta_rad", "sigma_theta [rad]", "log"),
        ("validity", "validity", "linear"),
        ("ellipse95_m", "ellipse95 [m]", "log"),
    ):
        page.select_option("#metric", name)
        page.locator("#bar-title", has_text=title).wait_for()
        page.locator("#bar-ramp .tick").nth(1).wait_for()
        assert page.input_value("#scale") == scale
    for low in ("0", "-1", "nonsense"):  # no start of a log scale
        page.fill("#low", low)
        page.keyboard.press("Tab")
    page.locator("#bar-ramp .tick").nth(1).wait_for()


def test_the_keyboard_alone_is_enough(page, served):
    load(page, served)
    page.locator("#map").focus()
    for key in [*["Shift+ArrowLeft"] * 4, "s", *["Shift+ArrowRight"] * 8, "g"]:
        page.keyboard.press(key)
    figures(page)
    for name, value in (("start-x", "1"), ("start-y", "5"), ("goal-x", "7"), ("goal-y", "5")):
        page.fill(f"#{name}", value)
    with page.expect_response("**/v1/plans") as answered:
        page.keyboard.press("Enter")
    assert answered.value.json()["request"]["goal"]["y_m"] == 5


def test_a_problem_is_said_in_words_and_its_hint_helps(page, served):
    page.expected = ["status of 422"]
    load(page, served, "#start=1,3")
    page.fill("#goal-x", "4")
    page.fill("#goal-y", "3")
    page.keyboard.press("Enter")
    page.wait_for_selector("#plan-trouble", state="visible")
    assert "obstacle" in page.locator("#plan-trouble").inner_text()
    page.locator("#plan-trouble").get_by_role("button").click()
    figures(page)
    assert (page.input_value("#goal-x"), page.input_value("#goal-y")) == ("2.00", "3.00")


def test_a_field_is_built_and_watched(page, served):
    load(page, served)
    page.locator("summary", has_text="Build a field").click()
    page.fill("#resolution", "1")
    with page.expect_response(
        lambda r: r.url.endswith("/v1/fields") and r.request.method == "POST"
    ) as answered:
        page.locator("#build button").click()
    page.wait_for_selector("#job", state="visible")
    finish(SimpleNamespace(app=served.app), answered.value.json()["job"])
    page.wait_for_selector("#job", state="hidden")
    page.locator("#field-choice option:checked", has_text="cell 1 m").wait_for(state="attached")


def test_without_a_map_there_is_one_thing_to_do(page, real):
    page.base = f"{real.base}/"
    page.route("**/v1/maps", lambda route: route.fulfill(json={"maps": []}))
    page.goto(page.base)
    page.locator("#no-map").wait_for()
    assert not page.locator("#tools").is_visible()
    page.mouse.click(600, 300)
    page.unroute("**/v1/maps")
    features = [f for f in ROOM["features"] if f["properties"].get("id") != "D"]
    world = json.dumps({**ROOM, "name": "first", "features": features}).encode()
    page.set_input_files(
        "#upload-world", {"name": "w.geojson", "mimeType": "application/json", "buffer": world}
    )
    page.click("#upload button")
    page.locator("#help", has_text="build one at the left").wait_for()
    assert page.locator("#map-choice option:checked").inner_text() == "first"
    assert not page.locator("#no-map").is_visible()


def test_a_tablet_and_the_dark_show_everything(browser, served):
    context = browser.new_context(
        viewport={"width": 820, "height": 1180}, has_touch=True, color_scheme="dark"
    )
    page = context.new_page()
    load(page, served)
    page.touchscreen.tap(*at(page, 1, 3))
    page.touchscreen.tap(*at(page, 7, 3))
    figures(page)
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= 820
    context.close()


def choose(page, tool):
    page.locator("#tools").get_by_text(tool).click()


def content_of(page, link):
    """What a click on a link downloads, and under which name."""
    with page.expect_download() as got:
        page.click(link)
    return got.value.path().read_bytes(), got.value.suggested_filename


def test_a_place_ranks_its_triplets_and_simulates_its_fixes(page, real):
    load(page, real, hall_of(real, "ranked", 2.1, {**LASER, "max_range_m": 5.0}))
    choose(page, "Inspect")
    with page.expect_response("**/point?*ranking=10*") as answered:
        page.mouse.click(*at(page, 1.75, 3.75))
    point = answered.value.json()
    page.locator("#ranking").wait_for()
    best, second, *_ = point["ranking"]["triplets"]
    chosen = page.locator("#ranking-rows button[aria-pressed=true]")
    assert chosen.inner_text() == ", ".join(best["triplet"]) == ", ".join(point["triplet"])
    assert f"of {len(point['ranking']['landmarks'])} (" in page.locator("#place-values").inner_text()
    with page.expect_response("**/v1/fixes") as answered:
        page.click("#simulate")
    fixes = answered.value.json()
    assert fixes["landmarks"] == point["triplet"]
    assert fixes["predicted"]["area95_m2"] == pytest.approx(point["metrics"]["area95_m2"], rel=1e-3)
    words = page.locator("#cloud-words")
    words.get_by_text(f"{100 * fixes['share_inside']:.1f} % of 2000 simulated fixes").wait_for()
    assert f"predicted {100 * fixes['predicted_share']:.1f} %" in words.inner_text()
    page.locator("#ranking-rows button").nth(1).click()
    assert chosen.inner_text() == ", ".join(second["triplet"])
    assert words.inner_text() == "", "the cloud was that of another triplet"
    page.mouse.click(*at(page, 7.25, 3.25))
    page.locator("#place-words").get_by_text("No fix here").wait_for()
    assert "are too far): a fix needs three" in page.locator("#place-why").inner_text()
    assert not page.locator("#simulate").is_visible()


def test_landmarks_are_moved_added_and_removed_and_the_field_follows(page, real):
    streams = []
    load(page, real, hall_of(real, "edited", 2.2) + "&place=1.25,3.25&start=1,3&goal=7,3")
    page.on("request", lambda r: streams.append(r.url) if r.url.endswith("/events") else None)
    before = figures(page)
    choose(page, "Landmarks")
    x, y = at(page, 8, 0)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y - 60, steps=4)
    page.mouse.up()
    assert page.input_value("#mark-id") == "B"
    assert float(page.input_value("#mark-x")) < 8
    page.click("#mark-add")
    page.mouse.click(*at(page, 6, 1))
    added = page.input_value("#mark-id")
    page.select_option("#mark-choice", label="D")
    page.locator("#map").focus()
    page.keyboard.press("Delete")
    with page.expect_response(lambda r: r.request.method == "PUT") as answered:
        page.click("#marks-save")
    assert answered.value.status == 201
    assert answered.value.request.headers["if-match"].startswith('"')
    page.wait_for_selector("#job", state="visible")
    page.wait_for_selector("#job", state="hidden")
    page.locator("#field-choice option:checked", has_text="cell 0.5 m").wait_for(state="attached")
    assert figures(page) != before
    stored = real.client.get("/v1/maps/edited/landmarks").json()
    assert [m["id"] for m in stored["landmarks"]] == ["A", "B", "C", "E", "F", added]
    assert stored["map"] in page.url
    assert len(streams) == 1, "the progress comes as events"
    assert page.locator("#marks-save").is_disabled()
    assert float(page.input_value("#high")) > 0


def test_changes_of_two_people_are_both_kept(page, real):
    page.expected = ["status of 412"]
    load(page, real, hall_of(real, "shared", 2.3))
    page.locator("summary", has_text="Landmarks").click()
    page.select_option("#mark-choice", label="B")
    page.fill("#mark-x", "7.5")
    page.keyboard.press("Tab")
    address = "/v1/maps/shared/landmarks"
    held = real.client.get(address)
    theirs = held.json()
    theirs["landmarks"][0]["y_m"] = 0.25
    kept = real.client.put(address, json=theirs, headers={"If-Match": held.headers["etag"]})
    assert kept.status_code == 201
    page.click("#marks-save")
    page.wait_for_selector("#marks-trouble", state="visible")
    assert "not the newest version" in page.locator("#marks-trouble").inner_text()
    assert page.input_value("#mark-x") == "7.5", "nothing is lost"
    page.locator("#marks-trouble").get_by_role("button").click()
    page.wait_for_selector("#marks-trouble", state="hidden")
    page.locator("#said", has_text="newest version now").wait_for(state="attached")
    with page.expect_response(lambda r: r.request.method == "PUT") as answered:
        page.click("#marks-save")
    assert answered.value.status == 201
    marks = {m["id"]: m for m in real.client.get(address).json()["landmarks"]}
    assert (marks["A"]["y_m"], marks["B"]["x_m"]) == (0.25, 7.5)
    page.wait_for_selector("#bar", state="visible")  # the field of both


def test_landmarks_that_cannot_be_are_refused_in_words(page, real):
    page.expected = ["status of 422"]
    load(page, real, hall_of(real, "refused", 2.4))
    page.locator("summary", has_text="Landmarks").click()
    page.select_option("#mark-choice", label="B")
    page.fill("#mark-id", "A")
    page.keyboard.press("Tab")
    page.click("#marks-save")
    page.wait_for_selector("#marks-trouble", state="visible")
    assert "'A'" in page.locator("#marks-trouble").inner_text()
    page.click("#marks-discard")
    assert page.locator("#mark-choice option").all_inner_texts()[1:3] == ["A", "B"]


def test_a_field_over_headings_is_built_shown_and_asked(page, real):
    load(page, real, hall_of(real, "turning", 2.5))
    page.locator("summary", has_text="Build a field").click()
    assert not page.locator("#headings").is_visible(), "a laser sees the same at every heading"
    page.select_option("#sensor", "forward")
    page.fill("#headings", "8")
    page.fill("#resolution", "0.5")
    page.click("#build button")
    page.wait_for_selector("#heading-row", state="visible")
    page.locator("#bar-meaning", has_text="at the best heading").wait_for()
    choose(page, "Inspect")
    page.mouse.click(*at(page, 6.25, 3.25))
    page.locator("#place-headings-words", has_text="of 8 headings").wait_for()
    for which, words in (("worst", "worst heading"), ("mean", "mean over"), ("angle", "heading 0°")):
        with page.expect_response(lambda r: "/heatmap.png" in r.url and "heading=" in r.url) as answered:
            page.select_option("#heading-shown", which)
        assert answered.value.status == 200
        page.locator("#bar-meaning", has_text=words).wait_for()
    with page.expect_response("**/point?*theta_rad=0.78*") as answered:
        page.fill("#heading-angle", "45")
        page.keyboard.press("Tab")
    assert answered.value.json()["heading_rad"] == pytest.approx(np.pi / 4)
    page.locator("#place-words", has_text="heading 45.0°").wait_for()
    page.wait_for_url("**heading=0.785*")
    page.locator("summary", has_text="Display").click()
    array, name = content_of(page, "#get-npy")
    assert (np.load(io.BytesIO(array)).shape, name) == ((12, 16), "area95_m2.npy")
    picture, name = content_of(page, "#get-png")
    assert (Image.open(io.BytesIO(picture)).format, name) == ("PNG", "field.png")


def test_a_path_is_downloaded_as_picture_and_as_json(page, real):
    load(page, real, hall_of(real, "driven", 2.6) + "&start=1,3&goal=7,3")
    figures(page)
    picture, name = content_of(page, "#get-picture")
    assert (Image.open(io.BytesIO(picture)).format, name) == ("PNG", "plan.png")
    plan, name = content_of(page, "#get-plan")
    assert json.loads(plan)["plan"].startswith(name.removesuffix(".json"))
