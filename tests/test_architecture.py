"""The house rules that a tool can check."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("maps", "localization", "planner", "api")
MODULES = sorted(p for package in PACKAGES for p in (ROOT / package).rglob("*.py"))


def test_kernels_are_compiled_without_parallel_or_fastmath():
    for path in MODULES:
        if path.parent.name != "kernels" or path.name == "__init__.py":
            continue
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                text = " ".join(ast.unparse(d) for d in node.decorator_list)
                assert "njit" in text, f"{path.name}:{node.name} is not compiled"
                assert "parallel" not in text, f"{path.name}:{node.name}: threads are made by the shell"
                assert "fastmath" not in text, f"{path.name}:{node.name}: no fastmath"


def test_only_the_doors_import_ompl_and_casadi():
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [a.name for a in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                if name.split(".")[0] == "ompl":
                    assert path in {ROOT / "planner" / f"{n}.py" for n in ("sampling", "sampling_se2")}, path
                if name.split(".")[0] == "casadi":
                    assert path == ROOT / "planner" / "smoothing.py", path


def test_no_module_is_too_long():
    long = {str(p.relative_to(ROOT)): n for p in MODULES if (n := len(p.read_text().splitlines())) > 420}
    assert not long


def test_no_global_random_state():
    for path in MODULES:
        assert not re.search(r"np\.random\.(seed|rand|randn|uniform|normal)\(", path.read_text()), path


def test_tracked_files_name_no_machine_or_host():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    bad = re.compile(r"(/work/|/root/|/home/\w|/tmp/|pypi\.org|--index-url|--find-links|file:///)")
    for name in listed.stdout.splitlines():
        path = ROOT / name
        if not path.exists() or path.suffix == ".png" or name == "tests/test_architecture.py":
            continue
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            assert not bad.search(line), f"{name}:{number}: {line.strip()[:80]}"


@pytest.mark.parametrize(
    "path", [p for p in MODULES if p.name != "__init__.py"], ids=lambda p: str(p.relative_to(ROOT))
)
def test_every_public_name_has_a_docstring(path):
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), f"{path} has no docstring"
    for node in tree.body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"{path}:{node.name} has no docstring"
