"""``surepath simulate``: what it prints, writes, draws and refuses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from PIL import Image

from api.cli import main
from api.cli_options import odometry_of
from api.codec import DocumentError
from api.codec_simulation import radius_of_answer, trajectory_of_answer
from localization.field_builder import build_field, build_heading_field
from localization.io.field_file import load_field, save_field
from localization.motion import OdometryModel
from localization.sensors import FORWARD_CAMERA, LASER
from maps.io.site import bundled_site
from planner.errors import InvalidProblem
from planner.simulation import SimulatedRobot, simulate


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A field of the room and a plan on it."""
    folder = tmp_path_factory.mktemp("simulate")
    save_field(build_field(bundled_site("mas97_room"), LASER, resolution=0.25), folder / "room.zarr")
    plan = ["plan", folder / "room.zarr", "--start", 1, 1, "--goal", 13.9, 13.9, "--radius", 0.3]
    assert run(*plan, "-o", folder / "plan.json") == 0
    return folder / "room.zarr", folder / "plan.json"


def simulated(capsys, files, *options):
    capsys.readouterr()
    assert run("simulate", files[0], "--plan", files[1], *options, "-o", "-") == 0
    return json.loads(capsys.readouterr().out)


def test_the_report_is_what_the_library_finds(capsys, files):
    found = simulated(capsys, files, "--runs", 60, "--seed", 4, "--odometry", "drift=0.02,slip=0.01")
    field = load_field(files[0])
    report = simulate(
        field.world,
        field.sensor,
        trajectory_of_answer(json.loads(files[1].read_text())),
        robot=SimulatedRobot(radius=0.3, odometry=OdometryModel(drift_sigma=0.02, slip_sigma=0.01)),
        runs=60,
        rng=np.random.default_rng(4),
        field=field,
    )
    assert found["runs"] == 60
    assert found["plan"].startswith("p_")
    assert found["robot"]["radius_m"] == 0.3
    assert found["robot"]["odometry"]["slip_sigma"] == 0.01
    assert found["collisions"]["count"] == report.collisions
    assert found["ellipse95"]["claimed"]["share"] == report.coverage.share
    assert found["goal_error"]["median_m"] == pytest.approx(np.nanmedian(report.goal_error))
    assert len(found["stations"]) == len(report.stations.s)
    last = found["stations"][-1]
    assert last["s_m"] == pytest.approx(found["length_m"])
    assert last["predicted_r95_m"] == report.stations.predicted_r95[-1]
    assert last["runs"] == 60 - report.collisions
    assert last["displaced_collision_low"] <= last["displaced_collision"] <= last["displaced_collision_high"]


def test_tables_reports_and_pictures(capsys, files, tmp_path):
    report, picture = tmp_path / "report.json", tmp_path / "picture.png"
    options = ("--runs", 30, "--mode", "fix", "-o", report, "--picture", picture)
    assert run("simulate", files[0], "--plan", files[1], *options) == 0
    printed = capsys.readouterr().out
    for word in ("30 of", "collisions", "off the goal", "NEES", "due fixes missed", "report.json"):
        assert word in printed
    assert json.loads(report.read_text())["robot"]["mode"] == "fix"
    with Image.open(picture) as image:
        assert image.size[0] == 1400


def test_a_radius_of_its_own_and_a_start_that_is_hardly_known(capsys, files):
    found = simulated(capsys, files, "--runs", 40, "--radius", 0.9, "--start-sigma", 0.2, 5)
    assert found["robot"]["radius_m"] == 0.9
    assert found["collisions"]["count"] > 0
    place = found["collisions"]["places"][0]
    assert 0 <= place["s_m"] <= found["length_m"]
    first = found["stations"][0]["predicted_ellipse95"]
    assert first["a_m"] == pytest.approx(0.2 * math.sqrt(-2 * math.log(0.05)))


def test_cameras_are_driven_on_fields_of_one_heading_and_of_many(capsys, files, tmp_path):
    room = bundled_site("mas97_room")
    one, many = tmp_path / "one.zarr", tmp_path / "many.zarr"
    save_field(build_field(room, FORWARD_CAMERA, resolution=0.5), one)
    save_field(build_heading_field(room, FORWARD_CAMERA, resolution=0.5, headings=12), many)
    options = ("--runs", 5, "--start-sigma", 0.05, 1)
    for field in (one, many):
        found = simulated(capsys, (field, files[1]), *options)
        assert 0 < found["blind"]["time_share"] < 1
    assert run("simulate", one, "--plan", files[1], *options) == 0
    assert "one heading" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--runs", 0), "from 1 to 100000"),
        (("--odometry", "speed=1"), "odometry"),
        (("--odometry", "drift=fast"), "give a number"),
        (("--odometry", "drift=0.1,drift=0.2"), "each once"),
        (("--odometry", "drift=-1"), "must be ≥ 0"),
        (("--mode", "guess"), "mode"),
        (("--policy", "forced_forward"), "camera"),
        (("--steering", "legs"), "steering"),
        (("--radius", "-2"), "radius"),
        (("--fix-rate", "nan"), "fix_rate"),
        (("--start-sigma", "0", "1"), "must be positive"),
    ],
)
def test_wrong_options_are_refused(capsys, files, options, message):
    assert run("simulate", files[0], "--plan", files[1], *options) == 1
    assert message in capsys.readouterr().err


def test_wrong_plans_are_refused(capsys, files, tmp_path):
    good = json.loads(files[1].read_text())
    bad = tmp_path / "plan.json"
    samples = good["routes"][0]["trajectory"]
    for answer, message in [
        ({}, "no 'routes'"),
        ({**good, "routes": []}, "no route"),
        ({**good, "routes": [{}]}, "no 'trajectory'"),
        ({**good, "routes": [{"trajectory": [*samples[:2], {"t_s": 1}]}]}, "Sample 2"),
        ({**good, "request": {}}, "give --radius"),
        ({**good, "map": "m_other"}, "another map"),
    ]:
        bad.write_text(json.dumps(answer))
        assert run("simulate", files[0], "--plan", bad) == 1
        assert message in capsys.readouterr().err.replace("\n", " ")
    assert run("simulate", files[0], "--plan", tmp_path / "none.json") == 1
    assert run("simulate", tmp_path / "none.zarr", "--plan", files[1]) == 1


def test_trajectories_of_answers():
    sample = dict.fromkeys(("t_s", "x_m", "y_m", "vx_m_s", "vy_m_s", "ax_m_s2", "ay_m_s2"), 1.0)
    t = trajectory_of_answer({"routes": [{"trajectory": [sample, {**sample, "t_s": 2}]}]})
    np.testing.assert_array_equal(t.t, [1, 2])
    assert t.points.shape == (2, 2)
    with pytest.raises(DocumentError, match="Sample 0"):
        trajectory_of_answer({"routes": [{"trajectory": [{**sample, "x_m": True}]}]})
    with pytest.raises(DocumentError, match="radius"):
        radius_of_answer({"request": {"robot": {"radius_m": "wide"}}})


def test_odometry_in_words():
    assert odometry_of("turn=0.1, drift=0") == OdometryModel(turn_sigma=0.1, drift_sigma=0.0)
    with pytest.raises(InvalidProblem):
        odometry_of("")
