"""``surepath triplets``: why a place is good or bad."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from api.cli_common import (
    HEADING_HELP,
    Criterion_,
    Landmarks_,
    Sensor_,
    UnknownFree_,
    UnknownOpaque_,
    World_,
    check_on_map,
    read_sensor,
    read_triplet,
    read_world,
)
from api.console import err, out, print_note
from localization.covariance import ellipse95
from localization.errors import LocalizationError
from localization.ranking import (
    LandmarkStatus,
    PlaceReport,
    TripletStatus,
    explain_place,
    one_triplet,
    triplet_status,
)
from localization.sensors import CRITERIA, Sensor
from localization.triplets import MAX_RANKED, TripletChoice
from maps.arrays import FloatArray
from maps.se2 import wrap
from maps.world import World

_WORDS = {
    LandmarkStatus.MEASURABLE: "yes",
    LandmarkStatus.TOO_NEAR: "no: too near",
    LandmarkStatus.TOO_FAR: "no: too far",
    LandmarkStatus.TURNED_AWAY: "no: it faces away",
    LandmarkStatus.HIDDEN: "no: something opaque is in between",
    LandmarkStatus.MUTED: "no: in a muted sector",
    LandmarkStatus.OUTSIDE_VIEW: "no: the camera cannot have it in view",
}
# Rows per kind in the table of landmarks.
_SHOWN = 10
_OUT = {
    TripletStatus.NOT_VISIBLE: "with a landmark that cannot be measured",
    TripletStatus.NOT_IN_ONE_VIEW: "not in one view",
    TripletStatus.DEGENERATE: "degenerate",
}


def triplets(
    world: World_,
    x: Annotated[float, typer.Argument(metavar="X", help="Where the robot is, m.", show_default=False)],
    y: Annotated[float, typer.Argument(metavar="Y", show_default=False)],
    heading_deg: Annotated[float, typer.Option(metavar="DEG", help=HEADING_HELP)] = 0.0,
    sensor: Sensor_ = "laser",
    criterion: Criterion_ = "area",
    count: Annotated[
        int, typer.Option(metavar="N", help="How many triplets to list at most, 1 to 10,000.")
    ] = 10,
    triplet: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Ask about these three landmarks alone.")
    ] = None,
    every_landmark: Annotated[
        bool, typer.Option("--all", help="List every landmark in range, not only the nearest of each kind.")
    ] = False,
    landmarks: Landmarks_ = None,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """Rank the landmark triplets at a place, and say of every landmark whether it can be measured.

    Also: how many triplets give no fix, and why, and which ones would rank with the best if their landmarks
    could be seen.
    """
    if criterion not in CRITERIA:
        raise LocalizationError(f"Unknown criterion '{criterion}'; use one of {', '.join(CRITERIA)}.")
    chosen = read_sensor(sensor)
    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    loaded.require_triangulation()
    check_on_map(loaded, x, y)
    if triplet is not None:
        _print_one(
            loaded, chosen, (x, y), math.radians(heading_deg), read_triplet(loaded, triplet), as_json=as_json
        )
        return
    with err.status("ranking …"):
        report = explain_place(
            loaded,
            chosen,
            (x, y),
            heading=math.radians(heading_deg),
            count=count,
            criterion=criterion,  # type: ignore[arg-type]  # checked above
        )
    if as_json:
        answer = {"criterion": criterion, **report_to_json(loaded, chosen, report)}
        sys.stdout.write(json.dumps(answer, indent=1, allow_nan=False) + "\n")
        return
    _print_report(loaded, chosen, report, None if every_landmark else _SHOWN)


def report_to_json(world: World, sensor: Sensor, report: PlaceReport) -> dict[str, Any]:
    """What a place offers, in figures; null where a number is not defined."""
    from api.codec import sensor_to_json  # noqa: PLC0415  (pydantic loads only here)

    ids, bearings = world.landmarks.ids, _bearings(world, sensor, report)
    return {
        "world": world.name,
        "x_m": float(report.point[0]),
        "y_m": float(report.point[1]),
        "heading_rad": report.heading,
        "sensor": sensor_to_json(sensor),
        "free": report.is_free,
        "triplets": [_choice(world, c) for c in report.ranked],
        "missed": [
            {
                **_choice(world, c),
                "blocking": {ids[i]: status.value for i, status in report.blocking(c.triplet).items()},
            }
            for c in report.missed
        ],
        "counts": None if report.counts is None else {status.value: n for status, n in report.counts.items()},
        "landmarks": [
            {
                "id": name,
                "x_m": float(world.landmarks.positions[i, 0]),
                "y_m": float(world.landmarks.positions[i, 1]),
                "distance_m": float(report.distance[i]),
                "bearing_rad": float(bearings[i]),
                "status": report.landmarks[i].value,
            }
            for i, name in enumerate(ids)
        ],
    }


def _choice(world: World, choice: TripletChoice) -> dict[str, Any]:
    a, b, azimuth = (float(v) for v in ellipse95(choice.covariance))
    return {
        "triplet": [world.landmarks.ids[i] for i in choice.triplet],
        "area95_m2": choice.area95,
        "r95_m": choice.r95,
        "covariance": choice.covariance.tolist(),
        "ellipse95": {"a_m": a, "b_m": b, "theta_rad": azimuth},
        "sigma_theta_rad": choice.sigma_theta,
        "pan_rad": choice.pan if math.isfinite(choice.pan) else None,
        "validity": choice.validity if math.isfinite(choice.validity) else None,
    }


def _print_one(
    world: World,
    sensor: Sensor,
    point: tuple[float, float],
    heading: float,
    triplet: tuple[int, int, int],
    *,
    as_json: bool,
) -> None:
    """What one triplet gives, its rank, or why it gives nothing."""
    status = triplet_status(world, sensor, point, triplet, heading=heading)
    choice = one_triplet(world, sensor, point, triplet, heading=heading)
    report = explain_place(world, sensor, point, heading=heading, count=MAX_RANKED)
    rank = next((k for k, c in enumerate(report.ranked, start=1) if set(c.triplet) == set(triplet)), None)
    why = {world.landmarks.ids[i]: s for i, s in report.blocking(triplet).items()}
    if as_json:
        answer = {
            "status": status.value,
            "rank": rank,
            "of": None if report.counts is None else report.counts[TripletStatus.FIX],
            "blocking": {name: s.value for name, s in why.items()},
            "fix": None if choice is None else _choice(world, choice),
        }
        sys.stdout.write(json.dumps(answer, indent=1, allow_nan=False) + "\n")
        return
    if status is TripletStatus.FIX:
        place = "beyond the 10,000 best" if rank is None else f"rank {rank}"
        fixes = "" if report.counts is None else f" of {report.counts[TripletStatus.FIX]} that give a fix"
        out.print(f"{place}{fixes}", highlight=False)
    elif why:
        said = "; ".join(f"{escape(name)} {_WORDS[s].removeprefix('no: ')}" for name, s in why.items())
        out.print(f"[yellow]no fix[/yellow]: {said}", highlight=False)
    else:
        out.print(f"[yellow]no fix[/yellow]: {_OUT[status]}", highlight=False)
    if choice is not None:
        title = "what it gives" if status is TripletStatus.FIX else "what it would give if it could be seen"
        out.print(_ranking(world, (choice,), title))


def _bearings(world: World, sensor: Sensor, report: PlaceReport) -> FloatArray:
    """Directions of the landmarks from the sensor's zero direction, rad."""
    dx, dy = (world.landmarks.positions - report.point - sensor.mount.offset(report.heading)).T
    return np.asarray(wrap(np.arctan2(dy, dx) - report.heading - sensor.mount.theta))


def _print_report(world: World, sensor: Sensor, report: PlaceReport, shown: int | None) -> None:
    x, y = (float(v) for v in report.point)
    if not report.is_free:
        print_note(f"({x:g}, {y:g}) m is not free: a robot cannot stand there, and nothing is ranked.")
    elif not report.ranked:
        seen = sum(s is LandmarkStatus.MEASURABLE for s in report.landmarks)
        out.print(f"[yellow]no fix[/yellow]: {seen} landmarks can be measured, no three give a fix")
    else:
        out.print(_ranking(world, report.ranked, "triplets, best first"))
    if report.counts is not None:
        out.print(_counted(report.counts), highlight=False)
    # What stands in the way can be moved; which way a landmark looks, less easily.
    missed = tuple(
        sorted(report.missed, key=lambda c: LandmarkStatus.TURNED_AWAY in report.blocking(c.triplet).values())
    )
    if missed:
        blocked = [
            ", ".join(
                f"{escape(world.landmarks.ids[i])} {_WORDS[status].removeprefix('no: ')}"
                for i, status in report.blocking(c.triplet).items()
            )
            for c in missed
        ]
        out.print(_ranking(world, missed, "would rank with them if they could be seen", blocked))
    out.print(_landmark_table(world, sensor, report, shown))
    far = Counter(report.landmarks)[LandmarkStatus.TOO_FAR]
    if far:
        out.print(f"{far} more are farther than {sensor.max_range:g} m", highlight=False)


def _ranking(
    world: World, choices: tuple[TripletChoice, ...], title: str, blocked: list[str] | None = None
) -> Table:
    has_pan = any(math.isfinite(c.pan) for c in choices)
    table = Table(title=title, title_justify="left")
    table.add_column("triplet")
    names = [
        "95 % area [m²]",
        "semi-axes [m]",
        "heading σ [°]",
        "valid [%]",
        *(["pan [°]"] if has_pan else []),
    ]
    for name in names:
        table.add_column(name, justify="right")
    if blocked is not None:
        table.add_column("but")
    for k, choice in enumerate(choices):
        a, b, _ = (float(v) for v in ellipse95(choice.covariance))
        row = [
            escape(", ".join(world.landmarks.ids[i] for i in choice.triplet)),
            f"{choice.area95:.3g}",
            f"{a:.3g} × {b:.3g}",
            f"{math.degrees(choice.sigma_theta):.2g}",
            f"{100 * choice.validity:.1f}",
        ]
        if has_pan:
            row.append(f"{math.degrees(choice.pan):.1f}")
        table.add_row(*row, *([] if blocked is None else [blocked[k]]))
    return table


def _counted(counts: dict[TripletStatus, int]) -> str:
    total = sum(counts.values())
    rest = [f"{counts[status]} {words}" for status, words in _OUT.items() if counts.get(status)]
    return f"{counts.get(TripletStatus.FIX, 0)} of {total} triplets give a fix" + "".join(
        f"; {part}" for part in rest
    )


def _landmark_table(world: World, sensor: Sensor, report: PlaceReport, most: int | None) -> Table:
    """Landmarks within range: those that can be measured first, each kind by distance, ``most`` of each."""
    table = Table(title="landmarks", title_justify="left")
    table.add_column("id")
    for name in ("distance [m]", "bearing [°]"):
        table.add_column(name, justify="right")
    table.add_column("can be measured")
    bearings = _bearings(world, sensor, report)
    shown = [i for i, s in enumerate(report.landmarks) if s is not LandmarkStatus.TOO_FAR]
    kinds: Counter[bool] = Counter()
    for i in sorted(
        shown, key=lambda i: (report.landmarks[i] is not LandmarkStatus.MEASURABLE, report.distance[i])
    ):
        status = report.landmarks[i]
        kinds[status is LandmarkStatus.MEASURABLE] += 1
        if most is not None and kinds[status is LandmarkStatus.MEASURABLE] > most:
            continue
        words = _WORDS[status]
        if status is LandmarkStatus.TOO_NEAR:
            words += f" (below {sensor.min_range:g} m)" if sensor.min_range > 0 else ""
        table.add_row(
            escape(world.landmarks.ids[i]),
            f"{report.distance[i]:.2f}",
            f"{math.degrees(bearings[i]):.1f}",
            words,
        )
    left = 0 if most is None else sum(max(0, n - most) for n in kinds.values())
    if left:
        table.caption = f"{left} farther ones are left out; --all lists them"
    return table
