"""``surepath calibrate``: the sensor file that comes out is the sensor that made the log."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from api.cli_common import read_sensor
from localization.sensors import Mount, OmnidirectionalSensor, PinholeFixedSensor, PinholePanSensor
from localization.triplets import best_triplet
from maps.io.landmark_files import read_landmarks
from maps.io.site import bundled_site
from tests.api.test_cli import run
from tests.localization.logs_made import LANDMARKS, standing_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("calibrate")
    rows = [f"{i},{x},{y}" for i, (x, y) in zip(LANDMARKS.ids, LANDMARKS.positions, strict=True)]
    (path / "landmarks.csv").write_text("\n".join(["id,x,y", *rows]))
    write_log(path / "log.csv", standing_log(np.random.default_rng(1), sigma=0.01, bias=0.02, outliers=0.01))
    wide = standing_log(np.random.default_rng(2), n=1500, sigma=0.002, column_sigma=0.01)
    write_log(path / "front.csv", wide.only(np.abs(wide.bearing) < 1.2))
    return path


def write_log(path, log):
    lines = ["t_s,landmark,bearing_rad,range_m,x_m,y_m,theta_rad"]
    for k in range(len(log.time)):
        x, y, theta = log.reference[k].tolist()
        name = LANDMARKS.ids[log.landmark[k]]
        distance = math.dist((x, y), LANDMARKS.positions[log.landmark[k]]) + 0.1
        lines.append(f"{log.time[k]},{name},{log.bearing[k]},{distance},{x},{y},{theta}")
    lines.append("1e6,nobody,0.1,,1,1,0")
    path.write_text("\n".join(lines))


def calibrated(capsys, folder, log, *options, code=0):
    capsys.readouterr()
    arguments = ["calibrate", str(folder / log), "--landmarks", str(folder / "landmarks.csv")]
    assert run(*arguments, "-o", str(folder / "sensor.json"), *options) == code
    return capsys.readouterr()


def test_a_scanner_comes_back_and_is_taken_by_the_field(capsys, folder):
    found = json.loads(calibrated(capsys, folder, "log.csv", "--json").out)
    assert found["n_misread"] == 1
    assert found["bias_rad"]["low"] <= 0.02 <= found["bias_rad"]["high"]
    assert found["floor_rad"]["value"] == pytest.approx(0.01, rel=0.05)
    assert found["measured_ranges"]["bias_m"] == pytest.approx(0.1)
    assert all(b["sigma_rad"]["low"] < b["sigma_rad"]["high"] for b in found["by_range"])
    sensor = read_sensor(str(folder / "sensor.json"))
    assert isinstance(sensor, OmnidirectionalSensor)
    assert sensor.bearing_floor == found["floor_rad"]["value"]
    world = bundled_site("mas97_room")
    plain = OmnidirectionalSensor(math.hypot(sensor.bearing_sigma, sensor.bearing_floor))
    got, want = (best_triplet(world, s, (2.5, 3.0)) for s in (sensor, plain))
    np.testing.assert_allclose(got.covariance, want.covariance, rtol=1e-9)


@pytest.mark.parametrize(
    ("kind", "made"), [("pinhole_pan", PinholePanSensor), ("pinhole_fixed", PinholeFixedSensor)]
)
def test_a_camera_comes_back(capsys, folder, kind, made):
    options = ("--kind", kind, "--fov-deg", "140", "--focal-px", "500", "--seed", "3")
    text = calibrated(capsys, folder, "front.csv", *options).out
    assert "column share" in text
    assert "off the axis" in text
    sensor = read_sensor(str(folder / "sensor.json"))
    assert isinstance(sensor, made)
    assert sensor.column_sigma_px == pytest.approx(5.0, rel=0.1)
    assert sensor.bearing_floor == pytest.approx(0.002, abs=0.0015)
    assert sensor.field_of_view == pytest.approx(math.radians(140))


def test_mount_and_landmarks_are_written(capsys, folder):
    # The same log, said to be of a sensor 0.5 m ahead and turned by 90°: poses of the robot lie behind.
    robot = np.genfromtxt(folder / "log.csv", delimiter=",", skip_header=1, dtype=None, encoding=None)
    lines = ["t_s,landmark,bearing_rad,x_m,y_m,theta_rad"]
    for t, name, bearing, _, x, y, theta in robot.tolist():
        heading = theta - math.pi / 2
        px, py = x - 0.5 * math.cos(heading), y - 0.5 * math.sin(heading)
        lines.append(f"{t},{name},{bearing},{px},{py},{heading}")
    (folder / "mounted.csv").write_text("\n".join(lines))
    options = ("--mount-x-m", "0.5", "--mount-theta-deg", "90", "--landmarks-output", str(folder / "out.csv"))
    found = json.loads(calibrated(capsys, folder, "mounted.csv", *options, "--json").out)
    assert found["floor_rad"]["value"] == pytest.approx(0.01, rel=0.05)
    assert read_sensor(str(folder / "sensor.json")).mount == Mount(0.5, 0.0, math.pi / 2)
    landmarks = read_landmarks(folder / "out.csv")
    assert landmarks.ids == LANDMARKS.ids
    np.testing.assert_allclose(landmarks.sigma, found["range_term_m"]["value"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--kind", "laser"), "Unknown kind 'laser'"),
        (("--kind", "pinhole_pan"), "needs --fov-deg and --focal-px"),
        (("--kind", "pinhole_pan", "--fov-deg", "190", "--focal-px", "500"), "fov_deg is 190"),
        (("--kind", "pinhole_pan", "--fov-deg", "90", "--focal-px", "-1"), "focal_px is -1"),
        (("--focal-px", "500"), "has no --focal-px"),
        (("--poses", "nowhere.csv"), "leave 'nowhere.csv' out"),
        (("--block-s", "0"), "Block length is 0"),
        (("--mount-x-m", "1000"), "mount arm"),
    ],
)
def test_mistakes_are_told_in_one_line(capsys, folder, options, words):
    assert words in calibrated(capsys, folder, "log.csv", *options, code=1).err.replace("\n", " ")


def test_too_little_is_told(capsys, folder):
    (folder / "short.csv").write_text("t_s,landmark,bearing_deg,x_m,y_m,theta_deg\n0,A,1,1,1,0\n")
    assert "calibration needs 30" in calibrated(capsys, folder, "short.csv", code=1).err.replace("\n", " ")
