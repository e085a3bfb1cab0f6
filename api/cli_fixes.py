"""``surepath fixes``: Monte Carlo of fixes at a pose."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer
from rich.markup import escape
from rich.table import Table

from api.cli_common import (
    Landmarks_,
    Sensor_,
    UnknownFree_,
    UnknownOpaque_,
    World_,
    check_on_map,
    read_sensor,
    read_triplet,
    read_world,
    write_file,
)
from api.console import err, out
from localization.covariance import area95, ellipse95
from localization.errors import LocalizationError
from localization.kernels.coverage import is_valid
from localization.ranking import one_triplet
from localization.simulation import FixCloud, simulate_fixes
from localization.triangulation import FixStatus
from maps.world import World


def fixes(
    world: World_,
    x: Annotated[float, typer.Argument(metavar="X", help="Where the robot is, m.", show_default=False)],
    y: Annotated[float, typer.Argument(metavar="Y", show_default=False)],
    heading_deg: Annotated[float, typer.Option(metavar="DEG", help="Heading of the robot.")] = 0.0,
    sensor: Sensor_ = "laser",
    triplet: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Ids of three landmarks; default: the best triplet.")
    ] = None,
    n: Annotated[int, typer.Option("-n", "--number", metavar="N", help="Number of measurements.")] = 10_000,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Same seed, same fixes.")] = 0,
    landmarks: Landmarks_ = None,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PNG", help="Draw cloud, ellipse, danger circle, horopters."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """Simulate fixes at a pose: measure a triplet many times with the sensor's noise, triangulate each.

    Says how many fixes lie inside the predicted 95 % ellipse and how prediction and sample compare: far
    from 95 % means that first order does not hold there.
    """
    chosen = read_sensor(sensor)
    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    loaded.require_triangulation()
    _check_place(loaded, x, y)
    three = None if triplet is None else read_triplet(loaded, triplet)
    with err.status("measuring …"):
        cloud = simulate_fixes(
            loaded,
            chosen,
            (x, y),
            heading=math.radians(heading_deg),
            triplet=three,
            n=n,
            rng=np.random.default_rng(seed),
        )
    choice = one_triplet(loaded, chosen, (x, y), cloud.triplet, heading=math.radians(heading_deg))
    predicted = math.nan if choice is None else choice.validity
    if output is not None:
        from api.fix_picture import fix_png  # noqa: PLC0415

        write_file(output, fix_png(loaded, cloud))
    if as_json:
        sys.stdout.write(
            json.dumps(fixes_to_json(loaded, cloud, seed, predicted), indent=1, allow_nan=False) + "\n"
        )
        return
    out.print(fixes_table(loaded, cloud, predicted))
    if output is not None:
        out.print(f"written: {output}", highlight=False)


def fixes_to_json(world: World, cloud: FixCloud, seed: int, predicted: float) -> dict[str, Any]:
    """A cloud of fixes in figures; null where a number is not defined."""
    bias = _numbers(cloud.bias)
    return {
        "world": world.name,
        "pose": dict(zip(("x_m", "y_m", "heading_rad"), _numbers(cloud.pose), strict=True)),
        "triplet": [world.landmarks.ids[i] for i in cloud.triplet],
        "pan_rad": _numbers(cloud.pan),
        "n": len(cloud.fixes),
        "seed": seed,
        "failures": _failures(cloud),
        "share_inside": cloud.share_inside,
        "predicted_share": None if math.isnan(predicted) else predicted,
        "predicted": _spread(cloud.predicted),
        "sample": _spread(cloud.sample_covariance),
        "bias": dict(zip(("x_m", "y_m", "heading_rad"), bias, strict=True)),
    }


def fixes_table(world: World, cloud: FixCloud, predicted: float) -> Table:
    """The same figures for people."""
    table = Table(show_header=False, box=None)
    x, y, heading = (float(v) for v in cloud.pose)
    names = ", ".join(world.landmarks.ids[i] for i in cloud.triplet)
    table.add_row("pose", f"({x:g}, {y:g}) m, {math.degrees(heading):g}°")
    pan = "" if math.isnan(cloud.pan) else f", axis {math.degrees(cloud.pan):.1f}° from the heading"
    table.add_row("triplet", escape(names) + pan)
    failed = ", ".join(f"{count} {name}" for name, count in _failures(cloud).items())
    table.add_row(
        "measurements", f"{len(cloud.fixes)}, {cloud.failures} without a fix" + _in_brackets(failed)
    )
    share = f"{100 * cloud.share_inside:.1f} %, predicted {100 * predicted:.1f} %"
    table.add_row("inside 95 % ellipse", share + ("" if is_valid(predicted) else " (not valid)"))
    for name, covariance in (("predicted", cloud.predicted), ("sample", cloud.sample_covariance)):
        table.add_row(name, _words(covariance))
    if cloud.failures < len(cloud.fixes):
        bx, by, turn = (float(v) for v in cloud.bias)
        table.add_row("bias", f"({bx:.2g}, {by:.2g}) m, {math.degrees(turn):.2g}°")
    return table


def _in_brackets(text: str) -> str:
    return f" ({text})" if text else ""


def _check_place(world: World, x: float, y: float) -> None:
    check_on_map(world, x, y)
    if not world.floor.free_at((x, y)):
        raise LocalizationError(f"Place ({x:g}, {y:g}) m is not free; choose one where a robot can stand.")


def _failures(cloud: FixCloud) -> dict[str, int]:
    """Outcomes other than a fix, in lower case, with their counts."""
    counts = {s.name.lower(): cloud.fixes.count(s) for s in FixStatus if s is not FixStatus.OK}
    return {name: count for name, count in counts.items() if count}


def _position(covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(covariance[[0, 0, 1], [0, 1, 1]])


def _spread(covariance: npt.NDArray[np.float64]) -> dict[str, Any]:
    position = _position(covariance)
    a, b, azimuth = _numbers(ellipse95(position))
    return {
        "pose_covariance": _numbers(covariance),
        "area95_m2": _numbers(area95(position)),
        "ellipse95": None if a is None else {"a_m": a, "b_m": b, "theta_rad": azimuth},
        "sigma_heading_rad": _numbers(np.sqrt(covariance[2, 2])),
    }


def _words(covariance: npt.NDArray[np.float64]) -> str:
    position = _position(covariance)
    a, b, azimuth = (float(v) for v in ellipse95(position))
    if math.isnan(a):
        return "–"
    turn = math.degrees(math.sqrt(float(covariance[2, 2])))
    return (
        f"95 % ellipse {2 * a:.3g} m × {2 * b:.3g} m at {math.degrees(azimuth):.0f}°, "
        f"{float(area95(position)):.3g} m²; heading σ {turn:.2g}°"
    )


def _numbers(values: npt.ArrayLike) -> Any:
    """Plain numbers, NaN as null."""
    plain = np.asarray(values).tolist()
    if isinstance(plain, list):
        return [_numbers(v) for v in plain]
    return plain if math.isfinite(plain) else None
