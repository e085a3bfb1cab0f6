"""Texts of pictures: only signs that the font has, whatever names people give."""

from __future__ import annotations

import pytest
from PIL import ImageDraw

from api import canvas
from tests.api.test_cli import field, room, run  # noqa: F401


@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("length [m]", "length [m]"),
        ("±5 °", "±5 °"),
        ("–", "-"),
        ("−0.5 × 2", "-0.5 x 2"),
        ("Mañana", "Manana"),
        ("Tür–Süd", "Tür-Süd"),
        ("倉庫 7", "?? 7"),
        ("ß → µ", "ss -> u"),
    ],
)
def test_signs_that_the_font_lacks(text, drawn):
    out = canvas.plain(text)
    assert all(map(canvas.has_glyph, out))
    if canvas.has_glyph("ü") or "ü" not in text:
        assert out == drawn


def test_which_signs_the_font_has():
    assert canvas.has_glyph("m")
    assert canvas.has_glyph("°")
    assert not canvas.has_glyph("–")
    assert not canvas.has_glyph("倉")


@pytest.mark.parametrize(
    "question",
    [
        ("matrix", "--points", "stations.csv"),
        ("plan", "--start", 2, 4, "--goal", 10, 4, "--radius", 0.3, "--deadline", 20, "--alternatives", 2),
        ("plan", "--start", 2, 4, "--goal", 10, 4, "--radius", 0.3, "--deadline", 20, "--schedule"),
        ("reach", "--from", 1, 1, "--max-length", 4),
    ],
    ids=lambda question: " ".join(map(str, question[::8])),
)
def test_pictures_have_no_empty_boxes(field, tmp_path, monkeypatch, question):  # noqa: F811
    drawn = []
    original = ImageDraw.ImageDraw.text

    def text(self, xy, text, *args, **options):
        drawn.append(text)
        return original(self, xy, text, *args, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", text)
    # A place inside a wall has no figures.
    (tmp_path / "stations.csv").write_text("id,x,y\nTür–Süd,1,1\nMañana,11,7\nwall,6,4\n")
    command, *more = (str(tmp_path / x) if x == "stations.csv" else x for x in question)
    assert run(command, field, *more, "--picture", tmp_path / "picture.png") == 0
    assert len(drawn) > 3
    assert not {sign for said in drawn for sign in str(said) if not canvas.has_glyph(sign)}
