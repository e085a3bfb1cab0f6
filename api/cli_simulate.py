"""``surepath simulate``: closed-loop runs of a plan."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from api.cli_common import Field_, write_file
from api.cli_options import FixRate_, Odometry_, StartSigma_, odometry_of, start_variances
from api.codec import DocumentError, read_json_file
from api.codec_simulation import (
    footprint_of_answer,
    radius_of_answer,
    simulation_to_json,
    trajectory_of_answer,
)
from api.console import err, out, print_note
from planner.reference import fitting_steering
from planner.simulation import DEFAULT_ODOMETRY, SimulatedRobot, simulate
from planner.simulation_report import SimulationReport

_PLAN_BYTES = 32_000_000


def simulate_command(
    field_path: Field_,
    plan: Annotated[
        Path, typer.Option(metavar="JSON", help="A plan on this field, as 'surepath plan -o' writes it.")
    ],
    runs: Annotated[int, typer.Option(metavar="N", help="How many, 1 to 100,000.")] = 1000,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Same seed, same runs.")] = 0,
    radius: Annotated[
        float | None,
        typer.Option(metavar="R", help="Radius of the robot, m. Default: the plan's, or its footprint."),
    ] = None,
    odometry: Odometry_ = None,
    fix_rate: FixRate_ = 5.0,
    mode: Annotated[str, typer.Option(help="Steer on filter (EKF) or fix (the last one).")] = "filter",
    policy: Annotated[
        str,
        typer.Option(help="best_triplet, arbitrary, or with a camera forced_forward, arbitrary_forward."),
    ] = "best_triplet",
    steering: Annotated[
        str | None,
        typer.Option(
            help="differential: along its heading, turning on the spot at corners; holonomic. Default: as "
            "the plan moves."
        ),
    ] = None,
    min_turn_radius: Annotated[
        float,
        typer.Option(
            "--min-turn-radius",
            metavar="R",
            help="Of a car, m: it turns no sharper, corrections included; take less than the plan's.",
        ),
    ] = 0.0,
    view_margin_deg: Annotated[
        float,
        typer.Option("--view-margin-deg", metavar="DEG", help="Landmarks keep this from a view's edges."),
    ] = 0.0,
    start_sigma: StartSigma_ = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="JSON", help="Write the report; - prints it.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw tracks, collisions, ellipses and errors.")
    ] = None,
) -> None:
    """Drive a plan many times in closed loop: odometry with noise, bearings, filter, path follower.

    Says how often the robot touches something, how far it strays, and whether the predicted ellipses hold.
    """
    from localization.heading_field import HeadingField  # noqa: PLC0415  (zarr loads only here)
    from localization.io.field_file import load_field  # noqa: PLC0415

    answer = read_json_file(plan, what="plan", max_bytes=_PLAN_BYTES)
    trajectory = trajectory_of_answer(answer)
    robot = SimulatedRobot(
        radius=radius_of_answer(answer) if radius is None else radius,
        footprint=footprint_of_answer(answer) if radius is None else None,
        odometry=DEFAULT_ODOMETRY if odometry is None else odometry_of(odometry),
        fix_rate=fix_rate,
        mode=mode,  # type: ignore[arg-type]  # checked by the robot itself
        policy=policy,  # type: ignore[arg-type]
        steering=fitting_steering(trajectory) if steering is None else steering,  # type: ignore[arg-type]
        min_turn_radius=min_turn_radius,
        view_margin=math.radians(view_margin_deg),
        start_covariance=None if start_sigma is None else _start(*start_sigma),
    )
    field = load_field(field_path)
    _check_same_map(answer, field.world.content_hash())
    fits = isinstance(field, HeadingField) or not field.sensor.depends_on_heading
    if not fits:
        print_note("the field holds for one heading; landmarks are chosen by the path instead")
    with err.status("driving …"):
        report = simulate(
            field.world,
            field.sensor,
            trajectory,
            robot=robot,
            runs=runs,
            rng=np.random.default_rng(seed),
            field=field if fits and policy == "best_triplet" and view_margin_deg == 0 else None,
        )
    to_stdout = output is not None and str(output) == "-"
    if output is not None:
        name = answer.get("plan")
        found = simulation_to_json(
            report,
            robot,
            world=field.world.name,
            plan=name if isinstance(name, str) else None,
            seed=seed,
        )
        text = json.dumps(found, indent=1, allow_nan=False) + "\n"
        sys.stdout.write(text) if to_stdout else write_file(output, text.encode())
    if picture is not None:
        from api.simulation_picture import simulation_png  # noqa: PLC0415

        write_file(picture, simulation_png(field.world, report))
    if not to_stdout:
        out.print(simulation_table(report))
        for path in (output, picture):
            if path is not None:
                out.print(f"written: {path}", highlight=False)


def simulation_table(report: SimulationReport) -> Table:
    """Figures of a simulation for people."""
    table = Table(show_header=False, box=None)
    way, time = float(report.reference.s[-1]), float(report.reference.times[-1])
    table.add_row("runs", f"{report.runs} of {way:.1f} m, {time:.1f} s each")
    c = report.collision
    table.add_row(
        "collisions",
        f"{report.collisions} ({100 * c.share:.2g} %, 95 % bounds {100 * c.low:.2g} to {100 * c.high:.2g} %)",
    )
    table.add_row("largest deviation", _words(report.worst_deviation))
    table.add_row("off the goal", _words(report.goal_error))
    table.add_row("inside 95 % ellipse", _shares(report))
    nees = report.nees
    table.add_row(
        "NEES", f"{nees.value:.3f}, consistent from {nees.low:.3f} to {nees.high:.3f} ({nees.dof} numbers)"
    )
    table.add_row("due fixes missed", f"{100 * report.blind_share:.1f} %")
    table.add_row("longest way without", _words(report.max_blind))
    return table


def _words(values: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return "–"
    median, high, largest = np.quantile(known, [0.5, 0.95, 1.0]).tolist()
    return f"median {median:.3g} m, 95 % below {high:.3g} m, largest {largest:.3g} m"


def _shares(report: SimulationReport) -> str:
    claimed, predicted = report.coverage, report.predicted_coverage
    return (
        f"{100 * claimed.share:.1f} % by the robot's own, {100 * predicted.share:.1f} % by the predicted one"
    )


def _start(sigma: float, sigma_deg: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    place, heading = start_variances(sigma, sigma_deg)
    return np.diag([place, place, heading])


def _check_same_map(answer: dict[str, Any], content_hash: str) -> None:
    if answer.get("map") != "m_" + content_hash:
        raise DocumentError("The plan was made on another map than the field; plan on this field.")
