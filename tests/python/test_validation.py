"""Rules of the messages in the client; that the server has the same is shown in test_refusals.py."""

import numpy as np
import pytest
from google.protobuf.struct_pb2 import Struct
from google.protobuf.timestamp_pb2 import Timestamp

from frankapy import FrankaArmArgumentError, proto
from frankapy.validation import number, validate, vector

Q = [0.0] * 7
UPRIGHT = [1.0, 0, 0, 0]

BAD = [
    (proto.MinJerkJoint(), "MinJerkJoint.q has 0 elements: expected 7"),
    (proto.MinJerkJoint(q=[0] * 6), "MinJerkJoint.q has 6 elements: expected 7"),
    (proto.MinJerkJoint(q=[0, 0, float("nan"), 0, 0, 0, 0]), r"MinJerkJoint.q\[2\] is nan"),
    (proto.MinJerkJoint(q=[0, 0, 0, 0, 0, 0, float("-inf")]), r"MinJerkJoint.q\[6\] is -inf"),
    (proto.MinJerkJoint(q=Q, duration=0), "MinJerkJoint.duration is 0 s: expected 0.001 to 3600 s"),
    (proto.MinJerkJoint(q=Q, duration=float("nan")), "MinJerkJoint.duration is nan"),
    (proto.RelativeMinJerkJoint(), "RelativeMinJerkJoint.delta_q has 0 elements"),
    (proto.MinJerkPose(position=[0.3, 0, 0.5]), "MinJerkPose.quaternion has 0 elements: expected 4"),
    (proto.MinJerkPose(position=[0.3, 0], quaternion=UPRIGHT), "MinJerkPose.position has 2 elements"),
    (proto.MinJerkPose(position=[0.3, 0, 2.5], quaternion=UPRIGHT), r"position\[2\] is 2.5 m: expected -2 to 2 m"),
    (proto.MinJerkPose(position=[0.3, 0, 0.5], quaternion=[1, 1, 0, 0]), "norm 1.41421: expected a unit quaternion"),
    (proto.RelativeMinJerkPose(translation=[0, 0, 0], quaternion=[0] * 4), "norm 0: expected a unit quaternion"),
    (proto.JointImpedance(stiffness=[4000] * 7), r"stiffness\[0\] is 4000 N m/rad: expected 0 to 3000 N m/rad"),
    (proto.CartesianImpedance(damping_ratio=-1), "damping_ratio is -1: expected 0.1 to 3"),
    (proto.CartesianImpedance(translational_stiffness=[1, 2]), "has 2 elements: expected 3"),
    (proto.InternalImpedance(K_x=[0.5] * 6), r"K_x\[0\] is 0.5 N/m, N m/rad: expected 1 to 3000"),
    (proto.Time(seconds=-1), "Time.seconds is -1 s: expected 0 to 1000000000 s"),
    (proto.FinalPose(orientation_threshold=4), "orientation_threshold is 4 rad: expected 0 to 3.2 rad"),
    (proto.GripperCommand(move=proto.GripperCommand.Move()), "Move.width is missing"),
    (proto.GripperCommand(grasp=proto.GripperCommand.Grasp(width=0.2)), "Grasp.width is 0.2 m: expected 0 to 0.1 m"),
]

GOOD = [
    proto.MinJerkJoint(q=Q),
    proto.RelativeMinJerkPose(translation=[0, 0, 0.1]),
    proto.JointImpedance(),
    proto.CartesianImpedance(),
    proto.InternalImpedance(),
    Timestamp(seconds=1),  # of proto3: has no presence
    Struct(fields={}),  # with a map
    proto.FinalJoint(),
    proto.Time(after_trajectory=0),
]


@pytest.mark.parametrize(("message", "text"), BAD, ids=[text for _, text in BAD])
def test_a_broken_rule_is_named(message, text):
    with pytest.raises(FrankaArmArgumentError, match=text):
        validate(message)


@pytest.mark.parametrize("message", GOOD, ids=lambda message: message.DESCRIPTOR.name)
def test_defaults_keep_the_rules(message):
    validate(message)


@pytest.mark.parametrize("value", [3, 3.0, np.float32(3), np.float64(3), np.int64(3), np.array(3.0)])
def test_every_real_number_is_one(value):
    assert number("duration", value) == 3


@pytest.mark.parametrize("value", [None, "3", [3], float("nan"), np.inf, {}, 1j])
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises(ValueError, match=f"duration is {value if value is None else ''}"):
        number("duration", value)


@pytest.mark.parametrize("value", [[1, 2, 3], (1, 2, 3), np.array([1, 2, 3], np.float32), range(1, 4)])
def test_every_array_of_the_right_length_is_one(value):
    np.testing.assert_array_equal(vector("joints", value, 3), [1, 2, 3])


@pytest.mark.parametrize(
    "value", [None, 3, [1, 2], [[1, 2, 3]], "abc", [1, 2, "x"], [1, 2, np.nan], [1, [2], 3], [1, 2, None]]
)
def test_what_is_no_such_array_is_refused_by_name(value):
    with pytest.raises(ValueError, match="joints"):
        vector("joints", value, 3)
