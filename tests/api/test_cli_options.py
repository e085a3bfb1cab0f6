"""Options that commands share: what they accept, and that they reach the planner."""

from __future__ import annotations

import json
import math

import pytest

from api.answers_plan import Plan
from api.cli_options import odometry_of, place_of, start_covariance_of, travel_of
from localization.motion import OdometryModel
from planner.errors import InvalidProblem
from tests.api.test_cli import field, room, run  # noqa: F401

AREA = {
    "type": "Feature",
    "properties": {"factor": 3.0},
    "geometry": {"type": "Polygon", "coordinates": [[[5, -1], [7, -1], [7, 20], [5, 20], [5, -1]]]},
}


@pytest.fixture
def across(tmp_path):
    path = tmp_path / "across.geojson"
    path.write_text(json.dumps(AREA))
    return path


def test_what_is_known_of_the_start():
    assert start_covariance_of(None, None) is None
    given = (0.01, 0.0, 0.02, 0.0, 0.0, 0.03)
    assert start_covariance_of(None, given) == given
    assert start_covariance_of((0.1, 2.0), None) == pytest.approx((0.01, 0, 0.01, 0, 0, math.radians(2) ** 2))
    with pytest.raises(InvalidProblem, match="not both"):
        start_covariance_of((0.1, 2.0), given)
    with pytest.raises(InvalidProblem, match="must be positive"):
        start_covariance_of((0.0, 2.0), None)
    assert odometry_of("slip=0.1") == OdometryModel(slip_sigma=0.1)


def test_places_are_named_as_what_they_are():
    assert place_of("1.5,-2", "The via point", "--via 1,2") == (1.5, -2.0)
    with pytest.raises(InvalidProblem, match=r"Corner 2 of the footprint is '0.5'; give X,Y"):
        place_of("0.5", "Corner 2 of the footprint", "1,2")


def test_travel(across):
    options = {"radius": 0.3, "max_ellipse95": 0.2, "max_collision_probability": 0.01}
    made = travel_of(objective="weighted", weight=3.0, avoid=across, areas=across, **options)
    assert (made.weight, made.max_ellipse95, made.max_collision_probability) == (3.0, 0.2, 0.01)
    assert len(made.avoid) == 1
    assert made.areas[0][1] == 3.0
    assert travel_of(objective="shortest", weight=3.0, avoid=None, areas=None, radius=0.3).weight == 0.0
    with pytest.raises(InvalidProblem, match=r"'minimax'.*weighted or shortest"):
        travel_of(objective="minimax", weight=3.0, avoid=None, areas=None, radius=0.3)


def test_matrix_and_reach_take_what_the_service_takes(field, across, tmp_path, capsys):  # noqa: F811
    (tmp_path / "p.json").write_text("[[2, 4], [10, 4]]")
    ask = ("matrix", field, "--points", tmp_path / "p.json", "-o", "-")
    assert run(*ask, "--objective", "shortest") == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["cost"][0][1] == pytest.approx(plain["length_m"][0][1])
    assert run(*ask, "--objective", "shortest", "--areas", across) == 0
    assert json.loads(capsys.readouterr().out)["cost"][0][1] > plain["cost"][0][1] + 3.0
    assert run(*ask, "--avoid", across) == 0
    assert json.loads(capsys.readouterr().out)["cost"][0][1] is None
    assert run(*ask, "--max-ellipse95", 1e-7) == 3
    assert json.loads(capsys.readouterr().out)["cost"][0][1] is None
    reach = ("reach", field, "--from", 2, 4, "--radius", 0.3)
    areas = []
    for more in ((), ("--avoid", across), ("--max-ellipse95", 0.03)):
        assert run(*reach, *more) == 0
        areas.append(float(capsys.readouterr().out.split("reach: ")[1].split()[0]))
    assert areas[1] < 0.6 * areas[0]
    assert 0 < areas[2] < areas[0]
    assert run(*reach, "--objective", "minimax") == 1


def test_reach_says_when_the_place_itself_breaks_a_bound(field, capsys):  # noqa: F811
    for option, words in (
        ("--max-r95", "r95 is"),
        ("--max-ellipse95", "semi-major axis"),
        ("--max-collision-probability", "the collision probability is"),
    ):
        near_wall = ("--from", 5.2, 4, "--radius", 0.3) if "coll" in option else ("--from", 2, 4)
        code = run("reach", field, *near_wall, option, 1e-9)
        said = capsys.readouterr()
        assert code in {1, 3}
        if code == 3:
            assert "0.0 m²" in said.out
            assert "No way can begin" in said.err
            assert words in said.err


def test_plan_takes_odometry_and_the_start(field, tmp_path, capsys):  # noqa: F811
    out = tmp_path / "plan.json"
    ask = ("plan", field, "--start", 2, 4, "--goal", 4, 4, "--radius", 0.3, "--deadline", 10, "-o", out)
    assert run(*ask, "--odometry", "distance=0.05", "--fix-rate", 2, "--start-sigma", 0.1, 2) == 0
    request = json.loads(out.read_text())["request"]
    assert request["robot"]["odometry"]["distance_sigma_m"] == 0.05
    assert request["robot"]["fix_rate_hz"] == 2
    assert request["start"]["covariance"][0] == pytest.approx(0.01)
    six = (0.01, -0.001, 0.02, 0.0, 0.0, 0.001)
    assert run(*ask, "--start-covariance", *six) == 0
    assert json.loads(out.read_text())["request"]["start"]["covariance"] == list(six)
    capsys.readouterr()
    assert run(*ask, "--footprint", "0.5 0.5") == 1
    said = capsys.readouterr().err
    assert "footprint" in said
    assert "via" not in said


def test_what_blocks_the_way_is_in_the_answer(field, across, tmp_path, capsys):  # noqa: F811
    out = tmp_path / "plan.json"
    ask = ("plan", field, "--start", 2, 4, "--goal", 10, 4, "-o", out)
    assert run(*ask, "--avoid", across, "--radius", 0.3) == 3
    answer = json.loads(out.read_text())
    Plan.model_validate(answer)
    assert answer["status"] == "no_path"
    assert answer["blocked"]["avoid"] == [0]
    assert answer["blocked"]["largest_radius_m"] == 0.0
    assert answer["blocked"]["largest_radius_without_avoid_m"] == pytest.approx(1.0, abs=1e-4)
    assert "avoid area 1 closes every way" in " ".join(capsys.readouterr().out.split())
    assert run(*ask, "--radius", 1.2) == 3
    answer = json.loads(out.read_text())
    blocked = answer["blocked"]
    assert (blocked["radius_m"], blocked["between"], blocked["avoid"]) == (1.2, ["wall", "wall"], [])
    assert blocked["largest_radius_m"] == pytest.approx(1.0, abs=1e-4)
    assert min(abs(blocked["place"]["y_m"] - y) for y in (1.0, 7.0)) < 1e-3
    assert "A radius of up to 1 m passes" in " ".join(capsys.readouterr().out.split())
    assert run(*ask, "--radius", 0.3) == 0
    assert json.loads(out.read_text())["blocked"] is None
