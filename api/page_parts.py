"""Frame and style of the HTML pages: no script, no inline style, nothing from another host."""

from __future__ import annotations

import hashlib

from fastapi import APIRouter, Request
from starlette.responses import Response

from api.caching import conditional

_STYLE = """\
body { margin: 0; background: #fff; }
main, .back { font: 16px/1.5 system-ui, sans-serif; color: #20242a; }
main a, .back a { color: #005ce6; }
main { max-width: 76rem; margin: 0 auto; padding: 1.5rem; }
main *, main { box-sizing: border-box; }
main h1 { font-size: 1.7rem; margin: 0 0 .3rem; }
main h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
main p { max-width: 52rem; }
main code, main pre { font: 0.9em/1.45 ui-monospace, monospace; }
main pre { background: #f5f6f8; border: 1px solid #d9dde2; border-radius: 6px; padding: .8rem;
  overflow-x: auto; }
main table { border-collapse: collapse; min-width: 60%; }
main th, main td { text-align: left; padding: .35rem 1.6rem .35rem 0; border-bottom: 1px solid #d9dde2;
  vertical-align: top; }
main th { color: #5b6470; font-weight: 600; }
main .number { text-align: right; font-variant-numeric: tabular-nums; }
main .soft, main figcaption { color: #5b6470; }
main figure { margin: 1rem 0; }
main img { max-width: 100%; height: auto; border: 1px solid #d9dde2; border-radius: 6px; }
main nav a { margin-right: 1.2rem; }
.back { margin: 0; padding: .6rem 1.5rem; border-bottom: 1px solid #d9dde2; }
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
