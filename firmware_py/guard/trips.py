"""Latched trips over a restart: a small file that the loop writes when they change."""

from __future__ import annotations

from pathlib import Path

import msgspec

from firmware_py.errors import OrbitdError

FILE_NAME = "trips.json"


class TripFileError(OrbitdError):
    """The file of latched trips cannot be read: nothing may be assumed about them."""

    exit_code = 2


class TripFile:
    """``trips.json`` in the guard's state directory: names of latched danger alarms."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE_NAME
        self._written: list[str] | None = None
        self.failures = 0

    def read(self) -> list[str]:
        """Names that stood latched when the guard last ended; empty when there is no file.

        Raises
        ------
        TripFileError
            The file is there but damaged or unreadable.
        """
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=list[str])
        except FileNotFoundError:
            return []
        except (OSError, msgspec.DecodeError) as error:
            raise TripFileError(f"{self._path}: {error}; look at the machine, then remove the file") from error

    def write(self, names: list[str]) -> None:
        """Keep ``names`` when they differ from what was kept last; a failure is counted and tried again."""
        if names == self._written:
            return
        fresh = self._path.with_suffix(".new")
        try:
            fresh.write_bytes(msgspec.json.encode(names))
            fresh.replace(self._path)
        except OSError:
            self.failures += 1
            return
        self._written = list(names)
