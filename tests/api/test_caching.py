"""Entity tags and the memory for finished answers."""

from __future__ import annotations

import pytest
from starlette.requests import Request
from starlette.responses import Response

from api.caching import BytesCache, conditional, etag_of


def _request(if_none_match: str | None) -> Request:
    headers = [] if if_none_match is None else [(b"if-none-match", if_none_match.encode())]
    return Request({"type": "http", "headers": headers})


@pytest.mark.parametrize(
    ("given", "status"),
    [
        (None, 200),
        ('"abc"', 304),
        ('W/"abc"', 304),
        ('"x", "abc"', 304),
        ("*", 304),
        ('"x"', 200),
        ("abc", 200),
    ],
)
def test_what_the_client_holds_is_not_sent_again(given, status):
    answer = conditional(_request(given), "abc", "no-cache", lambda: Response(b"body"))
    assert answer.status_code == status
    assert answer.headers["etag"] == '"abc"'
    assert answer.headers["cache-control"] == "no-cache"


def test_nothing_is_made_for_a_client_that_holds_it():
    def never() -> Response:
        raise AssertionError

    assert conditional(_request('"abc"'), "abc", "no-cache", never).body == b""


def test_tags_differ_with_every_part():
    assert len({etag_of(1, "2"), etag_of("1", 2), etag_of(1, 2), etag_of("12"), etag_of(1, None)}) == 5


def test_the_least_used_leaves_first():
    kept = BytesCache(limit=4)
    for key in "ab":
        kept.put(key, b"xx")
    assert kept.get("a") == b"xx"
    kept.put("c", b"yy")
    assert kept.get("b") is None
    assert kept.get("a") == b"xx"
    kept.put("a", b"zzzz")
    assert kept.get("c") is None
    kept.put("large", b"12345")
    assert kept.get("large") is None
    assert kept.get("a") == b"zzzz"
