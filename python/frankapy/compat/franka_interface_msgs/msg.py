"""Messages between scripts, arms and their hands."""

from frankapy.ros_messages import Errors, RobotState, SensorData, SensorDataGroup

__all__ = ["Errors", "RobotState", "SensorData", "SensorDataGroup"]
