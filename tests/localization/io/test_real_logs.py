"""The set of logs that the document is made from."""

from __future__ import annotations

import pytest

from localization.io.real_logs import read_real_logs
from localization.logs import LogFormatError


def test_all_logs_are_read(shared_data):
    cases = read_real_logs(shared_data / "bearing")
    assert [c.log.name for c in cases] == [
        "mrclam1.mat",
        "Dataset1 robot 1",
        "Dataset1 robot 2",
        "Dataset6 robot 1",
        "Dataset6 robot 2",
        "Roh",
    ]
    assert [c.filtered for c in cases] == [False, False, False, True, True, False]


def test_other_folders_are_refused(tmp_path):
    with pytest.raises(LogFormatError, match="mrclam"):
        read_real_logs(tmp_path)
    (tmp_path / "mrclam").mkdir()
    with pytest.raises(LogFormatError, match=r"mrclam1\.mat"):
        read_real_logs(tmp_path)
