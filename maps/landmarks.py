"""Landmarks: what the sensor measures bearings to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import KDTree

from maps.arrays import BoolArray, FloatArray, digest, frozen
from maps.errors import DuplicateLandmark, InvalidLandmark
from maps.se2 import wrap

MAX_LANDMARKS = 10_000
COINCIDENT_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkSet:
    """Landmarks with known positions.

    Attributes
    ----------
    ids
        N names, unique.
    positions
        Shape (N, 2): ``p_WL``, m.
    facing
        Shape (N,): azimuth of the landmark's outward normal in W, rad, wrapped to [-π, π); NaN where it
        can be seen from all sides.
    half_angle
        Shape (N,): largest angle between the normal and the line to the sensor, rad in (0, π]; π where
        there is no normal, whatever is given. Default with a normal: π/2.
    sigma
        Shape (N,): standard deviation of the survey, m, isotropic; default 0.

    Raises
    ------
    InvalidLandmark
        If a number is impossible, an id empty, or there are more than 10,000.
    DuplicateLandmark
        If two landmarks share an id or stand within a micrometre of each other.
    """

    ids: tuple[str, ...]
    positions: FloatArray
    facing: FloatArray = field(default=None)  # type: ignore[arg-type]
    half_angle: FloatArray = field(default=None)  # type: ignore[arg-type]
    sigma: FloatArray = field(default=None)  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        ids = tuple(str(i) for i in self.ids)
        n = len(ids)
        positions = frozen(np.asarray(self.positions, dtype=np.float64))
        if n == 0 and positions.size == 0:
            positions = frozen(np.empty((0, 2)))
        if positions.ndim != 2 or positions.shape[1] != 2:
            raise InvalidLandmark(f"Landmark positions have shape {positions.shape}; give (N, 2).")
        facing = np.full(n, np.nan) if self.facing is None else np.asarray(self.facing, dtype=np.float64)
        if self.half_angle is None:
            half = np.full(n, np.nan)
        else:
            half = np.asarray(self.half_angle, dtype=np.float64)
        sigma = np.zeros(n) if self.sigma is None else np.asarray(self.sigma, dtype=np.float64)
        if n > MAX_LANDMARKS:
            raise InvalidLandmark(f"{n} landmarks, the limit is {MAX_LANDMARKS}.")
        for name, array in (
            ("positions", positions),
            ("facing", facing),
            ("half_angle", half),
            ("sigma", sigma),
        ):
            if len(array) != n:
                raise InvalidLandmark(f"{n} landmark ids but {len(array)} {name}.")
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "facing", frozen(facing))
        object.__setattr__(self, "half_angle", frozen(np.where(np.isnan(half), math.pi / 2, half)))
        object.__setattr__(self, "sigma", frozen(sigma))
        self._check_values()
        object.__setattr__(self, "facing", frozen(wrap(facing)))
        object.__setattr__(self, "half_angle", frozen(np.where(self.has_facing, self.half_angle, math.pi)))
        self._check_unique()

    def _check_values(self) -> None:
        for i, name in enumerate(self.ids):
            if not name or len(name) > 200 or not name.isprintable():
                raise InvalidLandmark(
                    f"Landmark number {i} has the id {name[:40]!r}; use 1 to 200 printable characters."
                )
            x, y = self.positions[i]
            if not (math.isfinite(x) and math.isfinite(y)):
                raise InvalidLandmark(f"Landmark '{name}' stands at ({x}, {y}) m; both must be finite.")
            if math.isinf(self.facing[i]):
                raise InvalidLandmark(
                    f"Landmark '{name}' has facing {self.facing[i]} rad; it must be finite."
                )
            half = self.half_angle[i]
            if not 0 < half <= math.pi:
                raise InvalidLandmark(f"Landmark '{name}' has half angle {half} rad; it must be in (0, π].")
            sigma = self.sigma[i]
            if not (math.isfinite(sigma) and sigma >= 0):
                raise InvalidLandmark(
                    f"Landmark '{name}' has survey sigma {sigma} m; it must be ≥ 0 and finite."
                )

    def _check_unique(self) -> None:
        seen: dict[str, int] = {}
        for i, name in enumerate(self.ids):
            if name in seen:
                raise DuplicateLandmark(f"Landmark id '{name}' is used twice (numbers {seen[name]} and {i}).")
            seen[name] = i
        pair = _coincident(np.asarray(self.positions))
        if pair is not None:
            i, j = pair
            raise DuplicateLandmark(
                f"Landmarks '{self.ids[i]}' and '{self.ids[j]}' both stand at "
                f"({self.positions[i, 0]:g}, {self.positions[i, 1]:g}) m; remove one."
            )

    def __len__(self) -> int:
        return len(self.ids)

    def __reduce__(self) -> tuple[type[LandmarkSet], tuple[object, ...]]:
        return (LandmarkSet, (self.ids, self.positions, self.facing, self.half_angle, self.sigma))

    @property
    def has_facing(self) -> BoolArray:
        """Shape (N,): whether the landmark has an outward normal."""
        return np.asarray(~np.isnan(self.facing))

    @classmethod
    def empty(cls) -> LandmarkSet:
        """No landmarks."""
        return cls((), np.empty((0, 2)))

    def subset(self, indices: Sequence[int]) -> LandmarkSet:
        """The landmarks with these indices, in this order."""
        i = np.asarray(indices, dtype=np.int64)
        names = tuple(self.ids[k] for k in i)
        return LandmarkSet(names, self.positions[i], self.facing[i], self.half_angle[i], self.sigma[i])

    def content_hash(self) -> str:
        """SHA-256 (hex) of all landmarks in their order."""
        return digest(
            "landmarks",
            *self.ids,
            self.positions,
            np.nan_to_num(self.facing, nan=99.0),
            self.half_angle,
            self.sigma,
        )


def _coincident(positions: FloatArray) -> tuple[int, int] | None:
    """Two landmarks at one place, if there are any; the first such pair."""
    n = len(positions)
    if n < 2:
        return None
    # Exact copies apart: a tree of equal points degenerates.
    _, first, inverse = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    copies = np.nonzero(first[inverse.reshape(-1)] != np.arange(n))[0]
    if len(copies):
        return int(first[inverse.reshape(-1)[copies[0]]]), int(copies[0])
    distance, neighbour = KDTree(positions).query(positions, k=2, p=math.inf)
    close = np.nonzero(distance[:, 1] <= COINCIDENT_M)[0]
    if len(close) == 0:
        return None
    i = int(close[0])
    j = int(neighbour[i, 1] if neighbour[i, 0] == i else neighbour[i, 0])
    return min(i, j), max(i, j)
