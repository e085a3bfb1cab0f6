"""Documentation pages that load nothing from another host: Swagger UI and the list of problems."""

from __future__ import annotations

import hashlib
from functools import cache
from html import escape
from importlib import resources
from importlib.metadata import version

from fastapi import APIRouter, Request
from starlette.exceptions import HTTPException
from starlette.responses import Response

from api.errors import CODES
from api.page_parts import STYLE_PATH, page

_PACKAGE = "fastapi_swagger.resources"
_FILES = {
    "swagger-ui.css": "text/css; charset=utf-8",
    "swagger-ui-bundle.js": "text/javascript; charset=utf-8",
    "favicon-32x32.png": "image/png",
    "start.js": "text/javascript; charset=utf-8",
}
_START = """\
"use strict";
SwaggerUIBundle({
  url: "/openapi.json",
  dom_id: "#swagger-ui",
  deepLinking: true,
  displayRequestDuration: true,
  validatorUrl: null,
  defaultModelsExpandDepth: 0,
  tryItOutEnabled: true
});
"""
router = APIRouter(include_in_schema=False)


@cache
def _file(name: str) -> bytes:
    if name == "start.js":
        return _START.encode()
    return (resources.files(_PACKAGE) / name).read_bytes()


@cache
def _version() -> str:
    """Changes with the wheel and with our own script, so that browsers may keep the files for good."""
    return f"{version('fastapi-swagger')}-{hashlib.sha256(_START.encode()).hexdigest()[:8]}"


@router.get("/docs")
def docs() -> Response:
    """Swagger UI."""
    base = f"/docs/files/{_version()}"
    html = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>surepath API</title>
<link rel="icon" type="image/png" href="{base}/favicon-32x32.png">
<link rel="stylesheet" href="{base}/swagger-ui.css">
<link rel="stylesheet" href="{STYLE_PATH}">
</head>
<body>
<p class="back"><a href="/">surepath</a> · <a href="/docs/problems">error codes</a></p>
<div id="swagger-ui"></div>
<script src="{base}/swagger-ui-bundle.js"></script>
<script src="{base}/start.js"></script>
</body>
</html>
"""
    return Response(html, media_type="text/html", headers={"Cache-Control": "no-cache"})


@router.get("/docs/files/{release}/{name}")
def docs_file(release: str, name: str) -> Response:
    """One of the files of Swagger UI."""
    if name not in _FILES or release != _version():
        raise HTTPException(404, f"There is no file '{name[:80]}' here.")
    kept = "public, max-age=31536000, immutable"
    return Response(_file(name), media_type=_FILES[name], headers={"Cache-Control": kept})


@router.get("/docs/problems")
def problems(request: Request) -> Response:
    """Every error code with its status and meaning."""
    rows = "".join(
        f'<tr id="{code}"><td><code>{code}</code></td><td>{status}</td><td>{escape(title)}</td></tr>'
        for code, (status, title) in CODES.items()
    )
    body = f"""<h1>Error codes</h1>
<p>Every error is an <code>application/problem+json</code> document (RFC 9457). <code>code</code> is stable;
<code>detail</code> says what was wrong, <code>errors</code> where in the request, <code>hint</code> what
would help.</p>
<table><thead><tr><th>code</th><th>HTTP</th><th>meaning</th></tr></thead><tbody>{rows}</tbody></table>"""
    return page("Error codes", body, request)
