"""Poses and points of autolab_core: of the real one where it is installed, else frankapy's own."""

import importlib.machinery
import importlib.util
import sys
from pathlib import Path

_here = Path(__file__).resolve().parent.parent
_spec = importlib.machinery.PathFinder.find_spec(__name__, [path for path in sys.path if Path(path).resolve() != _here])
if _spec is not None and _spec.loader is not None:
    _real = importlib.util.module_from_spec(_spec)
    sys.modules[__name__] = _real
    _spec.loader.exec_module(_real)
else:
    from frankapy.rigid_transform import Point, RigidTransform

    __all__ = ["Point", "RigidTransform"]
