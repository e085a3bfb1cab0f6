"""Pictures of plans: outlines along the way, stretches of a schedule, areas and places of the question."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from PIL import Image

from api.canvas import InvalidPicture
from api.cli import main
from api.plan_picture import plan_png
from api.pose_picture import _BACKWARDS, _FORWARDS, outline_of, pose_png, poses_of
from api.schedule_picture import _COLORS, _TURNING, looks, schedule_png
from localization.field_builder import build_field
from localization.io.field_file import save_field
from localization.sensors import LASER, MAS97_CAMERA
from maps.io.site import bundled_site
from planner.problem import PlanningProblem

OUTLINE = "0.8,0.4 0.8,-0.4 -0.4,-0.4 -0.4,0.4"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("fields")
    for name, sensor in (("laser", LASER), ("camera", MAS97_CAMERA)):
        save_field(build_field(bundled_site("mas97_room"), sensor, resolution=0.25), path / f"{name}.zarr")
    return path


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


def planned(folder, field, *arguments, code=0):
    answer, picture = folder / "plan.json", folder / "plan.png"
    ends = ("-o", answer, "--picture", picture, "--deadline", 3)
    assert run("plan", folder / f"{field}.zarr", *arguments, *ends) == code
    with Image.open(picture) as image:
        return json.loads(answer.read_text()), np.asarray(image.convert("RGB")).astype(int)


def share_of(pixels, color) -> float:
    return float((np.abs(pixels - np.array(color)).max(axis=-1) < 12).mean())


def test_a_car_that_reverses_has_both_colours(folder):
    answer, pixels = planned(
        folder, "laser", "--start", 4, 4.5, "--goal", 3, 5, "--kinematics", "reeds_shepp",
        "--min-turn-radius", 1, "--start-heading-deg", 0, "--goal-heading-deg", 0, "--objective", "shortest",
    )  # fmt: skip
    gear = poses_of(answer["routes"][0]).gear
    assert {1.0, -1.0} <= set(gear.tolist())
    assert share_of(pixels, _FORWARDS) > 1e-4
    assert share_of(pixels, _BACKWARDS) > 1e-4


def test_outlines_are_those_of_the_robot(folder):
    problem = PlanningProblem((0.0, 0.0), (1.0, 1.0), 0.3)
    assert np.hypot(*outline_of(problem).T) == pytest.approx(0.3)
    answer, pixels = planned(
        folder, "laser", "--start", 2.2, 5.6, "--goal", 2.4, 10.8, "--footprint", OUTLINE,
        "--kinematics", "differential",
    )  # fmt: skip
    assert pixels.shape[1] == 1100
    assert share_of(pixels, _FORWARDS) > 1e-3
    motion = poses_of(answer["routes"][0])
    assert motion.poses[-1, :2] == pytest.approx([2.4, 10.8])


def test_without_headings_a_robot_faces_the_way_that_it_drives():
    rows = [{"x_m": 0.1 * k, "y_m": 0.0, "vx_m_s": 1.0, "vy_m_s": 0.0} for k in range(5)]
    motion = poses_of({"trajectory": [*rows, rows[-1]]})
    assert motion.poses[:, 2] == pytest.approx(0.0)
    assert (motion.gear == 1).all()
    back = [{**row, "theta_rad": math.pi} for row in rows]
    assert (poses_of({"trajectory": back}).gear == -1).all()


def test_a_plan_that_does_not_exist_is_drawn_too(folder):
    answer, pixels = planned(
        folder, "laser", "--start", 2.2, 5.6, "--goal", 2.4, 10.8, "--kinematics", "reeds_shepp",
        "--min-turn-radius", 6, "--max-r95", 1e-4, "--avoid", _avoid(folder), code=3,
    )  # fmt: skip
    assert answer["routes"] == []
    assert share_of(pixels, _FORWARDS) < 1e-4


def test_a_schedule_has_a_colour_for_every_triplet(folder):
    answer, pixels = planned(
        folder, "camera", "--start", 2, 3, "--goal", 12, 11, "--blind-r95", 1, "--schedule"
    )
    triplets = {tuple(sorted(s["triplet"])) for s in answer["routes"][0]["schedule"] if s["triplet"]}
    for color in _COLORS[: min(len(triplets), len(_COLORS))]:
        assert share_of(pixels, color) > 1e-4
    at_once = share_of(pixels, _TURNING)
    assert at_once < 1e-3, "edges of letters"
    slow, pixels = planned(
        folder,
        "camera",
        "--start",
        2,
        3,
        "--goal",
        12,
        11,
        "--blind-r95",
        1,
        "--schedule",
        "--pan-rate-deg",
        60,
    )
    route = slow["routes"][0]
    assert share_of(pixels, _TURNING) > at_once + 2e-3
    assert looks(route["schedule"]).count(None) == sum(x["kind"] != "fix" for x in route["schedule"])
    assert max(filter(None, looks(route["schedule"]))) == sum(x["kind"] == "fix" for x in route["schedule"])
    assert route["schedule_figures"]["turning_s"] > 0
    [warning] = [w for w in slow["warnings"] if "pans at 60°/s" in w]
    assert f"{route['uncertainty']['blind_m']:.1f} m, as if it turned at once" in warning
    field = build_field(bundled_site("mas97_room"), LASER, resolution=0.5)
    answer["routes"][0]["schedule"] = None
    with pytest.raises(InvalidPicture, match="no schedule"):
        schedule_png(field, answer)


def _avoid(folder):
    """The room cut in two."""
    path = folder / "avoid.geojson"
    ring = [[0, 9.2], [15, 9.2], [15, 9.8], [0, 9.8], [0, 9.2]]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def test_areas_and_via_points_are_marked(folder):
    areas = folder / "areas.geojson"
    ring = [[3, 1], [5, 1], [5, 3], [3, 3], [3, 1]]
    feature = {"type": "Feature", "properties": {"factor": 3}, "geometry": None}
    areas.write_text(json.dumps({**feature, "geometry": {"type": "Polygon", "coordinates": [ring]}}))
    plain = ("--start", 2, 4.5, "--goal", 13, 4.5, "--via", "8.5,8")
    answer, marked = planned(folder, "laser", *plain, "--areas", areas, "--avoid", _avoid(folder))
    field = build_field(bundled_site("mas97_room"), LASER, resolution=0.25)
    answer["request"] |= {"avoid": [], "areas": [], "via": []}
    with Image.open(io.BytesIO(plan_png(field, answer))) as image:
        bare = np.asarray(image.convert("RGB")).astype(int)
    changed = (np.abs(marked - bare).max(axis=-1) > 30).mean()
    assert 0.005 < changed < 0.2


def test_the_shortest_plan_is_not_drawn_twice(folder):
    answer, pixels = planned(
        folder, "laser", "--start", 2, 4.5, "--goal", 13, 4.5, "--objective", "shortest", "--blind-r95", 1
    )
    assert answer["shortest_baseline"] is not None
    assert share_of(pixels, (214, 79, 12)) < 1e-4


def test_a_matrix_has_a_picture(folder):
    places = folder / "places.csv"
    places.write_text("id,x,y\na,2,4.5\nb,13,4.5\nc,8.5,8\nwall,2,8\n")
    picture = folder / "matrix.png"
    assert run("matrix", folder / "laser.zarr", "--points", places, "--picture", picture) == 0
    with Image.open(picture) as image:
        assert image.width == 1300
        assert image.height > 300


def test_headings_of_a_field_are_drawn_with_outlines(folder):
    field = build_field(bundled_site("mas97_room"), LASER, resolution=0.5)
    problem = PlanningProblem((2.0, 4.5), (5.0, 5.0), 0.3)
    request = {"start": {}, "goal": {}}
    empty = {"status": "timeout", "routes": [], "request": request, "unmet": []}
    with Image.open(io.BytesIO(pose_png(field, empty, problem, width=400))) as image:
        assert image.width == 400
