"""The page in a browser: what people do, without an error in the console or a request to another host."""

from __future__ import annotations

import os
import re
import shutil
import threading
import time
from types import SimpleNamespace

import pytest
import uvicorn

import api.app
from tests.api.conftest import ROOM, IdleJobs, InlinePool, finish, ready_field, small_settings

driver = pytest.importorskip("playwright.sync_api", reason="the driver is missing: pip install playwright")
CHROMIUM = os.environ.get("SUREPATH_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
if CHROMIUM is None:
    pytest.skip("no Chromium here; SUREPATH_CHROMIUM names one", allow_module_level=True)
# Service and test share a process here, and filters of warnings are not made for two threads.
pytestmark = pytest.mark.filterwarnings("ignore")
SOON_MS = 15_000


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A service with a room and a ready field, on a port of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api.app, "JobRunner", IdleJobs)
        app = api.app.create_app(small_settings(tmp_path_factory.mktemp("page")), pool=InlinePool())
        server = uvicorn.Server(uvicorn.Config(app, port=0, log_config=None, access_log=False))
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        until = time.monotonic() + 20
        while not server.started and time.monotonic() < until:
            time.sleep(0.02)
    port = server.servers[0].sockets[0].getsockname()[1]
    base = f"http://127.0.0.1:{port}"
    try:
        yield SimpleNamespace(base=base, app=app, **vars(put_room(base, app)))
    finally:
        server.should_exit = True
        thread.join(20)


def put_room(base, app):
    """A room and its field, through the running service."""
    import httpx

    with httpx.Client(base_url=base) as client:
        client.app = app
        map_id = client.post("/v1/maps", json=ROOM).json()["map"]
        return ready_field(client, map_id)


@pytest.fixture(scope="module")
def browser():
    with driver.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def page(browser, served):
    """An open page; the test fails on what the console complains about and on requests elsewhere."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    opened = context.new_page()
    opened.set_default_timeout(SOON_MS)
    complaints: list[str] = []
    opened.expected = []
    opened.on("console", lambda m: complaints.append(m.text) if m.type in {"error", "warning"} else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on(
        "request",
        lambda r: (
            complaints.append(r.url) if not r.url.startswith((served.base + "/", "data:", "blob:")) else None
        ),
    )
    yield opened
    context.close()
    assert [c for c in complaints if not any(re.search(e, c) for e in opened.expected)] == []


def load(page, served, fragment=""):
    page.goto(f"{served.base}/{fragment}")
    page.wait_for_selector("#bar", state="visible")
    page.wait_for_url("**view=*")


def at(page, x, y):
    """Where a place of the map is on the screen, by the permalink."""
    page.wait_for_timeout(400)  # the link follows the view a moment later
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


def test_the_ranking_of_a_service_that_has_one_is_shown(page, served):
    def ranked(route):
        answer = route.fetch().json()
        if answer["state"] == "fix":
            other = {"triplet": ["A", "B", "D"], "area95_m2": 0.5, "pan_rad": None}
            best = {**other, "triplet": answer["triplet"], "area95_m2": answer["metrics"]["area95_m2"]}
            ellipse = {"a_m": 0.5, "b_m": 0.3, "theta_rad": 0.1}
            answer["ranking"] = [{**best, "ellipse95": answer["ellipse95"]}, {**other, "ellipse95": ellipse}]
            answer["reasons"] = ["The landmarks stand close to one line."]
        route.fulfill(json=answer)

    page.route("**/point?*", ranked)
    load(page, served, "#place=1.25,3.25")
    page.locator("#ranking").wait_for()
    assert "one line" in page.locator("#place-why").inner_text()
    page.locator("#ranking-rows").get_by_role("button").nth(1).click()
    assert "A, B, D" in page.locator("#said").text_content()
    assert page.locator("#ranking-rows button[aria-pressed=true]").inner_text() == "A, B, D"


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


def test_landmarks_are_moved_and_an_older_service_says_that_it_cannot_keep_them(page, served):
    page.expected = ["status of 40[45]"]
    load(page, served)
    page.route("**/v1/maps/*/landmarks", older)
    page.locator("summary", has_text="Landmarks").click()
    page.locator("#tools").get_by_text("Landmarks").click()
    x, y = at(page, 8, 6)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y + 60, steps=4)
    page.mouse.up()
    assert page.input_value("#mark-id") == "C"
    assert float(page.input_value("#mark-x")) < 8
    page.click("#marks-save")
    page.wait_for_selector("#marks-trouble", state="visible")
    assert "cannot be changed here" in page.locator("#marks-trouble").inner_text()


def test_changed_landmarks_are_a_new_version_with_a_field_of_its_own(page, served):
    """The contract of PUT …/landmarks, played by an upload."""
    sent = []

    def stored(route):
        if route.request.method != "PUT":
            return route.continue_()
        sent.append(route.request)
        moved = {m["id"]: [m["x_m"], m["y_m"]] for m in route.request.post_data_json["landmarks"]}
        walls = [f for f in ROOM["features"] if f["properties"]["kind"] != "landmark"]
        marks = [
            {
                "type": "Feature",
                "properties": {"kind": "landmark", "id": name},
                "geometry": {"type": "Point", "coordinates": place},
            }
            for name, place in moved.items()
        ]
        answer = page.request.post(f"{served.base}/v1/maps", data={**ROOM, "features": walls + marks})
        return route.fulfill(status=201, json=answer.json())

    page.route("**/v1/maps/*/landmarks", stored)
    load(page, served, f"#map={served.map}&field={served.id}&place=1.25,3.25&start=1,3&goal=7,3")
    figures(page)
    page.locator("summary", has_text="Landmarks").click()
    page.select_option("#mark-choice", label="B")
    page.fill("#mark-x", "7.5")
    page.keyboard.press("Tab")
    with page.expect_response(
        lambda r: r.url.endswith("/v1/fields") and r.request.method == "POST"
    ) as answered:
        page.click("#marks-save")
    assert sent[0].headers["if-match"].startswith('"')
    page.wait_for_selector("#job", state="visible")
    finish(SimpleNamespace(app=served.app), answered.value.json()["job"])
    page.wait_for_selector("#job", state="hidden")
    figures(page)
    page.locator("#place-values").get_by_text("Best triplet").wait_for()
    assert page.locator("#marks-save").is_disabled()
    assert float(page.input_value("#high")) > 0


def older(route):
    if route.request.method == "PUT":
        assert route.request.headers["if-match"].startswith('"')
        route.fulfill(
            status=405, content_type="application/problem+json", body='{"title": "no", "status": 405}'
        )
    else:
        route.continue_()


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
