"""The scenes of MAS97: where robot and landmarks stand in each figure, and what is simulated there.

The paper prints neither its floor plan nor coordinates. Room and path are those of the bundled site
``mas97_room``; places and triplets of Figs. 3, 6 and 8 were chosen for ellipses of the printed size.
What then follows (match, order, growth, bend) is not chosen.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import shapely

from localization.covariance import area95, ellipse95
from localization.field_builder import build_field
from localization.sensors import MAS97_CAMERA
from localization.simulation import FixCloud, simulate_fixes
from localization.triplets import best_triplet
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray, frozen
from maps.floor_plan import FloorPlan
from maps.landmarks import LandmarkSet
from maps.world import World

#: Room of Figs. 3, 4, 7 and 8: a bundled site.
SITE = "mas97_room"
ROOM_SIDE_M = 15.0

#: Figs. 3 and 4: place and poor triplet.
POOR_PLACE = (9.0, 4.0)
POOR_TRIPLET = ("L13", "L21", "L22")
N_FIXES = 1000  # as in the paper

#: Fig. 6: outer landmarks, offsets of the middle one from their line, and the place of the printed areas.
OUTER_LANDMARKS = ((1.5, 7.65), (3.5, 7.65))
TOPOLOGIES = (("topology 1: middle in front", -1.9), ("topology 2: middle behind", 1.9), ("collinear", 0.0))
TOPOLOGY_PLACE = (2.5, 3.0)
TOPOLOGY_RESOLUTION_M = 0.1
#: Growth with distance is looked at from here on, in front of every landmark.
CLEAR_OF_LANDMARKS_M = 3.0

#: Fig. 8: places and triplets of areas near the paper's.
WORST = (((7.5, 10.5), ("L01", "L02", "L18")), ((4.5, 6.5), ("L09", "L10", "L24")))
N_WORST_FIXES = 3000

#: Footnote 5: standard deviations of a column, px; the middle one is the paper's.
COLUMN_SIGMAS_PX = (2.5, 5.0, 10.0)
N_SCALING_FIXES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class Topology:
    """One panel of Fig. 6: three landmarks in an empty room.

    Attributes
    ----------
    name
        Of the arrangement.
    field
        Uncertainty field of the empty room of 15 m with these landmarks.
    area
        Area of the 95 % ellipse at :data:`TOPOLOGY_PLACE`, m².
    distances, areas
        Shape (K,): distance from the line of the outer landmarks, straight in front of them (m), and the
        area there (m²).
    """

    name: str
    field: UncertaintyField
    area: float
    distances: FloatArray
    areas: FloatArray

    def __post_init__(self) -> None:
        for name in ("distances", "areas"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class Bend:
    """How a cloud of fixes lies about a curve and about the axis of its predicted ellipse.

    Attributes
    ----------
    pair
        Indices into ``world.landmarks``: their horopter, of the three, is the nearest to the cloud.
    rms_horopter, rms_axis
        Root mean square distance of the fixes from that circle and from the ellipse's major axis, m.
    """

    pair: tuple[int, int]
    rms_horopter: float
    rms_axis: float


@dataclass(frozen=True, slots=True)
class Scaling:
    """Area against the noise of a column (footnote 5).

    Attributes
    ----------
    sigma_px
        Standard deviation of a column, px.
    predicted, sample
        Area of the 95 % ellipse, m²: to first order, and of the covariance of simulated fixes.
    """

    sigma_px: float
    predicted: float
    sample: float


def position_covariance(covariance: FloatArray) -> FloatArray:
    """xx, xy, yy of a covariance (3, 3) of x, y and heading; m²."""
    return np.asarray(covariance[[0, 0, 1], [0, 1, 1]])


def indices_of(world: World, ids: tuple[str, str, str]) -> tuple[int, int, int]:
    """Indices of three landmarks by name."""
    i, j, k = (world.landmarks.ids.index(name) for name in ids)
    return i, j, k


def poor_triplet(room: World, *, n: int = N_FIXES, rng: np.random.Generator) -> FixCloud:
    """Fig. 3: simulated fixes of a poor triplet."""
    triplet = indices_of(room, POOR_TRIPLET)
    return simulate_fixes(room, MAS97_CAMERA, POOR_PLACE, triplet=triplet, n=n, rng=rng)


def better_triplet(room: World, *, n: int = N_FIXES, rng: np.random.Generator) -> FixCloud:
    """Fig. 4: simulated fixes of the best triplet at the same place."""
    return simulate_fixes(room, MAS97_CAMERA, POOR_PLACE, n=n, rng=rng)


def worst_triplets(room: World, *, rng: np.random.Generator) -> tuple[FixCloud, ...]:
    """Fig. 8: simulated fixes of triplets near whose danger circle the robot stands."""
    return tuple(
        simulate_fixes(room, MAS97_CAMERA, place, triplet=indices_of(room, names), n=N_WORST_FIXES, rng=rng)
        for place, names in WORST
    )


def topology(name: str, offset: float) -> Topology:
    """One panel of Fig. 6.

    Parameters
    ----------
    name
        Of the arrangement.
    offset
        Of the middle landmark from the line of the outer ones, away from the robot, m.
    """
    (x0, y), (x1, _) = OUTER_LANDMARKS
    middle = 0.5 * (x0 + x1)
    landmarks = LandmarkSet(("A", "B", "C"), np.array([[x0, y], [middle, y + offset], [x1, y]]))
    floor = FloorPlan((shapely.box(0.0, 0.0, ROOM_SIDE_M, ROOM_SIDE_M),))
    world = World(name, floor, landmarks)
    distances, areas = [], []
    for distance in np.arange(CLEAR_OF_LANDMARKS_M, y, 0.25):
        choice = best_triplet(world, MAS97_CAMERA, (middle, y - distance))
        if choice is not None:
            distances.append(distance)
            areas.append(choice.area95)
    there = best_triplet(world, MAS97_CAMERA, TOPOLOGY_PLACE)
    return Topology(
        name,
        build_field(world, MAS97_CAMERA, resolution=TOPOLOGY_RESOLUTION_M),
        math.nan if there is None else there.area95,
        np.array(distances),
        np.array(areas),
    )


def spans(field: UncertaintyField) -> FloatArray:
    """Smallest angle that holds all landmarks, from every cell; shape (ny, nx), rad."""
    d = (
        field.world.landmarks.positions
        - field.frame.centres(*(slice(0, n) for n in field.frame.shape))[..., None, :]
    )
    azimuth = np.sort(np.arctan2(d[..., 1], d[..., 0]), axis=-1)
    around = azimuth[..., :1] + 2 * math.pi
    return np.asarray(2 * math.pi - np.diff(np.concatenate([azimuth, around], axis=-1)).max(axis=-1))


def share_in_order(topologies: tuple[Topology, ...]) -> tuple[int, float]:
    """Cells in front of all landmarks where every topology gives a fix, and the share with rising areas."""
    nearest = min(float(t.field.world.landmarks.positions[:, 1].min()) for t in topologies)
    frame = topologies[0].field.frame
    in_front = frame.centres(slice(0, frame.shape[0]), slice(0, frame.shape[1]))[..., 1] < nearest
    areas = np.stack([t.field.area95 for t in topologies])[:, in_front]
    areas = areas[:, np.isfinite(areas).all(axis=0)]
    return areas.shape[1], float((np.diff(areas, axis=0) > 0).all(axis=0).mean())


def bend(cloud: FixCloud) -> Bend:
    """Distances of a cloud from the nearest horopter and from the axis of its ellipse."""
    e = cloud.errors[:, :2]
    azimuth = float(ellipse95(position_covariance(cloud.predicted))[2])
    across = math.cos(azimuth) * e[:, 1] - math.sin(azimuth) * e[:, 0]
    near = []
    for a, b in itertools.combinations(range(3), 2):
        centre = _centre(cloud.landmarks[a] - cloud.pose[:2], cloud.landmarks[b] - cloud.pose[:2])
        off = np.hypot(*(e - centre).T) - np.hypot(*centre)
        near.append((_rms(off), (cloud.triplet[a], cloud.triplet[b])))
    rms, pair = min(near)
    return Bend(pair, rms, _rms(across))


def _centre(u: FloatArray, v: FloatArray) -> FloatArray:
    """Centre of the circle through the origin, u and v."""
    return np.asarray(np.linalg.solve(2 * np.stack([u, v]), [u @ u, v @ v]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def scaling(room: World, *, rng: np.random.Generator) -> tuple[Scaling, ...]:
    """Footnote 5: the poor triplet under several levels of noise."""
    out = []
    for sigma in COLUMN_SIGMAS_PX:
        sensor = replace(MAS97_CAMERA, column_sigma_px=sigma)
        triplet = indices_of(room, POOR_TRIPLET)
        cloud = simulate_fixes(room, sensor, POOR_PLACE, triplet=triplet, n=N_SCALING_FIXES, rng=rng)
        areas = (area95(position_covariance(c)) for c in (cloud.predicted, cloud.sample_covariance))
        predicted, sample = (float(a) for a in areas)
        out.append(Scaling(sigma, predicted, sample))
    return tuple(out)
