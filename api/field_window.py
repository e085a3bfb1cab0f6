"""Windows of a field as plain numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from api.canvas import BBox, check_bbox
from localization.uncertainty_field import METRICS, UncertaintyField
from maps.arrays import FloatArray
from maps.grid import GridFrame

#: Digits that a number in JSON has.
_DIGITS = 6


@dataclass(frozen=True, slots=True)
class Cells:
    """Cells of a window: rows and columns from, to, and every how many.

    Attributes
    ----------
    rows, cols
        Half-open ranges.
    step
        Every step-th of both, the first one in the middle of the first step.
    """

    rows: tuple[int, int]
    cols: tuple[int, int]
    step: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """As an index of the field's arrays."""
        first = (self.step - 1) // 2
        (r0, r1), (c0, c1) = self.rows, self.cols
        return slice(min(r0 + first, r1 - 1), r1, self.step), slice(min(c0 + first, c1 - 1), c1, self.step)


def cells_of(frame: GridFrame, bbox: BBox | None, *, max_side: int | None = None) -> Cells:
    """Cells of a window (W, m; None: all), every step-th if there are more than ``max_side`` on a side.

    Raises
    ------
    InvalidPicture
        If the window is empty, or beside the map.
    """
    rows, cols = (0, frame.n_rows), (0, frame.n_cols)
    if bbox is not None:
        x0, y0, x1, y1 = check_bbox(bbox, frame.bounds())
        corners = frame.to_grid([[x0, y0], [x1, y0], [x0, y1], [x1, y1]])
        # A window that ends on the edge of a cell does not hold the next one.
        low, high = np.floor(corners.min(axis=0) + 1e-9), np.ceil(corners.max(axis=0) - 1e-9)
        cols, rows = (
            (int(np.clip(a, 0, n - 1)), int(np.clip(max(b, a + 1), 1, n)))
            for a, b, n in zip(low, high, (frame.n_cols, frame.n_rows), strict=True)
        )
    longest = max(rows[1] - rows[0], cols[1] - cols[0])
    return Cells(rows, cols, 1 if max_side is None else max(1, math.ceil(longest / max_side)))


def window_values(field: UncertaintyField, metric: str, cells: Cells) -> FloatArray:
    """A metric at cells; shape (rows, columns), row 0 the lowest y, NaN without a value."""
    rows, cols = np.mgrid[cells.slices]
    return field.metric(metric, (rows, cols))


def window_to_json(field: UncertaintyField, metric: str, cells: Cells) -> dict[str, Any]:
    """A metric over a window as rows of numbers with six digits, null without a value."""
    values = window_values(field, metric, cells)
    frame = field.frame
    rows, cols = (s.start for s in cells.slices)
    x, y = frame.centres(slice(rows, rows + 1), slice(cols, cols + 1))[0, 0].tolist()
    return {
        "metric": metric,
        "unit": METRICS[metric][0],
        "first": {"x_m": x, "y_m": y},
        "step_m": cells.step * frame.resolution,
        "yaw_rad": frame.yaw,
        "rows": values.shape[0],
        "columns": values.shape[1],
        "values": _plain(values),
    }


def _plain(values: FloatArray) -> list[list[float | None]]:
    known = np.isfinite(values) & (values != 0)
    with np.errstate(all="ignore"):
        size = np.floor(np.log10(np.abs(np.where(known, values, 1.0))))
    scale = 10.0 ** (_DIGITS - 1 - size)
    short = np.where(known, np.rint(values * scale) / scale, values)
    out: list[list[float | None]] = short.tolist()
    for row in np.flatnonzero(~np.isfinite(values).all(axis=1)):
        out[row] = [v if v is not None and math.isfinite(v) else None for v in out[row]]
    return out
