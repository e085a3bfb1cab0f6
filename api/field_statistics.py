"""Figures of a whole field, or of areas of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from api.canvas import BBox
from api.codec_plan import number
from api.field_window import Cells, cells_of
from localization.uncertainty_field import METRICS, UncertaintyField, is_off
from maps.arrays import BoolArray
from maps.errors import InvalidGeometry


def statistics(
    field: UncertaintyField,
    metric: str,
    *,
    bbox: BBox | None = None,
    area: Polygon | None = None,
    percentiles: Sequence[float],
    bins: int,
    scale: str,
    most_cells: int,
) -> dict[str, Any]:
    """Percentiles, histogram and shares of a metric over the free cells of a window or an area.

    Parameters
    ----------
    field, metric
        Of what.
    bbox
        Window, W, m; None: everything.
    area
        Cells whose centre lies inside; None: all of the window.
    percentiles
        0 to 100.
    bins, scale
        Of the histogram: as many bins of equal width, on a ``linear`` or ``log`` axis.
    most_cells
        Above it only every step-th cell of both axes counts, which the answer says.

    Raises
    ------
    InvalidPicture
        If the window is empty or beside the map.
    InvalidGeometry
        If the area crosses itself.
    """
    if area is not None:
        with np.errstate(all="ignore"):  # far away, shapely's sums overflow
            bad = None if area.is_valid and 0 < area.area < math.inf else shapely.is_valid_reason(area)
        if bad is not None:
            raise InvalidGeometry(f"A polygon is not one: {bad}; rings must not cross themselves.")
        x0, y0, x1, y1 = field.frame.bounds()
        if not area.intersects(shapely.box(x0, y0, x1, y1)):
            return _figures(field, metric, None, None, percentiles, bins, scale)
        bbox = area.bounds
    whole = cells_of(field.frame, bbox)
    count = (whole.rows[1] - whole.rows[0]) * (whole.cols[1] - whole.cols[0])
    cells = Cells(whole.rows, whole.cols, max(1, math.ceil(math.sqrt(count / most_cells))))
    inside = None
    if area is not None:
        centres = field.frame.centres(*cells.slices)
        shapely.prepare(area)
        inside = shapely.contains_xy(area, centres[..., 0], centres[..., 1])
    return _figures(field, metric, cells, inside, percentiles, bins, scale)


def _figures(
    field: UncertaintyField,
    metric: str,
    cells: Cells | None,
    inside: BoolArray | None,
    percentiles: Sequence[float],
    bins: int,
    scale: str,
) -> dict[str, Any]:
    empty = np.empty(0, dtype=np.int64)
    rows, cols = empty, empty
    step = 1
    if cells is not None:
        step = cells.step
        free = field.free[cells.slices]
        rows, cols = np.nonzero(free if inside is None else free & inside)
        rows = rows * step + cells.slices[0].start
        cols = cols * step + cells.slices[1].start
    at = (rows, cols)
    values = field.metric(metric, at)
    known = values[np.isfinite(values)]
    fixes = np.isfinite(field.covariance[at][:, 0])
    good = fixes & ~is_off(field.validity[at])
    n = len(rows)
    unit, meaning = METRICS[metric]
    return {
        "metric": metric,
        "unit": unit,
        "meaning": meaning,
        "cells": n,
        "step": step,
        "free_area_m2": n * (step * field.frame.resolution) ** 2,
        "share_with_fix": float(fixes.mean()) if n else None,
        "share_valid": float(good.mean()) if n and field.method.estimator != "all_visible" else None,
        "with_value": len(known),
        "min": float(known.min()) if len(known) else None,
        "mean": float(known.mean()) if len(known) else None,
        "max": float(known.max()) if len(known) else None,
        "percentiles": _percentiles(known, percentiles),
        "histogram": _histogram(known, bins, scale),
    }


def _percentiles(known: Any, wanted: Sequence[float]) -> list[dict[str, float | None]]:
    found = np.percentile(known, wanted) if len(known) else np.full(len(wanted), np.nan)
    return [{"percent": float(p), "value": number(float(v))} for p, v in zip(wanted, found, strict=True)]


def _histogram(known: Any, bins: int, scale: str) -> dict[str, Any]:
    """Counts between edges; on a log axis values of 0 and below fall into no bin."""
    usable = known[known > 0] if scale == "log" else known
    if not len(usable):
        return {"scale": scale, "edges": [], "counts": [], "outside": len(known)}
    low, high = float(usable.min()), float(usable.max())
    if high <= low:
        low, high = (low * 0.999, high * 1.001) if low > 0 else (low - 0.5, high + 0.5)
    edges = np.geomspace(low, high, bins + 1) if scale == "log" else np.linspace(low, high, bins + 1)
    edges[0], edges[-1] = low, high
    counts, _ = np.histogram(usable, edges)
    return {
        "scale": scale,
        "edges": edges.tolist(),
        "counts": counts.tolist(),
        "outside": len(known) - int(counts.sum()),
    }
