"""``surepath matrix`` and ``surepath reach``."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer
from rich.table import Table

from api.cli_common import EXIT_UNMET, Field_, read_field, write_file
from api.cli_options import (
    Areas_,
    Avoid_,
    BlindR95_,
    CostObjective_,
    MaxAccel_,
    MaxCollision_,
    MaxEllipse95_,
    MaxR95_,
    MaxSpeed_,
    Radius_,
    Weight_,
    travel_of,
)
from api.codec import DocumentError
from api.console import err, out, print_note
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField

if TYPE_CHECKING:
    from planner.matrix import CostMatrix

# Larger matrices are not printed.
_MAX_PRINTED = 10

Deadline_ = Annotated[float, typer.Option(metavar="S", help="Time for all searches, s.")]


def matrix(
    field_path: Field_,
    points: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Places as CSV (id,x,y) or JSON (a list of pairs x, y), in m."),
    ],
    targets: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to; default: the same places.")
    ] = None,
    radius: Radius_ = 0.35,
    objective: CostObjective_ = "weighted",
    weight: Weight_ = 4.0,
    max_r95: MaxR95_ = None,
    max_ellipse95: MaxEllipse95_ = None,
    max_collision_probability: MaxCollision_ = None,
    blind_r95: BlindR95_ = None,
    avoid: Avoid_ = None,
    areas: Areas_ = None,
    max_speed: MaxSpeed_ = 1.2,
    max_accel: MaxAccel_ = 0.8,
    deadline: Deadline_ = 60.0,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Ends in .json, .csv (a line per pair) or .npy (cost, length, duration, mean and worst r95, "
            "metres without a fix; NaN where there is no way); - prints JSON.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw places, lengths and worst r95.")
    ] = None,
) -> None:
    """Cost, length, duration and uncertainty from every place to every other.

    Places that the robot cannot use are said, and empty in the answer. Exit code 3 when no pair has a way, or
    the deadline came first.
    """
    from api.codec_matrix import matrix_to_json  # noqa: PLC0415
    from maps.io.place_files import read_places  # noqa: PLC0415
    from planner.context import PlanningContext  # noqa: PLC0415
    from planner.matrix import cost_matrix, warm_up  # noqa: PLC0415

    to_stdout = output is not None and str(output) == "-"
    if output is not None and not to_stdout and output.suffix.lower() not in {".json", ".csv", ".npy"}:
        raise DocumentError(f"'{output}': a matrix is written as .json, .csv or .npy.")
    travel = travel_of(
        objective=objective,
        weight=weight,
        avoid=avoid,
        areas=areas,
        radius=radius,
        max_r95=max_r95,
        max_ellipse95=max_ellipse95,
        max_collision_probability=max_collision_probability,
        blind_r95=blind_r95,
        max_speed=max_speed,
        max_accel=max_accel,
    )
    names, places = read_places(points)
    other_names, others = read_places(targets) if targets is not None else (names, None)
    loaded = _one_field(field_path)
    with err.status("searching …"):
        warm_up()
        found = cost_matrix(PlanningContext(loaded), places, others, travel=travel, deadline=deadline)
    if picture is not None:
        from api.matrix_picture import matrix_png  # noqa: PLC0415

        write_file(picture, matrix_png(loaded, found, names, other_names))
    if to_stdout:
        document = matrix_to_json(found, names, other_names)
        sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")
    else:
        if output is not None:
            write_file(output, _matrix_bytes(found, names, other_names, output.suffix.lower()))
        _print_matrix(found, names, other_names)
    if not np.isfinite(found.cost).any() or not found.is_complete:
        raise typer.Exit(EXIT_UNMET)


def reach(
    field_path: Field_,
    place: Annotated[tuple[float, float], typer.Option("--from", metavar="X Y", help="Place, m.")],
    max_cost: Annotated[float | None, typer.Option("--max-cost", metavar="C", help="Largest cost.")] = None,
    max_length: Annotated[
        float | None, typer.Option("--max-length", metavar="L", help="Largest length, m.")
    ] = None,
    max_time: Annotated[
        float | None, typer.Option("--max-time", metavar="T", help="Longest drive at full speed, s.")
    ] = None,
    radius: Radius_ = 0.35,
    objective: CostObjective_ = "weighted",
    weight: Weight_ = 4.0,
    max_r95: MaxR95_ = None,
    max_ellipse95: MaxEllipse95_ = None,
    max_collision_probability: MaxCollision_ = None,
    blind_r95: BlindR95_ = None,
    avoid: Avoid_ = None,
    areas: Areas_ = None,
    max_speed: MaxSpeed_ = 1.2,
    deadline: Deadline_ = 30.0,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="GEOJSON", help="Write the polygons, in m; - prints them."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw map, field and the region.")
    ] = None,
) -> None:
    """Where a robot can get to from a place, and from where it can get there: both are the same.

    At most one of --max-cost, --max-length and --max-time; with --max-r95 only ways that never exceed it.
    Exit code 3 when nothing is within reach.
    """
    from api.codec_matrix import region_to_geojson  # noqa: PLC0415
    from planner.context import PlanningContext  # noqa: PLC0415
    from planner.reachability import reachable_region  # noqa: PLC0415

    measures: dict[Literal["cost", "length", "time"], float | None] = {
        "cost": max_cost,
        "length": max_length,
        "time": max_time,
    }
    given = [(name, value) for name, value in measures.items() if value is not None]
    if len(given) > 1:
        raise DocumentError("Give at most one of --max-cost, --max-length and --max-time.")
    measure, limit = given[0] if given else ("cost", float("inf"))
    travel = travel_of(
        objective=objective,
        weight=weight,
        avoid=avoid,
        areas=areas,
        radius=radius,
        max_r95=max_r95,
        max_ellipse95=max_ellipse95,
        max_collision_probability=max_collision_probability,
        blind_r95=blind_r95,
        max_speed=max_speed,
    )
    loaded = _one_field(field_path)
    with err.status("searching …"):
        region = reachable_region(
            PlanningContext(loaded), place, travel=travel, measure=measure, limit=limit, deadline=deadline
        )
    to_stdout = output is not None and str(output) == "-"
    if output is not None:
        text = json.dumps(region_to_geojson(region), allow_nan=False) + "\n"
        sys.stdout.write(text) if to_stdout else write_file(output, text.encode())
    if picture is not None:
        from api.reach_picture import reach_png  # noqa: PLC0415

        write_file(picture, reach_png(loaded, region))
    if not to_stdout:
        parts = f" in {len(region.polygons)} parts" if len(region.polygons) > 1 else ""
        out.print(f"within reach: {region.area:.1f} m²{parts}", highlight=False)
    for warning in region.warnings:
        print_note(warning)
    if not region.is_complete:
        print_note(f"the deadline of {deadline:g} s came first: the region is a part of the true one.")
    if not region.polygons:
        raise typer.Exit(EXIT_UNMET)


def _one_field(path: Path) -> UncertaintyField:
    found = read_field(path)
    if isinstance(found, HeadingField):
        print_note(f"the field is over {len(found)} headings; the worst of them counts in every cell.")
        return found.reduced("worst")
    return found


def _matrix_bytes(
    found: CostMatrix, names: tuple[str, ...], other_names: tuple[str, ...], suffix: str
) -> bytes:
    from api.codec_matrix import matrix_to_array, matrix_to_csv, matrix_to_json  # noqa: PLC0415

    if suffix == ".csv":
        return matrix_to_csv(found, names, other_names).encode()
    if suffix == ".npy":
        data = io.BytesIO()
        np.save(data, matrix_to_array(found))
        return data.getvalue()
    document = matrix_to_json(found, names, other_names)
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _print_matrix(found: CostMatrix, names: tuple[str, ...], other_names: tuple[str, ...]) -> None:
    if max(found.cost.shape) <= _MAX_PRINTED:
        table = Table(title="cost / worst r95 [m]", title_justify="left")
        table.add_column("")
        for name in other_names:
            table.add_column(name, justify="right")
        for name, costs, worst in zip(names, found.cost, found.worst_r95, strict=True):
            table.add_row(name, *(_cell(c, w) for c, w in zip(costs, worst, strict=True)))
        out.print(table)
    n, m = found.cost.shape
    ways = int(np.isfinite(found.cost).sum())
    out.print(
        f"{n} × {m} pairs, {ways} with a way, by {found.stats['searches']:.0f} searches "
        f"in {found.stats['total_s']:.2f} s",
        highlight=False,
    )
    for warning in found.warnings:
        out.print(f"[yellow]note[/yellow] {warning}", highlight=False)


def _cell(cost: float, worst: float) -> str:
    if np.isnan(cost):
        return "–"
    return f"{cost:.2f} / " + ("no fix" if np.isnan(worst) else f"{worst:.3f}")
