"""Maps of the ROS map_server: a YAML file and an image of occupancy.

A pixel's occupancy is ``p = (255 - v) / 255`` with ``v`` the mean of its colour channels, ``v / 255`` when
``negate`` is set; deeper images are scaled alike. ``p > occupied_thresh`` is occupied, ``p < free_thresh``
free. What lies between is unknown in mode ``trinary``; in ``scale`` it is partly occupied: neither free
nor opaque, but known. In mode ``raw`` a pixel of 0 … 100 is ``p`` in percent and any other is unknown.
Pixels that are not fully opaque are unknown in ``trinary`` and ``scale``.

Sources: ROS 1 ``map_server`` and nav2's ``map_io.cpp``. They differ: before 2025 alpha was averaged in with
the colours in mode ``trinary``; here, as in nav2 since, the colours count alone.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from maps.arrays import BoolArray
from maps.errors import MapError, MapFormatError, MapTooLarge
from maps.grid import GridFrame, OccupancyGrid
from maps.io.strict import number, parse_yaml, read_bytes, shown

MAX_PIXELS = 64_000_000
MAX_IMAGE_BYTES = 512 * 2**20
MAX_YAML_BYTES = 64 * 1024
MODES = ("trinary", "scale", "raw")

_PNM = re.compile(rb"P([2356])(?:\s+|#[^\n]*\n)+(\d{1,9})(?:\s+|#[^\n]*\n)+(\d{1,9})\s")
_PNG = b"\x89PNG\r\n\x1a\n"
_MAGIC = (
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"GIF8", "a GIF image"),
    (b"BM", "a BMP image"),
    (b"II*\x00", "a TIFF image"),
    (b"MM\x00*", "a TIFF image"),
    (b"RIFF", "a WebP image"),
    (b"P1", "a PBM bitmap"),
    (b"P4", "a PBM bitmap"),
    (b"P7", "a PAM image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself: fetch it first"),
    (b"<", "an SVG, XML or HTML document"),
    (b"{", "a JSON document"),
)


@dataclass(frozen=True, slots=True)
class MapMeta:
    """What a ``map.yaml`` says.

    Attributes
    ----------
    image
        Path of the image, relative to the YAML file.
    resolution
        Side of a pixel, m.
    origin
        x, y (m) and yaw (rad) of the lower-left corner of the lower-left pixel in W.
    negate
        Whether bright means occupied.
    occupied_thresh, free_thresh
        Limits of occupancy in [0, 1].
    mode
        ``trinary``, ``scale`` or ``raw``.
    """

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str = "trinary"


def parse_map_yaml(text: str | bytes) -> MapMeta:
    """Read the text of a ``map.yaml``; members that are not known are ignored, as map_server does.

    Raises
    ------
    MapFormatError
        If it is not YAML, uses anchors, or a member is missing or impossible.
    MapTooLarge
        If it is longer than 64 kB.
    """
    document = parse_yaml(text, "The map YAML", limit=MAX_YAML_BYTES)
    if not isinstance(document, dict):
        raise MapFormatError(
            f"The map YAML is {shown(document)}; it must be a mapping with 'image' and others."
        )
    required = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    missing = [key for key in required if key not in document]
    if missing:
        raise MapFormatError(
            f"The map YAML lacks {', '.join(repr(m) for m in missing)}; it needs {', '.join(required)}."
        )
    image = document["image"]
    if not isinstance(image, str) or not image.strip() or not image.isprintable():
        raise MapFormatError(
            f"The map YAML's image is {shown(image)}; it must be the path of a PGM or PNG file."
        )
    resolution = number(document["resolution"], "The map YAML's resolution", text_ok=True)
    if resolution <= 0:
        raise MapFormatError(f"The map YAML's resolution is {resolution:g} m per pixel; it must be positive.")
    origin = document["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapFormatError(f"The map YAML's origin is {shown(origin)}; it must be [x, y, yaw].")
    x, y, yaw = (number(v, f"The map YAML's origin[{i}]", text_ok=True) for i, v in enumerate(origin))
    occupied, free = (_threshold(document, key) for key in ("occupied_thresh", "free_thresh"))
    if free > occupied:
        raise MapFormatError(
            f"The map YAML's free_thresh {free:g} is above its occupied_thresh {occupied:g}; "
            "they may be swapped."
        )
    mode = document.get("mode", "trinary")
    if mode not in MODES:
        raise MapFormatError(f"The map YAML's mode is {shown(mode)}; it must be one of {', '.join(MODES)}.")
    return MapMeta(image.strip(), resolution, (x, y, yaw), _negate(document["negate"]), occupied, free, mode)


def _threshold(document: dict[Any, Any], key: str) -> float:
    value = number(document[key], f"The map YAML's {key}", text_ok=True)
    if not 0 <= value <= 1:
        raise MapFormatError(f"The map YAML's {key} is {value:g}; it must be between 0 and 1.")
    return value


def _negate(value: object) -> bool:
    if isinstance(value, (bool, int, float)) and value in {0, 1}:
        return bool(value)
    raise MapFormatError(f"The map YAML's negate is {shown(value)}; it must be 0 or 1.")


def grid_from_image(
    data: bytes, meta: MapMeta, *, unknown_is_free: bool = False, unknown_is_opaque: bool = False
) -> OccupancyGrid:
    """Grid of an image; its top row becomes the last row of the grid.

    Parameters
    ----------
    data
        Content of a PGM (P2, P5), PPM or PNG file (grey, RGB, palette, with or without alpha; 8 or 16 bit).
    meta
        What its YAML says.
    unknown_is_free, unknown_is_opaque
        What unknown cells count as; by default neither.

    Raises
    ------
    MapFormatError
        If the data are no such image, or damaged.
    MapTooLarge
        If it has more than 64 million pixels; found before they are read.
    InvalidGeometry
        If resolution or origin are impossible.
    """
    n_cols, n_rows = _image_size(data, meta.image)
    x, y, yaw = meta.origin
    frame = GridFrame(x, y, yaw, meta.resolution, n_rows, n_cols)
    image = _decode(data, meta.image)
    occupied, free, unknown = (mask[::-1] for mask in _classify(image, meta))
    if unknown_is_free:
        free = free | unknown
    if unknown_is_opaque:
        occupied = occupied | unknown
    return OccupancyGrid(frame, free, occupied, unknown)


def _image_size(data: bytes, name: str) -> tuple[int, int]:
    if data.startswith(_PNG) and data[12:16] == b"IHDR" and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
    elif match := _PNM.match(data):
        width, height = int(match[2]), int(match[3])
    else:
        found = next(
            (what for magic, what in _MAGIC if data.startswith(magic)), "no image that is known here"
        )
        if not data:
            found = "empty"
        elif data.startswith((_PNG, b"P2", b"P3", b"P5", b"P6")):
            found = "damaged: its header cannot be read"
        raise MapFormatError(f"The map image '{name}' is {found}; give a PGM (P2 or P5) or PNG file.")
    if width * height > MAX_PIXELS:
        raise MapTooLarge(
            f"The map image '{name}' has {width} × {height} pixels, the limit is {MAX_PIXELS} in all; "
            "scale it down."
        )
    if width == 0 or height == 0:
        raise MapFormatError(f"The map image '{name}' has {width} × {height} pixels: it is empty.")
    return width, height


def _decode(data: bytes, name: str) -> Image.Image:
    try:
        image: Image.Image = Image.open(io.BytesIO(data), formats=["PNG", "PPM"])
        image.load()
        if image.mode == "P" or "transparency" in image.info:
            image = image.convert("RGBA")
        elif image.mode == "1":
            image = image.convert("L")
    except (
        OSError,
        ValueError,
        SyntaxError,
        EOFError,
        struct.error,
        zlib.error,
        Image.DecompressionBombError,
    ) as error:
        raise MapFormatError(f"The map image '{name}' is damaged: {error}.") from error
    return image


def _classify(image: Image.Image, meta: MapMeta) -> tuple[BoolArray, BoolArray, BoolArray]:
    pixels = np.asarray(image)
    deepest = 65535 if image.mode.startswith("I") else 255
    clear = None
    if pixels.ndim == 3:
        n_colors = 1 if image.mode == "LA" else 3
        if pixels.shape[2] > n_colors and meta.mode != "raw":
            clear = pixels[..., n_colors] < 255
        total = sum(
            (pixels[..., k].astype(np.uint16) for k in range(1, n_colors)), pixels[..., 0].astype(np.uint16)
        )
        top = deepest * n_colors
    else:
        total, top = pixels, deepest
    # All shades at once in a table: one division per shade, not per pixel.
    shades = np.arange(top + 1)
    if meta.mode == "raw":
        percent = np.rint(shades * (255 / top))
        occupancy, known = percent / 100, percent <= 100
    else:
        occupancy, known = (shades if meta.negate else top - shades) / top, np.ones(top + 1, dtype=np.bool_)
    occupied = known & (occupancy > meta.occupied_thresh)
    free = known & (occupancy < meta.free_thresh)
    unknown = ~(occupied | free) if meta.mode == "trinary" else ~known
    index: npt.NDArray[Any] = np.clip(total, 0, top) if total.dtype.kind == "i" else total
    masks = [table[index] for table in (occupied, free, unknown)]
    if clear is not None:
        masks = [masks[0] & ~clear, masks[1] & ~clear, masks[2] | clear]
    return masks[0], masks[1], masks[2]


def read_map_server(
    path: str | Path, *, unknown_is_free: bool = False, unknown_is_opaque: bool = False
) -> OccupancyGrid:
    """Grid of a ``map.yaml`` and the image that it names, relative to it.

    Raises
    ------
    MapError
        As :func:`parse_map_yaml` and :func:`grid_from_image`, the file named; or a file is missing.
    """
    file = Path(path)
    text = read_bytes(file, limit=MAX_YAML_BYTES, what="map YAML")
    try:
        meta = parse_map_yaml(text)
        data = read_bytes(file.parent / meta.image, limit=MAX_IMAGE_BYTES, what="map image")
        return grid_from_image(
            data, meta, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
        )
    except MapError as error:
        raise type(error)(f"{file}: {error}") from error
