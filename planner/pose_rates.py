"""What a robot with a heading pays per metre in each cell at each heading, under bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from localization import covariance as cov
from localization.heading_field import HeadingField
from maps.arrays import FloatArray, frozen
from planner.clock import Stopped
from planner.context import PlanningContext
from planner.cost_space import CostSpace
from planner.extras import cells_near, judged_covariance
from planner.footprint import Footprint
from planner.grid_search import Bounds
from planner.problem import PlanningProblem, blind_rate_of
from planner.risk import Stop, cell_probabilities

#: Headings of the lattice of poses.
N_HEADINGS = 16
#: Cost per metre without a fix where that is forbidden and cannot be avoided.
BLIND_RATE = 1e4


@dataclass(frozen=True, slots=True)
class Limits:
    """What a search over poses keeps.

    Attributes
    ----------
    bounds
        In every cell, at the heading driven.
    is_blind_forced
        Whether cells without a fix may be crossed at a high price although the question closes them.
    """

    bounds: Bounds
    is_blind_forced: bool = False

    def blind_rate(self, problem: PlanningProblem) -> float | None:
        """Cost per metre in cells without a fix; None where they are closed."""
        limits = self.bounds.max_r95_m, self.bounds.max_ellipse95_m
        rate = blind_rate_of(problem.effective_weight, problem.blind_r95, *limits)
        return BLIND_RATE if rate is None and self.is_blind_forced else rate


class PoseRates:
    """Rates of one question.

    Parameters
    ----------
    problem, context
        The question and the field.
    headings
        Trusted field over headings, where the sensor depends on them.
    footprint
        The robot's outline; None for a disc.
    radius
        Of the disc that the cells are checked for, m.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        context: PlanningContext,
        headings: HeadingField | None,
        footprint: Footprint | None,
        radius: float,
    ) -> None:
        self.problem, self.context, self.headings = problem, context, headings
        self.footprint, self.radius = footprint, radius
        self._values: dict[str, FloatArray] = {}

    def under(
        self, limits: Limits, *, margin: float, is_careful: bool, stop: Stop
    ) -> tuple[CostSpace, FloatArray] | None:
        """Cost space of the best heading of each cell, and rates (H, ny, nx) at H even headings from 0.

        Parameters
        ----------
        limits
            What is kept.
        margin
            Room beyond the outline, m.
        is_careful
            On a field over headings: the worse one of all headings around.
        stop
            Shape (1,); another thread sets it to end early.

        Returns
        -------
        space, rates
            inf: forbidden. One heading where none matters. None when it was stopped.
        """
        try:
            if self.headings is None:
                space, rates = self._plain(limits, stop)
            else:
                space, rates = self._over_headings(limits, stop, is_careful=is_careful)
        except Stopped:
            return None
        if self.footprint is None:
            return space, rates
        count = max(len(rates), N_HEADINGS)
        fits = self.context.fits(self.footprint, margin, count, stop=stop)
        if fits is None:
            return None
        # An outline stays out of areas whatever its heading.
        reach = self.footprint.circumscribed_radius
        for polygon in self.problem.avoid:
            fits = fits & ~cells_near(space.frame, polygon, reach)
        return space, np.where(fits, rates if len(rates) == count else rates[:1], np.inf)

    def _between(self, name: str, stop: Stop, *, is_careful: bool) -> FloatArray:
        """Shape (H, ny, nx): what a bound is compared with; NaN where it says nothing. Two per bin."""
        if name not in self._values:
            self._values[name] = self._of_slices(name, stop)
        return between_bins(self._values[name], is_careful=is_careful)

    def _plain(self, limits: Limits, stop: Stop) -> tuple[CostSpace, FloatArray]:
        p, bounds = self.problem, limits.bounds
        extras = replace(
            p.extras, max_ellipse95=bounds.max_ellipse95_m, max_probability=bounds.max_collision_probability
        )
        if extras.max_probability is not None:
            # The one step that may take long, done in time or not at all; the graph then finds it at hand.
            self.context.risky(
                extras.max_probability, radius=self.radius, blind_r95=extras.blind_r95, stop=stop
            )
        space = self.context.graph(
            radius=self.radius,
            weight=p.effective_weight,
            max_r95=bounds.max_r95_m,
            blind_rate=limits.blind_rate(p),
            extras=extras,
        ).cost_space
        return space, space.rate[None]

    def _over_headings(self, limits: Limits, stop: Stop, *, is_careful: bool) -> tuple[CostSpace, FloatArray]:
        weight = self.problem.effective_weight
        loose = self.problem.extras.without_bounds()
        free = self.context.graph(radius=self.radius, weight=0.0, blind_rate=1.0, extras=loose).cost_space
        rates = 1.0 + weight * self._between("max_r95_m", stop, is_careful=is_careful)
        blind = limits.blind_rate(self.problem)
        rates[np.isnan(rates)] = np.inf if blind is None else blind
        for name in limits.bounds.given():
            with np.errstate(invalid="ignore"):
                values = self._between(name, stop, is_careful=is_careful)
                rates[values > getattr(limits.bounds, name)] = np.inf
        open_ = np.isfinite(free.rate)
        rates[:, ~open_] = np.inf
        rates *= np.where(open_, free.rate, 1.0)
        least = rates.min(axis=0)
        return replace(free, rate=least, passable=free.passable & np.isfinite(least), weight=weight), frozen(
            rates
        )

    def _of_slices(self, name: str, stop: Stop) -> FloatArray:
        assert self.headings is not None
        if name == "max_r95_m":
            return np.array([one.r95 for one in self.headings.slices])
        if name == "max_ellipse95_m":
            return np.array([cov.ellipse95(one.covariance)[..., 0] for one in self.headings.slices])
        context = self.context
        return np.array(
            [
                cell_probabilities(
                    context.clearance,
                    context.field.frame,
                    context.centre_clearance,
                    judged_covariance(one, self.problem.blind_r95),
                    radius=self.radius,
                    stop=stop,
                )
                for one in self.headings.slices
            ]
        )


def between_bins(values: FloatArray, *, is_careful: bool = False) -> FloatArray:
    """Values (2H, ny, nx) at twice as many headings from those of H bins; NaN is the worst.

    Between two bins the worse one counts; at a bin its own value, or, when careful, the worst of it and its
    neighbours: what a camera sees changes within a bin.
    """
    out = np.empty((2 * len(values), *values.shape[1:]))
    out[1::2] = np.maximum(values, np.roll(values, -1, axis=0))
    out[0::2] = np.maximum(np.roll(out[1::2], 1, axis=0), out[1::2]) if is_careful else values
    return out
