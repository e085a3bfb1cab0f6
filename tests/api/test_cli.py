from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from api.cli import main

ROOM = {
    "type": "FeatureCollection",
    "name": "room",
    "features": [
        {
            "type": "Feature",
            "properties": {"kind": "floor"},
            "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [12, 0], [12, 8], [0, 8], [0, 0]]]},
        },
        {
            "type": "Feature",
            "properties": {"kind": "obstacle", "opaque": True},
            "geometry": {"type": "Polygon", "coordinates": [[[5, 2], [7, 2], [7, 6], [5, 6], [5, 2]]]},
        },
        *(
            {
                "type": "Feature",
                "properties": {"kind": "landmark", "id": name},
                "geometry": {"type": "Point", "coordinates": xy},
            }
            for name, xy in {"A": [0, 0], "B": [12, 0], "C": [12, 8], "D": [0, 8], "E": [6, 0]}.items()
        ),
    ],
}


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    path = tmp_path_factory.mktemp("cli") / "room.geojson"
    path.write_text(json.dumps(ROOM))
    return path


@pytest.fixture(scope="module")
def field(room):
    path = room.with_name("room.zarr")
    assert run("field", room, "--resolution", "0.25", "-o", path) == 0
    return path


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


def width_of(path) -> int:
    with Image.open(path) as image:
        return image.width


def test_help_teaches_the_steps(capsys):
    assert run("--help") == 0
    text = capsys.readouterr().out
    for word in ("field", "heatmap", "plan", "serve", "demo", "Exit codes"):
        assert word in text


def test_world_check_says_what_the_map_holds(room, capsys):
    assert run("world", "check", room) == 0
    text = capsys.readouterr().out
    assert "88" in text  # free area: 12 x 8 - 2 x 4
    assert "5" in text


def test_world_check_fails_on_a_map_that_cannot_be_used(tmp_path, capsys):
    few = {**ROOM, "features": ROOM["features"][:4]}
    (tmp_path / "few.geojson").write_text(json.dumps(few))
    assert run("world", "check", tmp_path / "few.geojson") == 1
    assert "error" in capsys.readouterr().out


def test_world_check_draws_a_picture(room, tmp_path):
    assert run("world", "check", room, "--picture", tmp_path / "map.png") == 0
    assert width_of(tmp_path / "map.png") > 100


def test_field_then_heatmap(field, tmp_path, capsys):
    assert run("heatmap", field, "-o", tmp_path / "h.png", "--metric", "r95_m", "--width", 500) == 0
    assert width_of(tmp_path / "h.png") == 500
    assert "h.png" in capsys.readouterr().out


def test_plan_writes_the_answer_and_a_picture(field, tmp_path, capsys):
    code = run(
        *("plan", field, "--start", 2, 4, "--goal", 10, 4, "--radius", 0.3, "-o", tmp_path / "plan.json"),
        *("--picture", tmp_path / "plan.png"),
    )
    assert code == 0
    answer = json.loads((tmp_path / "plan.json").read_text())
    assert answer["status"] in {"exact", "approximate"}
    path = answer["routes"][0]["path"]
    assert (path[0]["x_m"], path[0]["y_m"]) == (2, 4)
    assert (path[-1]["x_m"], path[-1]["y_m"]) == (10, 4)
    length = sum(np.hypot(b["x_m"] - a["x_m"], b["y_m"] - a["y_m"]) for a, b in itertools.pairwise(path))
    assert length == pytest.approx(answer["routes"][0]["length_m"], rel=1e-3)
    assert answer["shortest_baseline"]["length_m"] <= answer["routes"][0]["length_m"] + 1e-6
    assert width_of(tmp_path / "plan.png") > 500
    assert "worst r95" in capsys.readouterr().out


def test_plan_prints_json_alone_when_asked(field, capsys):
    assert run("plan", field, "--start", 2, 4, "--goal", 4, 4, "--radius", 0.3, "-o", "-") == 0
    assert json.loads(capsys.readouterr().out)["routes"]


def test_the_same_seed_gives_the_same_answer(field, capsys):
    answers = []
    for _ in range(2):
        run("plan", field, "--start", 2, 4, "--goal", 10, 4, "--seed", 7, "--deadline", 20, "-o", "-")
        answers.append(json.loads(capsys.readouterr().out)["routes"])
    assert answers[0] == answers[1]


def test_a_bound_that_cannot_be_kept_is_an_answer_with_exit_code_3(field, tmp_path, capsys):
    out = tmp_path / "plan.json"
    code = run("plan", field, "--start", 2, 4, "--goal", 10, 4, "--max-r95", 1e-6, "-o", out)
    assert code == 3
    answer = json.loads(out.read_text())
    assert answer["status"] == "risk_unmet"
    assert answer["unmet"]
    assert "not met" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("field", "{room}", "--estimator", "worst", "-o", "{tmp}/f.zarr"), ["worst", "all_visible"]),
        (("field", "{room}", "--criterion", "beauty", "-o", "{tmp}/f.zarr"), ["beauty", "max_axis"]),
        (("field", "{room}", "--headings", "4", "-o", "{tmp}/f.zarr"), ["omnidirectional", "same at every"]),
        (
            ("field", "{room}", "--sensor", "forward", "--headings", "0", "-o", "{tmp}/f.zarr"),
            ["headings is 0", "1 to 720"],
        ),
        (
            ("field", "{room}", "--sensor", "forward", "--headings", "721", "-o", "{tmp}/f.zarr"),
            ["headings is 721"],
        ),
        (
            ("field", "{room}", "--headings", "4", "--heading-deg", "3", "-o", "{tmp}/f.zarr"),
            ["--heading-deg or --headings"],
        ),
        (("field", "{room}", "--heading-deg", "nan", "-o", "{tmp}/f.zarr"), ["nan", "finite"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--heading", "best"), ["one heading", "--headings N"]),
        (("field", "nowhere.yaml", "-o", "f.zarr"), ["no map at 'nowhere.yaml'", "warehouse"]),
        (("field", "{room}", "--sensor", "sonar", "-o", "{tmp}/f.zarr"), ["sonar", "laser"]),
        (("field", "{room}", "--resolution", "-1", "-o", "{tmp}/f.zarr"), ["-1"]),
        (("field", "{room}", "--resolution", "nan", "-o", "{tmp}/f.zarr"), ["nan"]),
        (("field", "{room}", "--resolution", "1e-7", "-o", "{tmp}/f.zarr"), ["limit"]),
        (("field", "{room}", "-o", "{tmp}/no/such/f.zarr"), ["does not exist"]),
        (("field", "warehouse", "--landmarks", "x.csv", "-o", "{tmp}/f.zarr"), ["its own landmarks"]),
        (("heatmap", "{tmp}/none.zarr", "-o", "{tmp}/h.png"), ["none.zarr"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--metric", "beauty"), ["beauty", "area95_m2"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--colormap", "jet2"), ["jet2", "viridis"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--width", "10000000"), ["10000000"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--height", "100"), ["colour bar", "130"]),
        (("heatmap", "{field}", "-o", "{tmp}/h.png", "--width", "-5"), ["-5"]),
        (("plan", "{field}", "--start", "2", "4", "--goal", "50", "4"), ["50", "outside"]),
        (("plan", "{field}", "--start", "6", "4", "--goal", "10", "4"), ["6", "4"]),
        (
            ("plan", "{field}", "--start", "2", "4", "--goal", "4.9", "4", "--radius", "0.3"),
            ["Goal (4.9, 4)", "needs 0.3 m", "nearest place"],
        ),
        (("plan", "{field}", "--start", "nan", "4", "--goal", "10", "4"), ["nan", "finite"]),
        (("plan", "{field}", "--start", "2", "4", "--goal", "10", "4", "--radius", "-1"), ["radius", "-1"]),
        (("plan", "{field}", "--start", "2", "4", "--goal", "10", "4", "--weight", "-2"), ["weight", "-2"]),
        (("plan", "{field}", "--start", "2", "4", "--goal", "10", "4", "--deadline", "0"), ["deadline", "0"]),
        (("plan", "{field}", "--start", "2", "4", "--goal", "10", "4", "--objective", "fun"), ["fun"]),
        (("plan", "{field}", "--goal", "10", "4"), ["--start"]),
        (("serve", "--host", "0.0.0.0"), ["0.0.0.0", "--insecure"]),
    ],
)
def test_wrong_input_is_one_clear_line_and_exit_code_1(arguments, words, room, field, tmp_path, capsys):
    values = {"room": str(room), "field": str(field), "tmp": str(tmp_path)}
    assert run(*(a.format(**values) for a in arguments)) == 1
    text = " ".join(capsys.readouterr().err.split())
    assert "error" in text
    assert "Traceback" not in text
    for word in words:
        assert word in text, text
    assert not list(tmp_path.iterdir()), "nothing was written"


def test_broken_sensor_file(room, tmp_path, capsys):
    sensor = tmp_path / "sensor.json"
    for text, word in (
        ('{"kind": "omnidirectional"', "JSON"),
        ('{"kind": "omnidirectional", "bearing_sigma_deg": -1}', "-1"),
        ('{"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "colour": "red"}', "colour"),
        ('{"kind": "sonar"}', "sonar"),
        ('{"kind": "omnidirectional", "bearing_sigma_deg": NaN}', ""),
    ):
        sensor.write_text(text)
        assert run("field", room, "--sensor", sensor, "-o", tmp_path / "f.zarr") == 1
        message = " ".join(capsys.readouterr().err.split())
        assert word in message, message
        assert "Traceback" not in message
    assert [p.name for p in tmp_path.iterdir()] == ["sensor.json"]


def test_a_sensor_file_is_read(room, tmp_path):
    sensor = tmp_path / "camera.json"
    sensor.write_text('{"kind": "pinhole_pan", "fov_deg": 90, "focal_px": 512, "column_sigma_px": 5}')
    assert run("field", room, "--sensor", sensor, "--resolution", 0.5, "-o", tmp_path / "f.zarr") == 0


def test_the_console_command_is_installed():
    command = Path(sys.executable).with_name("surepath")
    done = subprocess.run([command, "world", "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "check" in done.stdout


def test_plans_of_robots_with_a_heading(field, capsys):
    base = ("plan", field, "--start", 2, 2, "--goal", 8, 6, "--deadline", 20, "-o", "-")
    car = ("--kinematics", "reeds_shepp", "--min-turn-radius", 0.6, "--radius", 0.2)
    capsys.readouterr()
    assert run(*base, *car, "--start-heading-deg", 90, "--goal-heading-deg", 0) == 0
    answer = json.loads(capsys.readouterr().out)
    robot = answer["request"]["robot"]
    assert (robot["kinematics"], robot["min_turn_radius_m"]) == ("reeds_shepp", 0.6)
    path = answer["routes"][0]["path"]
    assert path[0]["theta_rad"] == pytest.approx(math.pi / 2, abs=1e-6)
    assert path[-1]["theta_rad"] == pytest.approx(0.0, abs=1e-6)
    assert answer["routes"][0]["trajectory"][0]["theta_rad"] == pytest.approx(math.pi / 2, abs=1e-6)
    outline = "-0.3,-0.2 0.5,-0.2 0.5,0.2 -0.3,0.2"
    assert run(*base, "--kinematics", "differential", "--footprint", outline) == 0
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["request"]["robot"]["footprint"]) == 4
    assert answer["routes"][0]["min_clearance_m"] > -0.05
    assert run(*base, "--footprint", "0,0 1,1") == 1
    assert "3 to 100 corners" in " ".join(capsys.readouterr().err.split())
    assert run(*base, "--kinematics", "dubins") == 1
    assert "needs a positive one" in " ".join(capsys.readouterr().err.split())
