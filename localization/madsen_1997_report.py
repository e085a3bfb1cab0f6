"""``docs/mas97.md``: the claims of MAS97 beside what :mod:`localization.madsen_1997` computes."""

from __future__ import annotations

from textwrap import fill

import numpy as np

from localization.madsen_1997 import SEED, Reproduction, Row, area
from localization.madsen_1997_path import N_DRIVES, STEP_M
from localization.madsen_1997_scenes import POOR_PLACE, SITE, TOPOLOGY_PLACE

COMMAND = "surepath reproduce mas97 -o docs"
PICTURE_FOLDER = "pictures"
#: Figure of the paper -> file in :data:`PICTURE_FOLDER`.
PICTURES = {figure: f"mas97_fig{figure}.png" for figure in (3, 4, 6, 7, 8)}
HEAD = ("where", "claim", "paper", "ours", "holds")


def report(r: Reproduction) -> str:
    """Markdown document with the table of every claim and the pictures of the figures."""
    parts = [_introduction(r), "## The numbers\n\n" + _table(r.rows()), *_figures(r)]
    return "\n".join(parts)


def cells(row: Row) -> tuple[str, str, str, str, str]:
    """A row as text, one cell per column of :data:`HEAD`."""
    verdict = "yes" if row.holds else "no"
    return row.where, row.claim, row.paper, row.ours, f"{verdict}: {row.criterion}"


def _table(rows: tuple[Row, ...]) -> str:
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _introduction(r: Reproduction) -> str:
    n = len(r.room.landmarks)
    text = f"""# The paper, reproduced

Made by `{COMMAND}` (seed {SEED}); every number of ours is computed by that command, none typed.

"""
    return text + _paragraphs(
        "C. B. Madsen, C. S. Andersen, J. S. Sørensen, *A Robustness Analysis of Triangulation-Based Robot "
        "Self-Positioning*, SIRS 1997. Camera: 512 columns over 53.13°, σ_u = 5 px, on a pan head.",
        "The paper prints neither its floor plan nor coordinates. The room here is the bundled site "
        f"`{SITE}`: 15 m by 15 m, boxes, {n} landmarks on walls and boxes, a free diagonal. The places and "
        "triplets of Figs. 3 and 8 and the layout of Fig. 6 were chosen so that the ellipses have the "
        "printed size; that they can is all that their sizes show. Not chosen: that the fixes match the "
        "ellipse, the order of the topologies, the growth with distance, the gain along the path, the bend "
        "of the clouds. Areas are those of 95 % ellipses; areas are of one magnitude up to a factor of √10.",
    )


def _figures(r: Reproduction) -> list[str]:
    path = r.path
    off = 1 - len(np.flatnonzero([bool(c) for c in path.forward])) / len(path.s)
    blind = float(np.isnan(path.best_areas).mean())
    largest = float(np.nanmax(path.best_areas))
    arbitrary = float(path.means().mean())
    x, y = POOR_PLACE
    return [
        _figure(
            3,
            "A poor triplet",
            f"{len(r.poor.fixes)} simulated fixes from ({x:g} m, {y:g} m): columns with noise, each "
            "triangulated exactly. The ellipse is the first-order prediction, not a fit.",
        ),
        _figure(
            4,
            "The same place, the best triplet",
            f"The best triplet of the {len(r.room.landmarks)} landmarks has "
            f"{area(r.better.predicted):.2f} m² instead of {area(r.poor.predicted):.2f} m². No area is "
            "printed for this figure.",
        ),
        _figure(
            6,
            "Three topologies",
            "One triplet in an empty room of 15 m, three positions of its middle landmark, one scale of "
            "colours. No fix: the triplet does not fit the field of view, or the place is in line with it.",
            _validity(r),
        ),
        _figure(
            7,
            "Along a path",
            f"An arbitrary triplet is one that the camera forced forward sees, each with the same chance; "
            f"{N_DRIVES} drives, mean (5th to 95th percentile). A drive either draws anew every "
            f"{STEP_M:g} m or keeps its triplet until it leaves the view. The picture shows the drive with "
            "kept triplets whose mean is nearest to that of all.",
            f"Means and worst cases are over the {100 * float(path.compared.mean()):.0f} % of the path "
            f"where both have a fix. On {100 * off:.0f} % the camera forced forward sees no triplet, towards "
            f"the end of the diagonal; with free pan {100 * blind:.1f} % are without a fix, and the largest "
            f"area on the whole path is {largest:.1f} m². The best triplet within the "
            f"view ahead has a mean of {path.mean_best_forward:.1f} m²: the choice alone gains a factor of "
            f"{arbitrary / path.mean_best_forward:.1f} over drawing anew, the free pan another "
            f"{path.mean_best_forward / path.mean_best:.1f}.",
        ),
        _figure(
            8,
            "Where first order fails",
            "Fixes near the danger circle. They lie along a horopter, the circle on which the angle "
            "between two landmarks does not change, and not in the ellipse. " + _worst(r),
        ),
    ]


def _validity(r: Reproduction) -> str:
    """What the field's own measure says of first order, by topology."""
    fields = [t.field for t in r.topologies]
    shares = ", ".join(f"{100 * np.mean(~f.is_valid[f.has_fix]):.0f} %" for f in fields)
    row, col = fields[0].frame.cell_at(np.array(TOPOLOGY_PLACE))
    there = ", ".join(f"{100 * float(f.validity[row, col]):.0f} %" for f in fields)
    return (
        "Striped: cells where first order fails, because not 95 % of the fixes lie inside the ellipse: "
        f"{shares} of the cells with a fix, by topology. At the place of the printed areas the shares are "
        f"{there}, as the field predicts them."
    )


def _worst(r: Reproduction) -> str:
    parts = []
    for cloud, bend in zip(r.worst, r.bends, strict=True):
        names = " and ".join(r.room.landmarks.ids[i] for i in bend.pair)
        x, y = (float(v) for v in cloud.pose[:2])
        parts.append(
            f"From ({x:g} m, {y:g} m) the nearest is that of {names}; {cloud.failures} of "
            f"{len(cloud.fixes)} measurements gave no fix."
        )
    return " ".join(parts)


def _figure(number: int, title: str, *paragraphs: str) -> str:
    picture = f"![Fig. {number}: {title}]({PICTURE_FOLDER}/{PICTURES[number]})"
    return f"## Fig. {number}: {title}\n\n{picture}\n\n" + _paragraphs(*paragraphs)


def _paragraphs(*texts: str) -> str:
    return "\n\n".join(fill(t, 115, break_on_hyphens=False, break_long_words=False) for t in texts) + "\n"
