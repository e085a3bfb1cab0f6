"""``surepath reproduce mas97``: the table, the document, the pictures."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import localization.madsen_1997 as study
from api import mas97_pictures_parts as parts
from api.cli import main
from api.mas97_pictures import figure_4, figure_6, figure_8, pictures
from api.mas97_pictures_path import figure_7
from localization.madsen_1997 import SEED, reproduce
from localization.madsen_1997_report import PICTURES
from localization.madsen_1997_scenes import SITE
from maps.io.site import bundled_site

DOCUMENT = Path(__file__).parents[2] / "docs" / "mas97.md"


@pytest.fixture(scope="module")
def made():
    return reproduce(bundled_site(SITE), rng=np.random.default_rng(SEED))


def run(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code


def colors(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def share_near(picture, color, box=(0, 0, 10_000, 10_000)):
    x0, y0, x1, y1 = box
    return np.mean(np.abs(picture[y0:y1, x0:x1] - np.array(color)).sum(axis=2) < 60)


def test_it_prints_every_claim_and_writes_document_and_pictures(tmp_path, capsys):
    assert run("reproduce", "mas97", "-o", tmp_path / "deep" / "folder") == 0
    text = " ".join(capsys.readouterr().out.split())
    for word in ("Fig. 3", "Fig. 4", "Fig. 6", "Fig. 7", "Fig. 8", "footnote 5", "paper", "ours", "mas97.md"):
        assert word in text
    folder = tmp_path / "deep" / "folder"
    assert (folder / "mas97.md").read_text() == DOCUMENT.read_text()
    for name in PICTURES.values():
        with Image.open(folder / "pictures" / name) as image:
            assert image.format == "PNG"
            assert image.width >= 1400


def test_a_claim_that_does_not_hold_is_exit_code_3(tmp_path, capsys, monkeypatch, made):
    wrong = replace(made, poor=made.worst[0])
    monkeypatch.setattr(study, "reproduce", lambda *_, **__: wrong)
    assert run("reproduce", "mas97", "-o", tmp_path) == 3
    assert "no: within 20" in " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "| no: within 20 % |" in (tmp_path / "mas97.md").read_text()


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert run("reproduce", "mas97", "-o", tmp_path / "file") == 1
    text = " ".join(capsys.readouterr().err.split())
    assert "Could not make the folder" in text
    assert "Traceback" not in text


def test_an_unknown_paper_is_one_clear_line(capsys):
    assert run("reproduce", "mas98") == 1
    assert "mas98" in capsys.readouterr().err


def test_pictures_of_all_figures(made):
    drawn = pictures(made)
    assert set(drawn) == set(PICTURES)
    for png in drawn.values():
        picture = colors(png)
        assert picture.shape[1] >= 1400
        assert picture.std() > 10


def test_figure_4_shows_a_small_ellipse_in_a_large_one(made):
    picture = colors(figure_4(made))
    near = (760, 60, 1460, 720)  # the right panel
    assert 0.001 < share_near(picture, parts.BEST, near) < share_near(picture, (244, 224, 211), near)


def test_figure_6_has_one_scale_of_colours(made):
    picture = colors(figure_6(made.topologies))
    # Below the crosses green rises along the colour map, violet to yellow; the median leaves out the stripes.
    lefts = [34 + k * 476 for k in range(3)]
    green = [np.median(picture[446:466, left + 62 : left + 82, 1]) for left in lefts]
    assert green == sorted(green)
    assert green[0] < green[2]


def test_figure_7_profile_tells_the_strategies_apart(made):
    picture = colors(figure_7(made.room, made.path))
    profile = (821, 45, 1518, 742)
    rows = {}
    for name, color in (("best", parts.BEST), ("arbitrary", parts.POOR)):
        x0, y0, x1, y1 = profile
        hits = np.abs(picture[y0:y1, x0:x1] - np.array(color)).sum(axis=2) < 60
        rows[name] = np.nonzero(hits)[0].mean()
    assert rows["arbitrary"] < rows["best"]  # higher up: a larger area


def test_figure_8_shows_fixes_outside_the_ellipse(made):
    picture = colors(figure_8(made))
    for left in (34, 780):
        panel = (left, 66, left + 700, 560)
        assert share_near(picture, parts.POOR, panel) > 0.0015
        assert share_near(picture, (0, 92, 230), panel) > 0.001


def test_axis_steps_are_round_and_about_60_pixels_apart():
    for length in (0.3, 1.0, 2.8, 15.4, 31.0, 900.0):
        step = parts.axis_step(length, 700)
        mantissa = step / 10 ** np.floor(np.log10(step) + 1e-9)
        assert round(mantissa, 9) in {1, 2, 5}
        assert 35 < step / length * 700 < 100
    assert parts.round_numbers(-1.0, 1.1, 0.5) == [-1.0, -0.5, 0.0, 0.5, 1.0]
