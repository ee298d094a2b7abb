"""Signal files of other people's systems, and our own recordings, as channels with rate and unit.

:func:`read` opens one file by its suffix; :mod:`~models.readers.assemble` makes even samples in SI
of it, by a channel map (:mod:`~models.readers.channel_map`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from models.readers import arrays, flight, mdf, parquet, tdms, text, uff, wav
from models.readers.channel_map import FileRules
from models.readers.signal_file import SignalFile, SignalFileError

READERS: Final[dict[str, Callable[[Path, FileRules], SignalFile]]] = {
    ".csv": text.read,
    ".txt": text.read,
    ".tsv": text.read,
    ".dat": text.read,
    ".asc": text.read,
    ".npz": arrays.read_npz,
    ".npy": arrays.read_npy,
    ".mat": arrays.read_mat,
    ".wav": wav.read,
    ".tdms": tdms.read,
    ".parquet": parquet.read,
    ".mf4": mdf.read,
    ".mdf": mdf.read,
    ".uff": uff.read,
    ".unv": uff.read,
    ".mcap": flight.read,
}
"""What reads a file, by suffix."""


def read(path: Path, rules: FileRules) -> SignalFile:
    """The channels of one file as they stand in it.

    Parameters
    ----------
    path
        Its suffix chooses the reader.
    rules
        What a person has said about the files, for what a file does not tell itself.

    Raises
    ------
    SignalFileError
        Names the file, the place in it, the cause and the next step.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SignalFileError(
            f"{path.name}: no reader for {path.suffix or 'a name without suffix'!r}; save it as "
            f"one of {', '.join(sorted(READERS))}"
        )
    if not path.is_file():
        raise SignalFileError(f"{path}: no such file; correct its name or drop its row")
    if not path.stat().st_size:
        raise SignalFileError(f"{path.name}: empty file; record it again or leave it out")
    return reader(path, rules)
