"""docs/questions.md: it holds the questions of the list, their commands as typed, and a picture for each."""

from __future__ import annotations

import re
import shlex

import pytest
import typer
from PIL import Image

from api.cli import app
from tests import question_pictures as made
from tests.question_list import FIELDS, QUESTIONS

TEXT = made.DOCUMENT.read_text()
SECTIONS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL))
LINES = [command.line for question in QUESTIONS for command in question.commands]


def test_every_question_has_its_section_in_order():
    assert list(SECTIONS) == [question.title for question in QUESTIONS]
    assert made.HEAD.format(fields="\n".join(FIELDS.values())) in TEXT
    assert made.contents() in TEXT


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: q.name)
def test_a_section_holds_question_commands_figures_and_pictures(question):
    text = SECTIONS[question.title]
    assert f"*{question.asks}*" in text
    assert "\n".join(made.commands_of(question)) in text
    assert "|" in text or "m²" in text
    pictures = re.findall(r"\(pictures/(question_\w+\.png)\)", text)
    shown = [k for k, command in enumerate(question.commands) if command.has_picture]
    assert pictures == [made.picture_name(question, k) for k in shown]
    for name in pictures:
        with Image.open(made.PICTURES / name) as image:
            assert image.width == made.WIDTH
    # Everything but the figures is the sentence of the list.
    for part in re.split(r"\{[^}]*\}", question.see):
        assert part in text


def test_no_picture_is_left_over():
    names = {path.name for path in made.PICTURES.glob("question_*.png")}
    assert names == set(re.findall(r"question_\w+\.png", TEXT))


@pytest.mark.parametrize("line", [*FIELDS.values(), *LINES])
def test_commands_are_understood(line, tmp_path, monkeypatch):
    """Options are those that there are; files need not be there."""
    monkeypatch.chdir(tmp_path)
    for name in FIELDS if "field" not in line else ():
        (tmp_path / name).mkdir()
    group = typer.main.get_command(app)
    words = shlex.split(line)[1:]
    command = group.commands[words[0]]
    with command.make_context(words[0], words[1:], parent=None) as context:
        assert context.params
