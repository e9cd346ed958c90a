"""Files that scripts and commands write."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from frankapy.exceptions import FrankaArmArgumentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def not_written(path: Path, error: OSError) -> FrankaArmArgumentError:
    """Return what to raise where a file cannot be written."""
    return FrankaArmArgumentError(f"{path} cannot be written: {os.strerror(error.errno) if error.errno else error}")


def write_file(path: str | Path, data: bytes) -> None:
    """Write a file; raises FrankaArmArgumentError where that cannot be."""
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise not_written(Path(path), error) from None


def require_writable(path: Path) -> None:
    """Raise FrankaArmArgumentError for a file that cannot be written, before what is to be in it is made."""
    folder = path.parent
    if not folder.is_dir():
        raise FrankaArmArgumentError(f"{path} cannot be written: there is no folder {folder}. Make it, or name another file")
    if path.is_dir():
        raise FrankaArmArgumentError(f"{path} is a folder: expected the name of a file")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise FrankaArmArgumentError(f"{path} cannot be written: this user may not. Name another file")


def require_picture(path: Path) -> None:
    """The same for a file that a picture is to be in; its name says of what kind."""
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise FrankaArmArgumentError(f"{path}: expected a name that ends in .png, .pdf or .svg")
    require_writable(path)


def write_picture(figure: Figure, path: Path, dpi: int) -> None:
    """Write a picture; raises FrankaArmArgumentError where that cannot be."""
    require_picture(path)
    try:
        figure.savefig(path, dpi=dpi)
    except OSError as error:
        raise not_written(path, error) from None
