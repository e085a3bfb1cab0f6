"""One door for every kind of map on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from maps.errors import MapError, MapFormatError
from maps.io.cob import plan_from_walls, read_line_maps, read_point_maps
from maps.io.landmark_files import read_landmarks
from maps.io.map_server import MAX_YAML_BYTES, parse_map_yaml, read_map_server
from maps.io.strict import read_bytes
from maps.io.world_file import read_world_file
from maps.landmarks import LandmarkSet
from maps.world import Floor, World

_WORLD_FILES = (".geojson", ".json")
_MAP_FILES = (".yaml", ".yml")


def load_world(
    path: str | Path,
    *,
    landmarks: str | Path | None = None,
    unknown_is_free: bool = False,
    unknown_is_opaque: bool = False,
    name: str | None = None,
) -> World:
    """World of a file or folder.

    Parameters
    ----------
    path
        A world file (``.geojson``), a ROS ``map.yaml``, or the folder of a site: with ``map.yaml`` and its
        image, or walls in ``line_maps`` where there is no image, and reflectors in ``point_maps``.
    landmarks
        File with landmarks (``.csv``, ``.yaml``, ``.geojson``); they replace those of the map.
    unknown_is_free, unknown_is_opaque
        What unknown cells of a map image count as; by default neither.
    name
        Name of the world; default: of the world file, else of file or folder.

    Raises
    ------
    MapError
        If a file is missing, damaged, too large or makes no sense; the message names it.
    """
    source = Path(path)
    options = {"unknown_is_free": unknown_is_free, "unknown_is_opaque": unknown_is_opaque}
    given = None if landmarks is None else read_landmarks(landmarks)
    if source.is_dir():
        return _load_site(source, given, name, options)
    if not source.exists():
        raise MapFormatError(f"There is no map '{source}'.")
    if source.suffix.lower() in _WORLD_FILES:
        world = read_world_file(source)
        world = world if given is None else world.with_landmarks(given)
        return world if name is None else world.renamed(name)
    if source.suffix.lower() in _MAP_FILES:
        if not _has_image(source) and (source.parent / "line_maps").is_dir():
            raise MapFormatError(
                f"The image of '{source}' is missing; give the folder '{source.parent}' to use its line_maps."
            )
        title = name or (source.parent.resolve().name if source.stem == "map" else source.stem)
        return World(title, read_map_server(source, **options), given or LandmarkSet.empty())
    raise MapFormatError(
        f"'{source}' is no map that can be read: give a world file (.geojson), the .yaml beside a map image "
        "or the folder of a site."
    )


def _load_site(folder: Path, given: LandmarkSet | None, name: str | None, options: dict[str, bool]) -> World:
    main = _main_file(folder)
    if main is not None and main.suffix.lower() in _WORLD_FILES:
        return (
            load_world(main, name=name)
            if given is None
            else load_world(main, name=name).with_landmarks(given)
        )
    reflectors = given if given is not None else read_point_maps(folder)
    marks = LandmarkSet.empty() if reflectors is None else reflectors
    title = name or folder.resolve().name
    floor: Floor
    walls = None
    if main is None or not _has_image(main):
        walls = read_line_maps(folder)
    if walls is not None:
        try:
            floor = plan_from_walls(walls, np.asarray(marks.positions))
        except MapError as error:
            raise type(error)(f"{folder / 'line_maps'}: {error}") from error
    elif main is not None:
        floor = read_map_server(main, **options)
    else:
        raise MapFormatError(
            f"The folder '{folder}' holds no map: it needs map.yaml, a .geojson file or walls in line_maps."
        )
    return World(title, floor, marks)


def _main_file(folder: Path) -> Path | None:
    usual = folder / "map.yaml"
    if usual.is_file():
        return usual
    found = sorted(
        f for f in folder.iterdir() if f.suffix.lower() in (*_WORLD_FILES, *_MAP_FILES) and f.is_file()
    )
    if len(found) > 1:
        names = ", ".join(f.name for f in found)
        raise MapFormatError(f"The folder '{folder}' holds several maps ({names}); give one of the files.")
    return found[0] if found else None


def _has_image(file: Path) -> bool:
    data = read_bytes(file, limit=MAX_YAML_BYTES, what="map YAML")
    try:
        return (file.parent / parse_map_yaml(data).image).is_file()
    except MapError as error:
        raise type(error)(f"{file}: {error}") from error
