"""Answers of the service to questions about many places, and to simulations."""

from __future__ import annotations

from typing import Any

import numpy as np

from api.codec_matrix import LAYERS, matrix_to_json, region_to_geojson
from api.codec_plan import FieldLabel, engine_version
from api.codec_simulation import simulation_to_json
from api.worker_orders import MatrixOrder, RegionOrder, SimulationOrder
from planner.matrix import CostMatrix
from planner.reachability import Region
from planner.simulation import SimulatedRobot
from planner.simulation_report import SimulationReport
from planner.travel import PlaceStatus


def matrix_answer(matrix: CostMatrix, label: FieldLabel, order: MatrixOrder) -> dict[str, Any]:
    """Answer of ``POST /v1/matrix``; holds no time of computation: same question, same bytes."""
    document = matrix_to_json(matrix, [""] * len(matrix.sources), [""] * len(matrix.targets))
    places = {
        side: [{k: v for k, v in place.items() if k != "id"} for place in document[side]]
        for side in ("sources", "targets")
    }
    missing = _unreachable(matrix)
    status = "timeout" if not matrix.is_complete else "partial" if missing else "complete"
    return {
        **_head(status, label, order.client_ref),
        **places,
        **{name: document[name] if name in order.metrics else None for name in LAYERS},
        "unreachable": missing,
        "warnings": [*order.warnings, *matrix.warnings],
    }


def _unreachable(matrix: CostMatrix) -> list[dict[str, Any]]:
    """Pairs without figures, and why."""
    rows, columns = np.nonzero(np.isnan(matrix.cost))
    out = []
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        reasons = [
            s.value for s in (matrix.source_status[i], matrix.target_status[j]) if s is not PlaceStatus.OK
        ]
        out.append({"source": i, "target": j, "status": reasons[0] if reasons else "no_path"})
    return out


def region_answer(region: Region, label: FieldLabel, order: RegionOrder) -> dict[str, Any]:
    """Answer of ``POST /v1/reachability``: GeoJSON in m of the map frame, with members of its own."""
    late = () if region.is_complete else ("The deadline came first: the region is a part of the true one.",)
    return {
        **region_to_geojson(region),
        **_head("complete" if region.is_complete else "timeout", label, order.client_ref),
        "warnings": [*order.warnings, *region.warnings, *late],
    }


def simulation_answer(
    report: SimulationReport, robot: SimulatedRobot, label: FieldLabel, order: SimulationOrder
) -> dict[str, Any]:
    """Answer of ``POST /v1/simulations``."""
    figures = simulation_to_json(report, robot, world=label.map_id, plan=order.plan, seed=order.seed)
    del figures["world"]
    is_complete = report.runs == order.runs
    late = () if is_complete else (f"The deadline came after {report.runs} of {order.runs} runs.",)
    return {
        **figures,
        **_head("complete" if is_complete else "timeout", label, order.client_ref),
        "runs_asked": order.runs,
        "warnings": [*order.warnings, *late],
    }


def _head(status: str, label: FieldLabel, client_ref: str | None) -> dict[str, Any]:
    return {
        "status": status,
        "map": label.map_id,
        "field": label.field_id,
        "engine": engine_version(),
        "client_ref": client_ref,
    }
