"""Settings of the service: every limit in one place, each changed by an environment variable."""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from maps.errors import SurepathError

PREFIX = "SUREPATH_"
_MIB = 2**20
_GIB = 2**30


class InvalidSettings(SurepathError):
    """A setting has an impossible value, or one that would be unsafe."""


class LimitExceeded(SurepathError):
    """A request is larger than a setting allows.

    Attributes
    ----------
    limit, requested
        What is allowed and what was asked for.
    setting
        Environment variable that sets the limit.
    place
        ``#/…``: the part of the body that is too large.
    """

    def __init__(
        self,
        message: str,
        *,
        limit: int | None = None,
        requested: int | None = None,
        setting: str | None = None,
        place: str | None = None,
    ) -> None:
        super().__init__(message)
        self.limit = limit
        self.requested = requested
        self.setting = setting
        self.place = place


def _cores() -> int:
    # A container's share, not the machine's size.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _half_of_memory() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return 2 * _GIB


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


_Count = Annotated[int, Field(ge=1)]
_Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Settings(BaseSettings):
    """What an operator may change; each field is also ``SUREPATH_<NAME>`` in the environment.

    Raises
    ------
    InvalidSettings
        If a value is impossible, or the address is reachable by other machines without ``insecure``.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="ignore", frozen=True, validate_default=True)

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8080, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    data_dir: Path = Field(
        default_factory=lambda: Path.home() / ".surepath", description="Folder of maps, fields and plans."
    )
    preload: bool = Field(True, description="Put the bundled warehouse into an empty store.")
    insecure: bool = Field(
        False,
        description="Allow an address that other machines reach although nobody is asked for a key.",
    )
    workers: _Count = Field(
        default_factory=_cores,
        le=256,
        description="Worker processes (at least two run: one is always kept for plans), and threads of a "
        "field computation.",
    )
    max_queue: _Count = Field(16, description="Requests that may wait for a worker.")
    max_upload_bytes: _Count = Field(64 * _MIB, description="Bytes of an uploaded map.")
    max_image_pixels: _Count = Field(64_000_000, description="Pixels of an uploaded image.")
    max_body_bytes: _Count = Field(8 * _MIB, description="Bytes of any other request body.")
    max_landmarks: _Count = Field(10_000, description="Landmarks of a map.")
    max_field_cells: _Count = Field(200_000_000, description="Cells of a field.")
    max_field_bytes: _Count = Field(
        default_factory=_half_of_memory,
        description="Memory a field may need while it is computed, bytes; by default half of what there is.",
    )
    max_storage_bytes: _Count = Field(50 * _GIB, description="Bytes of all maps, fields and plans on disk.")
    max_plans: _Count = Field(10_000, description="Plans kept for reading; the oldest go first.")
    max_heatmap_pixels: _Count = Field(16_000_000, description="Pixels of a heatmap.")
    max_json_cells: _Count = Field(1_000_000, description="Cells of a window of a field as JSON.")
    max_statistics_cells: _Count = Field(
        16_000_000,
        description="Cells that the statistics of a request look at; of more every n-th counts.",
    )
    max_parse_bytes: _Count = Field(
        2 * _GIB, description="Memory a worker may add while it decodes an upload, bytes."
    )
    max_parse_s: _Seconds = Field(30.0, description="Time for decoding an upload, s.")
    max_deadline_s: _Seconds = Field(30.0, le=30.0, description="Longest deadline of a plan, s.")
    max_batch: _Count = Field(100, le=1000, description="Plans of a batch.")
    max_batch_s: _Seconds = Field(120.0, description="Longest time for a batch of plans, s.")
    max_matrix_pairs: _Count = Field(2_500, le=250_000, description="Sources times targets of a matrix.")
    max_simulation_runs: _Count = Field(1_000, le=100_000, description="Runs of a simulation.")
    max_streams: _Count = Field(100, le=10_000, description="Event streams of jobs that are open at a time.")
    max_fixes: _Count = Field(100_000, le=10_000_000, description="Simulated measurements of POST /v1/fixes.")
    max_cloud_points: _Count = Field(10_000, description="Simulated fixes that are given one by one.")
    max_bearings: _Count = Field(1_000, le=10_000, description="Measured landmarks of POST /v1/localize.")
    max_ranking: _Count = Field(
        1_000, le=10_000, description="Triplets of a ranking, and as many that are missed."
    )
    default_deadline_s: _Seconds = Field(2.0, ge=0.05, description="Deadline of a plan that names none, s.")
    cache_bytes: _Count = Field(
        _GIB,
        description="Memory of the service for maps, as much again for fields, and of each worker for "
        "fields, of what was used lately, bytes.",
    )

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise InvalidSettings("; ".join(map(_sentence, error.errors()))) from error

    @model_validator(mode="after")
    def _check(self) -> Settings:
        if self.default_deadline_s > self.max_deadline_s:
            raise InvalidSettings(
                f"default_deadline_s is {self.default_deadline_s:g} s, above max_deadline_s "
                f"({self.max_deadline_s:g} s); lower it."
            )
        if not (self.insecure or _is_loopback(self.host)):
            raise InvalidSettings(
                f"The address '{self.host}' can be reached by other machines and nobody would be asked for "
                "a key. Use 127.0.0.1 behind a proxy, or add --insecure if your network is trusted."
            )
        return self

    @property
    def limits(self) -> dict[str, dict[str, Any]]:
        """Every limit by name: its value, the environment variable that sets it, what it means."""
        return {
            name: {
                "value": getattr(self, name),
                "setting": PREFIX + name.upper(),
                "description": info.description,
            }
            for name, info in type(self).model_fields.items()
            if name.startswith("max_") or name in {"workers", "default_deadline_s", "cache_bytes"}
        }


def _sentence(error: Any) -> str:
    name = ".".join(str(part) for part in error["loc"]) or "settings"
    return f"Setting {name} ({PREFIX}{name.upper()}) is {error['input']!r}: {error['msg'].lower()}"
