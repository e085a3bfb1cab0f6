"""Options that several commands share: the robot, what its ways cost, what they must keep, how it drifts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from api.areas import read_areas
from localization.motion import OdometryModel
from planner.errors import InvalidProblem

if TYPE_CHECKING:
    from planner.travel import Travel

Radius_ = Annotated[float, typer.Option(metavar="R", help="Radius of the robot, m.")]
Weight_ = Annotated[
    float, typer.Option(metavar="W", help="Extra metres accepted per metre driven at r95 = 1 m.")
]
CostObjective_ = Annotated[
    str, typer.Option(help="weighted: cost per metre 1 + weight · r95; shortest: length.")
]
MaxR95_ = Annotated[
    float | None, typer.Option("--max-r95", metavar="B", help="Never less certain than this, m.")
]
MaxEllipse95_ = Annotated[
    float | None, typer.Option("--max-ellipse95", metavar="B", help="Semi-major axis of the 95 % ellipse, m.")
]
MaxCollision_ = Annotated[
    float | None, typer.Option("--max-collision-probability", metavar="P", help="Of every pose, 0 to 1.")
]
BlindR95_ = Annotated[
    float | None,
    typer.Option(
        "--blind-r95",
        metavar="B",
        help="Allow cells without a fix, at the cost of a place with this r95, m. Default: forbidden.",
    ),
]
Avoid_ = Annotated[
    Path | None,
    typer.Option(metavar="GEOJSON", help="Polygons that the robot must not enter, map metres."),
]
Areas_ = Annotated[
    Path | None,
    typer.Option(metavar="GEOJSON", help="Polygons with a property 'factor' of the cost per metre."),
]
MaxSpeed_ = Annotated[float, typer.Option("--max-speed", metavar="V", help="m/s.")]
MaxAccel_ = Annotated[float, typer.Option("--max-accel", metavar="A", help="m/s².")]
Odometry_ = Annotated[
    str | None,
    typer.Option(
        metavar="KEY=σ,…",
        help="Noise: distance (m after 1 m), turn (rad after 1 rad), drift (rad after 1 m), "
        "slip (m after 1 m). Default: distance=0.02,turn=0.03,drift=0.01,slip=0.",
    ),
]
FixRate_ = Annotated[float, typer.Option("--fix-rate", metavar="HZ", help="Fixes per second.")]
StartSigma_ = Annotated[
    tuple[float, float] | None,
    typer.Option(
        "--start-sigma", metavar="M DEG", help="How well the start is known. Default: as by a fix there."
    ),
]
StartCovariance_ = Annotated[
    tuple[float, float, float, float, float, float] | None,
    typer.Option(
        "--start-covariance",
        metavar="XX XY YY XT YT TT",
        help="The same in full, m², m rad and rad²; for --start-sigma.",
    ),
]

_NOISES = ("distance", "turn", "drift", "slip")
_COST_OBJECTIVES = ("weighted", "shortest")


def odometry_of(text: str) -> OdometryModel:
    """Noise from ``distance=0.02,turn=0.03,…``; what is left out keeps its default.

    Raises
    ------
    InvalidProblem
        If a name is unknown, given twice, or without a number.
    """
    values: dict[str, float] = {}
    for part in text.split(","):
        key, _, value = (p.strip() for p in part.partition("="))
        if key not in _NOISES or f"{key}_sigma" in values:
            raise InvalidProblem(
                f"The odometry is '{text}'; give {', '.join(_NOISES)}, each once: distance=0.02,…"
            )
        try:
            values[f"{key}_sigma"] = float(value)
        except ValueError:
            raise InvalidProblem(f"The odometry's {key} is '{value}'; give a number.") from None
    return OdometryModel(**values)


def start_variances(sigma: float, sigma_deg: float) -> tuple[float, float]:
    """Variances of the place's coordinates and of the heading, m² and rad², from standard deviations.

    Raises
    ------
    InvalidProblem
        If one is not positive and finite.
    """
    if not all(math.isfinite(v) and v > 0 for v in (sigma, sigma_deg)):
        raise InvalidProblem(f"The start is known to {sigma} m and {sigma_deg}°; both must be positive.")
    return sigma**2, math.radians(sigma_deg) ** 2


def start_covariance_of(
    sigma: tuple[float, float] | None, covariance: tuple[float, float, float, float, float, float] | None
) -> tuple[float, float, float, float, float, float] | None:
    """Six numbers of a start's covariance from what is given of both; None: nothing is.

    Raises
    ------
    InvalidProblem
        If both are given.
    """
    if sigma is None:
        return covariance
    if covariance is not None:
        raise InvalidProblem("Give --start-sigma or --start-covariance, not both.")
    place, heading = start_variances(*sigma)
    return place, 0.0, place, 0.0, 0.0, heading


def place_of(text: str, what: str, example: str) -> tuple[float, float]:
    """A place from ``X,Y``; ``what`` begins the message, ``example`` ends it.

    Raises
    ------
    InvalidProblem
        If it is none.
    """
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InvalidProblem(f"{what} is '{text}'; give X,Y in m, such as {example}.") from None
    return x, y


def travel_of(
    *, objective: str, weight: float, avoid: Path | None, areas: Path | None, **options: float | None
) -> Travel:
    """Robot, costs and bounds of a question about many places.

    Raises
    ------
    InvalidProblem
        If a number is out of its range or the objective is another.
    DocumentError
        If a file of areas cannot be read.
    """
    from planner.travel import Travel  # noqa: PLC0415  (loads the planner)

    if objective not in _COST_OBJECTIVES:
        names = " or ".join(_COST_OBJECTIVES)
        raise InvalidProblem(f"The objective is '{objective}'; questions about many places take {names}.")
    return Travel(
        weight=weight if objective == "weighted" else 0.0,
        avoid=tuple(polygon for polygon, _ in read_areas(avoid)),
        areas=tuple(read_areas(areas)),
        **options,  # type: ignore[arg-type]  # checked by itself
    )
