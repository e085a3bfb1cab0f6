"""Maps, fields, jobs and places as JSON."""

from __future__ import annotations

import math
import time
from datetime import UTC, datetime
from typing import Any

import numpy as np

from api.codec import sensor_to_json
from api.codec_plan import number, triplet_names
from api.pace import Pace
from api.store_records import FieldRecord, JobRecord, JobStatus, MapRecord
from localization import covariance as cov
from localization.kernels.coverage import NOMINAL_SHARE
from localization.uncertainty_field import METRICS, USABLE_SHARE, UncertaintyField
from maps.arrays import FloatArray
from maps.world import World


def rfc3339(seconds: float | None) -> str | None:
    """Time since 1970 as UTC text.

    Examples
    --------
    >>> rfc3339(0.0)
    '1970-01-01T00:00:00.000Z'
    """
    if seconds is None:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def bounds_to_json(bounds: tuple[float, float, float, float]) -> dict[str, float]:
    """``(x_min, y_min, x_max, y_max)`` as an object."""
    return dict(zip(("x_min_m", "y_min_m", "x_max_m", "y_max_m"), bounds, strict=True))


def map_to_json(record: MapRecord) -> dict[str, Any]:
    """A map version."""
    here = f"/v1/maps/{record.id}"
    links = {"self": here, "image": f"{here}/image.png", "landmarks": f"{here}/landmarks"}
    if record.kind == "polygons":
        links["world"] = f"{here}/world.geojson"
    return {
        "map": record.id,
        "name": record.name,
        "kind": record.kind,
        "bounds": bounds_to_json(record.bounds),
        "resolution_m": record.resolution,
        "shape": None if record.shape is None else {"rows": record.shape[0], "columns": record.shape[1]},
        "landmarks": record.n_landmarks,
        "free_area_m2": record.free_area,
        "size_bytes": record.size,
        "parent": record.parent,
        "created": rfc3339(record.created),
        "links": links,
    }


def landmarks_to_json(world: World, map_id: str) -> dict[str, Any]:
    """The landmarks of a world in their order."""
    marks = world.landmarks
    return {
        "map": map_id,
        "landmarks": [
            {
                "id": name,
                "x_m": float(marks.positions[i, 0]),
                "y_m": float(marks.positions[i, 1]),
                "facing_rad": number(float(marks.facing[i])),
                "half_angle_rad": float(marks.half_angle[i]),
                "sigma_m": float(marks.sigma[i]),
            }
            for i, name in enumerate(marks.ids)
        ],
    }


def metrics_to_json() -> dict[str, dict[str, str]]:
    """Every metric with unit and meaning."""
    return {name: {"unit": unit, "meaning": meaning} for name, (unit, meaning) in METRICS.items()}


def field_to_json(record: FieldRecord) -> dict[str, Any]:
    """A field without its numbers."""
    here = f"/v1/fields/{record.id}"
    links = {
        "self": here,
        "map": f"/v1/maps/{record.map_id}",
        "heatmap": f"{here}/heatmap.png",
        "values": f"{here}/heatmap.npy",
        "point": f"{here}/point",
        "statistics": f"{here}/statistics",
        "tiles": f"{here}/tilejson.json",
        "legend": f"{here}/legend.json",
    }
    if record.job is not None:
        links["job"] = f"/v1/jobs/{record.job}"
    frame = record.frame
    return {
        "field": record.id,
        "map": record.map_id,
        "status": record.status.value,
        "sensor": sensor_to_json(record.sensor),
        "resolution_m": frame.resolution,
        "heading_rad": record.heading,
        "headings": record.headings,
        "estimator": record.estimator,
        "criterion": record.criterion,
        "origin": {"x_m": frame.origin_x, "y_m": frame.origin_y, "yaw_rad": frame.yaw},
        "shape": {"rows": frame.n_rows, "columns": frame.n_cols},
        "bounds": bounds_to_json(frame.bounds()),
        "metrics": metrics_to_json(),
        "size_bytes": record.size,
        "checksum": record.checksum,
        "job": record.job,
        "error": record.error,
        "created": rfc3339(record.created),
        "ended": rfc3339(record.ended),
        "links": links,
    }


def order_to_json(record: FieldRecord) -> dict[str, Any]:
    """The body of ``POST /v1/fields`` that asks for a field like this one."""
    return {
        "map": record.map_id,
        "sensor": sensor_to_json(record.sensor),
        "resolution_m": record.resolution,
        "heading_rad": record.heading,
        "headings": record.headings,
        "estimator": record.estimator,
        "criterion": record.criterion,
    }


def ordered_to_json(record: FieldRecord, job: JobRecord | None) -> dict[str, Any]:
    """Answer to an order for a field."""
    links = {"field": f"/v1/fields/{record.id}"}
    if job is not None:
        links["job"] = f"/v1/jobs/{job.id}"
    return {
        "field": record.id,
        "job": None if job is None else job.id,
        "status": record.status.value if job is None else job.status.value,
        "tiles": {"done": 0, "total": 0} if job is None else {"done": job.done, "total": job.total},
        "links": links,
    }


def job_to_json(record: JobRecord, pace: Pace | None = None) -> dict[str, Any]:
    """State and progress of a job; without its pace lately, that since its start counts."""
    eta = None
    if record.status is JobStatus.RUNNING and record.started is not None:
        if pace is not None:
            eta = pace.left(time.monotonic())
        elif 0 < record.done < record.total:
            eta = max(0.0, time.time() - record.started) * (record.total - record.done) / record.done
    return {
        "job": record.id,
        "field": record.field_id,
        "status": record.status.value,
        "tiles": {"done": record.done, "total": record.total},
        "attempts": record.attempts,
        "error": record.error,
        "eta_s": None if eta is None else round(eta, 1),
        "created": rfc3339(record.created),
        "started": rfc3339(record.started),
        "ended": rfc3339(record.ended),
        "links": {
            "self": f"/v1/jobs/{record.id}",
            "events": f"/v1/jobs/{record.id}/events",
            "field": f"/v1/fields/{record.field_id}",
        },
    }


def point_to_json(field: UncertaintyField, x: float, y: float) -> dict[str, Any]:
    """What a field says about a place (m in W); places without a value, or with a doubtful one, say why."""
    x0, y0, x1, y1 = field.frame.bounds()
    inside = x0 <= x <= x1 and y0 <= y <= y1 and bool(field.frame.contains((x, y)))
    row, col = (int(v) for v in field.frame.cell_at((x, y))) if inside else (0, 0)
    free = inside and bool(field.free[row, col])
    n_visible = int(field.n_visible[row, col]) if free else 0
    fix = free and bool(field.has_fix[row, col])
    at = (np.asarray(row), np.asarray(col))
    share = number(float(field.validity[row, col])) if fix else None
    valid = None if share is None else bool(field.is_valid[row, col])
    if not inside:
        state, reason = "outside", f"The field spans x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m."
    elif not free:
        state, reason = "occupied", "The centre of this cell is not free floor."
    elif not fix:
        state, reason = "no_fix", _why_no_fix(n_visible)
    elif valid is False and share is not None:
        state, reason = "fix", _why_not_valid(field, row, col, share)
    else:
        state, reason = "fix", None
    covariance = [float(v) for v in field.covariance[row, col]] if fix else None
    ellipse = None
    if covariance is not None:
        a, b, azimuth = (float(v) for v in cov.ellipse95(covariance))
        ellipse = {"a_m": a, "b_m": b, "theta_rad": azimuth}
    return {
        "x_m": x,
        "y_m": y,
        "cell": {"row": row, "column": col} if inside else None,
        "state": state,
        "reason": reason,
        "metrics": {name: number(float(field.metric(name, at))) if free else None for name in METRICS},
        "covariance": covariance,
        "ellipse95": ellipse,
        "validity": share,
        "valid": valid,
        "triplet": triplet_names(field.triplet[row, col], field.world.landmarks.ids),
        "pan_rad": number(float(field.pan[row, col])) if fix else None,
        "n_visible": n_visible,
        "heading_rad": field.heading,
        "headings": None,
        "ranking": None,
    }


def _why_no_fix(n_visible: int) -> str:
    if n_visible < 3:
        seen = {0: "No landmark is", 1: "Only 1 landmark is"}.get(
            n_visible, f"Only {n_visible} landmarks are"
        )
        return f"{seen} in view; a fix needs three."
    return f"{n_visible} landmarks are in view, but no three at once that give a fix."


def _why_not_valid(field: UncertaintyField, row: int, col: int, share: float) -> str:
    """In words: the ellipse of this cell's fix cannot be believed."""
    words = (
        f"The fix is there, but {'only ' if share < NOMINAL_SHARE else ''}about {100 * share:.0f} % of fixes "
        "lie inside the 95 % ellipse: first order does not hold here."
    )
    triplet = field.triplet[row, col]
    place = field.frame.centres(slice(row, row + 1), slice(col, col + 1))[0, 0]
    place = place + np.asarray(field.sensor.mount.offset(field.heading))
    distance = _to_circle(place, field.world.landmarks.positions[triplet])
    if math.isfinite(distance):
        names = ", ".join(triplet_names(triplet, field.world.landmarks.ids) or [])
        words += f" The circle through {names}, on which fixes degenerate, is {distance:.2g} m away."
    usable = share >= USABLE_SHARE
    return words + f" Plans count {'on a larger ellipse' if usable else 'it as a place without a fix'}."


def _to_circle(place: FloatArray, three: FloatArray) -> float:
    """Distance of a place from the circle through three points, m; NaN where they lie on one line."""
    p, q = three[1] - three[0], three[2] - three[0]
    twice = 2.0 * float(p[0] * q[1] - p[1] * q[0])
    if twice == 0.0:
        return math.nan
    pp, qq = float(p @ p), float(q @ q)
    centre = np.array([q[1] * pp - p[1] * qq, p[0] * qq - q[0] * pp]) / twice
    return abs(math.hypot(*(place - three[0] - centre)) - math.hypot(*centre))
