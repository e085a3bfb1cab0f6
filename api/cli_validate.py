"""``surepath validate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from api.cli_common import write_file
from api.console import err, out


def validate(
    logs: Annotated[Path, typer.Argument(metavar="FOLDER", help="With mrclam/ and roh/ as published.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="MD", help="Document to write.")],
) -> None:
    """Hold the model against real logs: calibration, ellipses, choice of triplets, filter."""
    from localization.io.real_logs import read_real_logs  # noqa: PLC0415
    from localization.validation_report import validation_report  # noqa: PLC0415

    with err.status("measuring …"):
        text = validation_report(read_real_logs(logs))
    write_file(output, text.encode())
    out.print(f"written: {output}", highlight=False)
