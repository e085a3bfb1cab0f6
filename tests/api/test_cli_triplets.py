"""``surepath triplets``."""

from __future__ import annotations

import json
import math

import pytest

from localization.ranking import LandmarkStatus, TripletStatus
from localization.sensors import LASER
from localization.triplets import rank_triplets
from maps.io.load import load_world
from tests.api.test_cli import ROOM, run

FIXED = {"kind": "pinhole_fixed", "fov_deg": 150, "focal_px": 500, "column_sigma_px": 1}
MUTED = {
    "kind": "omnidirectional",
    "bearing_sigma_deg": 0.1,
    "min_range_m": 1.0,
    "max_range_m": 9.0,
    "muted": [{"begin_deg": 170, "end_deg": -100}],
    "mount": {"x_m": 0.5, "theta_deg": 0},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("triplets")
    (path / "room.geojson").write_text(json.dumps(ROOM))
    (path / "empty.geojson").write_text(json.dumps({**ROOM, "features": ROOM["features"][:2]}))
    (path / "fixed.json").write_text(json.dumps(FIXED))
    (path / "muted.json").write_text(json.dumps(MUTED))
    return path


def asked(capsys, *arguments):
    capsys.readouterr()
    assert run("triplets", *arguments, "--json") == 0
    return json.loads(capsys.readouterr().out)


def test_the_ranking_is_that_of_the_engine(folder, capsys):
    answer = asked(capsys, folder / "room.geojson", 2, 4, "--count", 3)
    ranked = rank_triplets(load_world(folder / "room.geojson"), LASER, (2.0, 4.0), count=3)
    assert [t["triplet"] for t in answer["triplets"]] == [["ABCDE"[i] for i in c.triplet] for c in ranked]
    for told, choice in zip(answer["triplets"], ranked, strict=True):
        assert told["area95_m2"] == choice.area95
        assert told["covariance"] == choice.covariance.tolist()
        assert told["pan_rad"] is None
    assert sum(answer["counts"].values()) == math.comb(5, 3)
    assert set(answer["counts"]) == {s.value for s in TripletStatus}
    assert answer["criterion"] == "area"
    assert answer["free"] is True


@pytest.mark.parametrize("criterion", ["area", "max_axis", "trace"])
def test_each_criterion_ranks_by_its_own(folder, capsys, criterion):
    found = asked(capsys, folder / "room.geojson", 3, 1, "--criterion", criterion)["triplets"]
    value = {
        "area": lambda t: t["area95_m2"],
        "max_axis": lambda t: t["ellipse95"]["a_m"],
        "trace": lambda t: t["covariance"][0] + t["covariance"][2],
    }[criterion]
    values = [value(t) for t in found]
    assert values == sorted(values)


def test_every_landmark_says_whether_it_can_be_measured(folder, capsys):
    answer = asked(
        capsys, folder / "room.geojson", 1, 0.5, "--sensor", folder / "muted.json", "--heading-deg", 90
    )
    status = {mark["id"]: mark["status"] for mark in answer["landmarks"]}
    # The sensor stands at (1, 1), looks along +y, and does not see from 170° to -100° off that.
    assert status == {"A": "measurable", "B": "too_far", "C": "too_far", "D": "measurable", "E": "muted"}
    by_id = {mark["id"]: mark for mark in answer["landmarks"]}
    assert by_id["A"]["distance_m"] == pytest.approx(math.sqrt(2))
    assert by_id["A"]["bearing_rad"] == pytest.approx(math.radians(135))
    assert by_id["E"]["bearing_rad"] == pytest.approx(math.atan2(-1, 5) - math.pi / 2)
    assert set(status.values()) <= {s.value for s in LandmarkStatus}


def test_what_is_hidden_or_out_of_view_is_said_in_words(folder, capsys):
    assert (
        run(
            "triplets", folder / "room.geojson", 2, 4, "--sensor", folder / "fixed.json", "--heading-deg", 180
        )
        == 0
    )
    text = " ".join(capsys.readouterr().out.split())
    assert "no: the camera cannot have it in view" in text
    assert "no fix: 2 landmarks can be measured" in text
    assert run("triplets", folder / "room.geojson", 2, 1) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "triplets, best first" in text
    assert "no: something opaque is in between" in text
    assert "triplets give a fix" in text


def test_too_far_is_counted(folder, capsys):
    assert run("triplets", folder / "room.geojson", 1, 4, "--sensor", folder / "muted.json") == 0
    assert "more are farther than 9 m" in " ".join(capsys.readouterr().out.split())


def test_a_place_that_is_not_free_is_explained(folder, capsys):
    assert run("triplets", folder / "room.geojson", 6, 4) == 0
    assert "is not free" in " ".join(capsys.readouterr().err.split())
    answer = asked(capsys, folder / "room.geojson", 6, 4)
    assert (answer["free"], answer["triplets"], answer["counts"]) == (False, [], None)


def test_a_map_without_landmarks_is_refused(folder, capsys):
    assert run("triplets", folder / "empty.geojson", 2, 4) == 1
    assert "0 landmarks; a fix needs 3" in " ".join(capsys.readouterr().err.split())


def test_one_triplet_has_its_rank_or_a_reason(folder, capsys):
    ranked = asked(capsys, folder / "room.geojson", 2, 4, "--count", 100)["triplets"]
    for rank, told in ((1, ranked[0]), (len(ranked), ranked[-1])):
        answer = asked(capsys, folder / "room.geojson", 2, 4, "--triplet", ",".join(told["triplet"]))
        assert answer["status"] == "fix"
        assert (answer["rank"], answer["of"]) == (rank, len(ranked))
        assert answer["fix"]["area95_m2"] == told["area95_m2"]
        assert 0 < answer["fix"]["validity"] <= 0.951
    muted = folder / "muted.json"
    told = asked(capsys, folder / "room.geojson", 2, 4, "--sensor", muted, "--count", 1)
    out = [x["id"] for x in told["landmarks"] if x["status"] != "measurable"]
    ok = [x["id"] for x in told["landmarks"] if x["status"] == "measurable"]
    three = [*out, *ok][:3]
    answer = asked(capsys, folder / "room.geojson", 2, 4, "--sensor", muted, "--triplet", ",".join(three))
    assert answer["status"] == "not_visible"
    assert answer["rank"] is None
    assert set(answer["blocking"]) == set(out) & set(three)
    assert (
        run("triplets", folder / "room.geojson", 2, 4, "--sensor", muted, "--triplet", ",".join(three)) == 0
    )
    assert "no fix" in capsys.readouterr().out
    assert run("triplets", folder / "room.geojson", 2, 4, "--triplet", "A,B") == 1
    assert "three different landmarks" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("50", "4"), ["(50, 4)", "outside"]),
        (("-1", "-2"), ["(-1, -2)", "outside"]),
        (("nan", "4"), ["finite"]),
        (("2", "4", "--heading-deg", "inf"), ["Heading", "finite"]),
        (("2", "4", "--criterion", "beauty"), ["beauty", "max_axis"]),
        (("2", "4", "--count", "0"), ["0", "1 to 10000"]),
        (("2", "4", "--count", "20000"), ["20000"]),
        (("2", "4", "--sensor", "sonar"), ["sonar", "laser"]),
        (("2",), ["Y"]),
        (("2", "4", "--cuont", "3"), ["--cuont"]),
    ],
)
def test_wrong_input_is_one_clear_line(folder, capsys, arguments, words):
    assert run("triplets", folder / "room.geojson", *arguments) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in said
    for word in words:
        assert word in said, said
