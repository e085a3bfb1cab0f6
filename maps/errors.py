"""Errors of the map layer.

::

    SurepathError
    └── MapError
        ├── MapFormatError        a file or document that cannot be read as what it claims to be
        ├── MapTooLarge           more cells, pixels or bytes than the limit
        ├── InvalidGeometry       polygons, grids or frames that make no sense
        ├── InvalidLandmark       one landmark is wrong (value named)
        │   ├── DuplicateLandmark     two with one id, or two at one place
        │   └── LandmarkOutsideMap    stands outside the map's bounds
        └── TooFewLandmarks       a fix needs three

Every message names the value, the limit and what to do.
"""

from __future__ import annotations


class SurepathError(Exception):
    """Root of every error that surepath raises on purpose: the caller can mend the input."""


class MapError(SurepathError):
    """A map, floor or landmark set is wrong."""


class MapFormatError(MapError):
    """A file or document cannot be read as what it claims to be."""


class MapTooLarge(MapError):
    """A map has more cells, pixels or bytes than the limit allows."""


class InvalidGeometry(MapError):
    """Polygons, grids or frames that make no sense."""


class InvalidLandmark(MapError):
    """One landmark has an impossible value."""


class DuplicateLandmark(InvalidLandmark):
    """Two landmarks share an id or a position."""


class LandmarkOutsideMap(InvalidLandmark):
    """A landmark stands outside the bounds of its map."""


class TooFewLandmarks(MapError):
    """Fewer than three landmarks: no triangulation is possible anywhere."""
