"""Roh's logs: degrees to radians, places from file names."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.io.roh import read_roh
from localization.logs import LogFormatError, residuals, scans


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "landmark.csv").write_text("0, 0\n6, 0\n6, 6\n")
    # From (3, 3), heading +90°: azimuths -135°, -45° and 45°.
    (tmp_path / "X3.0_Y3.0.csv").write_text("135,-135,-45\n134,-134,-44\n")
    (tmp_path / "(X1.5,Y3).csv").write_text("0,0,0\n")
    (tmp_path / "README.txt").write_text("not a log")
    return tmp_path


def test_readings_become_sightings(folder):
    log = read_roh(folder)
    assert len(log.time) == 9
    e, _ = residuals(log)
    np.testing.assert_allclose(e[3:6], 0, atol=1e-12)
    np.testing.assert_allclose(e[6:], np.radians([-1, 1, 1]), atol=1e-12)
    np.testing.assert_allclose(log.reference[0], [1.5, 3.0, math.pi / 2])
    np.testing.assert_array_equal(log.block, [0] * 3 + [1] * 6)
    assert [len(s) for s in scans(log)] == [3, 3, 3]


def test_folders_that_are_none_are_refused(folder, tmp_path_factory):
    (folder / "X3.0_Y3.0.csv").write_text("1,2\n")
    with pytest.raises(LogFormatError, match=r"X3.0_Y3.0.csv, line 1"):
        read_roh(folder)
    empty = tmp_path_factory.mktemp("empty")
    with pytest.raises(LogFormatError, match=r"landmark\.csv"):
        read_roh(empty)
    (empty / "landmark.csv").write_text("0,0\n1,0\n1,1\n")
    with pytest.raises(LogFormatError, match="no file like"):
        read_roh(empty)
    (empty / "landmark.csv").write_text("0,0\n0,0\n")
    with pytest.raises(LogFormatError, match="both stand at"):
        read_roh(empty)


def test_real_scatter_is_what_its_description_says(shared_data):
    """Scatter 0.3 to 1.5° per beacon with one larger; biases from -2.6 to 7.3° by the medians."""
    log = read_roh(shared_data / "bearing" / "roh")
    e, _ = residuals(log)
    assert len(e) == 4000
    bias, scatter = [], []
    for block in range(5):
        for landmark in range(4):
            mine = np.degrees(e[(log.block == block) & (log.landmark == landmark)])
            bias.append(np.median(mine))
            scatter.append(np.std(mine))
    assert -3.0 < min(bias) < -1.5
    assert 6.0 < max(bias) < 9.0
    assert np.median(scatter) < 1.0
