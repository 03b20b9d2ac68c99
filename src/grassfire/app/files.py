"""Output files: all of them or none."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from grassfire.errors import InputError


def check_folder(folder: Path) -> None:
    """Refuse, before any work, a folder that could not be written to."""
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError("is not a folder", source=str(nearest), remedy="choose another --out")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            "the output folder cannot be written",
            source=str(folder),
            remedy="choose another --out or change its permissions",
        )


def write_files(texts: Mapping[Path, str | bytes]) -> None:
    """Write all files or none: temporary neighbours first, then one rename for each.

    Raises
    ------
    InputError
        If a file cannot be written; the ones that stood there before are untouched then.
    """
    temporary: dict[Path, Path] = {}
    path = Path()
    try:
        for path, text in texts.items():
            if path.is_dir():
                raise IsADirectoryError(0, "is a folder")
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary[path] = path.with_name(f".{path.name}.{os.getpid()}.tmp")
            data = text.encode("utf-8") if isinstance(text, str) else text
            temporary[path].write_bytes(data)
        for path, neighbour in temporary.items():
            neighbour.replace(path)
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror or 'unknown reason'}",
            source=str(path),
            remedy="choose another place for the output",
        ) from error
    finally:
        for neighbour in temporary.values():
            neighbour.unlink(missing_ok=True)
