"""Why a robot with a heading has no way, in words that say what would help."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from maps.arrays import FloatArray
from planner.any_angle import shorten
from planner.cost_to_go import GridGraph
from planner.lattice import End, Outcome, lattice_for, search_lattice
from planner.steering import PoseSpace

# Corners that turn by less than this do not need an arc, rad.
_CORNER_RAD = 0.35
# Radii that are tried, as shares of the one asked for.
_SHARES = (0.75, 0.5, 0.35, 0.25)
# Clearance that is shown at most, m.
_CAP_M = 100.0


def why_no_way(
    space: PoseSpace, start: End, goal: End, *, stop: npt.NDArray[np.uint8], n_headings: int = 16
) -> str:
    """What keeps a robot from a goal.

    Parameters
    ----------
    space
        In which the lattice has no way.
    start, goal
        The ends.
    stop
        Shape (1,); when it is set, only what is known by then is said.
    n_headings
        Of the lattice.
    """
    plain = space.cost_space
    graph = GridGraph.from_cost_space(replace(plain, rate=np.min(space.rates, axis=0)))
    _, points = graph.costs_to((goal.x, goal.y), stop=stop).path_from((start.x, start.y))
    if stop[0] != 0:
        return "There is no way for this robot."
    if points is None:
        return f"Start and goal are not connected for a robot of radius {plain.radius:g} m."
    steering = space.steering
    points, _ = shorten(points, graph.cost_space)
    if not steering.is_car:
        place, room = _tightest(points, space)
        return (
            f"A disc of {plain.radius:g} m has a way, the robot with its heading has none: its outline does "
            "not fit, or a bound forbids the heading. That disc's way is tightest at "
            f"({place[0]:.1f}, {place[1]:.1f}) m, with {room:.2f} m to the nearest wall."
        )
    said = f"No way with arcs of {steering.min_turn_radius:g} m radius leads from pose to pose"
    place, room = _tightest(points, space)
    said += (
        f"; where the way without that limit is tightest, at ({place[0]:.1f}, {place[1]:.1f}) m, "
        f"the aisle leaves {room:.2f} m to the nearest wall."
    )

    def works(**changes: object) -> bool:
        if stop[0] != 0:
            return False
        other = replace(space, steering=replace(steering, **changes))  # type: ignore[arg-type]
        found = search_lattice(lattice_for(other, n_headings=n_headings), start, goal, stop=stop)
        return found.outcome is Outcome.FOUND

    if not steering.has_reverse and works(kinematics="reeds_shepp"):
        return f"{said} With a reverse gear there is one."
    for share in _SHARES:
        radius = share * steering.min_turn_radius
        if works(min_turn_radius=radius):
            return f"{said} With arcs of {radius:.2g} m there is one."
    return said


def _tightest(points: FloatArray, space: PoseSpace) -> tuple[FloatArray, float]:
    # The corner, or else the end, with the least clearance, and that.
    steps = np.diff(points, axis=0)
    directions = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.abs(np.remainder(np.diff(directions) + math.pi, 2.0 * math.pi) - math.pi)
    corners = points[1:-1][turns > _CORNER_RAD]
    places = corners if len(corners) else points[[0, -1]]
    room = np.minimum(space.cost_space.clearance.distance(places), _CAP_M)
    k = int(np.argmin(room))
    return places[k], float(room[k])
