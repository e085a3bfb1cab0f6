"""Pages: they work, and they ask no other host."""

from __future__ import annotations

import re

import pytest

from api.errors import CODES
from tests.api.conftest import problem_of


@pytest.mark.parametrize("path", ["/", "/docs", "/docs/problems"])
def test_pages_load_their_own_files_only(gallery, path):
    client = gallery.client
    page = client.get(path)
    assert page.status_code == 200
    assert page.headers["content-type"].startswith("text/html")
    loaded = re.findall(r'<(?:script|link|img)[^>]*?(?:src|href)="([^"]+)"', page.text)
    assert loaded
    for address in loaded:
        assert re.match(r"/[^/]|data:", address), address
        if address.startswith("/"):
            assert client.get(address).status_code == 200, address
    assert "<style" not in page.text
    assert not re.search(r"<script>|\son\w+=|\sstyle=", page.text), "the policy forbids inline code"


def test_files_of_the_documentation_stay_for_good(client):
    script = re.search(r'src="(/docs/files/[^"]+bundle.js)"', client.get("/docs").text)[1]
    answer = client.get(script)
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-type"].startswith("text/javascript")
    assert len(answer.content) > 500_000
    problem_of(client.get("/docs/files/0/start.js"), 404, "not_found")
    problem_of(client.get(script.replace("swagger-ui-bundle.js", "other.js")), 404, "not_found")


def test_every_code_is_explained(client):
    page = client.get("/docs/problems").text
    for code in CODES:
        assert f'id="{code}"' in page


def test_the_landing_page_shows_what_is_here(client, field):
    page = client.get("/")
    assert f"{field.path}/heatmap.png" in page.text
    assert ">room</a>" in page.text
    held = {"if-none-match": page.headers["etag"]}
    assert client.get("/", headers=held).status_code == 304


def test_names_are_escaped(client):
    from tests.api.conftest import ROOM

    client.post("/v1/maps", json={**ROOM, "name": "<script>alert(1)</script>"})
    assert "<script>alert" not in client.get("/").text


def test_an_empty_store_has_a_page(client):
    assert "None yet" in client.get("/").text
