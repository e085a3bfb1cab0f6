"""The ranking of triplets at a place as JSON, and in words what is wrong with the place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from api.codec_plan import number
from localization.covariance import ellipse95
from localization.ranking import LandmarkStatus, PlaceReport, TripletStatus
from localization.sensors import Sensor
from localization.triplets import TripletChoice
from localization.uncertainty_field import is_off
from maps.se2 import wrap
from maps.world import World

WORDS = {
    LandmarkStatus.MEASURABLE: "it can be measured",
    LandmarkStatus.TOO_NEAR: "it is too near",
    LandmarkStatus.TOO_FAR: "it is too far",
    LandmarkStatus.TURNED_AWAY: "it faces away",
    LandmarkStatus.HIDDEN: "something opaque is in between",
    LandmarkStatus.MUTED: "it is in a muted sector",
    LandmarkStatus.OUTSIDE_VIEW: "the camera cannot have it in view",
}
_COUNTED = {
    LandmarkStatus.TOO_NEAR: "too near",
    LandmarkStatus.TOO_FAR: "too far",
    LandmarkStatus.TURNED_AWAY: "facing away",
    LandmarkStatus.HIDDEN: "hidden",
    LandmarkStatus.MUTED: "in a muted sector",
    LandmarkStatus.OUTSIDE_VIEW: "outside the view",
}
_NO_FIX = {TripletStatus.NOT_IN_ONE_VIEW: "not in one view", TripletStatus.DEGENERATE: "degenerate"}
#: A triplet that is hidden is worth a word when its area is below this share of the best one's.
_WORTH_A_WORD = 0.8


def ranking_to_json(world: World, sensor: Sensor, report: PlaceReport, criterion: str) -> dict[str, Any]:
    """Ranked and missed triplets, every landmark with its status, and the reason of a bad place."""
    ids, marks = world.landmarks.ids, world.landmarks.positions
    dx, dy = (marks - report.point - sensor.mount.offset(report.heading)).T
    bearings = wrap(np.arctan2(dy, dx) - report.heading - sensor.mount.theta)
    return {
        "place": {"x_m": float(report.point[0]), "y_m": float(report.point[1])},
        "heading_rad": report.heading,
        "criterion": criterion,
        "free": report.is_free,
        "reason": reason_of(world, report),
        "triplets": [choice_to_json(world, c) for c in report.ranked],
        "missed": [
            {
                **choice_to_json(world, c),
                "blocking": {ids[i]: status.value for i, status in report.blocking(c.triplet).items()},
            }
            for c in report.missed
        ],
        "counts": None
        if report.counts is None
        else {s.value: report.counts.get(s, 0) for s in TripletStatus},
        "landmarks": [
            {
                "id": name,
                "x_m": float(marks[i, 0]),
                "y_m": float(marks[i, 1]),
                "distance_m": float(report.distance[i]),
                "bearing_rad": float(bearings[i]),
                "status": report.landmarks[i].value,
                "reason": WORDS[report.landmarks[i]],
            }
            for i, name in enumerate(ids)
        ],
    }


def choice_to_json(world: World, choice: TripletChoice) -> dict[str, Any]:
    """A triplet and the fix that it gives."""
    a, b, azimuth = (float(v) for v in ellipse95(choice.covariance))
    share = np.asarray(choice.validity, dtype=np.float32)
    return {
        "triplet": [world.landmarks.ids[i] for i in choice.triplet],
        "area95_m2": choice.area95,
        "r95_m": choice.r95,
        "covariance": choice.covariance.tolist(),
        "ellipse95": {"a_m": a, "b_m": b, "theta_rad": azimuth},
        "sigma_theta_rad": choice.sigma_theta,
        "pan_rad": number(choice.pan),
        "validity": number(choice.validity),
        "valid": None if np.isnan(share) else not bool(is_off(share)),
    }


def reason_of(world: World, report: PlaceReport) -> str | None:
    """Why there is no fix at a place, or what keeps it from a better one; None: nothing does."""
    if not report.is_free:
        return "A robot cannot stand here: the place is not free floor, and nothing is ranked."
    missed = _worth_a_word(world, report)
    if report.ranked:
        return missed
    words = [_seen(report)]
    if report.counts is not None and (out := _listed(report.counts, _NO_FIX)):
        words.append(f"Of the triplets that can be seen {out}.")
    return " ".join([*words, *([missed] if missed else [])])


def _seen(report: PlaceReport) -> str:
    counts = Counter(report.landmarks)
    seen = counts[LandmarkStatus.MEASURABLE]
    others = _listed(counts, _COUNTED)
    enough = "no three of them give a fix" if seen >= 3 else "a fix needs three"
    also = f" ({others})" if others else ""
    return f"{seen} of {len(report.landmarks)} landmarks can be measured{also}: {enough}."


def _listed(counts: Any, words: dict[Any, str]) -> str:
    """As in ``3 are hidden, 1 is too far``."""
    found = [(counts.get(status, 0), said) for status, said in words.items()]
    return ", ".join(f"{n} {'is' if n == 1 else 'are'} {said}" for n, said in found if n)


def _worth_a_word(world: World, report: PlaceReport) -> str | None:
    """The best triplet that cannot be seen, if it is much better than what can be."""
    # What stands in between can be moved; which way a landmark looks, less easily.
    movable = [
        c for c in report.missed if LandmarkStatus.TURNED_AWAY not in report.blocking(c.triplet).values()
    ]
    found = next(iter(movable or report.missed), None)
    if found is None or (report.ranked and found.area95 > _WORTH_A_WORD * report.ranked[0].area95):
        return None
    ids = world.landmarks.ids
    names = _and(ids[i] for i in found.triplet)
    why = "; ".join(f"{ids[i]}: {WORDS[s]}" for i, s in report.blocking(found.triplet).items())
    return f"{names} would give an ellipse of {found.area95:.2g} m², but not all can be measured ({why})."


def _and(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}"
