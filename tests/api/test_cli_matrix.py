"""``surepath matrix`` and ``surepath reach``: files in, files out, exit codes."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
import shapely
from PIL import Image

from api.reach_picture import reach_png
from planner.reachability import reachable_region
from planner.travel import Travel
from tests.api.test_cli import field, room, run  # noqa: F401
from tests.planner.test_matrix import CLOSED, context_of, places


@pytest.fixture
def stations(tmp_path):
    path = tmp_path / "stations.csv"
    path.write_text("id,x,y\ndock,1.0,1.0\nshelf,11.0,7.0\nwall,6.0,4.0\n")
    return path


def test_matrix_of_a_file(field, stations, tmp_path, capsys):  # noqa: F811
    assert run("matrix", field, "--points", stations, "-o", tmp_path / "matrix.json") == 0
    document = json.loads((tmp_path / "matrix.json").read_text())
    assert [p["status"] for p in document["sources"]] == ["ok", "ok", "occupied"]
    assert 12.0 < document["length_m"][0][1] < 14.0
    assert document["length_m"][0][2] is None
    said = capsys.readouterr().out
    assert "3 × 3 pairs, 4 with a way, by 1 searches" in said
    assert "Place 3 at (6, 4) m" in said
    assert run("matrix", field, "--points", stations, "-o", tmp_path / "matrix.npy") == 0
    array = np.load(tmp_path / "matrix.npy")
    assert array.shape == (6, 3, 3)
    assert array[1, 0, 1] == document["length_m"][0][1]
    assert run("matrix", field, "--points", stations, "-o", tmp_path / "matrix.csv") == 0
    assert (tmp_path / "matrix.csv").read_text().startswith("source,target,cost,length_m")


def test_matrix_to_other_places_on_stdout(field, stations, tmp_path, capsys):  # noqa: F811
    (tmp_path / "to.json").write_text("[[2, 7], [10, 1]]")
    assert run("matrix", field, "--points", stations, "--targets", tmp_path / "to.json", "-o", "-") == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["cost"]) == 3
    assert [p["id"] for p in document["targets"]] == ["1", "2"]


def test_matrix_without_any_way(field, tmp_path, capsys):  # noqa: F811
    (tmp_path / "p.json").write_text("[[6, 4], [6, 4.5]]")
    assert run("matrix", field, "--points", tmp_path / "p.json") == 3
    assert "too close" in capsys.readouterr().out


def test_mistakes_of_matrix(field, stations, tmp_path, capsys):  # noqa: F811
    assert run("matrix", field, "--points", tmp_path / "none.csv") == 1
    assert run("matrix", field, "--points", stations, "-o", tmp_path / "matrix.xlsx") == 1
    assert run("matrix", field, "--points", stations, "--radius", "-1") == 1
    said = capsys.readouterr().err
    for words in ("none.csv", ".json, .csv or .npy", "radius"):
        assert words in said


def test_region_as_geojson_and_picture(field, tmp_path, capsys):  # noqa: F811
    out, picture = tmp_path / "region.geojson", tmp_path / "region.png"
    code = run("reach", field, "--from", "1", "1", "--max-length", "4", "-o", out, "--picture", picture)
    assert code == 0
    (feature,) = json.loads(out.read_text())["features"]
    shape = shapely.geometry.shape(feature["geometry"])
    assert shape.contains(shapely.Point(1, 1))
    assert shape.bounds[2] == pytest.approx(5.0, abs=0.3)
    with Image.open(picture) as image:
        assert image.width == 1500
    assert "within reach:" in capsys.readouterr().out
    assert run("reach", field, "--from", "1", "1", "-o", "-") == 0
    assert json.loads(capsys.readouterr().out)["features"][0]["properties"]["limit"] is None


def test_mistakes_of_reach(field, capsys):  # noqa: F811
    assert run("reach", field, "--from", "1", "1", "--max-length", "4", "--max-cost", "3") == 1
    assert run("reach", field, "--from", "-3", "1") == 1
    assert run("reach", field, "--from", "1", "1", "--max-r95", "1e-9") == 3
    said = capsys.readouterr().err
    assert "at most one" in said
    assert "outside the map" in said


def test_the_region_is_painted():
    context = context_of(CLOSED)
    region = reachable_region(context, places(CLOSED, "a")[0], travel=Travel(0.2))
    with Image.open(io.BytesIO(reach_png(context.field, region, width=600, title="rooms"))) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    blue = np.abs(pixels - [0, 92, 230]).sum(axis=1) < 60
    assert blue.sum() > 200
