"""``python -m tests.simulation_study --write`` measures the tables of docs/simulation.md: minutes on two cores."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from api.simulation_picture import simulation_png
from localization.consistency import share_bounds
from localization.field_builder import build_field
from localization.sensors import LASER
from maps.io.load import load_world
from maps.io.site import bundled_site
from planner.context import PlanningContext
from planner.madsen_1997_drive import FIX_RATE, ODOMETRY, RADIUS, VIEW_MARGIN, drive_diagonal
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from planner.result import PlanStatus
from planner.simulation import SimulatedRobot, simulate
from tests.conftest import SHARED
from tests.test_main_job import SITES, ends_of, with_placed_landmarks

DOCUMENT = Path(__file__).parents[1] / "docs" / "simulation.md"
PICTURES = DOCUMENT.parent / "pictures"
RUNS = 1000
SEED = 7
DISC_M = 0.3
#: Coarse enough that the ellipses matter beside the aisles: r95 of some 5 to 20 cm.
SENSOR = replace(LASER, bearing_sigma=math.radians(0.5))
LIMITS = (0.05, 0.005)
PAIRS = 2
# So many stations are judged at once: the bounds of each are as much wider.
_LEVEL = 1 - 0.05 / 120

TEXT = """# Plans in simulation

Made by `python -m tests.simulation_study --write` (seed {seed}, {runs} runs per row); every number is measured by that command.

`surepath simulate` drives a plan in closed loop: odometry with noise, bearings of the chosen landmarks with noise, an extended
Kalman filter, and a follower that steers on what the robot believes. Whether a landmark is seen is decided by an exact line of
sight from where the robot truly is, and which one is looked at by where it believes to be. A run ends when the robot touches
something, by exact clearance, between steps as well.

## Promised and simulated collision probability

`max_collision_probability` bounds the probability per pose that the robot touches something when it stands where one fix says
that its path is. The runs below steer on single fixes of the landmarks that are best where the robot should be ({rate:g} per second,
laser of {sigma:g}°, disc of {radius:g} m), {pairs} seeded pairs per site. "Promised" is the largest probability along the planned path; "displaced" is the largest share, at any of
up to 120 stations, of runs that would touch something there if they believed to be exactly on the path; "exceeded" counts
stations whose share lies above the limit beyond chance (95 % for all stations of a row together). The last two columns are
closed loops: shares of whole runs that touch anything anywhere, on single fixes and on the filter. They are not bounded by the
limit, which is of one pose: a path of many poses near a wall may collide more often. A follower does not jump to every fix,
though: it averages them.

{collisions}

A robot without a filter must not look up landmarks where its last fix says that it is: one wild fix, and it looks at those of
another place. On the filter it may, and does here (the cell of the field that it believes to be in).

Fields have cells of 0.1 m, and a promise is made for the middle of a cell: where a fix changes much within one, coarser cells
promise too much. Pairs for which no plan keeps the limit are left out.

The real maps (all but the first two) have reflectors where their makers put them (plant, office) or on their walls, 4 m apart.

## Fig. 7 of MAS97, driven

The diagonal of the paper's room by a disc of {wide:g} m with its camera, {fixes:g} fixes per second, odometry of {distance:g} m/√m and
{drift:g} rad/√m (`planner.madsen_1997_drive`). Best triplets with free pan against the camera forced to look ahead, with the best
of the triplets that it sees then, or an arbitrary one anew at every fix, as in the paper.

{fig7}

![Runs with the camera forced forward](pictures/simulation_forced_forward.png)

![Runs with the best triplet and free pan](pictures/simulation_best_triplet.png)

Triplets are chosen with {margin:g}° to spare at the edges of the view. Without, the triplet with the smallest ellipse nearly fills
the view, and the camera, turned by what the robot believes, loses one of the three all the time: {missed_filled:.0f} % of due fixes are
missed instead of {missed_spared:.0f} %.
"""


def worlds():
    """Name and world of every site at hand."""
    for name in ("mas97_room", "warehouse"):
        yield name, bundled_site(name)
    if SHARED.is_dir():
        for name, (path, spacing) in SITES.items():
            world = load_world(SHARED / path)
            yield name, world if spacing is None else with_placed_landmarks(world, spacing)


def collisions() -> list[dict[str, object]]:
    """Rows of the first table."""
    rows = []
    for name, world in worlds():
        context = PlanningContext(build_field(world, SENSOR, resolution=0.1))
        rng = np.random.default_rng(SEED)
        for k, (start, goal) in enumerate(ends_of(context, rng, PAIRS)):
            for limit in LIMITS:
                problem = PlanningProblem(
                    start=start, goal=goal, radius=DISC_M, max_collision_probability=limit, deadline=30.0
                )
                found = plan(problem, context)
                if found.route is None or found.status is PlanStatus.RISK_UNMET:
                    print(f"{name} {k} {limit}: {found.status.value}")
                    continue
                rows.append(_row(f"{name} {k + 1}", limit, found.route, context))
                print(rows[-1])
    return rows


def _row(name, limit, route, context) -> dict[str, object]:
    reports = {}
    for mode, rate in (("fix", 20.0), ("filter", 5.0)):
        robot = SimulatedRobot(radius=DISC_M, mode=mode, fix_rate=rate)
        reports[mode] = simulate(
            context.field.world,
            context.field.sensor,
            route.trajectory,
            robot=robot,
            runs=RUNS,
            rng=np.random.default_rng(SEED),
            field=context.field if mode == "filter" else None,
        )
    at = reports["fix"].stations
    low = [
        share_bounds(round(d * n), n, level=_LEVEL)[0]
        for d, n in zip(at.displaced.tolist(), at.n.tolist(), strict=True)
        if n
    ]
    # A run that touches something at once never gets to the first station.
    at_start = int((reports["fix"].collision_s == 0).sum())
    return {
        "path": name,
        "length [m]": f"{route.summary.length:.0f}",
        "limit": f"{limit:g}",
        "promised": f"{route.summary.max_collision_probability:.2g}",
        "displaced": f"{max(np.nanmax(at.displaced), at_start / RUNS):.2g}",
        "exceeded": sum(v > limit for v in [*low, share_bounds(at_start, RUNS, level=_LEVEL)[0]]),
        "inside ellipse": f"{100 * reports['fix'].coverage.share:.1f} %",
        "runs colliding, fixes": f"{reports['fix'].collision.share:.2g}",
        "runs colliding, filter": f"{reports['filter'].collision.share:.2g}",
    }


def fig7() -> tuple[list[dict[str, object]], dict]:
    """Rows of the second table, and its reports."""
    reports = drive_diagonal(bundled_site("mas97_room"), runs=RUNS, rng=np.random.default_rng(SEED))
    rows = [
        {
            "way to look": policy.replace("_", " "),
            "runs colliding": f"{100 * r.collision.share:.1f} % ({100 * r.collision.low:.1f} to {100 * r.collision.high:.1f})",
            "rms error [m]": f"{r.mean_error:.3f}",
            "95 % off the goal by less than [m]": f"{np.nanquantile(r.goal_error, 0.95):.2f}",
            "due fixes missed": f"{100 * r.blind_share:.0f} %",
            "inside own 95 % ellipse": f"{100 * r.coverage.share:.1f} %",
            "NEES (3)": f"{r.nees.value:.2f}",
        }
        for policy, r in reports.items()
    ]
    return rows, reports


def _filled() -> float:
    """Due fixes missed with triplets that fill the view."""
    room = bundled_site("mas97_room")
    return drive_diagonal(room, runs=RUNS, rng=np.random.default_rng(SEED), view_margin=0.0)[
        "best_triplet"
    ].blind_share


def _table(rows: list[dict[str, object]]) -> str:
    lines = ["| " + " | ".join(rows[0]) + " |", "|" + "---|" * len(rows[0])]
    return "\n".join(lines + ["| " + " | ".join(str(v) for v in row.values()) + " |" for row in rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write docs/{DOCUMENT.name} and its pictures")
    options = parser.parse_args()
    began = time.perf_counter()
    warm_up()
    rows, reports = fig7()
    found = collisions()
    text = TEXT.format(
        seed=SEED,
        runs=RUNS,
        rate=20,
        sigma=math.degrees(SENSOR.bearing_sigma),
        radius=DISC_M,
        pairs=PAIRS,
        collisions=_table(found),
        wide=RADIUS,
        fixes=FIX_RATE,
        distance=ODOMETRY.distance_sigma,
        drift=ODOMETRY.drift_sigma,
        fig7=_table(rows),
        margin=math.degrees(VIEW_MARGIN),
        missed_filled=100 * _filled(),
        missed_spared=100 * reports["best_triplet"].blind_share,
    )
    print(text)
    print(f"{time.perf_counter() - began:.0f} s")
    if options.write:
        DOCUMENT.write_text(text)
        for policy in ("best_triplet", "forced_forward"):
            picture = simulation_png(bundled_site("mas97_room"), reports[policy], width=1000)
            (PICTURES / f"simulation_{policy}.png").write_bytes(picture)


if __name__ == "__main__":
    main()
