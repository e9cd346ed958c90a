"""A progress bar on long work."""

from __future__ import annotations

import sys
from typing import Any


class _Silent:
    """Stands in where nobody looks."""

    n = 0

    def update(self, by: float = 1) -> None:
        """Count nothing."""

    def __enter__(self) -> _Silent:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def progress(total: float, text: str, unit: str) -> Any:
    """Return a bar on the terminal's standard error, to be used with `with`; it shows itself after half a second."""
    if not getattr(sys.stderr, "isatty", bool)():  # there may be none, or what stands in for it
        return _Silent()
    from tqdm import tqdm  # which takes its time

    return tqdm(total=total, desc=text, unit=unit, unit_scale=True, delay=0.5, leave=False)
