"""``surepath field`` and ``surepath heatmap``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from api.cli_common import (
    Field_,
    Landmarks_,
    UnknownFree_,
    UnknownOpaque_,
    World_,
    read_field,
    read_sensor,
    read_world,
    write_file,
)
from api.colormaps import COLORMAPS
from api.console import field_table, out, progress_bar
from localization.uncertainty_field import METRICS


def field(
    world: World_,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FIELD.zarr", help="Folder to write.")],
    landmarks: Landmarks_ = None,
    sensor: Annotated[
        str,
        typer.Option(
            metavar="SENSOR",
            help="A preset (laser: 0.1°, 30 m; mas97: the paper's camera) or a JSON file such as "
            '{"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 25} or '
            '{"kind": "pinhole_pan", "fov_deg": 53.13, "focal_px": 512, "column_sigma_px": 5}.',
        ),
    ] = "laser",
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell, m.")] = 0.1,
    heading_deg: Annotated[
        float, typer.Option(metavar="DEG", help="Heading of the robot; matters for limited pan heads only.")
    ] = 0.0,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    threads: Annotated[int | None, typer.Option(help="Threads; default: one per core.")] = None,
) -> None:
    """Compute the sensory uncertainty field of a map.

    For every free cell: the best visible landmark triplet, the covariance of the fix that it gives and
    the area of its 95 % ellipse. The result is a zarr group that xarray opens; it carries map and
    sensor, so that plans need nothing else.
    """
    from localization.field_builder import build_field  # noqa: PLC0415
    from localization.io.field_file import check_target, save_field  # noqa: PLC0415

    chosen = read_sensor(sensor)
    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    check_target(output)
    with progress_bar() as bar:
        task = bar.add_task(f"field of {loaded.name}", total=None)
        built = build_field(
            loaded,
            chosen,
            resolution=resolution,
            heading=math.radians(heading_deg),
            threads=threads,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    save_field(built, output)
    out.print(field_table(built))
    out.print(f"written: {output}", highlight=False)


def heatmap(
    field_path: Field_,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PNG", help="Picture to write.")],
    metric: Annotated[str, typer.Option(help=f"One of {', '.join(METRICS)}.")] = "area95_m2",
    width: Annotated[int | None, typer.Option(metavar="PX", help="Width of the picture.")] = None,
    height: Annotated[int | None, typer.Option(metavar="PX", help="Height of the picture.")] = None,
    window: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 Y0 X1 Y1", help="Part of the map to show, m."),
    ] = None,
    limits: Annotated[
        tuple[float, float] | None, typer.Option("--range", metavar="MIN MAX", help="Ends of the colours.")
    ] = None,
    scale: Annotated[str, typer.Option(help="log or linear.")] = "log",
    colormap: Annotated[str, typer.Option(help=f"One of {', '.join(COLORMAPS)}.")] = "viridis",
    legend: Annotated[bool, typer.Option(help="Colour bar at the right.")] = True,
) -> None:
    """Draw a field. Hatched: free cells where fewer than three landmarks are seen together."""
    from api.render import heatmap_png  # noqa: PLC0415

    png = heatmap_png(
        read_field(field_path),
        metric=metric,
        width=width,
        height=height,
        bbox=window,
        vmin=limits[0] if limits else None,
        vmax=limits[1] if limits else None,
        scale=scale,
        colormap=colormap,
        legend=legend,
    )
    write_file(output, png)
    out.print(f"written: {output}", highlight=False)
