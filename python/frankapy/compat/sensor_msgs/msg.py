"""The state of joints."""

from frankapy.ros_messages import JointState

__all__ = ["JointState"]
