"""Whether the robot can stand at the start and at the goal."""

from __future__ import annotations

from shapely import Point

from maps.clearance import TOUCH_M
from planner.context import PlanningContext
from planner.errors import GoalOccupied, GoalOutsideMap, PlannerError, StartOccupied, StartOutsideMap
from planner.problem import PlanningProblem

# Hints have this much more room than the robot needs, m, so that they survive rounding to centimetres.
_HINT_MARGIN_M = 0.01

_OUTSIDE: dict[str, type[PlannerError]] = {"start": StartOutsideMap, "goal": GoalOutsideMap}
_OCCUPIED: dict[str, type[PlannerError]] = {"start": StartOccupied, "goal": GoalOccupied}


def check_ends(problem: PlanningProblem, context: PlanningContext) -> None:
    """Refuse a start or goal where the robot cannot be.

    Raises
    ------
    StartOutsideMap, GoalOutsideMap
        If it is not on the field's grid.
    StartOccupied, GoalOccupied
        If it is not free, or nearer to an obstacle or an area to avoid than the radius. Message and
        ``nearest_free`` say where the robot fits.
    """
    radius, robot = problem.inner_radius, problem.robot_in_words
    for name in ("start", "goal"):
        x, y = place = problem.start if name == "start" else problem.goal
        said = f"{name.capitalize()} ({x:g}, {y:g}) m"
        if not bool(context.field.frame.contains(place)):
            x0, y0, x1, y1 = context.field.frame.bounds()
            raise _OUTSIDE[name](
                f"{said} is outside the map, which spans x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m.",
                nearest_free=_hint(place, radius, context),
            )
        for k, polygon in enumerate(problem.avoid):
            gap = float(polygon.distance(Point(place)))
            if gap <= radius:
                raise _OCCUPIED[name](
                    f"{said} is {_down(gap)} m from avoid area {k + 1}, which {robot} must not "
                    "touch. Move the place, or change the area."
                )
        distance = float(context.clearance.distance([place])[0])
        if distance >= max(radius - TOUCH_M, TOUCH_M):
            continue
        hint = _hint(place, radius, context)
        where = (
            "It fits nowhere on this map; a smaller robot may."
            if hint is None
            else f"The nearest place where it fits is ({hint[0]:.2f}, {hint[1]:.2f}) m."
        )
        if distance <= TOUCH_M:
            trouble = f"is not in free space; {robot} cannot stand there."
        else:
            trouble = f"is {_down(distance)} m from the nearest obstacle; {robot} needs {radius:g} m."
        raise _OCCUPIED[name](f"{said} {trouble} {where}", nearest_free=hint)


def _down(distance: float) -> str:
    # Rounded down to millimetres: it must not read as enough.
    return f"{int(distance * 1000) / 1000:g}"


def _hint(place: tuple[float, float], radius: float, context: PlanningContext) -> tuple[float, float] | None:
    for margin in (_HINT_MARGIN_M, 0.0):
        found = context.clearance.nearest_free(
            [place],
            radius + margin,
            frame=context.field.frame,
            centre_clearance=context.centre_clearance,
        )
        if found is not None:
            return (float(found[0, 0]), float(found[0, 1]))
    return None
