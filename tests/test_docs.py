"""README and docs: links lead somewhere, and what is shown to be typed works."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from api.cli import main
from tests.conftest import SHARED

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text()):
        if not target.startswith(("http://", "https://", "mailto:")):
            assert (path.parent / target).exists(), f"{path.name} links to {target}"


def test_make_targets_in_the_readme_exist():
    makefile = (ROOT / "Makefile").read_text()
    for target in set(re.findall(r"(?:^|`)make ([a-z-]+)", README, re.MULTILINE)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def shell_lines() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    text = "\n".join(blocks).replace("\\\n", " ")
    return [line.split("  #")[0].strip() for line in text.splitlines() if line.strip()]


def test_surepath_commands_in_the_readme_work(tmp_path, monkeypatch):
    """Every ``surepath`` line runs, in order, in one empty folder; plant lines only where the data is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs" / "pictures").mkdir(parents=True)
    ran = 0
    for line in shell_lines():
        if not re.match(r"(\.venv/bin/)?surepath (?!serve|demo)", line):
            continue
        words = shlex.split(line)
        if "../shared" in line or "plant" in line:
            if not SHARED.is_dir():
                continue
            words = [w.replace("../shared/data", str(SHARED)) for w in words]
        with pytest.raises(SystemExit) as stop:
            main(words[1:])
        assert stop.value.code == 0, line
        ran += 1
    assert ran >= 3


def test_python_snippets_of_the_readme_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        exec(compile(block, "README.md", "exec"), {})


def test_pictures_of_the_readme_are_tracked():
    names = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README)
    assert names
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    assert set(names) <= set(listed.stdout.split())
