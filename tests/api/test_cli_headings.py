"""Fields over headings, methods and every kind of sensor on the command line."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image

from api.codec import sensor_from_json
from api.console import field_table
from api.heading_view import view_of
from localization.errors import LocalizationError
from localization.heading_field import HeadingField
from localization.io.field_file import load_field
from localization.method import FieldMethod
from localization.uncertainty_field import METRICS
from tests.api.test_cli import ROOM, run, width_of

CAMERA = {"kind": "pinhole_fixed", "fov_deg": 120, "focal_px": 500, "column_sigma_px": 1}
SENSORS = {
    "laser": {
        "kind": "omnidirectional",
        "bearing_sigma_deg": 0.1,
        "bearing_floor_deg": 0.02,
        "muted": [{"begin_deg": 120, "end_deg": -120}],
        "mount": {"x_m": 0.2, "y_m": 0, "theta_rad": 0},
    },
    "pan": {**CAMERA, "kind": "pinhole_pan", "fov_deg": 100, "pan_min_deg": -120, "pan_max_deg": 120},
    "fixed": {**CAMERA, "mount": {"theta_deg": 180}},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("headings")
    (path / "room.geojson").write_text(json.dumps(ROOM))
    for name, sensor in SENSORS.items():
        (path / f"{name}.json").write_text(json.dumps(sensor))
    return path


@pytest.fixture(scope="module")
def turning(folder):
    path = folder / "turning.zarr"
    arguments = ("--sensor", folder / "fixed.json", "--resolution", 0.25, "--headings", 6, "-o", path)
    assert run("field", folder / "room.geojson", *arguments) == 0
    return path


def words(capsys):
    """What was said: stdout, stderr."""
    said = capsys.readouterr()
    return " ".join(said.out.split()), " ".join(said.err.split())


@pytest.mark.parametrize("name", SENSORS)
def test_a_sensor_file_of_each_kind_makes_a_field(folder, name, capsys):
    path = folder / f"one_{name}.zarr"
    arguments = ("--sensor", folder / f"{name}.json", "--resolution", 0.5, "-o", path)
    assert run("field", folder / "room.geojson", *arguments) == 0
    out, err = words(capsys)
    assert "the field is for heading 0°" in err, "nobody said which heading"
    assert "without a fix" in out
    assert "not valid" in out
    field = load_field(path)
    assert field.sensor == sensor_from_json(SENSORS[name])
    assert field.has_fix.any()
    assert run("field", folder / "room.geojson", *arguments, "--heading-deg", -90) == 0
    assert "heading 0°" not in words(capsys)[1]
    assert load_field(path).heading == pytest.approx(-np.pi / 2)
    assert run("heatmap", path, "-o", folder / "one.png") == 0


def test_a_method_is_computed_and_told(folder, capsys):
    path = folder / "all.zarr"
    method = ("--estimator", "all_visible", "--criterion", "trace")
    assert run("field", folder / "room.geojson", "--resolution", 0.5, *method, "-o", path) == 0
    out, _ = words(capsys)
    assert "all landmarks in view" in out
    assert "not known for all_visible" in out
    assert load_field(path).method == FieldMethod("all_visible", "trace")
    assert run("heatmap", path, "-o", folder / "v.png", "--metric", "validity") == 1
    assert "Validity is not known" in words(capsys)[1]
    plan = ("--start", 2, 4, "--goal", 10, 4, "--radius", 0.3, "-o", "-", "--picture", folder / "all.png")
    assert run("plan", path, *plan) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["routes"][0]["uncertainty"]["blind_m"] == 0
    assert all(p["covariance"] and p["triplet"] is None for p in answer["routes"][0]["path"])
    assert width_of(folder / "all.png") > 500


def test_the_table_counts_cells_without_a_fix_and_not_valid(folder, capsys):
    field = load_field(_field(folder, "fixed", capsys))
    cells = [[str(c) for c in column.cells] for column in field_table(field).columns]
    rows = dict(zip(*cells, strict=True))
    free = field.free.sum()
    assert rows["without a fix"] == f"{100 * (free - field.has_fix.sum()) / free:.1f} % of the free cells"
    doubtful = (field.has_fix & ~field.is_valid).sum()
    assert rows["not valid"] == f"{100 * doubtful / field.has_fix.sum():.1f} % of the fixes"


def _field(folder, name, capsys):
    path = folder / f"table_{name}.zarr"
    arguments = ("--sensor", folder / f"{name}.json", "--resolution", 0.25, "-o", path)
    assert run("field", folder / "room.geojson", *arguments) == 0
    capsys.readouterr()
    return path


def test_a_field_over_headings_is_made_and_told(folder, turning, capsys):
    field = load_field(turning)
    assert isinstance(field, HeadingField)
    assert len(field) == 6
    cells = [[str(c).strip() for c in column.cells] for column in field_table(field).columns]
    rows = dict(zip(*cells, strict=True))
    assert rows["headings"] == "6, every 60°"
    share = field.share_with_fix()[field.free]
    assert rows["without a fix"] == f"{100 * (1 - share.mean()):.1f} % of free cells × headings"
    assert rows["at every heading"] == f"{100 * np.mean(share == 0):.1f} % of the free cells"
    assert rows["at one or more headings"] == f"{100 * np.mean(share < 1):.1f} % of the free cells"


@pytest.mark.parametrize("heading", ["best", "worst", "mean", "90", "-123.4"])
def test_a_heatmap_of_each_view(turning, folder, heading, capsys):
    for metric in ("area95_m2", "n_visible", "validity"):
        path = folder / "view.png"
        shown = ("--heading", heading, "--metric", metric, "--width", 300)
        assert run("heatmap", turning, "-o", path, *shown) == 0
        assert width_of(path) == 300
    assert "note" not in words(capsys)[1], "what was asked for needs no remark"


def test_the_best_heading_is_shown_when_nothing_is_asked(turning, folder, capsys):
    assert run("heatmap", turning, "-o", folder / "default.png", "--width", 300) == 0
    assert "the best of 6 headings is shown" in words(capsys)[1]
    for which in ("best", "worst"):
        assert run("heatmap", turning, "-o", folder / f"{which}.png", "--width", 300, "--heading", which) == 0
    assert (folder / "default.png").read_bytes() == (folder / "best.png").read_bytes()
    assert (folder / "best.png").read_bytes() != (folder / "worst.png").read_bytes()


@pytest.mark.parametrize("metric", METRICS)
def test_views_are_what_they_say(turning, metric):
    field = load_field(turning)
    means = field.mean(metric)
    view = view_of(field, "mean", metric)
    np.testing.assert_array_equal(view.metric(metric), means)
    at = (np.array([3, 5]), np.array([2, 9]))
    np.testing.assert_array_equal(view.metric(metric, at), means[at])
    np.testing.assert_array_equal(
        view_of(field, None, metric).metric(metric), field.reduced("best").metric(metric)
    )
    assert view_of(field, "121", metric) is field.slices[2]
    assert view_of(field.slices[1], None, metric) is field.slices[1]


def test_another_metric_of_a_mean_is_that_of_the_best_heading(turning):
    field = load_field(turning)
    view = view_of(field, "mean", "r95_m")
    np.testing.assert_array_equal(view.metric("area95_m2"), field.reduced("best").area95)


@pytest.mark.parametrize("heading", ["up", "nan", "inf", "", "1,2"])
def test_headings_that_are_none_are_refused(turning, heading, folder, capsys):
    with pytest.raises(LocalizationError, match="best, worst, mean"):
        view_of(load_field(turning), heading, "area95_m2")
    assert run("heatmap", turning, "-o", folder / "no.png", "--heading", heading) == 1
    assert "best, worst, mean" in words(capsys)[1]
    assert run("heatmap", turning, "-o", folder / "no.png", "--heading", "mean", "--metric", "beauty") == 1
    assert "beauty" in words(capsys)[1]
    assert not (folder / "no.png").exists()


def test_a_plan_drives_by_the_heading_of_travel(folder, capsys):
    sensor = {**CAMERA, "fov_deg": 175}
    (folder / "wide.json").write_text(json.dumps(sensor))
    path = folder / "wide.zarr"
    arguments = ("--sensor", folder / "wide.json", "--resolution", 0.25, "--headings", 4, "-o", path)
    assert run("field", folder / "room.geojson", *arguments) == 0
    capsys.readouterr()
    plan = (
        "--start",
        2,
        4,
        "--goal",
        2,
        6,
        "--radius",
        0.3,
        "--blind-r95",
        1,
        "-o",
        "-",
        "--picture",
        folder / "p.png",
    )
    assert run("plan", path, *plan) == 0
    said = capsys.readouterr()
    assert "over 4 headings: the robot faces the way" in " ".join(said.err.split())
    answer = json.loads(said.out)
    field = load_field(path)
    assert answer["field"] == "f_" + field.content_hash()
    assert answer["planner"].startswith("lattice")
    for place in answer["routes"][0]["path"]:
        one = field.at(place["theta_rad"]).trusted()
        row, col = one.frame.cell_at((place["x_m"], place["y_m"]))
        if place["r95_m"] is not None:
            assert place["r95_m"] == pytest.approx(one.r95[row, col], rel=1e-6, abs=1e-8)
    with Image.open(io.BytesIO((folder / "p.png").read_bytes())) as image:
        assert image.width > 500
