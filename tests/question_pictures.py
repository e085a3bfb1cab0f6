"""``python -m tests.question_pictures --write`` answers the questions of docs/questions.md anew: a few minutes."""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import tempfile
from pathlib import Path

from PIL import Image

from api.cli import main as surepath
from api.console import SHORT_S, late_words, schedule_words
from api.schedule_picture import looks
from tests.question_list import COLUMNS, FIELDS, QUESTIONS, Command, Question

ROOT = Path(__file__).parents[1]
DOCUMENT = ROOT / "docs" / "questions.md"
PICTURES = ROOT / "docs" / "pictures"
WIDTH = 1000

HEAD = """# Questions that a plan answers

Made by `python -m tests.question_pictures --write`: it types the commands below on the bundled sites, and every figure and picture
is of their answers. Add `--picture plan.png` to see a plan, `-o plan.json` for all of it; the same questions [over REST](rest.md).
Objectives, bounds, areas and via points go together in one command; what does not is said by name.

The fields, once:

```sh
{fields}
```

In the pictures colour is the area of the 95 % ellipse of one fix, hatched cells have none; blue is the plan, orange the shortest way
for the same robot, whatever its uncertainty.
"""


def picture_name(question: Question, k: int) -> str:
    """Of the picture of a command."""
    shown = [i for i, command in enumerate(question.commands) if command.has_picture]
    return (
        f"question_{question.name}.png"
        if len(shown) == 1
        else f"question_{question.name}_{shown.index(k) + 1}.png"
    )


def run(line: str, *more: str) -> int:
    """Exit code of a command in this folder."""
    try:
        surepath([*shlex.split(line)[1:], *more])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def answered(question: Question, folder: Path) -> list[dict]:
    """Answers to the commands of a question; its pictures go to docs/pictures."""
    for name, text in question.files.items():
        (folder / name).write_text(text + "\n")
    out = []
    for k, command in enumerate(question.commands):
        answer = "answer.json" if command.line.startswith("surepath simulate") else "plan.json"
        more = ["-o", answer]
        if command.has_picture:
            more += ["--picture", "picture.png"]
        code = run(command.line, *more)
        assert code == command.expected, f"{command.line}: exit code {code}"
        if command.has_picture:
            save_small(folder / "picture.png", PICTURES / picture_name(question, k))
        out.append(json.loads((folder / answer).read_text()))
    return out


def save_small(source: Path, target: Path) -> None:
    """The picture at the width of the document, in few colours."""
    with Image.open(source) as image:
        height = round(image.height * WIDTH / image.width)
        small = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
    # Rare colours, such as those of the routes, must not get lost.
    few = small.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(target, optimize=True)


def shown(value: float | None, digits: int | None) -> str:
    """A figure of a table."""
    if value is None:
        return "–"
    if digits is None:
        return "0" if value < 1e-12 else f"{value:.2g}"
    return f"{value:.{digits}f}"


def table(head: list[str], rows: list[list[str]]) -> str:
    """Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def plan_table(question: Question, answers: list[dict]) -> str:
    """A row for every route, and the shortest one."""
    rows = []
    for command, answer in zip(question.commands, answers, strict=True):
        routes = answer["routes"]
        names = [command.row] if len(routes) == 1 else [str(k + 1) for k in range(len(routes))]
        rows += [[name, *_figures(question, route)] for name, route in zip(names, routes, strict=True)]
        if not routes:
            rows.append([command.row, f"`{answer['status']}`", *[""] * (len(question.columns) - 1)])
    other = answers[0].get("shortest_baseline")
    if other is not None:
        with_heading = any("footprint" in c.line or "kinematics" in c.line for c in question.commands)
        name = "shortest, without a heading" if with_heading else "shortest"
        row = [name, *_figures(question, other)]
        if row[1:] != rows[0][1:]:
            rows.append(row)
    return table(["", *(COLUMNS[name][0] for name in question.columns)], rows)


def _figures(question: Question, route: dict) -> list[str]:
    return [shown(COLUMNS[name][2](route), COLUMNS[name][1]) for name in question.columns]


def schedule_table(route: dict) -> str:
    """The stretches; those without a fix have no number, as in the picture."""
    head = [
        "",
        "from [m]",
        "to [m]",
        "from [s]",
        "landmarks",
        "pan [°]",
        "worst r95 [m]",
        "begin to turn by [s]",
        "1 s late",
    ]
    rows = []
    for number, part in zip(looks(route["schedule"]), route["schedule"], strict=True):
        if part["kind"] != "fix" and part["t_end_s"] - part["t_start_s"] < SHORT_S:
            continue
        ends = [part["pan_start_rad"], part["pan_end_rad"]]
        rows.append([
            "" if number is None else str(number), shown(part["s_start_m"], 1), shown(part["s_end_m"], 1), shown(part["t_start_s"], 1),
            " ".join(part["triplet"] or ["turning" if part["kind"] == "turning" else "none"]),
            " to ".join(shown(None if pan is None else math.degrees(pan), 0) for pan in ends),
            shown(part["max_r95_m"], 3), shown(part["turn_from_s"], 1), late_words(part),
        ])  # fmt: skip
    return table(head, rows) + f"\n\n{schedule_words(route).capitalize()}."


def matrix_table(answer: dict) -> str:
    """Lengths and worst r95."""
    names = [place["id"] for place in answer["targets"]]
    rows = []
    for place, lengths, worst in zip(
        answer["sources"], answer["length_m"], answer["worst_r95_m"], strict=True
    ):
        cells = [f"{shown(a, 1)} m, {shown(b, 3)} m" for a, b in zip(lengths, worst, strict=True)]
        rows.append([place["id"], *cells])
    return table(["length, worst r95", *names], rows)


def simulation_table(answer: dict) -> str:
    """Collisions, errors, ellipses."""
    hits, ellipse = answer["collisions"], answer["ellipse95"]["claimed"]
    rows = [
        ["runs", str(answer["runs"])],
        ["runs that touch something", f"{100 * hits['share']:.1f} % (95 % bounds {100 * hits['low']:.1f} to {100 * hits['high']:.1f} %)"],
        ["rms error", f"{answer['rms_error_m']:.3f} m"],
        ["deviation from the path, largest of a run", f"median {answer['worst_deviation']['median_m']:.2f} m, 95 % below {answer['worst_deviation']['q95_m']:.2f} m"],
        ["inside the filter's own 95 % ellipse", f"{100 * ellipse['share']:.1f} %"],
    ]  # fmt: skip
    return table(["", ""], rows)


def tables(question: Question, answers: list[dict]) -> list[str]:
    """What stands between the command and the picture."""
    last = answers[-1]
    if question.name == "matrix":
        return [matrix_table(last)]
    if question.name == "reach":
        area = (
            last["properties"]["area_m2"]
            if "properties" in last
            else sum(f["properties"]["area_m2"] for f in last["features"])
        )
        return [f"Within reach: {area:.0f} m²."]
    if question.name == "simulation":
        return [simulation_table(last)]
    out = [plan_table(question, answers)]
    if question.name == "schedule":
        out.append(schedule_table(answers[0]["routes"][0]))
    out += [f"> {item['message']}" for item in answers[0]["unmet"]]
    return out


def figures_of(answers: list[dict]) -> dict[str, float]:
    """What the sentences about pictures may name."""
    first = answers[0]
    if not first.get("routes"):
        return {}
    route, last = first["routes"][0], answers[-1].get("routes") or first["routes"]
    found = {name: read(route) for name, (_, _, read) in COLUMNS.items()}
    found |= {"count": len(first["routes"]), "last_blind": last[0]["uncertainty"]["blind_m"]}
    if found["worst"] is not None:
        found["worst_mm"] = 1000 * found["worst"]
    other = first.get("shortest_baseline")
    if other is not None:
        found["extra"] = found["length"] - other["length_m"]
        found["extra_percent"] = 100 * found["extra"] / other["length_m"]
        found["shortest_blind"] = other["uncertainty"]["blind_m"]
    return found


def commands_of(question: Question) -> list[str]:
    """Lines to paste; files are written first."""
    lines = []
    for name, text in question.files.items():
        lines += [f"cat > {name} <<'END'", *text.rstrip("\n").splitlines(), "END"]
    return lines + [_with_output(c, question) for c in question.commands]


def _with_output(command: Command, question: Question) -> str:
    last = question.commands[-1]
    return (
        f"{command.line} -o plan.json"
        if question.name == "simulation" and command is not last
        else command.line
    )


def section(question: Question, answers: list[dict]) -> str:
    """One question of the document."""
    commands = "\n".join(commands_of(question))
    see = question.see.format(**figures_of(answers))
    parts = [
        f"## {question.title}",
        f"*{question.asks}*",
        f"```sh\n{commands}\n```",
        *tables(question, answers),
    ]
    many = sum(command.has_picture for command in question.commands) > 1
    parts += [
        f"![{question.title}{f': {command.row}' if many else ''}](pictures/{picture_name(question, k)})"
        for k, command in enumerate(question.commands)
        if command.has_picture
    ]
    return "\n\n".join([*parts, see]) + "\n"


def contents() -> str:
    """Links to the questions."""
    return "\n".join(f"- [{q.title}](#{anchor(q.title)}): {q.asks}" for q in QUESTIONS)


def anchor(title: str) -> str:
    """Of a heading, as GitHub makes it."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -")
    return kept.replace(" ", "-")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.question_pictures", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write docs/questions.md and its pictures")
    parser.add_argument(
        "--only",
        nargs="*",
        help="names of questions: their sections are printed, nothing else is written than their pictures",
    )
    options = parser.parse_args()
    chosen = [q for q in QUESTIONS if not options.only or q.name in options.only]
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        try:
            for line in FIELDS.values():
                assert run(line) == 0, line
            sections = [section(question, answered(question, Path(name))) for question in chosen]
        finally:
            os.chdir(here)
    text = "\n".join([HEAD.format(fields="\n".join(FIELDS.values())), contents() + "\n", *sections])
    if options.write and not options.only:
        DOCUMENT.write_text(text)
    else:
        print("\n".join(sections))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
