"""``surepath plan``."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from api.areas import read_areas
from api.cli_common import EXIT_UNMET, Field_, read_field, write_file
from api.cli_options import (
    Areas_,
    Avoid_,
    BlindR95_,
    FixRate_,
    MaxAccel_,
    MaxCollision_,
    MaxEllipse95_,
    MaxR95_,
    MaxSpeed_,
    Odometry_,
    Radius_,
    StartCovariance_,
    StartSigma_,
    Weight_,
    odometry_of,
    place_of,
    start_covariance_of,
)
from api.console import err, print_note, print_plan
from api.questions import FRONT_COUNT, AlternativesAsked, FrontAsked, More
from localization.heading_field import HeadingField
from localization.motion import OdometryModel
from planner.errors import InvalidProblem

if TYPE_CHECKING:
    from localization.uncertainty_field import UncertaintyField
    from planner.problem import PlanningProblem


def plan(
    field_path: Field_,
    start: Annotated[tuple[float, float], typer.Option(metavar="X Y", help="Start, m.")],
    goal: Annotated[tuple[float, float], typer.Option(metavar="X Y", help="Goal, m.")],
    radius: Radius_ = 0.35,
    objective: Annotated[
        str,
        typer.Option(
            help="shortest; weighted: cost per metre 1 + weight · r95; minimax: least worst r95, then "
            "length; pareto: routes from the shortest to the surest."
        ),
    ] = "weighted",
    weight: Weight_ = 4.0,
    max_r95: MaxR95_ = None,
    max_ellipse95: MaxEllipse95_ = None,
    max_collision_probability: MaxCollision_ = None,
    max_blind_distance: Annotated[
        float | None,
        typer.Option("--max-blind-distance", metavar="D", help="Longest stretch without a fix, m."),
    ] = None,
    covariance: Annotated[
        str,
        typer.Option(help="Whose uncertainty counts: fix, or fused (the filter's, odometry and fixes)."),
    ] = "fix",
    odometry: Odometry_ = None,
    fix_rate: FixRate_ = 10.0,
    start_sigma: StartSigma_ = None,
    start_covariance: StartCovariance_ = None,
    against: Annotated[
        str | None, typer.Option(help="For pareto: worst (default) or mean r95 against length.")
    ] = None,
    count: Annotated[
        int | None, typer.Option(metavar="N", help="For pareto: routes at most, 2 to 50 (default 8).")
    ] = None,
    alternatives: Annotated[
        int | None,
        typer.Option(metavar="K", help="Up to K routes that differ, 1 to 10, the best one included."),
    ] = None,
    max_cost_factor: Annotated[
        float,
        typer.Option("--max-cost-factor", metavar="F", help="Alternatives cost at most this times the best."),
    ] = 1.4,
    max_share: Annotated[
        float,
        typer.Option("--max-share", metavar="Q", help="Alternatives share at most this part of their way."),
    ] = 0.6,
    schedule: Annotated[
        bool, typer.Option("--schedule", help="Say for every stretch which landmarks to look at, and where.")
    ] = False,
    kinematics: Annotated[
        str, typer.Option(help="holonomic, differential (turns in place), dubins or reeds_shepp.")
    ] = "holonomic",
    min_turn_radius: Annotated[
        float, typer.Option("--min-turn-radius", metavar="R", help="Of arcs, m; for dubins and reeds_shepp.")
    ] = 0.0,
    start_heading_deg: Annotated[
        float | None, typer.Option("--start-heading-deg", metavar="DEG", help="Default: any.")
    ] = None,
    goal_heading_deg: Annotated[
        float | None, typer.Option("--goal-heading-deg", metavar="DEG", help="Default: any.")
    ] = None,
    footprint: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y X,Y …",
            help="Corners of the outline, m: x ahead, y to the left; for --radius.",
        ),
    ] = None,
    max_turn_rate: Annotated[
        float, typer.Option("--max-turn-rate", metavar="W", help="rad/s; where headings matter.")
    ] = 1.0,
    max_turn_accel: Annotated[
        float | None, typer.Option("--max-turn-accel", metavar="A", help="rad/s². Default: no limit.")
    ] = None,
    pan_rate_deg: Annotated[
        float | None,
        typer.Option("--pan-rate-deg", metavar="W", help="Of a pan head, °/s. Default: it turns at once."),
    ] = None,
    via: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y", help="Place to pass; may be given several times, in order."),
    ] = None,
    avoid: Avoid_ = None,
    areas: Areas_ = None,
    blind_r95: BlindR95_ = None,
    max_speed: MaxSpeed_ = 1.2,
    max_accel: MaxAccel_ = 0.8,
    deadline: Annotated[float, typer.Option(metavar="S", help="Time for the whole plan, s.")] = 2.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Same seed, same answer.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="JSON", help="Write the answer of POST /v1/plans; - prints it."
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw map, field, all routes and ellipses.")
    ] = None,
) -> None:
    """Plan a path through a field: the one on which the robot knows where it is.

    On a field over headings the robot faces its way, and the cost is that of its heading.

    Exit code 3 when no path keeps the bound (the best effort is written all the same).
    """
    from api.codec import plan_to_json  # noqa: PLC0415
    from api.finding import find, warm_up  # noqa: PLC0415
    from planner.context import PlanningContext  # noqa: PLC0415
    from planner.problem import PlanningProblem  # noqa: PLC0415

    more = More(
        None if alternatives is None else AlternativesAsked(alternatives, max_cost_factor, max_share),
        _front(objective, against, count),
        schedule,
        _pan_rate(pan_rate_deg),
    )
    problem = PlanningProblem(
        start=start,
        goal=goal,
        radius=radius,
        objective="shortest" if more.front else objective,  # type: ignore[arg-type]  # checked by itself
        weight=weight,
        max_r95=max_r95,
        max_ellipse95=max_ellipse95,
        max_collision_probability=max_collision_probability,
        max_blind_distance=max_blind_distance,
        covariance=covariance,  # type: ignore[arg-type]  # checked by the problem itself
        odometry=OdometryModel() if odometry is None else odometry_of(odometry),
        fix_rate=fix_rate,
        start_covariance=start_covariance_of(start_sigma, start_covariance),
        kinematics=kinematics,  # type: ignore[arg-type]  # checked by the problem itself
        min_turn_radius=min_turn_radius,
        start_heading=None if start_heading_deg is None else math.radians(start_heading_deg),
        goal_heading=None if goal_heading_deg is None else math.radians(goal_heading_deg),
        footprint=None if footprint is None else _footprint(footprint),
        turn_rate=max_turn_rate,
        max_turn_accel=math.inf if max_turn_accel is None else max_turn_accel,
        via=tuple(place_of(text, "The via point", "--via 12.5,3") for text in via or ()),
        avoid=tuple(polygon for polygon, _ in read_areas(avoid)),
        areas=tuple((polygon, factor) for polygon, factor in read_areas(areas)),
        blind_r95=blind_r95,
        max_speed=max_speed,
        max_accel=max_accel,
        deadline=deadline,
        seed=seed,
    )
    found = read_field(field_path)
    if isinstance(found, HeadingField):
        loaded = found.reduced("best")
        print_note(f"the field is over {len(found)} headings: the robot faces the way that it drives.")
    else:
        loaded = found
    with err.status("preparing …"):
        warm_up(more)  # compiling is not planning: the deadline starts afterwards
        context = PlanningContext(found)
    answer = plan_to_json(find(problem, context, more), found, problem=problem, more=more)
    to_stdout = output is not None and str(output) == "-"
    if output is not None:
        text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
        sys.stdout.write(text) if to_stdout else write_file(output, text.encode())
    if picture is not None:
        write_file(picture, _picture(loaded, answer, problem, of_headings=found is not loaded))
    if not to_stdout:
        print_plan(answer)
    if answer["status"] not in {"exact", "approximate"}:
        raise typer.Exit(EXIT_UNMET)


def _picture(
    field: UncertaintyField, answer: dict[str, Any], problem: PlanningProblem, *, of_headings: bool
) -> bytes:
    """Map and routes; where the robot's heading matters its outline, with a schedule the stretches."""
    if problem.has_pose or of_headings:
        from api.pose_picture import pose_png  # noqa: PLC0415

        return pose_png(field, answer, problem)
    if len(answer["routes"]) == 1 and answer["routes"][0].get("schedule"):
        from api.schedule_picture import schedule_png  # noqa: PLC0415

        return schedule_png(field, answer)
    from api.plan_picture import plan_png  # noqa: PLC0415

    return plan_png(field, answer)


def _front(objective: str, against: str | None, count: int | None) -> FrontAsked | None:
    """The front that is asked for."""
    if objective == "pareto":
        against = "worst" if against is None else against
        return FrontAsked(against, FRONT_COUNT if count is None else count)  # type: ignore[arg-type]
    if against is not None or count is not None:
        raise InvalidProblem("--against and --count belong to --objective pareto.")
    return None


def _pan_rate(degrees: float | None) -> float:
    if degrees is None:
        return math.inf
    if not (math.isfinite(degrees) and degrees > 0):
        raise InvalidProblem(f"The pan rate is {degrees}°/s; it must be positive and finite.")
    return math.radians(degrees)


def _footprint(text: str) -> tuple[tuple[float, float], ...]:
    """Corners from ``X,Y X,Y …``."""
    example = '--footprint "0.5,0.3 -0.5,0.3 -0.5,-0.3 0.5,-0.3"'
    corners = enumerate(text.split(), 1)
    return tuple(place_of(corner, f"Corner {k} of the footprint", example) for k, corner in corners)
