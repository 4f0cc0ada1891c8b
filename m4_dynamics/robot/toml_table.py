"""A TOML table that hands out checked values and notices keys that nobody asked for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from m4_dynamics.errors import M4Error, RobotDescriptionError

__all__ = ["TomlTable"]

_TYPE_NAMES = {bool: "the boolean", int: "the integer", float: "the number", str: "the string", list: "the list"}


class TomlTable:
    """One table of a TOML file.

    Every getter raises an error (of a robot's file: `RobotDescriptionError`) that names the file, the table, the key,
    what was received and what would be valid. Call `finish` when all keys have been read.

    Attributes:
        file: The file, for messages.
        path: Where the table stands in the file, such as "wheels".
        values: The table's contents.
        error_type: What is raised; a file of another kind than a robot's sets its own in a subclass.
    """

    error_type: type[M4Error] = RobotDescriptionError

    def __init__(self, file: Path, path: str, values: object) -> None:
        self.file = file
        self.path = path
        if not isinstance(values, dict):
            raise self.error_type(f"{file}: [{path}] must be a table, got {_in_words(values)}")
        self.values: dict[str, Any] = values
        self._known: list[str] = []

    def error(self, key: str, problem: str) -> M4Error:
        """An error about one key, to be raised by the caller."""
        return self.error_type(f"{self.file}: [{self.path}] {key} {problem}")

    def take(self, key: str) -> Any:
        """The raw value, or None if the key is absent."""
        if key not in self._known:
            self._known.append(key)
        return self.values.get(key)

    def finish(self) -> None:
        """Raise if the table holds a key that nobody has read."""
        for key in self.values:
            if key not in self._known:
                place = f"[{self.path}] " if self.path else ""
                raise self.error_type(f"{self.file}: {place}unknown key '{key}'; valid: {', '.join(self._known)}")

    def number(
        self,
        key: str,
        *,
        default: float | None = None,
        above: float | None = None,
        least: float | None = None,
        most: float | None = None,
    ) -> float:
        """A finite number within bounds; without a default the key is required."""
        value = self.take(key)
        if value is not None:
            return self._check_number(key, value, above, least, most)
        if default is None:
            raise self.error(key, f"is missing; expected {_range_in_words(above, least, most)}")
        return default

    def number_of_each(
        self,
        key: str,
        names: tuple[str, ...],
        *,
        default: float | None = None,
        above: float | None = None,
        least: float | None = None,
    ) -> dict[str, float]:
        """One number for all names, or a table with a number for each; without a default the key is required."""
        given = self.optional_number_of_each(key, names, above=above, least=least)
        if given is not None:
            return given
        if default is None:
            raise self.error(
                key, f"is missing; expected {_range_in_words(above, least, None)}, or a table with one for each name"
            )
        return dict.fromkeys(names, default)

    def optional_number_of_each(
        self, key: str, names: tuple[str, ...], *, above: float | None = None, least: float | None = None
    ) -> dict[str, float] | None:
        """As `number_of_each`, but None if the key is absent."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            return dict.fromkeys(names, self._check_number(key, value, above, least, None))
        for name in value:
            if name not in names:
                raise self.error(key, f"names '{name}', which is not in this table's list; valid: {', '.join(names)}")
        for name in names:
            if name not in value:
                raise self.error(key, f"has no number for '{name}'")
        return {name: self._check_number(f"{key}.{name}", value[name], above, least, None) for name in names}

    def text(self, key: str, *, default: str | None = None) -> str:
        """A non-empty string; without a default the key is required."""
        value = self.take(key)
        if value is not None:
            return self.check_text(key, value)
        if default is None:
            raise self.error(key, "is missing; expected a string")
        return default

    def names(self, key: str, *, length: int | None = None, optional: bool = False) -> tuple[str, ...]:
        """A list of different names, empty if the key is optional and absent."""
        value = self.take(key)
        wanted = "a list of names" if length is None else f"a list of {length} names"
        if value is None:
            if optional:
                return ()
            raise self.error(key, f"is missing; expected {wanted}")
        if not isinstance(value, list) or (length is not None and len(value) != length):
            raise self.error(key, f"must be {wanted}, got {_in_words(value)}")
        names = tuple(self.check_text(f"{key}[{index}]", name) for index, name in enumerate(value))
        for name in names:
            if names.count(name) > 1:
                raise self.error(key, f"names '{name}' more than once")
        return names

    def direction(self, key: str) -> tuple[float, float, float] | None:
        """Three numbers that are not all zero, or None if the key is absent."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) != 3:
            raise self.error(key, f"must be a list of three numbers, got {_in_words(value)}")
        x, y, z = (self._check_number(f"{key}[{index}]", entry, None, None, None) for index, entry in enumerate(value))
        if math.hypot(x, y, z) < 1e-9:
            raise self.error(key, "must not be zero")
        return (x, y, z)

    def check_text(self, key: str, value: object) -> str:
        """The value, if it is a non-empty string."""
        if not isinstance(value, str) or not value:
            raise self.error(key, f"must be a non-empty string, got {_in_words(value)}")
        return value

    def _check_number(
        self, key: str, value: object, above: float | None, least: float | None, most: float | None
    ) -> float:
        wanted = _range_in_words(above, least, most)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"must be {wanted}, got {_in_words(value)}")
        number = float(value)
        too_small = (above is not None and number <= above) or (least is not None and number < least)
        if not math.isfinite(number) or too_small or (most is not None and number > most):
            raise self.error(key, f"must be {wanted}, got {number!r}")
        return number


def _in_words(value: object) -> str:
    kind = _TYPE_NAMES.get(type(value))
    return "a table" if isinstance(value, dict) else f"{kind or type(value).__name__} {value!r}"


def _range_in_words(above: float | None, least: float | None, most: float | None) -> str:
    bounds = []
    if above is not None:
        bounds.append(f"above {above:g}")
    if least is not None:
        bounds.append(f"of at least {least:g}")
    if most is not None:
        bounds.append(f"up to {most:g}")
    return " ".join(["a finite number", " and ".join(bounds)]).strip()
