"""Logs of measurements from CSV: what is read, and what is refused with its line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.camera import Camera
from localization.errors import LogFormatError
from localization.io.sightings_csv import read_sightings
from localization.logs import Sighting, residuals
from localization.sensors import Mount
from maps.landmarks import LandmarkSet
from maps.se2 import wrap

LANDMARKS = LandmarkSet(("A", "B", "C"), np.array([[4.0, 0.0], [0.0, 3.0], [5.0, 5.0]]))
HEAD = "t_s,landmark,bearing_deg,x_m,y_m,theta_deg\n"
GOOD = HEAD + "0,A,0,0,0,0\n1,B,90,0,0,0\n"


def written(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_bearings_with_poses_in_the_same_lines(tmp_path):
    text = (
        "# rig\nt_s;landmark;bearing_rad;range_m;theta_deg;x_m;y_m\n"
        "2;C;0.5;7;45;0;0\n\n1;A;0.1;;0;0;0\n3;?;0.2;;0;0;0\n4;B;0.3;;;;\n"
    )
    read = read_sightings(written(tmp_path, text), LANDMARKS)
    log = read.log
    np.testing.assert_array_equal(log.time, [1, 2, 3, 4])
    assert log.landmark.tolist() == [0, 2, -1, 1]
    assert log.outcome.tolist() == [
        Sighting.USABLE, Sighting.USABLE, Sighting.MISREAD, Sighting.NO_REFERENCE,
    ]  # fmt: skip
    np.testing.assert_allclose(residuals(log)[0][:2], [0.1, 0.5], atol=1e-12)
    np.testing.assert_array_equal(np.isnan(read.ranges), [True, False, True, True])
    assert read.ranges[1] == 7


def test_poses_in_a_second_file_are_interpolated(tmp_path):
    log = written(tmp_path, "t_s,id,bearing_deg\n0.05,A,0\n9,A,0\n")
    poses = written(tmp_path, "t_s,x_m,y_m,theta_rad\n0,0,0,0\n0.1,1,0,0.2\n", "poses.csv")
    read = read_sightings(log, LANDMARKS, poses=poses).log
    np.testing.assert_allclose(read.reference[0], [0.5, 0.0, 0.1])
    assert read.outcome.tolist() == [Sighting.USABLE, Sighting.NO_REFERENCE]
    with pytest.raises(LogFormatError, match="of its own"):
        read_sightings(written(tmp_path, GOOD, "both.csv"), LANDMARKS, poses=poses)


def test_columns_of_a_panned_camera_on_a_mount(tmp_path, rng):
    camera, mount = Camera(500.0, 300.0, 600.0), Mount(0.3, -0.1, 0.4)
    lines = ["t_s,landmark,column_px,pan_deg,x_m,y_m,theta_rad"]
    for k in range(30):
        x, y, theta = rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-3, 3)
        ox, oy = mount.offset(theta)
        i = k % 3
        dx, dy = LANDMARKS.positions[i] - [x + ox, y + oy]
        true = math.atan2(dy, dx) - theta - mount.theta
        psi = rng.uniform(-0.5, 0.5)
        u = camera.columns(psi)
        lines.append(f"{k},{LANDMARKS.ids[i]},{u:.12f},{math.degrees(true - psi):.12f},{x},{y},{theta}")
    path = written(tmp_path, "\n".join(lines))
    log = read_sightings(path, LANDMARKS, camera=camera, mount=mount).log
    e, _ = residuals(log)
    np.testing.assert_allclose(wrap(e), 0.0, atol=1e-9)
    assert np.abs(log.bearing).max() < 0.55
    with pytest.raises(LogFormatError, match="which camera"):
        read_sightings(path, LANDMARKS)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "no measurements"),
        (HEAD, "no measurements"),
        (HEAD + "0,A,x,0,0,0\n", "line 2: bearing is 'x'"),
        (HEAD + "0,A,nan,0,0,0\n", "line 2: bearing"),
        (HEAD + "0,A,,0,0,0\n", "line 2: bearing is missing"),
        (HEAD + ",A,1,0,0,0\n", "line 2: t_s is missing"),
        (HEAD + "0,A,1,0,0\n", "line 2 has 5 values"),
        (HEAD + "0,A,1,0,,0\n", "line 2: give x_m, y_m and theta"),
        ("t_s,landmark,bearing,x_m,y_m,theta_deg\n0,A,0,0,0,0\n", "'bearing', which is not allowed"),
        ("t_s,landmark,bearing_deg,bearing_rad,x_m,y_m,theta_deg\n0,A,0,0,0,0,0\n", "two columns"),
        ("t_s,landmark,bearing_deg,column_px,x_m,y_m,theta_deg\n0,A,0,0,0,0,0\n", "needs one of"),
        ("t_s,landmark,x_m,y_m,theta_deg\n0,A,0,0,0\n", "needs one of"),
        ("t_s,bearing_deg,x_m,y_m,theta_deg\n0,0,0,0,0\n", "lacks the column landmark"),
        ("t_s,landmark,bearing_deg,x_m,y_m\n0,A,0,0,0\n", "lacks the column theta_deg or theta_rad"),
        (
            "t_s,landmark,column_px,x_m,y_m,theta_deg\n0,A,-3,0,0,0\n",
            "line 2: column -3 px is not in the image",
        ),
    ],
)
def test_what_is_refused(tmp_path, text, match):
    camera = Camera(500.0, 300.0, 600.0)
    with pytest.raises(LogFormatError, match=match):
        read_sightings(written(tmp_path, text), LANDMARKS, camera=camera)


def test_files_and_numbers_that_are_none(tmp_path):
    with pytest.raises(LogFormatError, match="no log"):
        read_sightings(tmp_path / "none.csv", LANDMARKS)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(LogFormatError, match="not UTF-8"):
        read_sightings(tmp_path / "binary.csv", LANDMARKS)
    good = written(tmp_path, GOOD)
    for options in ({"block_s": 0.0}, {"max_gap": math.nan}):
        with pytest.raises(LogFormatError, match="positive"):
            read_sightings(good, LANDMARKS, **options)
    back = written(tmp_path, "t_s,x_m,y_m,theta_rad\n1,0,0,0\n0,1,0,0.2\n", "back.csv")
    plain = written(tmp_path, "t_s,id,bearing_deg\n0.05,A,0\n", "plain.csv")
    with pytest.raises(LogFormatError, match="line 3: time goes back"):
        read_sightings(plain, LANDMARKS, poses=back)
