"""What surrounds every request: its id, limits of its body, headers of the answer, the last catch."""

from __future__ import annotations

import logging
import re
import secrets
import time
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.errors import Problem

log = logging.getLogger("surepath.http")

CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
SECURITY_HEADERS = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}\Z")
_JSON = re.compile(r"application/([a-z0-9.+-]+\+)?json\Z")
_WITH_BODY = {"POST", "PUT", "PATCH"}


class Outermost:
    """ASGI application around the whole service.

    Parameters
    ----------
    app
        What it surrounds.
    upload_path
        The one path that takes files (multipart/form-data) and large bodies.
    max_upload, max_body
        Bytes of a body there and elsewhere.
    """

    def __init__(self, app: ASGIApp, *, upload_path: str, max_upload: int, max_body: int) -> None:
        self.app = app
        self.upload_path = upload_path
        self.max_upload = max_upload
        self.max_body = max_body

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection, as ASGI asks."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began = time.perf_counter()
        headers = Headers(scope=scope)
        given = headers.get("x-request-id", "")
        request_id = given if _REQUEST_ID.match(given) else secrets.token_hex(12)
        scope.setdefault("state", {})["request_id"] = request_id
        started = False

        async def send_with_headers(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                out = MutableHeaders(scope=message)
                out["X-Request-ID"] = request_id
                for name, value in SECURITY_HEADERS.items():
                    out[name] = value
                out.setdefault("Cache-Control", "no-store")
                out.append("Server-Timing", f"total;dur={1000 * (time.perf_counter() - began):.1f}")
            await send(message)

        try:
            problem = self._refusal(scope, headers)
            if problem is not None:
                await problem.response(scope["path"], request_id)(scope, receive, send_with_headers)
                return
            await self.app(scope, self._counted(scope, receive), send_with_headers)
        except Exception:
            log.exception("%s %s failed (request %s)", scope["method"], scope["path"], request_id)
            if started:
                raise
            problem = Problem.of_code("internal", "Something failed inside the service; its log knows more.")
            await problem.response(scope["path"], request_id)(scope, receive, send_with_headers)

    def _limit(self, scope: Scope) -> tuple[int, str]:
        if scope["path"] == self.upload_path:
            return self.max_upload, "SUREPATH_MAX_UPLOAD_BYTES"
        return self.max_body, "SUREPATH_MAX_BODY_BYTES"

    def _refusal(self, scope: Scope, headers: Headers) -> Problem | None:
        """What can be said about a body before it is read."""
        length = headers.get("content-length", "")
        limit, setting = self._limit(scope)
        if length.isdigit() and int(length) > limit:
            return Problem.of_code(
                "too_large",
                f"The body has {length} bytes, the limit here is {limit}.",
                limit=limit,
                requested=int(length),
                setting=setting,
            )
        has_body = length not in {"", "0"} or "transfer-encoding" in headers
        if scope["method"] not in _WITH_BODY or not has_body:
            return None
        media = headers.get("content-type", "").split(";")[0].strip().lower()
        upload = scope["path"] == self.upload_path
        if _JSON.match(media) or (upload and media == "multipart/form-data"):
            return None
        wanted = "application/json or multipart/form-data" if upload else "application/json"
        return Problem.of_code("unsupported_media", f"The content type is '{media[:80]}'; send {wanted}.")

    def _counted(self, scope: Scope, receive: Receive) -> Receive:
        """Receive that stops a body without Content-Length at the limit."""
        limit, _ = self._limit(scope)
        total = 0

        async def counted() -> Message:
            nonlocal total
            message: dict[str, Any] = dict(await receive())
            total += len(message.get("body", b""))
            if total > limit:
                raise HTTPException(413, f"The body has more than {limit} bytes, the limit here.")
            return message

        return counted
