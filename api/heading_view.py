"""One field to look at out of a field over headings."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from localization.errors import LocalizationError
from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField
from maps.arrays import FloatArray, IntArray

_CHOICES = "best, worst, mean or an angle in degrees"


@dataclass(frozen=True, slots=True, eq=False)
class MeanMetric(UncertaintyField):
    """A field of which one metric is a mean over headings.

    Attributes
    ----------
    mean_of
        Name of the metric.
    means
        Shape (ny, nx): its values; None: the field's own.
    """

    mean_of: str = ""
    means: FloatArray | None = None

    def metric(self, name: str, at: tuple[IntArray, IntArray] | None = None) -> FloatArray:
        """As of a field; the mean for the metric that is one."""
        if self.means is None or name != self.mean_of:
            return UncertaintyField.metric(self, name, at)
        return self.means if at is None else np.asarray(self.means[at])


def view_of(field: UncertaintyField | HeadingField, heading: str | None, metric: str) -> UncertaintyField:
    """What a heatmap of a metric shows.

    Parameters
    ----------
    field
        At one heading, or over headings.
    heading
        ``best`` (the default, None), ``worst``, ``mean``, or an angle in degrees: the nearest of the field's.
    metric
        Name of the metric; matters to ``mean``.

    Raises
    ------
    LocalizationError
        If the heading is none of that, the field has but one, or the metric is unknown.
    """
    if not isinstance(field, HeadingField):
        if heading is not None:
            raise LocalizationError(
                "The field holds for one heading; make one over headings with 'surepath field --headings N'."
            )
        return field
    which = "best" if heading is None else heading
    if which == "mean":
        return _mean(field, metric)
    if which in {"best", "worst"}:
        return field.reduced("best" if which == "best" else "worst")
    return field.at(_degrees(which))


def _degrees(text: str) -> float:
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not math.isfinite(degrees):
        raise LocalizationError(f"Heading is '{text}'; use {_CHOICES}.")
    return math.radians(degrees)


def _mean(field: HeadingField, metric: str) -> UncertaintyField:
    means = field.mean(metric)
    # Stripes are drawn where the mean share is not that of a valid fix.
    one = replace(field.reduced("best"), validity=field.mean("validity").astype(np.float32))
    values: dict[str, Any] = {f.name: getattr(one, f.name) for f in fields(one)}
    return MeanMetric(**values, mean_of=metric, means=means)
