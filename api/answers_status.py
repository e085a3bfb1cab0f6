"""Bodies of answers about the service itself; for the OpenAPI document."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.answers_base import Answer


class ColorMaps(Answer):
    """Colour maps and metrics that heatmaps take."""

    colormaps: list[str]
    default: str
    metrics: dict[str, dict[str, str]]


class Status(Answer):
    """The service itself."""

    service: str
    version: str
    versions: dict[str, str]
    planners: list[str]
    limits: dict[str, dict[str, Any]]
    workers: dict[str, Any]
    maps: int
    fields: int


class Alive(Answer):
    """Health."""

    status: str
    checks: dict[str, bool] = Field(default_factory=dict)
