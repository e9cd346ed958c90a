"""The protobuf messages between client and server: kinds of trajectory, controller and termination, states, requests; and
those between a script and a simulated arm.

They are made of wire/proto by the build; units, sizes, ranges and defaults are written there.
"""

try:
    from frankapy.proto import reprs  # noqa: F401
    from frankapy.proto import sensors_pb2 as sensor_msg_pb2
    from frankapy.proto.controllers_pb2 import *  # noqa: F403
    from frankapy.proto.endings_pb2 import *  # noqa: F403
    from frankapy.proto.keys_pb2 import *  # noqa: F403
    from frankapy.proto.limits_pb2 import *  # noqa: F403
    from frankapy.proto.published_parameters import *  # noqa: F403
    from frankapy.proto.sensors_pb2 import *  # noqa: F403
    from frankapy.proto.service_pb2 import *  # noqa: F403
    from frankapy.proto.simulation_pb2 import *  # noqa: F403
    from frankapy.proto.skill_pb2 import *  # noqa: F403
    from frankapy.proto.state_pb2 import *  # noqa: F403
    from frankapy.proto.terminations_pb2 import *  # noqa: F403
    from frankapy.proto.trajectories_pb2 import *  # noqa: F403
    from frankapy.proto.walls_pb2 import *  # noqa: F403
except ModuleNotFoundError as error:
    if error.name is None or not error.name.startswith("frankapy.proto."):
        raise
    raise ImportError(f"{error.name} is not there: the build makes it. Run `make build` in the repository.") from error
