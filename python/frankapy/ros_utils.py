"""What of the published interface is shown in rviz, where scripts run with ROS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from frankapy import collision_boxes
from frankapy.collision_boxes import as_box
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.franka_constants import FrankaConstants as FC
from frankapy.poses import quaternion


class BoxesPublisher:
    """Shows boxes in rviz, where scripts run with ROS; elsewhere they are checked, and nobody is there to look."""

    def __init__(self, name: str, world_frame: str = "panda_link0") -> None:
        """Publish under the topic `name`, in the frame `world_frame`."""
        self.name = name
        self.world_frame = world_frame
        try:
            import rospy
            from visualization_msgs.msg import MarkerArray

            self._publisher = rospy.Publisher(name, MarkerArray, queue_size=10)
        except ImportError:
            self._publisher = None

    def publish_boxes(self, boxes: Sequence[Any]) -> None:
        """Publish rows of 9 (centre, roll, pitch, yaw, size) or 10 numbers (centre, quaternion w, x, y, z, size); m, rad."""
        rows = [np.asarray(box, dtype=float) for box in boxes]
        for row in rows:
            if row.shape not in ((9,), (10,)):
                raise FrankaArmArgumentError(f"Invalid format for box! It has the shape {row.shape}: expected (9,) or (10,)")
        if self._publisher is None:
            return
        import rospy
        from visualization_msgs.msg import Marker, MarkerArray

        markers = []
        for i, row in enumerate(rows):
            marker = Marker()
            marker.type, marker.id = Marker.CUBE, i
            marker.header.frame_id, marker.header.stamp = self.world_frame, rospy.Time.now()
            place, turn, size = marker.pose.position, marker.pose.orientation, marker.scale
            pose, (size.x, size.y, size.z) = as_box(row)
            place.x, place.y, place.z = pose[:3, 3]
            turn.w, turn.x, turn.y, turn.z = quaternion(pose)
            grey = marker.color
            grey.r, grey.g, grey.b, grey.a = 0.5, 0.5, 0.5, 0.6
            markers.append(marker)
        self._publisher.publish(MarkerArray(markers))


def publish_joints(joints: np.ndarray, robot_num: int) -> None:
    """Publish joints (rad, (7,)) for rviz, under franka_virtual_joints_<number of the arm>; without ROS nobody would look."""
    try:
        import rospy
        from sensor_msgs.msg import JointState
    except ImportError:
        return
    message = JointState()
    message.header.stamp = rospy.Time.now()
    message.name, message.position = list(FC.JOINT_NAMES), [*joints.tolist(), 0.0, 0.0]
    rospy.Publisher(f"franka_virtual_joints_{robot_num}", JointState, queue_size=10).publish(message)


def publish_arm_boxes(joints: np.ndarray, robot_num: int) -> None:
    """Publish the arm's boxes at `joints` (rad, (7,)) for rviz, under franka_collision_boxes_<number of the arm>."""
    poses = collision_boxes.poses_at(joints)
    boxes = [np.r_[pose[:3, 3], quaternion(pose), size] for pose, size in zip(poses, collision_boxes.SHAPES, strict=True)]
    BoxesPublisher(f"franka_collision_boxes_{robot_num}").publish_boxes(boxes)
