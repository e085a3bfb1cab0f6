"""Files of the page: scripts and style from the folder ``ui``, kept for good under a versioned address."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import resources

from fastapi import APIRouter
from starlette.exceptions import HTTPException
from starlette.responses import Response

from api.codec import sensor_to_json, to_json_bytes
from api.codec_records import metrics_to_json
from api.colormaps import COLORMAPS, DEFAULT_COLORMAP
from api.render import default_scale
from api.routes.heatmaps import RENDERER
from localization.heading_field import MAX_HEADINGS
from localization.sensors import PRESETS
from localization.uncertainty_field import METRICS

TYPES = {
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "json": "application/json",
}
#: What the scripts must know and the service knows already: made here, so that it is said in one place.
FACTS = "facts.json"
TEMPLATE = "index.html"
_FOREVER = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


@cache
def files() -> dict[str, bytes]:
    """Every file that is served, by name."""
    found = {
        entry.name: entry.read_bytes()
        for entry in (resources.files("api") / "ui").iterdir()
        if entry.name.rpartition(".")[2] in TYPES
    }
    return {**found, FACTS: _facts()}


@cache
def template() -> str:
    """The page before its addresses and its content without a script are put in."""
    return (resources.files("api") / "ui" / TEMPLATE).read_text(encoding="utf-8")


@cache
def base() -> str:
    """Where the files are; changes with their content, since scripts name each other without a version."""
    content = hashlib.sha256()
    for name, data in sorted(files().items()):
        content.update(f"{name}\0{len(data)}\0".encode() + data)
    return f"/ui/{content.hexdigest()[:12]}"


def _facts() -> bytes:
    """Colour tables (256 colours in hexadecimal), metrics, sensor presets, version of the pictures."""
    return to_json_bytes(
        {
            "colormaps": {name: table.tobytes().hex() for name, table in COLORMAPS.items()},
            "default_colormap": DEFAULT_COLORMAP,
            "metrics": {
                name: {**said, "scale": default_scale(name)} for name, said in metrics_to_json().items()
            },
            "metric_order": list(METRICS),
            "presets": {name: sensor_to_json(sensor) for name, sensor in PRESETS.items()},
            "depends_on_heading": [name for name, sensor in PRESETS.items() if sensor.depends_on_heading],
            "max_headings": MAX_HEADINGS,
            "renderer": RENDERER,
        }
    )


@router.get("/ui/{release}/{name}")
def page_file(release: str, name: str) -> Response:
    """One of the page's files."""
    if name not in files() or f"/ui/{release}" != base():
        raise HTTPException(404, f"There is no file '{name[:80]}' here.")
    media_type = TYPES[name.rpartition(".")[2]]
    return Response(files()[name], media_type=media_type, headers={"Cache-Control": _FOREVER})
