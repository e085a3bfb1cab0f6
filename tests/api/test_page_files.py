"""Files of the page: what is served, and rules that hold in every one of them."""

from __future__ import annotations

import fnmatch
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from api import page_files
from api.codec import sensor_from_json
from api.colormaps import COLORMAPS
from api.middleware import CSP
from localization.sensors import PRESETS
from localization.uncertainty_field import METRICS
from tests.api.conftest import problem_of

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "api" / "ui"
SCRIPTS = sorted(FOLDER.glob("*.js"))
TEXTS = {path.name: path.read_text() for path in sorted(FOLDER.iterdir())}
#: Names of XML vocabularies look like addresses; nobody asks for them.
NAMESPACES = {"http://www.w3.org/2000/svg"}


def test_every_file_is_served_for_good_under_its_version(gallery):
    for name, content in page_files.files().items():
        answer = gallery.client.get(f"{page_files.base()}/{name}")
        assert answer.status_code == 200
        assert answer.content == content
        assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert answer.headers["content-type"] == page_files.TYPES[name.rpartition(".")[2]]
        assert answer.headers["content-security-policy"] == CSP
        assert answer.headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("name", ["index.html", "none.js", "..%2fapp.py", "%2e%2e"])
def test_nothing_else_is_served(gallery, name):
    answer = gallery.client.get(f"{page_files.base()}/{name}")
    assert answer.status_code == 404
    problem_of(gallery.client.get("/ui/0123456789ab/main.js"), 404, "not_found")


def test_the_page_itself_is_asked_for_again(gallery):
    page = gallery.client.get("/")
    assert page.headers["cache-control"] == "no-cache"
    assert page.headers["content-security-policy"] == CSP
    held = gallery.client.get("/", headers={"if-none-match": page.headers["etag"]})
    assert held.status_code == 304
    assert f'src="{page_files.base()}/main.js"' in page.text
    assert "$" not in page.text, "a place of the template was left empty"


def test_without_a_script_the_page_can_be_read(gallery):
    plain = re.search(r"<noscript>(.*)</noscript>", gallery.client.get("/").text, re.DOTALL)[1]
    assert ">room</a>" in plain
    assert f"{gallery.path}/heatmap.png" in plain


@pytest.mark.parametrize("name", TEXTS)
def test_no_file_names_another_host(name):
    found = set(re.findall(r"(?:https?:|wss?:|ftp:)?//[\w.-]+\.\w+[^\s\"'`)]*", TEXTS[name]))
    assert found <= NAMESPACES
    assert "@import" not in TEXTS[name]
    assert "url(" not in TEXTS[name]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_scripts_make_no_html_and_no_code_from_text(path):
    text = path.read_text()
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
        assert word not in text
    assert not re.search(r"setAttribute\(\"style\"|cssText", text), "the policy forbids style attributes"
    assert text.startswith("// "), "a script begins by saying what it is for"
    assert text.count("\n") < 300


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: p.name)
def test_scripts_import_what_is_there(path):
    for names, source in re.findall(r"import \{([^}]+)\} from \"([^\"]+)\"", path.read_text()):
        assert source.startswith("./")
        exported = (FOLDER / source).read_text()
        for name in re.findall(r"([\w$]+)(?: as \w+)?,?", names):
            assert re.search(
                rf"export (async )?(function|const|let|class) {re.escape(name)}[ (={{;]", exported
            ), (
                source,
                name,
            )


def test_imports_go_one_way():
    """No module needs, through others, itself."""
    needs = {p.name: set(re.findall(r"from \"\./([^\"]+)\"", p.read_text())) for p in SCRIPTS}
    while needs:
        free = {name for name, wanted in needs.items() if not wanted & needs.keys()}
        assert free, f"a circle among {sorted(needs)}"
        needs = {name: wanted for name, wanted in needs.items() if name not in free}
    assert "main.js" in {p.name for p in SCRIPTS}


def test_every_element_that_a_script_wants_is_in_the_page():
    ids = re.findall(r"\sid=\"([^\"]+)\"", TEXTS["index.html"])
    assert len(ids) == len(set(ids))
    made = set(re.findall(r"id: \"([^\"]+)\"", "".join(p.read_text() for p in SCRIPTS)))
    for path in SCRIPTS:
        for name in re.findall(r"\$\(\"([^\"]+)\"\)", path.read_text()):
            assert name in set(ids) | made, f"{path.name} wants #{name}"


def test_every_control_has_a_label():
    page = TEXTS["index.html"]
    inside = "".join(re.findall(r"<label[^>]*>(?:(?!</label>).)*</label>", page, re.DOTALL))
    for tag, attributes in re.findall(r"<(input|select|progress)\b([^>]*)>", page):
        name = re.search(r"id=\"([^\"]+)\"", attributes)
        labelled = f"<{tag}{attributes}>" in inside or (name and f'for="{name[1]}"' in page)
        assert labelled, attributes
    for attributes, text in re.findall(r"<button\b([^>]*)>([^<]*)</button>", page):
        assert "aria-label=" in attributes or len(text) > 1


def test_the_facts_are_the_engines_own():
    facts = json.loads(page_files.files()[page_files.FACTS])
    assert facts["metric_order"] == list(METRICS)
    assert set(facts["presets"]) == set(PRESETS)
    for name, preset in facts["presets"].items():
        assert sensor_from_json(preset) == PRESETS[name]
    for name, text in facts["colormaps"].items():
        table = np.frombuffer(bytes.fromhex(text), dtype=np.uint8).reshape(256, 3)
        np.testing.assert_array_equal(table, COLORMAPS[name])


def test_the_files_are_part_of_the_package():
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    for name in TEXTS:
        assert any(fnmatch.fnmatch(f"ui/{name}", pattern) for pattern in data["api"])
