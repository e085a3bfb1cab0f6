"""The uncertainty field over (x, y, heading), for sensors that see otherwise when the robot turns."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from localization.errors import LocalizationError
from localization.method import BEST_AREA, FieldMethod
from localization.sensors import Sensor
from localization.uncertainty_field import UncertaintyField, field_hash
from maps.arrays import BoolArray, FloatArray, IntArray, digest
from maps.grid import GridFrame
from maps.se2 import wrap
from maps.world import World

MAX_HEADINGS = 720
Reduction = Literal["best", "worst"]


def heading_bins(count: int) -> FloatArray:
    """Headings (count,) of the bins, rad in [-π, π): 0, a turn / count, … counter-clockwise.

    Raises
    ------
    LocalizationError
        If the count is not from 1 to 720.
    """
    if not 1 <= count <= MAX_HEADINGS:
        raise LocalizationError(f"Number of headings is {count}; it must be from 1 to {MAX_HEADINGS}.")
    return wrap(2 * math.pi / count * np.arange(count))


@dataclass(frozen=True, slots=True, eq=False)
class HeadingField:
    """Uncertainty fields of one world and sensor at evenly spaced headings of the robot.

    Attributes
    ----------
    slices
        One field per heading, in the order of :func:`heading_bins`, on the same cells.

    Raises
    ------
    LocalizationError
        If the fields do not belong together.
    """

    slices: tuple[UncertaintyField, ...]

    def __post_init__(self) -> None:
        first = self.slices[0] if self.slices else None
        if first is None or not np.allclose([f.heading for f in self.slices], heading_bins(len(self.slices))):
            raise LocalizationError("A field over headings needs one field for each of the bins, in order.")
        for other in self.slices[1:]:
            if (other.frame, other.sensor, other.method) != (first.frame, first.sensor, first.method):
                raise LocalizationError("The fields of a field over headings differ in frame or sensor.")

    def __len__(self) -> int:
        return len(self.slices)

    def __reduce__(self) -> tuple[type[HeadingField], tuple[tuple[UncertaintyField, ...]]]:
        return (HeadingField, (self.slices,))

    @property
    def world(self) -> World:
        """What the fields were computed from."""
        return self.slices[0].world

    @property
    def sensor(self) -> Sensor:
        """What measures."""
        return self.slices[0].sensor

    @property
    def frame(self) -> GridFrame:
        """Cells."""
        return self.slices[0].frame

    @property
    def method(self) -> FieldMethod:
        """Estimator and criterion."""
        return self.slices[0].method

    @property
    def free(self) -> BoolArray:
        """Shape (ny, nx): cells whose centre lies in free space."""
        return self.slices[0].free

    @property
    def headings(self) -> FloatArray:
        """Shape (H,), rad in [-π, π)."""
        return heading_bins(len(self.slices))

    def at(self, heading: float) -> UncertaintyField:
        """The field of the bin nearest to a heading, rad.

        Raises
        ------
        LocalizationError
            If the heading is not finite.
        """
        if not math.isfinite(heading):
            raise LocalizationError(f"Heading is {heading}; it must be finite, rad.")
        n = len(self.slices)
        return self.slices[round(heading / (2 * math.pi) * n) % n]

    def trusted(self) -> HeadingField:
        """Every slice as planning may count on it, see :meth:`UncertaintyField.trusted`."""
        return HeadingField(tuple(one.trusted() for one in self.slices))

    def reduced(self, which: Reduction) -> UncertaintyField:
        """One field with the best or the worst heading of every cell, by the ellipse's area.

        A heading without a fix is worse than any with one: ``worst`` has a fix only where every heading has.
        Of equal headings the first counts. Pan angles belong to a heading and are left out.

        Raises
        ------
        LocalizationError
            If ``which`` is neither.
        """
        if which not in {"best", "worst"}:
            raise LocalizationError(f"Reduction is '{which}'; use 'best' or 'worst'.")
        first = self.slices[0]
        chosen = np.zeros(first.frame.shape, dtype=np.int64)
        area = _size(first)
        for k, field in enumerate(self.slices[1:], start=1):
            other = _size(field)
            better = other < area if which == "best" else other > area
            chosen[better] = k
            area[better] = other[better]
        layers = {name: getattr(first, name).copy() for name in ("covariance", "sigma_theta", "triplet")}
        layers |= {name: getattr(first, name).copy() for name in ("n_visible", "validity")}
        for k, field in enumerate(self.slices[1:], start=1):
            at = chosen == k
            for name, array in layers.items():
                array[at] = getattr(field, name)[at]
        pan = np.full(first.frame.shape, np.nan)
        return replace(first, heading=0.0, pan=pan, reduction=f"{which} of {len(self.slices)}", **layers)

    def best_heading(self) -> IntArray:
        """Shape (ny, nx): index of the heading with the smallest ellipse; -1 where none has a fix."""
        areas = np.stack([_size(f) for f in self.slices])
        best = np.argmin(areas, axis=0)
        return np.where(np.isfinite(areas.min(axis=0)), best, -1)

    def mean(self, metric: str) -> FloatArray:
        """Mean of a metric over the headings with a fix, shape (ny, nx); NaN where none has.

        Raises
        ------
        LocalizationError
            If the metric is unknown.
        """
        total, count = np.zeros(self.frame.shape), np.zeros(self.frame.shape)
        for field in self.slices:
            values = field.metric(metric)
            known = np.isfinite(values)
            total[known] += values[known]
            count += known
        mean: FloatArray = np.divide(total, count, out=np.full(self.frame.shape, np.nan), where=count > 0)
        return mean

    def share_with_fix(self) -> FloatArray:
        """Shape (ny, nx): share of the headings that have a fix."""
        return np.asarray(np.mean([f.has_fix for f in self.slices], axis=0))

    def content_hash(self) -> str:
        """SHA-256 (hex) of everything the numbers depend on."""
        return heading_field_hash(self.world, self.sensor, self.frame, len(self.slices), method=self.method)


def _size(field: UncertaintyField) -> FloatArray:
    return np.where(field.has_fix, field.area95, np.inf)


def heading_field_hash(
    world: World, sensor: Sensor, frame: GridFrame, count: int, *, method: FieldMethod = BEST_AREA
) -> str:
    """Content hash of the field over ``count`` headings that these inputs give, before it is computed."""
    return digest("headings", field_hash(world, sensor, frame, 0.0, method=method, n_headings=count))
