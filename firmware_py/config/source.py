"""Where each key of a configuration stands, so that every refusal can name its line."""

from __future__ import annotations

import re
from pathlib import Path

from firmware_py.errors import OrbitdError


class ConfigError(OrbitdError, ValueError):
    """The configuration cannot be used; the text names file, line, key, value, limit and next step."""

    exit_code = 2


class ConfigFile:
    """The text of a configuration and where each key stands in it.

    Parameters
    ----------
    path
        Name for messages (the file itself is not read here).
    text
        TOML source.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = text
        self._lines = _key_lines(text)

    def error(self, key: str, value: object, cause: str) -> ConfigError:
        """A :class:`ConfigError` at ``key`` (dotted, list items as ``channel[2].scale``)."""
        line = self._line(key)
        where = f"{self.path.name}:{line}" if line else self.path.name
        shown = "" if value is None else f" = {value}"
        return ConfigError(f"config error: {where}: {key}{shown}: {cause}")

    def _line(self, key: str) -> int:
        """Line of ``key`` or of the nearest table above it; 0 when neither is written."""
        while key and key not in self._lines:
            key = key.rpartition(".")[0]
        return self._lines.get(key, 0)


def _key_lines(text: str) -> dict[str, int]:
    """Line number of each dotted key; arrays of tables count as ``name[i]``."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix = ""
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if array := re.match(r"\[\[\s*([\w.-]+)\s*\]\]", line):
            name = array.group(1)
            prefix = f"{name}[{counts.get(name, 0)}]"
            counts[name] = counts.get(name, 0) + 1
            lines.setdefault(name, number)
            lines[prefix] = number
        elif table := re.match(r"\[\s*([\w.-]+)\s*\]", line):
            prefix = table.group(1)
            lines[prefix] = number
        elif entry := re.match(r"([\w.-]+)\s*=", line):
            lines[f"{prefix}.{entry.group(1)}".lstrip(".")] = number
    return lines
