"""The real logs that the model is validated on, read from one folder."""

from __future__ import annotations

from pathlib import Path

from localization.errors import LogFormatError
from localization.io.mrclam import read_mrclam_mat, read_mrclam_run
from localization.io.roh import read_roh
from localization.validation import LogCase


def read_real_logs(folder: str | Path) -> tuple[LogCase, ...]:
    """MRCLAM ``mrclam1.mat``, ``Dataset1``, ``Dataset6`` and Roh, as ``validation_report`` takes them.

    Parameters
    ----------
    folder
        With ``mrclam/`` and ``roh/``.

    Raises
    ------
    LogFormatError
        If something is missing or not such a file.
    """
    folder = Path(folder)
    mrclam = folder / "mrclam"
    if not mrclam.is_dir():
        raise LogFormatError(f"Folder '{folder.name}' has no 'mrclam'; give the folder of bearing logs.")
    cases = [
        LogCase(read_mrclam_mat(mrclam / "mrclam1.mat"), "MRCLAM, all robots, standing, outliers removed")
    ]
    cases += [
        LogCase(read_mrclam_run(mrclam / "Dataset1", robot), "MRCLAM, reference for the first part")
        for robot in (1, 2)
    ]
    cases += [
        LogCase(read_mrclam_run(mrclam / "Dataset6", robot), "MRCLAM, obstacles in the arena", filtered=True)
        for robot in (1, 2)
    ]
    return (*cases, LogCase(read_roh(folder / "roh"), "rotating detector, five places", per_landmark=True))
