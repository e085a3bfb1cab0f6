"""What all importers share: bounded reading, strict JSON and YAML, checked values.

Every error names the source and the place in it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import yaml

from maps.errors import MapFormatError, MapTooLarge

MAX_YAML_BYTES = 64 * 1024
_MAX_DEPTH = 32
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_LONGEST_SHOWN = 60


def read_bytes(path: str | Path, *, limit: int, what: str) -> bytes:
    """Whole content of a file of at most ``limit`` bytes.

    Raises
    ------
    MapFormatError
        If there is no such file or it cannot be read.
    MapTooLarge
        If it is longer.
    """
    file = Path(path)
    try:
        if file.is_dir():
            raise MapFormatError(f"'{file}' is a folder, not a {what}.")
        with file.open("rb") as handle:
            data = handle.read(limit + 1)
    except FileNotFoundError:
        raise MapFormatError(f"There is no {what} '{file}'.") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise MapFormatError(f"The {what} '{file}' cannot be read: {reason}.") from error
    check_size(data, limit=limit, what=f"{what} '{file}'")
    return data


def check_size(data: bytes | str, *, limit: int, what: str) -> None:
    """Raise :class:`~maps.errors.MapTooLarge` if there are more than ``limit`` bytes or characters."""
    if len(data) > limit:
        size = f"{limit / 2**20:g} MiB" if limit >= 2**20 else f"{limit / 1024:g} kB"
        raise MapTooLarge(f"The {what} is larger than the limit of {size} ({limit} bytes).")


def decode(data: bytes, source: str) -> str:
    """Text of UTF-8 bytes, a byte order mark removed; MapFormatError when they are not UTF-8."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapFormatError(
            f"{source} is not UTF-8 (byte 0x{data[error.start]:02x} at position {error.start}); save it so."
        ) from error


def parse_json(data: bytes | str, source: str) -> Any:
    """Strict JSON: no NaN or Infinity, no member given twice, bounded depth.

    Raises
    ------
    MapFormatError
        If the text is not such JSON; the message says where.
    """
    text = decode(data, source) if isinstance(data, bytes) else data

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key, value in pairs:
            if key in out:
                raise MapFormatError(f"{source} gives the member {shown(key)} twice in one object.")
            out[key] = value
        return out

    def constant(word: str) -> None:
        raise MapFormatError(f"{source} holds {word}, which is not a JSON number; leave the member out.")

    try:
        return json.loads(text, object_pairs_hook=unique, parse_constant=constant)
    except json.JSONDecodeError as error:
        raise MapFormatError(
            f"{source} is not JSON: {error.msg} (line {error.lineno}, column {error.colno})."
        ) from error
    except RecursionError:
        raise MapFormatError(f"{source} nests its objects and arrays too deeply.") from None
    except ValueError as error:
        raise MapFormatError(f"{source} is not JSON that can be read: {error}.") from error


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe loader that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002
        seen: set[str] = set()
        scalars = [key for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for key in scalars:
            if key.value in seen:
                message = f"the key {shown(key.value)} is given twice"
                raise yaml.constructor.ConstructorError(None, None, message, key.start_mark)
            seen.add(key.value)
        return dict(super().construct_mapping(node, deep=deep))


def parse_yaml(data: bytes | str, source: str, *, limit: int = MAX_YAML_BYTES) -> Any:
    """Plain YAML: safe types only, no anchors or aliases, no key given twice, bounded size and depth.

    Raises
    ------
    MapFormatError
        If the text is not such YAML; the message says where.
    MapTooLarge
        If it is longer than ``limit``.
    """
    check_size(data, limit=limit, what=source)
    text = decode(data, source) if isinstance(data, bytes) else data
    try:
        depth = 0
        # Looked through as a stream first: aliases can blow up and depth can exhaust the stack.
        for event in yaml.parse(text, Loader=_Loader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
                at = _line(event.start_mark)
                raise MapFormatError(f"{source} uses a YAML anchor or alias{at}; write it out.")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _MAX_DEPTH:
                raise MapFormatError(f"{source} nests its lists and mappings too deeply.")
        return yaml.load(text, Loader=_Loader)  # noqa: S506  (the loader is a safe one)
    except yaml.MarkedYAMLError as error:
        at = _line(error.problem_mark)
        raise MapFormatError(f"{source} is not valid YAML: {error.problem}{at}.") from error
    except (yaml.YAMLError, ValueError, UnicodeError, OverflowError) as error:
        reason = str(error).replace("\n", " ")
        raise MapFormatError(f"{source} is not valid YAML: {reason}.") from error


def _line(mark: Any) -> str:
    return "" if mark is None else f" (line {mark.line + 1})"


def shown(value: object) -> str:
    """A value as it may stand in a message: short, on one line."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 1] + "…"


def members(
    value: object, where: str, *, required: Collection[str], optional: Collection[str] = ()
) -> dict[str, Any]:
    """An object that has all required members and no others than those allowed.

    Raises
    ------
    MapFormatError
        If it is no object, lacks a member or has a foreign one.
    """
    if not isinstance(value, dict):
        raise MapFormatError(f"{where} is {shown(value)}; it must be an object.")
    allowed = [*required, *optional]
    for key in value:
        if key not in allowed:
            name = key if isinstance(key, str) and key.isidentifier() else shown(key)
            raise MapFormatError(
                f"{where}.{name[:_LONGEST_SHOWN]} is not allowed; allowed here: {', '.join(allowed)}."
            )
    for key in required:
        if key not in value:
            raise MapFormatError(f"{where} lacks the member '{key}'.")
    return value


def number(value: object, where: str, *, text_ok: bool = False) -> float:
    """A finite number; ``text_ok`` also takes one written as text, as CSV and YAML's ``1e-3`` give it.

    Raises
    ------
    MapFormatError
        If it is anything else, a boolean included.
    """
    out = math.nan
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            out = float(value)
        except OverflowError:
            out = math.inf
    elif text_ok and isinstance(value, str) and _NUMBER.fullmatch(value.strip()):
        out = float(value)
    if not math.isfinite(out):
        raise MapFormatError(f"{where} is {shown(value)}; it must be a finite number.")
    return out


def label(value: object, where: str) -> str:
    """A name of 1 to 200 printable characters.

    Raises
    ------
    MapFormatError
        If it is anything else.
    """
    if not isinstance(value, str) or not value or len(value) > 200 or not value.isprintable():
        raise MapFormatError(f"{where} is {shown(value)}; it must be text of 1 to 200 printable characters.")
    return value
