"""Errors of the localization layer.

::

    SurepathError
    └── LocalizationError
        ├── InvalidSensor          a sensor with impossible numbers
        ├── DegenerateGeometry     landmarks or a triplet that admit no fix
        ├── Cancelled              the caller asked to stop
        ├── FieldTooLarge          more cells than the limit
        └── FieldFormatError       a file that is not a field, or not one of this version
"""

from __future__ import annotations

from maps.errors import SurepathError


class LocalizationError(SurepathError):
    """A sensor, field or request about fixes is wrong."""


class InvalidSensor(LocalizationError):
    """A sensor model has an impossible number."""


class DegenerateGeometry(LocalizationError):
    """Landmarks and place admit no fix, or no covariance."""


class Cancelled(LocalizationError):
    """The caller asked to stop; nothing was kept."""


class FieldTooLarge(LocalizationError):
    """A field would have more cells than the limit."""


class FieldFormatError(LocalizationError):
    """A file is not an uncertainty field, or not one of this version."""
