"""``surepath plan`` with several routes and with schedules."""

from __future__ import annotations

import json

import pytest

from tests.api.test_cli import field, room, run, width_of  # noqa: F401

ENDS = ("--start", 2, 4, "--goal", 10, 4, "--radius", 0.3, "--deadline", 20)


def said(capsys) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_alternatives_with_picture_and_table(field, tmp_path, capsys):  # noqa: F811
    out, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    more = ("--alternatives", 3, "--max-cost-factor", 3, "-o", out, "--picture", picture)
    assert run("plan", field, *ENDS, *more) == 0
    answer = json.loads(out.read_text())
    assert len(answer["routes"]) == 2
    assert answer["request"]["alternatives"]["max_cost_factor"] == 3.0
    assert width_of(picture) > 500
    words = said(capsys)
    assert "shared" in words
    assert "2 of 3 routes" in words


@pytest.mark.parametrize(("against", "column"), [("worst", "max r95"), ("mean", "weight")])
def test_a_front(field, tmp_path, capsys, against, column):  # noqa: F811
    out, picture = tmp_path / "front.json", tmp_path / "front.png"
    more = ("--objective", "pareto", "--against", against, "--count", 4, "-o", out, "--picture", picture)
    high = ("--start", 2, 5, "--goal", 10, 5, "--radius", 0.3, "--deadline", 20)
    assert run("plan", field, *high, *more) == 0
    answer = json.loads(out.read_text())
    assert 2 <= len(answer["routes"]) <= 4
    assert answer["request"]["objective"] == {
        "kind": "pareto",
        "uncertainty_weight_per_m": 4.0,
        "covariance": "fix",
        "against": against,
        "count": 4,
    }
    assert width_of(picture) > 500
    assert column in said(capsys)


def test_a_schedule(field, tmp_path, capsys):  # noqa: F811
    out = tmp_path / "plan.json"
    assert run("plan", field, *ENDS, "--schedule", "--pan-rate-deg", 90, "-o", out) == 0
    schedule = json.loads(out.read_text())["routes"][0]["schedule"]
    assert schedule[0]["triplet"]
    words = said(capsys)
    assert "when to look where" in words
    assert schedule[0]["triplet"][0] in words
    assert "length [m]" in words, "units are no markup"
    assert "as scheduled: worst r95" in words


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--alternatives", 0), "from 1 to 10"),
        (("--alternatives", 2, "--max-share", 1), "below 1"),
        (("--alternatives", 2, "--via", "3,1"), "no via points"),
        (("--alternatives", 2, "--objective", "pareto"), "several routes already"),
        (("--objective", "pareto", "--count", 1), "from 2 to 50"),
        (("--objective", "pareto", "--against", "best"), "'worst' or 'mean'"),
        (("--objective", "pareto", "--covariance", "fused"), "single fixes"),
        (("--against", "mean"), "belong to --objective pareto"),
        (("--schedule", "--pan-rate-deg", 0), "must be positive"),
    ],
)
def test_mistakes(field, more, words, capsys):  # noqa: F811
    assert run("plan", field, *ENDS, *more) == 1
    assert words in " ".join(capsys.readouterr().err.split())
