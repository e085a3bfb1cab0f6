"""``surepath field`` and ``surepath heatmap``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from api.cli_common import (
    HEADING_HELP,
    Criterion_,
    Field_,
    Landmarks_,
    Sensor_,
    UnknownFree_,
    UnknownOpaque_,
    World_,
    read_field,
    read_sensor,
    read_world,
    write_file,
)
from api.colormaps import COLORMAPS
from api.console import field_table, out, print_note, progress_bar
from localization.errors import LocalizationError
from localization.heading_field import HeadingField
from localization.method import ESTIMATORS, FieldMethod
from localization.uncertainty_field import METRICS, UncertaintyField


def field(
    world: World_,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FIELD.zarr", help="Folder to write.")],
    landmarks: Landmarks_ = None,
    sensor: Sensor_ = "laser",
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell, m.")] = 0.1,
    heading_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help=f"{HEADING_HELP} Default 0.", show_default=False)
    ] = None,
    headings: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Compute N evenly spaced headings instead, from 0 on: a field over headings."
        ),
    ] = None,
    estimator: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help=f"What a fix is made of, one of {', '.join(ESTIMATORS)}: the best three landmarks in view, "
            "or all of them by weighted least squares (validity is not known then).",
        ),
    ] = "best_triplet",
    criterion: Criterion_ = "area",
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    threads: Annotated[int | None, typer.Option(help="Threads; default: one per core.")] = None,
) -> None:
    """Compute the sensory uncertainty field of a map.

    For every free cell: the best visible landmark triplet, the covariance of the fix that it gives, the
    area of its 95 % ellipse, and whether first order holds there. The result is a zarr group that xarray
    opens; it carries map and sensor, so that plans need nothing else.
    """
    from localization.field_builder import build_field, build_heading_field  # noqa: PLC0415
    from localization.io.field_file import check_target, save_field  # noqa: PLC0415

    method = FieldMethod(estimator, criterion)  # type: ignore[arg-type]  # it checks itself
    chosen = read_sensor(sensor)
    _check_headings(heading_deg, headings)
    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    check_target(output)
    built: UncertaintyField | HeadingField
    with progress_bar() as bar:
        task = bar.add_task(f"field of {loaded.name}", total=None)

        def progress(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        if headings is None:
            built = build_field(
                loaded,
                chosen,
                resolution=resolution,
                heading=math.radians(heading_deg or 0.0),
                method=method,
                threads=threads,
                progress=progress,
            )
        else:
            built = build_heading_field(
                loaded,
                chosen,
                resolution=resolution,
                headings=headings,
                method=method,
                threads=threads,
                progress=progress,
            )
    save_field(built, output)
    out.print(field_table(built))
    if chosen.depends_on_heading and headings is None and heading_deg is None:
        print_note(
            "this sensor sees otherwise when the robot turns; the field is for heading 0°. "
            "Give --heading-deg, or --headings 36 for all."
        )
    out.print(f"written: {output}", highlight=False)


def _check_headings(heading_deg: float | None, headings: int | None) -> None:
    if heading_deg is not None and headings is not None:
        raise LocalizationError("Give --heading-deg or --headings, not both.")
    if heading_deg is not None and not math.isfinite(heading_deg):
        raise LocalizationError(f"Heading is {heading_deg}°; it must be finite.")


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
    scale: Annotated[
        str | None,
        typer.Option(
            metavar="log|linear",
            help="Default: linear for n_visible and validity, else log.",
            show_default=False,
        ),
    ] = None,
    colormap: Annotated[str, typer.Option(help=f"One of {', '.join(COLORMAPS)}.")] = "viridis",
    legend: Annotated[bool, typer.Option(help="Colour bar at the right.")] = True,
    heading: Annotated[
        str | None,
        typer.Option(
            metavar="best|worst|mean|DEG",
            help="Of a field over headings. best: what the robot can have by turning on the spot (default). "
            "worst: what it can count on whichever way it looks; a heading without a fix is the worst, "
            "hatched. mean: of the metric, over the headings with a fix. DEG: the nearest heading.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Draw a field. Hatched: free cells without a fix; finely striped: a fix whose ellipse does not hold."""
    from api.heading_view import view_of  # noqa: PLC0415
    from api.render import heatmap_png  # noqa: PLC0415

    loaded = read_field(field_path)
    view = view_of(loaded, heading, metric)
    if isinstance(loaded, HeadingField) and heading is None:
        print_note(f"the best of {len(loaded)} headings is shown; see --heading.{_lost(loaded)}")
    png = heatmap_png(
        view,
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


def _lost(loaded: HeadingField) -> str:
    """How much of what the best heading shows is missing at others."""
    share = loaded.share_with_fix()[loaded.free]
    some = int(np.count_nonzero((share > 0) & (share < 1)))
    if not some:
        return ""
    percent = 100 * some / len(share)
    return f" {percent:.0f} % of the free cells have a fix at some headings only."
