"""The page at ``/``: map, field, paths; without a script what this is, what is here, where to go on."""

from __future__ import annotations

import hashlib
from html import escape
from string import Template

from fastapi import APIRouter, Request
from starlette.responses import Response

from api import page_files
from api.caching import conditional
from api.codec_plan import engine_version
from api.dependencies import Service_
from api.page_parts import STYLE_PATH
from api.store_records import FieldRecord, FieldStatus, MapRecord

router = APIRouter(include_in_schema=False)
_SHOWN = 50
_EXAMPLE = """curl -H 'Content-Type: application/json' {base}v1/plans -d '
  {{"map": "warehouse", "start": {{"x_m": 4, "y_m": 4}}, "goal": {{"x_m": 55, "y_m": 20}},
   "robot": {{"radius_m": 0.35}}}}'"""


@router.get("/")
def landing_page(request: Request, service: Service_) -> Response:
    """The page; its scripts fetch what they show, a browser without scripts reads the plain one."""
    plain = _plain(request, service)
    filled = Template(page_files.template()).substitute(
        base=page_files.base(), plain_style=STYLE_PATH, plain=plain
    )
    content = filled.encode()
    tag = hashlib.sha256(content).hexdigest()[:32]
    return conditional(request, tag, "no-cache", lambda: Response(content, media_type="text/html"))


def _plain(request: Request, service: Service_) -> str:
    """Maps, fields and a heatmap, as HTML without a script."""
    maps, fields = service.store.maps()[::-1], service.store.fields()[::-1]
    names = {m.id: m.name for m in maps}
    ready = [f for f in fields if f.status is FieldStatus.READY]
    return f"""<h1>surepath</h1>
<p>The path planner for mobile robots that knows how well the robot will know where it is.
Upload a map with landmarks, compute its field of localization uncertainty once, and ask for paths on which
the robot stays certain of its position.</p>
<nav><a href="/docs">API, to try out</a><a href="/docs/problems">Error codes</a>
<a href="/openapi.json">OpenAPI document</a><a href="/v1/status">Status and limits</a></nav>
{_picture(ready, names)}
<h2>Maps</h2>
{_maps(maps)}
<h2>Fields</h2>
{_fields(fields, names)}
<h2>A first path</h2>
<pre>{escape(_EXAMPLE.format(base=request.base_url))}</pre>
<p class="soft">version {escape(engine_version())}</p>"""


def _picture(ready: list[FieldRecord], names: dict[str, str]) -> str:
    if not ready:
        return '<p class="soft">No field is computed yet; reload this page when one is.</p>'
    shown = next((f for f in ready if names.get(f.map_id) == "warehouse"), ready[0])
    name = escape(names.get(shown.map_id, shown.map_id))
    address = f"/v1/fields/{escape(shown.id)}/heatmap.png?width=1200"
    return (
        f'<figure><a href="{address}"><img src="{address}" width="1200" '
        f'alt="Heatmap of localization uncertainty: {name}"></a>'
        f"<figcaption>{name}: area of the 95 % ellipse of the best landmark triplet in each cell. "
        "Yellow: uncertain; hatched: fewer than three landmarks are seen together.</figcaption></figure>"
    )


def _maps(maps: list[MapRecord]) -> str:
    if not maps:
        return '<p class="soft">None yet: POST one to <code>/v1/maps</code>.</p>'
    rows = "".join(
        f'<tr><td><a href="/v1/maps/{escape(m.id)}">{escape(m.name)}</a></td><td>{escape(m.kind)}</td>'
        f'<td class="number">{m.bounds[2] - m.bounds[0]:.1f} × {m.bounds[3] - m.bounds[1]:.1f} m</td>'
        f'<td class="number">{m.n_landmarks}</td>'
        f'<td><a href="/v1/maps/{escape(m.id)}/image.png">picture</a></td></tr>'
        for m in maps[:_SHOWN]
    )
    head = '<th>name</th><th>floor</th><th class="number">size</th><th class="number">landmarks</th><th></th>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{_rest(len(maps))}"


def _fields(fields: list[FieldRecord], names: dict[str, str]) -> str:
    if not fields:
        return '<p class="soft">None yet: POST an order to <code>/v1/fields</code>.</p>'
    rows = "".join(
        f'<tr><td><a href="/v1/fields/{escape(f.id)}">{escape(names.get(f.map_id, f.map_id))}</a></td>'
        f"<td>{escape(f.sensor.kind)}</td>"
        f'<td class="number">{f.frame.n_cols} × {f.frame.n_rows} at {f.resolution:g} m</td>'
        f"<td>{_state(f)}</td></tr>"
        for f in fields[:_SHOWN]
    )
    head = '<th>map</th><th>sensor</th><th class="number">cells</th><th>state</th>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>{_rest(len(fields))}"


def _state(field: FieldRecord) -> str:
    if field.status is FieldStatus.READY:
        return f'<a href="/v1/fields/{escape(field.id)}/heatmap.png">heatmap</a>'
    if field.job is None:
        return escape(field.status.value)
    return f'<a href="/v1/jobs/{escape(field.job)}">{escape(field.status.value)}</a>'


def _rest(count: int) -> str:
    return f'<p class="soft">{count - _SHOWN} more.</p>' if count > _SHOWN else ""
