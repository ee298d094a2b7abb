"""Whose the bytes of a model are: the package's, a trusted key's, or nobody's, and then by name."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from firmware_py.brain.errors import ModelMissingError, ModelTrustError, ModelUnfitError
from firmware_py.config import ModelsConfig
from firmware_py.model_sets import manifest
from firmware_py.model_sets.errors import SetError
from firmware_py.model_sets.manifest import MANIFEST, SIGNATURE

MAX_BYTES: Final = 64 * 2**20
UNSIGNED: Final = "unsigned"


class Vouched(NamedTuple):
    """The bytes of a file, and by whom they are vouched for, in words."""

    data: bytes
    by: str


def read_bytes(path: Path) -> bytes:
    """The file, at most :data:`MAX_BYTES`.

    Raises
    ------
    ModelMissingError, ModelUnfitError
        It cannot be read, or is larger.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ModelMissingError(
            f"{path}: cannot be read ({error.strerror}); train and export it, or set "
            f"models.directory"
        ) from error
    if len(data) > MAX_BYTES:
        raise ModelUnfitError(
            f"{path.name}: larger than {MAX_BYTES} bytes; this device loads small models only"
        )
    return data


def packaged(path: Path) -> Vouched:
    """A file of the package, vouched for by its manifest.

    Raises
    ------
    ModelMissingError, ModelTrustError, ModelUnfitError
        It is not there, not in the manifest, or not what the manifest says.
    """
    data = read_bytes(path)
    if not _in_manifest(path, data):
        raise ModelTrustError(f"{path.name}: not in {MANIFEST}; reinstall the package")
    return Vouched(data, "the package")


def vouched(path: Path, settings: ModelsConfig) -> Vouched:
    """A file of a person's, vouched for by the signature of its manifest or of itself.

    Raises
    ------
    ModelMissingError, ModelUnfitError
        It cannot be read.
    ModelTrustError
        It is not what the manifest says, or signed by no trusted key where that is required.
    """
    data = read_bytes(path)
    listed = _in_manifest(path, data)
    signed = [path.with_name(path.name + ".sig")]
    if listed:
        signed.append(path.with_name(SIGNATURE))
    said, found = UNSIGNED, False
    for place in signed:
        if not place.is_file():
            continue
        found = True
        about = read_bytes(path.with_name(MANIFEST)) if place.name == SIGNATURE else data
        try:
            key = manifest.signed_by(about, read_bytes(place), settings.public_keys)
        except SetError as error:
            raise ModelTrustError(str(error)) from error
        if key:
            return Vouched(data, f"key {manifest.fingerprint(key)}")
        said = f"signed by none of the {len(settings.public_keys)} models.public_keys"
    if settings.signed_only:
        raise ModelTrustError(
            f"{path.name}: {said if found else 'unsigned, and a signature is required'}; sign it "
            "(`orbitd keys sign`), or trust its maker's key (`orbitd keys trust`)"
        )
    return Vouched(data, said)


def _in_manifest(path: Path, data: bytes) -> bool:
    """Whether the manifest beside ``path`` names it; what it says of it must then hold."""
    beside = path.with_name(MANIFEST)
    if not beside.is_file():
        return False
    try:
        entry = manifest.read_manifest(read_bytes(beside), MANIFEST).files.get(path.name)
    except SetError as error:
        raise ModelTrustError(f"{path.name}: {error}") from error
    if entry is None:
        return False
    if wrong := manifest.unlike(entry, data):
        raise ModelTrustError(
            f"{path.name}: {wrong}; reinstall the package, or write the manifest of the set again"
        )
    return True
