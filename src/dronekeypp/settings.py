"""Keep settings as plain dataclasses with checked values.

They can be written as JSON and read again. A wrong key or value raises an error of one line.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from dronekeypp.errors import InputError
from dronekeypp.files import parse_json

YES_NO = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


class Settings:
    """This is the base of every dataclass of settings.

    A subclass lists the allowed words of a text field in `CHOICES`, the smallest value of a number in
    `LEAST`, and the largest in `MOST`. In `ONLY_WITH` it says that a field is used only where other fields
    have certain values; elsewhere any value but the default is refused. Every field is an int, float, bool,
    str or "str | None", or settings of its own.
    """

    CHOICES: ClassVar[dict[str, tuple[str, ...]]] = {}
    LEAST: ClassVar[dict[str, float]] = {}
    MOST: ClassVar[dict[str, float]] = {}
    ONLY_WITH: ClassVar[dict[str, tuple[tuple[str, Any], ...]]] = {}

    def __post_init__(self) -> None:
        """Convert and check every value.

        Raises:
            InputError: a value does not fit its field, or is set though it is not used.
        """
        for field in dataclasses.fields(self):
            value = _coerce(field.name, str(field.type), getattr(self, field.name))
            object.__setattr__(self, field.name, value)
        for name, words in self.CHOICES.items():
            if getattr(self, name) not in words:
                raise InputError(f"{name}={getattr(self, name)!r} is not one of: {', '.join(words)}")
        for name, most in self.MOST.items():
            if not getattr(self, name) <= most:
                raise InputError(f"{name}={getattr(self, name)!r} must be at most {most:g}")
        for name, least in self.LEAST.items():
            if not getattr(self, name) >= least:
                raise InputError(f"{name}={getattr(self, name)!r} must be at least {least:g}")
        for name, reason in self.unused(vars(self)).items():
            if getattr(self, name) != getattr(type(self), name):
                raise InputError(f"{name}={getattr(self, name)} is not used: {reason}")

    @classmethod
    def unused(cls, values: Mapping[str, Any]) -> dict[str, str]:
        """Return the settings that do not count beside the given `values`, and why.

        The result is, for example, {"angle_zero": "it needs rotation=euler"}. A setting that is not among the
        values has its default.
        """
        reasons = {}
        for name, conditions in cls.ONLY_WITH.items():
            for other, wanted in conditions:
                if not _same(values.get(other, getattr(cls, other)), wanted):
                    reasons[name] = f"it needs {other}={wanted}"
        return reasons

    @classmethod
    def known_keys(cls, values: Mapping[str, Any]) -> list[str]:
        """Return the names of all settings that can stand beside the given `values`."""
        return cls.keys()

    @classmethod
    def keys(cls) -> list[str]:
        """Return the names of the settings."""
        return [field.name for field in dataclasses.fields(cls)]

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as a dict that JSON can hold."""
        return dataclasses.asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build the settings from a dict.

        Raises:
            InputError: a key does not exist (the known ones are listed), or a value does not fit.
        """
        check_mapping(values, cls.__name__)
        unknown = sorted(set(values) - set(cls.keys()))
        if unknown:
            raise InputError(f"unknown setting {unknown[0]!r}; known: {', '.join(cls.keys())}")
        return cls(**values)

    def to_json(self) -> str:
        """Return the settings as JSON text."""
        return json.dumps(self.to_dict(), indent=2)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote.

        Raises:
            InputError: the text is not JSON, or `from_dict` refuses what it holds.
        """
        return cls.from_dict(parse_json(text, cls.__name__))

    def replace(self, **changes: Any) -> Self:
        """Return the same settings with some of them changed.

        What is no longer used then goes back to its default.
        """
        return type(self).from_dict({**self.kept_beside(changes), **changes})

    def kept_beside(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return these settings without those that `changes` replaces or makes useless."""
        return usable(type(self), self.to_dict(), changes)


def _same(value: Any, wanted: Any) -> bool:
    """Say whether a value, which may still be text from a command line, is the wanted one."""
    if isinstance(wanted, bool) and isinstance(value, str):
        return YES_NO.get(value.lower()) == wanted
    return value == wanted


def usable(kind: type[Settings], usual: Mapping[str, Any], chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the `usual` settings that this `kind` still uses beside the `chosen` ones."""
    together = {**usual, **chosen}
    known, unused = kind.known_keys(together), kind.unused(together)
    result = {}
    for key, value in usual.items():
        if key in known and key not in unused and key not in chosen:
            result[key] = value
    return result


def check_mapping(values: Any, name: str) -> None:
    """Check that `values` is a dict of settings.

    Raises:
        InputError: it is something else. The message calls it by `name`.
    """
    if not isinstance(values, dict):
        raise InputError(f"{name} needs a mapping of settings, got {type(values).__name__}")


def _coerce(name: str, kind: str, value: Any) -> Any:
    """Return a value as the type of its field.

    Text from a command line ("1e-3", "true", "none") is read. Any other value must fit by itself.

    Raises:
        InputError: the value does not fit.
    """
    try:
        if kind == "bool":
            if isinstance(value, str):
                return YES_NO[value.lower()]
            if value in (0, 1):
                return bool(value)
        elif kind == "int" and not isinstance(value, bool):
            if isinstance(value, str) or float(value) == int(value):
                return int(value)
        elif kind == "float" and not isinstance(value, bool):
            if float(value) == float(value) and abs(float(value)) != float("inf"):
                return float(value)
        elif kind.startswith("str"):
            if "None" in kind and (value is None or str(value).lower() in ("none", "null", "")):
                return None
            if isinstance(value, str):
                return value
            if hasattr(value, "__fspath__"):
                return str(value)
        elif not kind.startswith(("int", "float")):
            return value  # a part with settings of its own, which checks them itself
    except (KeyError, ValueError, TypeError, OverflowError):
        pass
    raise InputError(f"{name}={value!r} does not fit: expected {kind}")
