"""What surrounds every request."""

from __future__ import annotations

import logging

import pytest
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from api.errors import Problem
from api.middleware import CSP, Outermost
from tests.api.clients import TestClient


async def _echo(request: Request) -> PlainTextResponse:
    return PlainTextResponse(str(len(await request.body())))


async def _fail(_: Request) -> PlainTextResponse:
    raise ZeroDivisionError("secret")


@pytest.fixture
def client():
    async def on_http(request, error):
        return Problem.of_exception(error).response(request.url.path, request.state.request_id)

    routes = [
        Route("/upload", _echo, methods=["POST"]),
        Route("/echo", _echo, methods=["GET", "POST"]),
        Route("/fail", _fail),
    ]
    around = Middleware(Outermost, upload_path="/upload", max_upload=1000, max_body=100)
    return TestClient(Starlette(routes=routes, middleware=[around], exception_handlers={413: on_http}))


JSON = {"content-type": "application/json"}


def test_every_answer_carries_id_and_security_headers(client):
    answer = client.get("/echo")
    assert answer.headers["content-security-policy"] == CSP
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["cache-control"] == "no-store"
    assert answer.headers["server-timing"].startswith("total;dur=")
    assert len(answer.headers["x-request-id"]) == 24
    assert client.get("/echo").headers["x-request-id"] != answer.headers["x-request-id"]


def test_a_clients_id_is_kept_if_it_is_one(client):
    assert client.get("/echo", headers={"x-request-id": "abc-1"}).headers["x-request-id"] == "abc-1"
    for bad in ("a b", "x" * 65, "a\\nb", ""):
        assert client.get("/echo", headers={"x-request-id": bad}).headers["x-request-id"] != bad


@pytest.mark.parametrize(("path", "limit"), [("/echo", 100), ("/upload", 1000)])
def test_a_body_over_the_limit_is_413_declared_or_not(client, path, limit):
    assert client.post(path, content=b"x" * limit, headers=JSON).text == str(limit)
    for body in (b"x" * (limit + 1), iter([b"x" * limit, b"x"])):
        answer = client.post(path, content=body, headers=JSON)
        assert answer.status_code == 413
        assert answer.json()["code"] == "too_large"
        assert answer.headers["content-type"] == "application/problem+json"


def test_the_limit_names_its_setting(client):
    problem = client.post("/echo", content=b"x" * 101, headers=JSON).json()
    assert (problem["limit"], problem["requested"]) == (100, 101)
    assert problem["setting"] == "SUREPATH_MAX_BODY_BYTES"


@pytest.mark.parametrize(
    ("path", "media", "status"),
    [
        ("/echo", "application/json; charset=utf-8", 200),
        ("/echo", "application/geo+json", 200),
        ("/echo", "text/plain", 415),
        ("/echo", "", 415),
        ("/echo", "multipart/form-data; boundary=x", 415),
        ("/upload", "multipart/form-data; boundary=x", 200),
        ("/upload", "image/png", 415),
    ],
)
def test_content_types(client, path, media, status):
    assert client.post(path, content=b"x", headers={"content-type": media}).status_code == status


def test_what_fails_inside_is_told_to_the_log_only(client, caplog):
    with caplog.at_level(logging.ERROR):
        answer = client.get("/fail", headers={"x-request-id": "abc"})
    assert answer.status_code == 500
    assert answer.json()["code"] == "internal"
    assert answer.headers["x-request-id"] == "abc"
    assert "secret" not in answer.text
    assert "ZeroDivisionError" in caplog.text
