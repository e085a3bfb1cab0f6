"""The sites drawn for this project, as package data."""

from __future__ import annotations

from importlib import resources

from maps.errors import MapError
from maps.io.world_file import world_from_geojson
from maps.world import World

_SUFFIX = ".geojson"


def bundled_site_names() -> tuple[str, ...]:
    """Names of the bundled sites, sorted."""
    folder = resources.files("maps.sites")
    names = [entry.name for entry in folder.iterdir()]
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in names if name.endswith(_SUFFIX)))


def bundled_site_text(name: str) -> str:
    """World file of a bundled site.

    Raises
    ------
    MapError
        If there is no site of that name.
    """
    names = bundled_site_names()
    if name not in names:
        raise MapError(f"There is no bundled site {name!r}; there are: {', '.join(names)}.")
    return resources.files("maps.sites").joinpath(name + _SUFFIX).read_text(encoding="utf-8")


def bundled_site(name: str) -> World:
    """A bundled site as a world.

    Raises
    ------
    MapError
        If there is no site of that name.
    """
    return world_from_geojson(bundled_site_text(name), name=name)
