"""Files that scripts and commands write."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from frankapy.exceptions import FrankaArmArgumentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def writing_to(path: str | Path) -> Iterator[None]:
    """Raise FrankaArmArgumentError where that file or folder cannot be written inside."""
    try:
        yield
    except OSError as error:
        raise FrankaArmArgumentError(f"{path} cannot be written: {os.strerror(error.errno) if error.errno else error}") from None


def write_file(path: str | Path, data: bytes) -> None:
    """Write a file; raises FrankaArmArgumentError where that cannot be."""
    with writing_to(path):
        Path(path).write_bytes(data)


def require_writable(path: Path) -> None:
    """Raise FrankaArmArgumentError for a file that cannot be written, before what is to be in it is made."""
    folder = path.parent
    with writing_to(path):  # whose folder this user may not even look into
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
    with writing_to(path):
        figure.savefig(path, dpi=dpi)
