"""MRCLAM logs: every line has an outcome; what is no log is refused by name and line."""

from __future__ import annotations

import gzip
import math

import numpy as np
import pytest
from scipy.io import savemat

from localization.errors import LocalizationError
from localization.io.mrclam import read_mrclam_mat, read_mrclam_run, table
from localization.logs import LogFormatError, Sighting, residuals

BARCODES = "# Subject Barcode\n 1 5\n 2 14\n 6 63\n 7 81\n 8 7\n"
GROUND = "# x y\n 6 4.0 0.0 0.001 0.001\n 7 0.0 4.0 0.002 0.0\n 8 -4.0 0.0 0 0\n"
TRACK = "".join(f"{t / 10:.1f} 0.0 0.0 0.0\n" for t in (*range(11), *range(20, 31)))
MEASURED = """# time code range bearing
0.05 63 4.0 0.01
0.05 81 4.0 1.57
0.10 14 1.0 0.20
0.20 99 2.0 0.30
1.50 63 4.0 0.02
2.50 7 4.0 -3.14
9.00 7 4.0 3.14
"""
ODOMETRY = "0.0 0.0 0.0\n3.0 0.0 0.0\n"


@pytest.fixture
def folder(tmp_path):
    for name, text in (
        ("Barcodes.dat", BARCODES),
        ("Landmark_Groundtruth.dat", GROUND),
        ("Robot1_Measurement.dat", MEASURED),
        ("Robot1_Odometry.dat", ODOMETRY),
    ):
        (tmp_path / name).write_text(text)
    (tmp_path / "Robot1_Groundtruth.dat.gz").write_bytes(gzip.compress(TRACK.encode()))
    return tmp_path


def test_every_line_has_its_outcome(folder):
    log = read_mrclam_run(folder, 1)
    S = Sighting
    expected = [S.USABLE, S.USABLE, S.ROBOT, S.MISREAD, S.NO_REFERENCE, S.USABLE, S.NO_REFERENCE]
    assert [Sighting(o) for o in log.outcome] == expected
    np.testing.assert_array_equal(log.landmark, [0, 1, -1, -1, 0, 2, 2])
    e, r = residuals(log)
    np.testing.assert_allclose(e[[0, 1, 5]], [0.01, 1.57 - math.pi / 2, math.pi - 3.14], atol=1e-12)
    np.testing.assert_allclose(r[[0, 1, 5]], 4.0)
    assert np.isnan(e[[2, 3, 4, 6]]).all()
    assert log.landmarks.ids == ("6", "7", "8")
    np.testing.assert_allclose(log.landmarks.sigma, [0.001, math.sqrt(2e-6), 0.0])


def test_lines_out_of_order_are_sorted(folder):
    (folder / "Robot1_Measurement.dat").write_text("2.5 7 4.0 3.0\n0.5 63 4.0 0.0\n")
    np.testing.assert_array_equal(read_mrclam_run(folder, 1).time, [0.5, 2.5])


def test_the_first_part_of_a_reference_will_do(folder):
    (folder / "Robot1_Groundtruth.dat.gz").unlink()
    text = "# part\ntime_s,x_m,y_m,yaw_rad\n" + TRACK.replace(" ", ",")
    (folder / "Robot1_Groundtruth_first_part.csv.gz").write_bytes(gzip.compress(text.encode()))
    assert read_mrclam_run(folder, 1).count(Sighting.USABLE) == 3


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("Robot1_Measurement.dat", "0.1 63 4.0\n", "line 1: '0.1 63 4.0' is not 4"),
        ("Robot1_Measurement.dat", "0.1 63 4.0 0.1\n0.2 63 x 0.1\n", "line 2"),
        ("Robot1_Measurement.dat", "0.1 63 4.0 nan\n", "finite"),
        ("Robot1_Measurement.dat", "# nothing\n", "no numbers"),
        ("Robot1_Odometry.dat", "2.0 0 0\n1.0 0 0\n", "odometry are not ascending"),
        ("Landmark_Groundtruth.dat", "6 1 1 0 0\n7 1 1 0 0\n8 2 2 0 0\n", "both stand at"),
        ("Barcodes.dat", "6 63\n7 63\n", "two subjects"),
        ("Robot1_Groundtruth.dat", "\x00\x01\n", "line 1"),
    ],
)
def test_files_that_are_none_are_refused(folder, name, text, match):
    if name == "Robot1_Groundtruth.dat":
        (folder / "Robot1_Groundtruth.dat.gz").unlink()
    (folder / name).write_text(text)
    with pytest.raises(LogFormatError, match=match):
        read_mrclam_run(folder, 1)


def test_missing_and_broken_files_are_named(folder):
    with pytest.raises(LogFormatError, match="Robot2_Measurement"):
        read_mrclam_run(folder, 2)
    (folder / "Robot1_Groundtruth.dat.gz").write_bytes(b"no gzip")
    with pytest.raises(LogFormatError, match="cannot be read"):
        read_mrclam_run(folder, 1)


def test_tables_skip_comments_and_heads(tmp_path):
    (tmp_path / "a.csv").write_text("# c\nx,y\n1, 2\n\n3,4\n")
    np.testing.assert_array_equal(table(tmp_path / "a.csv", 2), [[1, 2], [3, 4]])
    (tmp_path / "b.csv").write_text("1,2\nx,y\n")
    with pytest.raises(LogFormatError, match="line 2"):
        table(tmp_path / "b.csv", 2)


def write_mat(path, **changes):
    content = {
        "landmark": [[1, 4.0, 0.0], [2, 0.0, 4.0], [3, -4.0, 0.0]],
        "groundtruth": [[1, 0.0, 0.0, 0.0], [2, 1.0, 0.0, 0.0]],
        "measurement": [[2, 1, 3.0, 0.1], [1, 1, 4.0, 0.0], [1, 9, 4.0, 0.0], [3, 2, 4.0, 0.0]],
    }
    savemat(path, content | changes)
    return path


def test_pooled_poses(tmp_path):
    log = read_mrclam_mat(write_mat(tmp_path / "m.mat"))
    S = Sighting
    assert [Sighting(o) for o in log.outcome] == [S.USABLE, S.MISREAD, S.USABLE, S.NO_REFERENCE]
    np.testing.assert_allclose(residuals(log)[0][[0, 2]], [0.0, 0.1])
    # The robot jumped a metre between the poses.
    assert log.block[0] == log.block[1] != log.block[2]


def test_pooled_files_that_are_none_are_refused(tmp_path):
    for changes, match in (
        ({"landmark": [[1, 2]]}, "landmark"),
        ({"groundtruth": [[1, 0.0, math.nan, 0.0]]}, "row 1 of 'groundtruth'"),
        ({"measurement": "text"}, "measurement"),
    ):
        with pytest.raises(LogFormatError, match=match):
            read_mrclam_mat(write_mat(tmp_path / "m.mat", **changes))
    for content in (b"", b"MATLAB 5.0 MAT-file" + b"\x00" * 300, b"x" * 500):
        (tmp_path / "n.mat").write_bytes(content)
        with pytest.raises(LogFormatError, match=r"n\.mat"):
            read_mrclam_mat(tmp_path / "n.mat")
    with pytest.raises(LocalizationError, match=r"gone\.mat"):
        read_mrclam_mat(tmp_path / "gone.mat")


def test_real_runs_are_what_their_description_says(shared_data):
    """Counts and noise as found when the data was collected, with the same interpolation."""
    folder = shared_data / "bearing" / "mrclam"
    for dataset, robot, n, median, sigma_deg in (
        ("Dataset1", 1, 1171, -0.0088, 1.40),
        ("Dataset1", 2, 1085, 0.0024, 0.53),
        ("Dataset6", 1, 1531, -0.0003, 0.62),
        ("Dataset6", 2, 3232, 0.0033, 0.53),
    ):
        log = read_mrclam_run(folder / dataset, robot)
        e = residuals(log)[0][log.usable]
        assert log.count(Sighting.USABLE) == pytest.approx(n, rel=0.01)
        assert np.median(e) == pytest.approx(median, abs=1e-4)
        assert math.degrees(1.4826 * np.median(np.abs(e - np.median(e)))) == pytest.approx(
            sigma_deg, abs=0.01
        )
    assert read_mrclam_run(folder / "Dataset6", 1).count(Sighting.MISREAD) == 1


def test_real_pooled_poses_are_what_their_description_says(shared_data):
    log = read_mrclam_mat(shared_data / "bearing" / "mrclam" / "mrclam1.mat")
    e, _ = residuals(log)
    assert len(e) == 32970
    assert len(np.unique(log.time)) == 9782
    assert np.median(e) == pytest.approx(-0.0035, abs=1e-4)
