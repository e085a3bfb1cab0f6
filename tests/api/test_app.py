"""The application as a whole."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import api.app
from api.settings import Settings
from api.store_files import write_field
from localization.field_builder import build_field
from localization.sensors import LASER
from maps.io.site import bundled_site
from tests.api.clients import TestClient
from tests.api.conftest import IdleJobs, InlinePool, problem_of


@pytest.mark.parametrize(
    "path", ["/nowhere", "/v1/nowhere", "/v1/maps/", "/v1/fields/f/heatmap.gif", "/%ff%00"]
)
def test_unknown_addresses(gallery, path):
    problem_of(gallery.client.get(path), 404, "not_found")


def test_other_methods(gallery):
    problem = problem_of(gallery.client.put("/v1/plans"), 405, "method_not_allowed")
    assert problem["instance"] == "/v1/plans"


@pytest.mark.parametrize(
    ("path", "allowed"),
    [
        ("/v1/maps/room/landmarks", "GET, PUT"),
        ("/v1/maps", "GET, POST"),
        ("/v1/fields/f_1/statistics", "GET, POST"),
        ("/v1/plans/batch", "POST"),
    ],
)
def test_other_methods_are_told_which_there_are(gallery, path, allowed):
    answer = gallery.client.request("PATCH", path)
    problem_of(answer, 405, "method_not_allowed")
    assert answer.headers["allow"] == allowed


def test_large_bodies(gallery):
    answer = gallery.client.post(
        "/v1/plans", content=b"x" * 100_001, headers={"content-type": "application/json"}
    )
    problem = problem_of(answer, 413, "too_large")
    assert (problem["limit"], problem["setting"]) == (100_000, "SUREPATH_MAX_BODY_BYTES")


@pytest.mark.parametrize(
    "body",
    [b"{", b"\xff", b"[" * 100_000, b'{"seed": ' + b"1" * 5000 + b"}", b"{'a': 1}"],
    ids=["cut", "bytes", "deep", "digits", "quotes"],
)
def test_broken_bodies_are_400(gallery, body):
    answer = gallery.client.post("/v1/plans", content=body, headers={"content-type": "application/json"})
    problem_of(answer, 400, "malformed_body")


def test_the_openapi_document_is_complete(gallery):
    document = gallery.client.get("/openapi.json").json()
    assert document["openapi"].startswith("3.1")
    references = set(re.findall(r"#/components/schemas/([\w.-]+)", gallery.client.get("/openapi.json").text))
    assert references <= set(document["components"]["schemas"])
    assert "HTTPValidationError" not in document["components"]["schemas"]
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            where = f"{method} {path}"
            assert operation.get("tags"), where
            assert operation.get("description"), where
            if path in {"/healthz", "/readyz"}:
                continue
            for status, answer in operation["responses"].items():
                if int(status) >= 400:
                    assert list(answer["content"]) == ["application/problem+json"], (where, status)
                elif int(status) in {200, 201, 202}:
                    assert answer.get("content"), (where, status)


def test_examples_of_the_document_work(client, field):
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    first, over_headings = schemas["FieldIn"]["examples"]
    order = {**first, "map": "room", "resolution_m": 0.5}
    assert client.post("/v1/fields", json=order).status_code == 200
    assert client.post("/v1/fields", json={**over_headings, "map": "room"}).status_code == 202
    assert (
        client.post("/v1/plans", json={**schemas["PlanIn"]["examples"][0], "map": "room"}).status_code == 200
    )
    upload = client.get("/openapi.json").json()["paths"]["/v1/maps"]["post"]["requestBody"]["content"]
    assert client.post("/v1/maps", json=upload["application/json"]["example"]).status_code == 201


@pytest.fixture(scope="module")
def warehouse(tmp_path_factory):
    """A service with the warehouse and a coarse field of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(api.app, "JobRunner", IdleJobs)
        settings = Settings(data_dir=tmp_path_factory.mktemp("warehouse"), preload=False)
        with TestClient(api.app.create_app(settings, pool=InlinePool())) as client:
            store = client.app.state.service.store
            world = bundled_site("warehouse")
            record, _ = store.add_map(world, name="warehouse")
            _, job = store.add_field_request(record.id, LASER, 0.25, 0.0)
            staged = store.staging_path(store.claim_job(job.id).id)
            size, checksum = write_field(build_field(world, LASER, resolution=0.25), staged)
            assert store.commit_field(job.id, staged, size=size, checksum=checksum)
            yield client


@pytest.mark.parametrize(
    ("schema", "path", "status"),
    [
        ("PlanIn", "/v1/plans", {"exact", "approximate", "risk_unmet"}),
        ("MatrixIn", "/v1/matrix", {"complete"}),
        ("ReachIn", "/v1/reachability", {"complete"}),
        ("SimulationIn", "/v1/simulations", {"complete"}),
        ("TripletsIn", "/v1/triplets", {None}),
        ("LocalizeIn", "/v1/localize", {"ok"}),
        ("FixesIn", "/v1/fixes", {"ok"}),
        ("EvaluationIn", "/v1/evaluations", {None}),
        ("BatchIn", "/v1/plans/batch", {None}),
    ],
)
def test_examples_of_questions_work_on_the_warehouse(warehouse, schema, path, status):
    examples = warehouse.get("/openapi.json").json()["components"]["schemas"][schema]["examples"]
    assert examples
    for example in examples:
        answer = warehouse.post(path, json=example)
        assert answer.status_code == 200, answer.text
        assert answer.json().get("status") in status


def pasted() -> list[tuple[str, dict]]:
    """Addresses and bodies of the curl lines of the documents."""
    found = []
    for name in ("README.md", "docs/rest.md"):
        text = (Path(__file__).parents[2] / name).read_text()
        found += re.findall(r"curl -s http://127\.0\.0\.1:8080(\S+) -H \S+ \S+ -d '([^']*)'", text)
    return [(path, json.loads(body)) for path, body in found]


def test_curl_lines_of_the_documents_work(warehouse):
    lines = pasted()
    assert {path for path, _ in lines} == {
        "/v1/plans",
        "/v1/matrix",
        "/v1/reachability",
        "/v1/simulations",
        "/v1/triplets",
        "/v1/localize",
        "/v1/fixes",
        "/v1/plans/batch",
        "/v1/evaluations",
        "/v1/fields",
    }
    for path, body in lines:
        answer = warehouse.post(path, json=body)
        assert answer.status_code == (202 if path == "/v1/fields" else 200), answer.text
        # Questions about one place have no outcome but the answer.
        status = answer.json().get("status", "complete")
        assert status in {"complete", "exact", "approximate", "risk_unmet", "ok", "accepted"}, body


def test_an_empty_store_gets_the_warehouse(tmp_path, monkeypatch):
    monkeypatch.setattr(api.app, "JobRunner", IdleJobs)
    settings = Settings(data_dir=tmp_path, preload=True)
    with TestClient(api.app.create_app(settings, pool=InlinePool())) as client:
        assert [m["name"] for m in client.get("/v1/maps").json()["maps"]] == ["warehouse"]
        (field,) = client.get("/v1/fields").json()["fields"]
        assert field["resolution_m"] == 0.1
        client.delete(f"/v1/jobs/{field['job']}")
        client.delete(f"/v1/maps/{field['map']}")
        client.post("/v1/maps", json=__import__("tests.api.conftest", fromlist=["ROOM"]).ROOM)
    with TestClient(api.app.create_app(settings, pool=InlinePool())) as client:
        assert [m["name"] for m in client.get("/v1/maps").json()["maps"]] == ["room"], (
            "not into a store in use"
        )
