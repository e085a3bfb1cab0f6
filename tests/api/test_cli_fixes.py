"""``surepath fixes``: what it prints, draws and refuses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from PIL import Image

from api.cli import main
from localization.covariance import area95
from localization.sensors import MAS97_CAMERA
from localization.simulation import simulate_fixes
from maps.io.site import bundled_site

PLACE = ("mas97_room", 9, 4, "--sensor", "mas97")


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


def answer(capsys, *arguments):
    assert run("fixes", *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out)


def test_json_is_what_the_library_finds(capsys):
    found = answer(capsys, *PLACE, "--triplet", "L13,L21,L22", "-n", 4000, "--seed", 5, "--heading-deg", 30)
    room = bundled_site("mas97_room")
    triplet = tuple(room.landmarks.ids.index(n) for n in ("L13", "L21", "L22"))
    cloud = simulate_fixes(
        room,
        MAS97_CAMERA,
        (9.0, 4.0),
        heading=math.radians(30),
        triplet=triplet,
        n=4000,
        rng=np.random.default_rng(5),
    )
    assert found["world"] == "mas97_room"
    assert found["triplet"] == ["L13", "L21", "L22"]
    assert found["pose"] == {"x_m": 9.0, "y_m": 4.0, "heading_rad": pytest.approx(math.radians(30))}
    assert (found["n"], found["seed"], found["failures"]) == (4000, 5, {})
    assert found["share_inside"] == cloud.share_inside == pytest.approx(0.95, abs=0.02)
    assert found["pan_rad"] == pytest.approx(cloud.pan)
    for name, covariance in (("predicted", cloud.predicted), ("sample", cloud.sample_covariance)):
        np.testing.assert_allclose(found[name]["pose_covariance"], covariance)
        area = area95(covariance[[0, 0, 1], [0, 1, 1]])
        ellipse = found[name]["ellipse95"]
        assert found[name]["area95_m2"] == pytest.approx(float(area))
        assert math.pi * ellipse["a_m"] * ellipse["b_m"] == pytest.approx(float(area))
        assert found[name]["sigma_heading_rad"] == pytest.approx(math.sqrt(covariance[2, 2]))
    assert list(found["bias"].values()) == pytest.approx(cloud.bias.tolist())


def test_the_best_triplet_is_the_default_and_the_seed_decides(capsys):
    first, second, other = (answer(capsys, *PLACE, "-n", 500, "--seed", s) for s in (1, 1, 2))
    assert first == second
    assert first["triplet"] == other["triplet"] == ["L21", "L22", "L23"]
    assert first["bias"] != other["bias"]


def test_table_and_picture(tmp_path, capsys):
    assert run("fixes", *PLACE, "-n", 2000, "-o", tmp_path / "fixes.png") == 0
    text = capsys.readouterr().out
    for word in ("inside 95 % ellipse", "predicted", "sample", "bias", "2000, 0 without a fix", "fixes.png"):
        assert word in text
    with Image.open(tmp_path / "fixes.png") as image:
        assert image.width == 1500


def test_json_stays_alone_on_stdout_with_a_picture(tmp_path, capsys):
    found = answer(capsys, *PLACE, "-n", 100, "-o", tmp_path / "fixes.png")
    assert found["n"] == 100
    assert (tmp_path / "fixes.png").exists()


def test_failures_are_counted_by_name(capsys):
    arguments = ("mas97_room", 4, 8, "--sensor", "mas97", "--triplet", "L09,L10,L23", "-n", 1000)
    found = answer(capsys, *arguments)
    assert set(found["failures"]) <= {"no_pose", "degenerate"}
    assert 100 < sum(found["failures"].values()) < 500
    assert found["share_inside"] < 0.3
    assert run("fixes", *arguments) == 0
    assert "no_pose" in capsys.readouterr().out


def test_one_fix_has_no_sample_covariance(capsys):
    found = answer(capsys, *PLACE, "-n", 1)
    assert found["sample"]["ellipse95"] is None
    assert found["sample"]["area95_m2"] is None
    assert run("fixes", *PLACE, "-n", 1) == 0
    assert "nan" not in capsys.readouterr().out


def test_negative_coordinates_are_coordinates(tmp_path, capsys):
    room = {
        "type": "FeatureCollection",
        "name": "below zero",
        "features": [
            {
                "type": "Feature",
                "properties": {"kind": "floor"},
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [[[-9, -9], [-1, -9], [-1, -1], [-9, -1], [-9, -9]]],
                },
            },
            *(
                {
                    "type": "Feature",
                    "properties": {"kind": "landmark", "id": name},
                    "geometry": {"type": "Point", "coordinates": at},
                }
                for name, at in {"A": [-9, -9], "B": [-1, -9], "C": [-5, -1]}.items()
            ),
        ],
    }
    path = tmp_path / "room.geojson"
    path.write_text(json.dumps(room))
    found = answer(capsys, path, "-4.5", "-.5e1", "-n", 10)
    assert found["pose"] == {"x_m": -4.5, "y_m": -5.0, "heading_rad": 0.0}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere", "1", "1"), ["no map at 'nowhere'", "mas97_room"]),
        (("mas97_room", "1"), ["Y"]),
        (("mas97_room", "1", "north"), ["Y", "valid number"]),
        (("mas97_room", "nan", "1"), ["nan", "finite"]),
        (("mas97_room", "1", "inf"), ["inf", "finite"]),
        (("mas97_room", "99", "1"), ["(99, 1)", "outside the map"]),
        (("mas97_room", "2", "8"), ["(2, 8)", "not free"]),
        (("mas97_room", "9", "4", "--heading-deg", "nan"), ["nan"]),
        (("mas97_room", "9", "4", "--sensor", "sonar"), ["sonar", "laser"]),
        (("mas97_room", "9", "4", "--triplet", "L01,L02"), ["L01,L02", "three different"]),
        (("mas97_room", "9", "4", "--triplet", "L01,L02,L02"), ["three different"]),
        (("mas97_room", "9", "4", "--triplet", "L01,L02,X9"), ["'X9'", "L01"]),
        (("mas97_room", "9", "4", "--triplet", "L13,L21,L19"), ["L19", "cannot be seen"]),
        (("mas97_room", "9", "4", "--sensor", "mas97", "--triplet", "L03,L13,L21"), ["do not fit"]),
        (("mas97_room", "9", "4", "-n", "0"), ["0", "10000000"]),
        (("mas97_room", "9", "4", "-n", "1000000000000"), ["1000000000000"]),
        (("mas97_room", "9", "4", "--seed", "-1"), ["seed", "0"]),
        (("mas97_room", "9", "4", "--sed", "1"), ["--sed"]),
        (("mas97_room", "9", "4", "-n", "10", "-o", "{tmp}/no/such.png"), ["such.png", "Could not write"]),
        (("warehouse", "6", "18", "--landmarks", "x.csv"), ["its own landmarks"]),
    ],
)
def test_wrong_input_is_one_clear_line_and_exit_code_1(arguments, words, tmp_path, capsys):
    assert run("fixes", *(a.format(tmp=tmp_path) for a in arguments)) == 1
    told = capsys.readouterr()
    text = " ".join(told.err.split())
    assert "error" in text
    assert "Traceback" not in text
    assert told.out == ""
    for word in words:
        assert word in text, text
    assert not list(tmp_path.iterdir()), "nothing was written"
