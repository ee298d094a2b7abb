"""The text of a configuration: how it is read, where each key stands, and how its faults are
told."""

from __future__ import annotations

import codecs
import os
import re
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from firmware_py.errors import OrbitdError
from firmware_py.machine.migrate import first_key, in_first_words

MAX_BYTES: Final = 64 * 1024
"""A full configuration with comments has 6 kB; the parser's time grows with the square of the worst
texts."""
MAX_LINE: Final = 2000
VALUE_SHOWN: Final = 60
"""Characters of a value that a fault repeats."""

_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
_BARE: Final = r"[A-Za-z0-9_-]+"
_KEY: Final = rf"""(?:{_BARE}|"[^"\\]*"|'[^']*')"""
_DOTTED: Final = rf"({_KEY}(?:\s*\.\s*{_KEY})*)"
_ARRAY, _TABLE, _ENTRY = (
    re.compile(p) for p in (rf"\[\[\s*{_DOTTED}\s*\]\]", rf"\[\s*{_DOTTED}\s*\]", rf"{_DOTTED}\s*=")
)
_LONG_QUOTE: Final = re.compile(r'"""|' + "'''")


class Fault(msgspec.Struct, frozen=True):
    """One thing that is wrong, and where.

    ``line`` is 0 where the key is not written.  ``value`` is as a person sees it, empty for a whole
    table. ``least`` and ``greatest`` are the range of the key by itself where it is a number;
    ``cause`` names the limit that was broken.
    """

    file: str
    line: int
    key: str
    value: str
    cause: str
    next_step: str
    least: float | None = None
    greatest: float | None = None

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        key = f": {self.key}" if self.key else ""
        shown = f" = {self.value}" if self.value else ""
        return f"config error: {where}{key}{shown}: {self.cause}; {self.next_step}"


class ConfigError(OrbitdError, ValueError):
    """The configuration cannot be used; the text has a line for each of ``faults``."""

    exit_code = 2

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = list(faults)
        super().__init__("\n".join(map(str, self.faults)))


class ConfigFile:
    """The text of a configuration and where each key stands in it.

    Parameters
    ----------
    path
        Name for messages (the file itself is not read here).
    text
        TOML source.
    label
        What messages call the file, when that is not its name alone.

    Attributes
    ----------
    lines
        Line of each key that is written.
    """

    def __init__(self, path: Path, text: str, label: str = "") -> None:
        self.path = path
        self.text = text
        self._label = label or path.name
        self.lines = _key_lines(text)

    def fault(self, key: str, value: object, cause: str, line: int = 0) -> Fault:
        """A :class:`Fault` at ``key`` (dotted, list items as ``channel[2].scale``).

        ``cause`` ends with the next step, after its last semicolon.
        """
        text, _, step = cause.rpartition("; ")
        if not text:
            text, step = step, "correct it"
        return Fault(
            shown(self._label),
            line or self._line(key),
            key and shown(key),
            shown(value),
            text,
            step,
        )

    def error(self, key: str, value: object, cause: str) -> ConfigError:
        """The one fault as an error."""
        return ConfigError([self.fault(key, value, cause)])

    def _line(self, key: str) -> int:
        """Line of ``key`` or of the nearest table above it; 0 when neither is written."""
        while key and key not in self.lines:
            key = key[: max(key.rfind("."), key.rfind("["), 0)]
        return self.lines.get(key, 0)


@dataclass(frozen=True)
class Source:
    """Where the values of a configuration were written, and what each key is called there.

    Attributes
    ----------
    path
        What a person named.
    place
        File of a key of :class:`~firmware_py.config.Config`, and what it is called in it.
    worded
        A text that names such keys, in the words of the files.
    """

    path: Path
    place: Callable[[str], tuple[ConfigFile, str]]
    worded: Callable[[str], str]

    def fault(self, key: str, value: object, cause: str) -> Fault:
        """A :class:`Fault` at ``key``; ``cause`` ends with the next step, after a semicolon."""
        file, own = self.place(key)
        return file.fault(own, value, self.worded(cause))

    def written(self, key: str) -> bool:
        """Whether ``key`` itself stands there, not only a default for it."""
        file, own = self.place(key)
        return own in file.lines


def one_file(file: ConfigFile, *, first: bool) -> Source:
    """The source of a single file, ``first``: of the first schema."""
    if first:
        return Source(file.path, lambda key: (file, first_key(key)), in_first_words)
    return Source(file.path, lambda key: (file, key), str)


_OF_MACHINE: Final = re.compile(r"\bmachine(\.|, )")


def two_files(folder: Path, machine: ConfigFile, device: ConfigFile) -> Source:
    """The source of a rig folder."""

    def place(key: str) -> tuple[ConfigFile, str]:
        above, _, own = key.partition(".")
        return (machine, own) if above == "machine" else (device, key)

    return Source(folder, place, lambda text: _OF_MACHINE.sub("", text))


def shown(value: object) -> str:
    """``value`` on one line, short, and without anything that a terminal would execute."""
    if (
        value is None
        or isinstance(value, dict)
        or (isinstance(value, list) and dict in map(type, value))
    ):
        return ""
    plain = isinstance(value, str) and value.isprintable() and value
    try:
        text = str(value) if plain else repr(value)
    except (
        ValueError,
        RecursionError,
    ):  # an integer of more digits, or a list deeper, than Python writes out
        return "(too large to show)"
    return text if len(text) <= VALUE_SHOWN else f"{text[:VALUE_SHOWN]}.. ({len(text)} characters)"


def read_file(path: Path, label: str = "") -> ConfigFile:
    """The file, whatever a person or an editor made of it; ``label`` as of :class:`ConfigFile`.

    Raises
    ------
    ConfigError
        Not a readable regular file of reasonable size in UTF-8; the text says which, and where.
    """
    source = ConfigFile(path, "", label)
    try:
        data = _read(path)
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or str(error)
        raise source.error(
            "",
            None,
            f"cannot be read ({said}); name a rig folder with machine.toml and device.toml "
            f"(`orbitd rig new FOLDER` writes one), a shipped rig, or a readable TOML file",
        ) from error
    if len(data) > MAX_BYTES:
        raise source.error(
            "", None, f"more than {MAX_BYTES} bytes; name a configuration, shipped ones have 6 kB"
        )
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            raise source.error(
                "", None, f"begins with a byte order mark of {encoding}; save it as UTF-8"
            )
    data = data.removeprefix(
        codecs.BOM_UTF8
    )  # the mark that some editors put before UTF-8 says nothing new
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line, byte = data.count(b"\n", 0, error.start) + 1, data[error.start]
        raise ConfigError(
            [source.fault("", None, f"byte {byte:#04x} is not UTF-8; save it as UTF-8", line)]
        ) from error
    for line, words in enumerate(text.split("\n"), 1):
        if "\0" in words:
            raise ConfigError([source.fault("", None, "a NUL byte; save it as UTF-8 text", line)])
        if len(words) > MAX_LINE:
            cause = f"a line of more than {MAX_LINE} characters; break it"
            raise ConfigError([source.fault("", None, cause, line)])
    return ConfigFile(path, text, label)


def _read(path: Path) -> bytes:
    """At most one byte more than may be; never waits (a pipe) nor reads for ever (a device)."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        mode = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode):
            raise OSError("a folder" if stat.S_ISDIR(mode) else "no regular file")
        return os.read(descriptor, MAX_BYTES + 1)
    finally:
        os.close(descriptor)


def _key_lines(text: str) -> dict[str, int]:
    """Line number of each dotted key; arrays of tables count as ``name[i]``."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix = ""
    quoted = False
    for number, raw in enumerate(text.split("\n"), 1):
        line = raw.strip()
        inside, quoted = quoted, quoted ^ len(_LONG_QUOTE.findall(line)) % 2 == 1
        if inside:
            continue
        if array := _ARRAY.match(line):
            name = _plain(array.group(1))
            prefix = f"{name}[{counts.get(name, 0)}]"
            counts[name] = counts.get(name, 0) + 1
            lines.setdefault(name, number)
            lines[prefix] = number
        elif table := _TABLE.match(line):
            prefix = _plain(table.group(1))
            lines[prefix] = number
        elif entry := _ENTRY.match(line):
            lines[f"{prefix}.{_plain(entry.group(1))}".lstrip(".")] = number
    return lines


def _plain(dotted: str) -> str:
    """A dotted key without quotes and blanks."""
    return ".".join(part.strip("\"'") for part in re.findall(_KEY, dotted))
