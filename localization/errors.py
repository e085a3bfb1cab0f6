"""Errors of the localization layer.

::

    SurepathError
    └── LocalizationError          also raised itself: a request that makes no sense
        ├── InvalidSensor          a sensor or camera with impossible numbers
        ├── InvalidMeasurement     bearings, columns, landmarks or sigmas of impossible shape or value
        ├── ColumnOutsideImage     an image column that the camera does not have
        ├── BehindCamera           a bearing that has no image column
        ├── DegenerateGeometry     landmarks or a triplet that admit no fix
        ├── NotPositiveDefinite    a matrix that is no covariance
        ├── LogFormatError         a log that cannot be read as what it claims to be
        ├── CalibrationError       a log that holds too little to calibrate from
        ├── Cancelled              the caller asked to stop
        ├── FieldTooLarge          more cells than the limit
        └── FieldFormatError       a file that is not a field, or not one of this version

Outcomes of good input are no errors: ``localization.triangulation.FixStatus`` of a fix,
``localization.logs.Sighting`` of a line of a log, NaN in a field's layers where ``has_fix`` is False.
"""

from __future__ import annotations

from maps.errors import SurepathError


class LocalizationError(SurepathError):
    """A sensor, field or request about fixes is wrong."""


class InvalidSensor(LocalizationError):
    """A sensor model has an impossible number."""


class InvalidMeasurement(LocalizationError):
    """Bearings, columns, landmarks or sigmas of impossible shape or value."""


class ColumnOutsideImage(LocalizationError):
    """An image column that the camera does not have."""


class BehindCamera(LocalizationError):
    """A bearing at or beyond 90° off the optical axis: it has no image column."""


class DegenerateGeometry(LocalizationError):
    """Landmarks and place admit no fix, or no covariance."""


class NotPositiveDefinite(LocalizationError):
    """A covariance is not symmetric and positive semidefinite."""


class LogFormatError(LocalizationError):
    """A log cannot be read as what it claims to be."""


class CalibrationError(LocalizationError):
    """A log holds too little to calibrate from."""


class Cancelled(LocalizationError):
    """The caller asked to stop; nothing was kept."""


class FieldTooLarge(LocalizationError):
    """A field would have more cells than the limit."""


class FieldFormatError(LocalizationError):
    """A file is not an uncertainty field, or not one of this version."""
