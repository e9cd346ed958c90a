"""Numbers for people."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def digits(values: Iterable[float], count: int = 3) -> str:
    """Return numbers in brackets, with so many digits behind the point."""
    rounded = np.round(np.asarray(values, dtype=float), count) + 0.0  # no "-0"
    return f"[{' '.join(f'{value:.{count}f}' for value in rounded)}]"
