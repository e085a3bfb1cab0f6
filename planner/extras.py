"""What a question adds to the field: further bounds, areas to avoid, areas that cost more or less."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely import Polygon

from localization import covariance as cov
from localization.uncertainty_field import UncertaintyField
from maps.arrays import BoolArray, FloatArray
from maps.grid import GridFrame
from planner.obstacles import cells_around

if TYPE_CHECKING:
    from planner.context import PlanningContext


@dataclass(frozen=True, slots=True)
class Extras:
    """Bounds and areas of a question; hashable, so that what they make of a field is kept.

    Attributes
    ----------
    max_ellipse95
        Largest semi-major axis of the 95 % ellipse, m; None: any.
    max_probability
        Largest collision probability of a pose; None: any.
    blind_r95
        What stands for r95 where there is no fix, when collisions are judged, m; None: such cells are not
        judged.
    avoid
        Areas that the robot's body must not enter, W, m.
    areas
        Areas with the factor by which driving there costs more (or less).
    """

    max_ellipse95: float | None = None
    max_probability: float | None = None
    blind_r95: float | None = None
    avoid: tuple[Polygon, ...] = ()
    areas: tuple[tuple[Polygon, float], ...] = ()

    def without_bounds(self) -> Extras:
        """The areas alone."""
        return replace(self, max_ellipse95=None, max_probability=None, blind_r95=None)

    def without_areas(self) -> Extras:
        """All but the areas of other cost."""
        return replace(self, areas=())


NO_EXTRAS = Extras()


def forbidden_cells(extras: Extras, context: PlanningContext, radius: float) -> BoolArray | None:
    """Cells (ny, nx) that bounds or areas close to a disc of this radius, m; None: no cell.

    A cell is closed by an area when any of it is nearer to the area than the radius.
    """
    field = context.field
    out = np.zeros(field.frame.shape, dtype=np.bool_)
    if extras.max_ellipse95 is not None:
        with np.errstate(invalid="ignore"):
            out |= cov.ellipse95(field.covariance)[..., 0] > extras.max_ellipse95
    if extras.max_probability is not None:
        out |= context.risky(extras.max_probability, radius=radius, blind_r95=extras.blind_r95)
    for polygon in extras.avoid:
        out |= cells_near(field.frame, polygon, radius)
    return out if out.any() else None


def judged_covariance(field: UncertaintyField, blind_r95: float | None) -> FloatArray:
    """Covariance (ny, nx, 3) by which collisions are judged; without a fix a circle of ``blind_r95``."""
    if blind_r95 is None:
        return field.covariance
    variance = blind_r95**2 / cov.CHI2_95
    blind = np.array([variance, 0.0, variance])
    return np.where(field.has_fix[..., None], field.covariance, blind)


def cost_factors(extras: Extras, frame: GridFrame) -> FloatArray | None:
    """Factor (ny, nx) of the cost per metre, by the cells' centres; None: 1 everywhere.

    Where areas overlap their factors multiply.
    """
    if not extras.areas:
        return None
    out = np.ones(frame.shape)
    centres = frame.centres()
    for polygon, factor in extras.areas:
        shapely.prepare(polygon)
        out[shapely.contains_xy(polygon, centres[..., 0], centres[..., 1])] *= factor
    return out


def cells_near(frame: GridFrame, polygon: Polygon, distance: float) -> BoolArray:
    """Cells of which some point is nearer to a polygon than a distance, m."""
    out = np.zeros(frame.shape, dtype=np.bool_)
    rows, cols = cells_around(frame, polygon, distance)
    if rows.start >= rows.stop or cols.start >= cols.stop:
        return out
    r, c = np.mgrid[rows, cols]
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0, 0]])
    rings = np.stack([c[..., None] + square[:, 0], r[..., None] + square[:, 1]], axis=-1)
    boxes = shapely.polygons(frame.to_world(rings.astype(np.float64)))
    shapely.prepare(polygon)
    out[rows, cols] = shapely.dwithin(polygon, boxes, distance)
    return out
