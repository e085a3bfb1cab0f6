"""The figures of MAS97 made again: every claim and printed number beside ours.

Madsen, Andersen, Sørensen, *A Robustness Analysis of Triangulation-Based Robot Self-Positioning*, SIRS 1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from localization.covariance import area95, ellipse95
from localization.madsen_1997_path import PathStudy, Spread, spread, study_path
from localization.madsen_1997_scenes import (
    COLUMN_SIGMAS_PX,
    TOPOLOGIES,
    TOPOLOGY_PLACE,
    Bend,
    Scaling,
    Topology,
    bend,
    better_triplet,
    poor_triplet,
    position_covariance,
    scaling,
    share_in_order,
    spans,
    topology,
    worst_triplets,
)
from localization.sensors import MAS97_CAMERA
from localization.simulation import FixCloud
from maps.arrays import FloatArray
from maps.world import World

SEED = 1997

#: What the paper prints (m, m²), to the digits that it prints.
PAPER_CLOUD_M = (2.0, 1.0)
PAPER_TOPOLOGIES_M2 = (0.2, 0.6, 3.5)
PAPER_MEANS_M2 = (2.0, 0.3)
PAPER_FACTOR = 6.0
PAPER_WORST_M2 = (8.0, 0.12)
PAPER_WORST_TRIPLETS_M2 = (24.0, 37.0)

#: Up to this factor two areas count as of one magnitude: half an order.
MAGNITUDE = math.sqrt(10.0)


@dataclass(frozen=True, slots=True)
class Row:
    """A claim of the paper beside what comes out here.

    Attributes
    ----------
    where
        Figure, section or footnote.
    claim
        In words.
    paper, ours
        Numbers with units.
    criterion
        What is asked of ours.
    holds
        Whether it is met.
    """

    where: str
    claim: str
    paper: str
    ours: str
    criterion: str
    holds: bool


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """The scenes of the paper, computed.

    Attributes
    ----------
    room
        World of Figs. 3, 4, 7 and 8.
    poor, better
        Figs. 3 and 4: fixes of two triplets at one place.
    topologies
        Fig. 6: middle landmark in front, behind, in line.
    path
        Fig. 7.
    worst, bends
        Fig. 8: clouds, and how they lie about a curve.
    scaling
        Footnote 5.
    """

    room: World
    poor: FixCloud
    better: FixCloud
    topologies: tuple[Topology, ...]
    path: PathStudy
    worst: tuple[FixCloud, ...]
    bends: tuple[Bend, ...]
    scaling: tuple[Scaling, ...]

    def rows(self) -> tuple[Row, ...]:
        """One row per claim, in the order of the paper's figures."""
        return (
            *_figures_3_4(self),
            *_figure_6(self),
            *_figure_7(self.path),
            _footnote_5(self.scaling),
            *_figure_8(self),
        )


def reproduce(room: World, *, rng: np.random.Generator) -> Reproduction:
    """Build the scenes of Figs. 3, 4, 6, 7 and 8 and of footnote 5 and compute what the paper reports.

    Parameters
    ----------
    room
        The bundled site ``mas97_room``: 15 m by 15 m, boxes, 24 landmarks, a free diagonal.
    rng
        Source of all noise and choices; ``default_rng(SEED)`` gives the numbers in the documentation.
    """
    a, b, c, d, e = rng.spawn(5)
    worst = worst_triplets(room, rng=c)
    return Reproduction(
        room=room,
        poor=poor_triplet(room, rng=a),
        better=better_triplet(room, rng=b),
        topologies=tuple(topology(name, offset) for name, offset in TOPOLOGIES),
        path=study_path(room, rng=d),
        worst=worst,
        bends=tuple(bend(cloud) for cloud in worst),
        scaling=scaling(room, rng=e),
    )


def full_axes(covariance: FloatArray) -> tuple[float, float]:
    """Length and width of the 95 % ellipse of a pose covariance (3, 3), m."""
    a, b, _ = (float(v) for v in ellipse95(position_covariance(covariance)))
    return 2 * a, 2 * b


def area(covariance: FloatArray) -> float:
    """Area of the 95 % ellipse of a pose covariance (3, 3), m²."""
    return float(area95(position_covariance(covariance)))


def _figures_3_4(r: Reproduction) -> list[Row]:
    size, seen = full_axes(r.poor.predicted), full_axes(r.poor.sample_covariance)
    poor, better = area(r.poor.predicted), area(r.better.predicted)
    matches = abs(r.poor.share_inside - 0.95) <= 0.02 and _within(seen, size, 1.1)
    return [
        Row(
            "Fig. 3, §2",
            "fixes of a poor triplet in a room of 15 m cover about this much",
            _by(PAPER_CLOUD_M, 0),
            f"{_by(size, 2)} (95 % ellipse)",
            "within 20 %",
            _within(size, PAPER_CLOUD_M, 1.2),
        ),
        Row(
            "Fig. 3, §2",
            "the predicted 95 % ellipse matches 1000 simulated fixes",
            "95 % (no printed share)",
            f"{100 * r.poor.share_inside:.1f} % of {len(r.poor.fixes)} inside; "
            f"their own ellipse {_by(seen, 2)}",
            "95 ± 2 % inside, axes within 10 %",
            matches,
        ),
        Row(
            "Fig. 4",
            "another triplet at the same place has a smaller ellipse",
            "no printed number",
            f"{poor:.2f} → {better:.2f} m², factor {poor / better:.1f}; "
            f"{100 * r.better.share_inside:.1f} % of {len(r.better.fixes)} fixes inside",
            "smaller, 95 ± 2 % inside",
            better < poor and abs(r.better.share_inside - 0.95) <= 0.02,
        ),
    ]


def _figure_6(r: Reproduction) -> list[Row]:
    areas = tuple(t.area for t in r.topologies)
    cells, ordered = share_in_order(r.topologies)
    rising = all((np.diff(t.areas) > 0).all() for t in r.topologies)
    wrong = blind = free = 0
    for t in r.topologies:
        fits = spans(t.field) <= MAS97_CAMERA.field_of_view
        wrong += int(np.count_nonzero(t.field.has_fix & ~fits))
        blind += int(np.count_nonzero(t.field.free & ~fits))
        free += int(np.count_nonzero(t.field.free))
    near, far = (float(f(t.distances[k] for t in r.topologies)) for f, k in ((max, 0), (min, -1)))
    growth = ", ".join(_growth(t, near, far) for t in r.topologies)
    x, y = TOPOLOGY_PLACE
    return [
        Row(
            "Fig. 6, §4.3",
            "middle landmark in front < behind < collinear",
            " < ".join(f"{a:g}" for a in PAPER_TOPOLOGIES_M2) + " m²",
            " < ".join(f"{a:.2f}" for a in areas)
            + f" m²; so in {100 * ordered:.0f} % of {cells} cells in front",
            "order at every cell",
            ordered == 1.0 and areas[0] < areas[1] < areas[2],
        ),
        Row(
            "Fig. 6, §4.3",
            f"areas at ({x:g} m, {y:g} m)",
            ", ".join(f"{a:g}" for a in PAPER_TOPOLOGIES_M2) + " m²",
            ", ".join(f"{a:.2f}" for a in areas) + " m²",
            "within 10 %",
            _within(areas, PAPER_TOPOLOGIES_M2, 1.1),
        ),
        Row(
            "§4.3",
            "area grows with distance to the triplet",
            "no printed number",
            f"from {near:g} to {far:g} m: {growth} m²",
            "at every step of 0.25 m",
            rising,
        ),
        Row(
            "§4.3",
            "no fix where the triplet does not fit the field of view",
            "no printed number",
            f"{wrong} fixes in the {blind} cells where it does not fit, of {free} in three rooms",
            "none",
            wrong == 0 and blind > 0,
        ),
    ]


def _figure_7(path: PathStudy) -> list[Row]:
    rows = []
    for kept, how in ((True, "kept while it is in view"), (False, "drawn anew every 0.1 m")):
        means, factor = spread(path.means(kept=kept)), path.reduction(kept=kept)
        worst, there = path.worst(kept=kept)
        high, low, ratio = spread(worst), spread(there), spread(worst / there)
        rows.append(
            Row(
                "Fig. 7, §5.1",
                f"mean area along a path, arbitrary triplet in a camera forced forward ({how}) → "
                "best triplet with free pan",
                f"{PAPER_MEANS_M2[0]:g} → {PAPER_MEANS_M2[1]:g} m², factor {PAPER_FACTOR:g}",
                f"{_spread(means, 1)} → {path.mean_best:.2f} m², factor {_spread(factor, 0)}",
                "factor ≥ 6 in 95 % of drives, areas of one magnitude",
                factor.low >= PAPER_FACTOR
                and _within((means.mean, path.mean_best), PAPER_MEANS_M2, MAGNITUDE),
            )
        )
        rows.append(
            Row(
                "Fig. 7, §5.1",
                f"worst place of the arbitrary triplet ({how}) → best triplet there",
                f"{PAPER_WORST_M2[0]:g} → {PAPER_WORST_M2[1]:g} m², factor "
                f"{PAPER_WORST_M2[0] / PAPER_WORST_M2[1]:.0f}",
                f"{_spread(high, 1)} → {_spread(low, 2)} m², factor {_spread(ratio, 0)}",
                "factor > 10 in 95 % of drives, areas of one magnitude",
                ratio.low > 10 and _within((high.mean, low.mean), PAPER_WORST_M2, MAGNITUDE),
            )
        )
    return rows


def _footnote_5(levels: tuple[Scaling, ...]) -> Row:
    return Row(
        "footnote 5",
        "area scales with σ_u²",
        "4 times for twice the noise",
        _ratios([s.predicted for s in levels])
        + " times predicted, "
        + _ratios([s.sample for s in levels])
        + f" of simulated fixes, for σ_u = {', '.join(f'{s:g}' for s in COLUMN_SIGMAS_PX)} px",
        "exact to first order, simulated within 5 %",
        _scales(levels),
    )


def _figure_8(r: Reproduction) -> list[Row]:
    areas = tuple(area(c.predicted) for c in r.worst)
    shares = " and ".join(f"{100 * c.share_inside:.0f} %" for c in r.worst)
    off = " and ".join(f"{b.rms_horopter:.2f}" for b in r.bends)
    axis = " and ".join(f"{b.rms_axis:.2f}" for b in r.bends)
    curved = all(3 * b.rms_horopter < b.rms_axis for b in r.bends)
    return [
        Row(
            "Fig. 8, §5.2",
            "areas of worst triplets",
            " and ".join(f"{a:g}" for a in PAPER_WORST_TRIPLETS_M2) + " m²",
            " and ".join(f"{a:.1f}" for a in areas) + " m²",
            "within 10 %",
            _within(areas, PAPER_WORST_TRIPLETS_M2, 1.1),
        ),
        Row(
            "Fig. 8, §5.2",
            "the cloud lies on a curve, not in the ellipse",
            "no printed number",
            f"{shares} of the fixes inside; {off} m (rms) off a horopter, {axis} m off the ellipse's axis",
            "below 80 % inside, horopter 3 times nearer",
            curved and all(c.share_inside < 0.8 for c in r.worst),
        ),
    ]


def _within(ours: tuple[float, ...], paper: tuple[float, ...], factor: float) -> bool:
    """Whether each of ours is the paper's up to a factor."""
    return all(p / factor <= o <= p * factor for o, p in zip(ours, paper, strict=True))


def _by(size: tuple[float, float], digits: int) -> str:
    return f"{size[0]:.{digits}f} m × {size[1]:.{digits}f} m"


def _spread(s: Spread, digits: int) -> str:
    return f"{s.mean:.{digits}f} ({s.low:.{digits}f} to {s.high:.{digits}f})"


def _growth(t: Topology, near: float, far: float) -> str:
    """Areas at two distances."""
    first, last = (float(t.areas[np.flatnonzero(t.distances == d)[0]]) for d in (near, far))
    return f"{first:.2g} → {last:.2g}"


def _ratios(values: list[float]) -> str:
    return " and ".join(f"{b / a:.2f}" for a, b in pairwise(values))


def _scales(levels: tuple[Scaling, ...]) -> bool:
    """Whether areas go with the square of the noise: predicted to rounding, simulated within 5 %."""
    base = levels[0]
    for level in levels[1:]:
        want = (level.sigma_px / base.sigma_px) ** 2
        exact = math.isclose(level.predicted / base.predicted, want, rel_tol=1e-9)
        if not exact or not math.isclose(level.sample / base.sample, want, rel_tol=0.05):
            return False
    return True
