"""``surepath world``: look at maps before they are used."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from api.cli_common import (
    EXIT_MISTAKE,
    Landmarks_,
    UnknownFree_,
    UnknownOpaque_,
    World_,
    read_world,
    write_file,
)
from api.console import out

world_app = typer.Typer(no_args_is_help=True, help="Look at maps before they are used.")


@world_app.command("check")
def world_check(
    world: World_,
    landmarks: Landmarks_ = None,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw floor and landmarks.")] = None,
) -> None:
    """Load a map and say what it holds and what will cause trouble.

    Exit code 1 when the map cannot be used.
    """
    from maps.check import check_world  # noqa: PLC0415

    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    report = check_world(loaded)
    table = Table(show_header=False, box=None)
    for name, value in report.figures.items():
        table.add_row(name, value)
    out.print(table)
    for finding in report.findings:
        color = {"error": "red", "warning": "yellow"}.get(finding.severity, "cyan")
        out.print(f"[{color}]{finding.severity}[/{color}] {finding.code}: {finding.message}", highlight=False)
    if picture is not None:
        from api.render import map_png  # noqa: PLC0415

        write_file(picture, map_png(loaded))
    if any(f.severity == "error" for f in report.findings):
        raise typer.Exit(EXIT_MISTAKE)
