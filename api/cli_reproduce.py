"""``surepath reproduce``: published results made again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from api.cli_common import EXIT_UNMET, make_folder, write_file
from api.console import err, out

reproduce_app = typer.Typer(no_args_is_help=True, help="Make published results again.")


@reproduce_app.callback()
def _group() -> None:
    """Keeps the name of the paper a word of its own while there is only one."""


@reproduce_app.command("mas97")
def mas97(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="Folder for mas97.md and its pictures.")
    ] = Path("mas97"),
) -> None:
    """Madsen, Andersen, Sørensen 1997, Figs. 3, 4, 6, 7 and 8: the paper's numbers beside ours.

    Prints a row per claim and writes mas97.md with a picture per figure. Exit code 3 when a claim does
    not hold.
    """
    import numpy as np  # noqa: PLC0415

    from api.mas97_pictures import pictures  # noqa: PLC0415
    from localization.madsen_1997 import SEED, reproduce  # noqa: PLC0415
    from localization.madsen_1997_report import (  # noqa: PLC0415
        HEAD,
        PICTURE_FOLDER,
        PICTURES,
        cells,
        report,
    )
    from localization.madsen_1997_scenes import SITE  # noqa: PLC0415
    from maps.io.site import bundled_site  # noqa: PLC0415

    make_folder(output / PICTURE_FOLDER)
    with err.status("computing the scenes …"):
        found = reproduce(bundled_site(SITE), rng=np.random.default_rng(SEED))
    rows = found.rows()
    table = Table(*HEAD, show_lines=True)
    for row in rows:
        *text, verdict = cells(row)
        table.add_row(*text, f"[{'green' if row.holds else 'red'}]{verdict}[/]")
    out.print(table)
    with err.status("drawing …"):
        for figure, png in pictures(found).items():
            write_file(output / PICTURE_FOLDER / PICTURES[figure], png)
    write_file(output / "mas97.md", report(found).encode())
    out.print(f"written: {output / 'mas97.md'} and {len(PICTURES)} pictures", highlight=False, soft_wrap=True)
    if not all(row.holds for row in rows):
        raise typer.Exit(EXIT_UNMET)
