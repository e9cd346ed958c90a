"""The module that pickled poses name."""

from frankapy.rigid_transform import Point, RigidTransform

__all__ = ["Point", "RigidTransform"]
