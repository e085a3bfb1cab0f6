"""Frame and style of the HTML pages: no script, no inline style, nothing from another host."""

from __future__ import annotations

import hashlib

from fastapi import APIRouter, Request
from starlette.responses import Response

from api.caching import conditional

_STYLE = """\
:root { color-scheme: light; --ink: #20242a; --soft: #5b6470; --line: #d9dde2; --blue: #005ce6; }
* { box-sizing: border-box; }
body { margin: 0; font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: #fff; }
main { max-width: 76rem; margin: 0 auto; padding: 1.5rem; }
h1 { font-size: 1.7rem; margin: 0 0 .3rem; }
h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p { max-width: 52rem; }
a { color: var(--blue); }
code, pre { font: 0.9em/1.45 ui-monospace, monospace; }
pre { background: #f5f6f8; border: 1px solid var(--line); border-radius: 6px; padding: .8rem;
  overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { text-align: left; padding: .35rem .8rem .35rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { color: var(--soft); font-weight: 600; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
.soft, figcaption { color: var(--soft); }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; border: 1px solid var(--line); border-radius: 6px; }
nav a { margin-right: 1.2rem; }
.back { margin: 0; padding: .6rem 1.5rem; border-bottom: 1px solid var(--line);
  font: 15px system-ui, sans-serif; }
"""
STYLE_PATH = f"/static/page-{hashlib.sha256(_STYLE.encode()).hexdigest()[:10]}.css"

router = APIRouter(include_in_schema=False)


@router.get(STYLE_PATH)
def style() -> Response:
    """The style sheet; its address changes with its content."""
    kept = "public, max-age=31536000, immutable"
    return Response(_STYLE, media_type="text/css", headers={"Cache-Control": kept})


def page(title: str, body: str, request: Request) -> Response:
    """An HTML page; ``body`` is HTML, its variable parts escaped by the caller; ``title`` is plain."""
    html = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title} · surepath</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="{STYLE_PATH}">
</head>
<body><main>
{body}
</main></body>
</html>
"""
    content = html.encode()
    tag = hashlib.sha256(content).hexdigest()[:32]
    return conditional(request, tag, "no-cache", lambda: Response(content, media_type="text/html"))
