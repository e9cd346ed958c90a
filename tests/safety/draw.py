"""Random parts, sensor messages, walls and pushes: valid by the rules of wire/proto, and about where the arm is.

Kinds are those of frankapy.parts, so a new one is drawn from then on. What its rules do not say (that one number is less than
another, that tables have the same rows) is drawn by the names and units of fields; a part whose fields need more is refused
by the server now and then, and that is no harm.
"""

import contextlib
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from google.protobuf.any_pb2 import Any as AnyMessage
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message

from frankapy import FrankaArmArgumentError, FrankaConstants, RigidTransform, proto
from frankapy.parts import describe, kinds, make, robot_controllers
from frankapy.proto import rules_pb2, sensors_pb2
from frankapy.validation import is_repeated, rule_of, validate
from frankapy.walls import Box, Capsule, Cylinder, Mesh, Plane, Sphere

HOME = np.array(FrankaConstants.HOME_JOINTS)
TOPIC = "campaign"
TRIES = 20
LONGEST = 1.5  # s of a skill that nobody stops
# The most that is drawn of a unit whose rule leaves more, or nothing.
CAPS = {"s": 1, "N": 30, "N m": 10, "m": 0.3, "rad": 0.5, "m/s": 0.5, "rad/s": 1.5, "m/s^2": 3, "rad/s^2": 8, "N m/rad": 3000}
PAIR_CAPS = CAPS | {"N m": 3, "rad/s": 1, "N m/rad": 300}  # of "one, other", which are linear and angular
# Movement primitives: their rules leave any number.
PRIMITIVE = {"tau": (0.5, 3), "alpha": (30, 250), "beta": (8, 60), "mu": (0, 1), "h": (5, 100), "weights": (-0.25, 0.25)}
# Of the robot's own laws: softer, it throws the arm past the limits that its reference keeps to.
FIRM = {"K_theta": ([500] * 7, [3000] * 7), "K_x": ([1000] * 3 + [100] * 3, [3000] * 3 + [300] * 3)}
SOFTER = 0.2  # that of an orientation, whose time is a part of the duration
SAMPLES = 10_000  # rows from which on a table is of one sample for each ms
_T = TypeVar("_T")
_DESCRIPTIONS = {kind.name: kind for kind in describe()}


class Draw:
    """Draws about a posture `q` (rad, (7,)) and the pose of EE there, inside and beyond the range `q_range` ((2, 7), rad)."""

    def __init__(self, seed: Sequence[int], q_range: np.ndarray, q: np.ndarray, pose: RigidTransform) -> None:
        self._random = np.random.default_rng(seed)
        self._range = q_range
        self.q, self.pose = q, pose

    # --- numbers ---

    def one(self, choices: Sequence[_T]) -> _T:
        return choices[self._random.integers(len(choices))]

    def chance(self, probability: float) -> bool:
        return bool(self._random.random() < probability)

    def uniform(self, least: float, most: float) -> float:
        return float(self._random.uniform(least, most))

    def direction(self) -> np.ndarray:
        vector = self._random.normal(size=3)
        return vector / np.linalg.norm(vector)

    # --- skills ---

    def skill(self, torque: bool = False, led: bool = True) -> dict:
        """Arguments of FrankaArm.run.

        `torque`: in which our torques hold the arm, alone or beside a motion; `led`: also those in which it may be led.
        """
        controllers = [descriptor for _, descriptor in kinds("controller") if led or not is_led(descriptor.name)]

        def modes(trajectory: Descriptor, controller: Descriptor) -> list[str]:
            fitting = robot_controllers(trajectory.name, controller.name)
            return [name for name in fitting if name.startswith("torque")] if torque else fitting

        trajectory = self.one([descriptor for _, descriptor in kinds("trajectory")])
        controller = self.one([each for each in controllers if modes(trajectory, each)])
        fitting = modes(trajectory, controller)
        ends = [make("Time", seconds=self.uniform(0.1, LONGEST))]
        if self.chance(0.4):
            judging = [d for _, d in kinds("termination") if trajectory.name in _DESCRIPTIONS[d.name].fits]
            ends.insert(0, self.part(self.one(judging)))
        # Forces, and the like, leave torque alone.
        robot_controller = self.one([*fitting, *["torque"] * len(fitting)] if "torque" in fitting else fitting)
        if isinstance(ends[0], proto.Contact) and self.chance(0.7):
            endings = [d for _, d in kinds("ending") if d.name != "Comply" or robot_controller == "torque"]
            ends[0].then.Pack(self.part(self.one(endings)))
        law = self.part(controller)
        if isinstance(law, proto.InternalImpedance) and robot_controller in ("joint_position", "joint_velocity"):
            law.ClearField("K_x")  # by which an elbow is held by nothing: however firm, it is left behind and thrown
        return {
            "trajectory": self.part(trajectory),
            "controller": law,
            "until": ends,
            "robot_controller": robot_controller,
            "speed": self.one([1, 1, 1, self.uniform(0.1, 1)]),
        }

    def change(self, skill: dict, led: bool = True) -> dict:
        """Arguments of FrankaArm.change for that skill: mostly the same kinds with other numbers, so that they fit."""
        other = self.skill(led=led)
        if self.chance(0.8):
            other |= {role: self.part(skill[role].DESCRIPTOR) for role in ("trajectory", "controller")}
        roles = [role for role in ("trajectory", "controller", "until") if self.chance(0.5)] or ["controller"]
        return {role: other[role] for role in roles}

    def part(self, descriptor: Descriptor) -> Message:
        """A part that is valid by its rules."""
        for _ in range(TRIES):
            message = self._message(descriptor)
            with contextlib.suppress(FrankaArmArgumentError):
                validate(message)
                return message
        raise ValueError(f"{TRIES} draws of {descriptor.name} are against its rules: draw.py has to know its fields")

    def sensor_messages(self) -> list[Message]:
        """One of each kind that a part may take, in any order; those that it does not are refused by the server."""
        found = [
            self.part(descriptor)
            for descriptor in sensors_pb2.DESCRIPTOR.message_types_by_name.values()
            if descriptor.name != "SensorMessage" and any(_has_rule(field) for field in descriptor.fields)
            if descriptor.name != "ShouldTerminateSensorMessage" or self.chance(0.02)
        ]
        self._random.shuffle(found)  # type: ignore[arg-type]
        return found

    # --- surroundings ---

    def wall(self) -> proto.Wall:
        """A body near the hand, or somewhere within reach; or a plane, with what is around home before it; or what the hand holds."""
        if self.chance(0.15):
            return self.held()
        angle, height = self.uniform(-np.pi, np.pi), self.uniform(0, 1.1)
        place = np.array([0, 0, height]) + self.uniform(0.3, 0.9) * np.array([np.cos(angle), np.sin(angle), 0])
        if self.chance(0.7):
            place = self.pose.translation + self.uniform(0.1, 0.35) * self.direction()
        pose = RigidTransform(RigidTransform.rotation_from_axis_angle(self.uniform(0, np.pi) * self.direction()), place)
        size = np.exp(self._random.uniform(np.log(0.01), np.log(0.4), 3))  # thin ones too
        return self.one(
            [
                lambda: Plane(np.array([0.2, 0, 0.5]) - place + 0.1 * self.direction(), place),
                lambda: Box(size, pose),
                lambda: Sphere(size[0], place),
                lambda: Cylinder(size[0], size[1], pose),
                lambda: Capsule(size[0], size[1], pose),
                lambda: Mesh(np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]]) * size, [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]], pose),
            ]
        )()

    def held(self) -> proto.Wall:
        """A stick in the hand, more or less along its z."""
        turn = RigidTransform.rotation_from_axis_angle(self.uniform(0, 0.6) * self.direction())
        length = self.uniform(0.05, 0.3)
        stick = Capsule(self.uniform(0.005, 0.03), length, RigidTransform(turn, [0, 0, 0.1] + turn[:, 2] * length / 2))
        stick.held = True
        return stick

    def push(self) -> dict:
        """Arguments of ControlChannel.push: up to 30 N, at the hand or a link."""
        force = self.uniform(5, 30) * self.direction()
        return {"wrench": [*force, 0, 0, 0], "duration": self.uniform(0.1, 1), "link": self.one([None, None, 4, 5, 6, 7])}

    # --- by the rules ---

    def _message(self, descriptor: Descriptor) -> Message:
        message: Message = getattr(proto, descriptor.name)()
        fields = list(descriptor.fields)
        left_out = [field for field in fields if _may_be_left_out(field)]
        # Of those that stand for each other at most one is given; where there are no others, one is.
        given = self.one(left_out) if left_out and (len(left_out) == len(fields) or self.chance(0.5)) else None
        self._rows, self._basis = int(self._random.integers(2, 6)), int(self._random.integers(2, 4))
        if any(rule_of(field).max_rows > SAMPLES for field in fields):
            self._rows = int(self._random.integers(100, 400))
        for field in sorted(fields, key=_comes_first):
            rule = rule_of(field)
            if field.message_type is not None and not is_repeated(field):
                continue  # what comes after a contact: skill() draws it
            if _may_be_left_out(field) and field is not given:
                continue
            if _has_default(field) and field.name != "duration" and self.chance(0.4):
                continue
            if field.message_type is not None:
                parts = [d for _, d in kinds("termination") if d.name not in ("AnyOf", "AllOf")]
                for _ in range(self._random.integers(1, 4)):
                    packed: AnyMessage = getattr(message, field.name).add()
                    packed.Pack(self.part(self.one(parts)))
            elif field.enum_type is not None:
                setattr(message, field.name, self.one(list(field.enum_type.values_by_number)))
            elif field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
                setattr(message, field.name, TOPIC)
            elif field.cpp_type == FieldDescriptor.CPPTYPE_BOOL:
                setattr(message, field.name, self.chance(0.4))
            elif is_repeated(field):
                getattr(message, field.name).extend(map(float, self._numbers(message, field)))
            elif rule.ByteSize():
                setattr(message, field.name, float(self._numbers(message, field)[0]))
        for names, both in (("position_only", "orientation_only"), True), (("cartesian", "joint"), False):
            if all(name in descriptor.fields_by_name and getattr(message, name) == both for name in names):
                setattr(message, self.one(names), not both)  # they exclude each other, or one of them there has to be
        return message

    def _numbers(self, message: Message, field: FieldDescriptor) -> np.ndarray:
        rule = rule_of(field)
        name = field.name
        stem = name.removeprefix("position_").removeprefix("quat_")
        rows = self._rows if rule.row or (is_repeated(field) and not rule.size) else 1
        if stem == "initial_sensor_values":
            return self._random.uniform(0.5, 1.5, self._sensor_values(message))
        if stem in PRIMITIVE:
            count = 1 if not is_repeated(field) else self._basis * (self._dimensions(message, name) if stem == "weights" else 1)
            share = SOFTER if name.startswith("quat_") and stem in ("alpha", "beta") else 1
            return share * self._random.uniform(*PRIMITIVE[stem], count)
        if stem in FIRM:
            return self._random.uniform(*FIRM[stem])
        if rule.unit_norm or stem == "quaternions":
            return self._quaternions(rows, relative=bool(rule.initial))
        if rule.unit == "rad" and (rule.size == 7 or rule.row == 7 or stem == "joints") and not rule.HasField("min"):
            return self._joints(rows, difference=name.startswith("delta"), samples=rule.max_rows > SAMPLES)
        if rule.unit == "m" and stem in ("position", "positions"):
            return self._positions(rows, samples=rule.max_rows > SAMPLES)
        if rule.unit == "m" and stem in ("lower", "upper"):
            away = self._random.uniform(0.02, 0.3, 3)
            return self.pose.translation + (away if stem == "upper" else -away)
        if stem == "pose":
            return RigidTransform(self.pose.rotation, self._positions(1)).matrix.T.ravel()
        if stem == "axis":
            return self.direction()
        if stem == "times":
            return np.cumsum(self._random.uniform(0.05, 0.4, rows))
        if stem == "acc_duration" or (stem.endswith("_time") and "duration" in message.DESCRIPTOR.fields_by_name):
            return np.array([self.uniform(0.1, 0.5) * message.duration])  # type: ignore[attr-defined]
        if stem == "force" and "force_axes" in message.DESCRIPTOR.fields_by_name:  # elsewhere there is motion
            return self._ranged(field, 6) * (list(message.force_axes) or np.zeros(6))  # type: ignore[attr-defined]
        return self._ranged(field, rule.size or (rows if is_repeated(field) else 1))

    def _ranged(self, field: FieldDescriptor, count: int) -> np.ndarray:
        rule = rule_of(field)
        units = rule.unit.split(", ") if count == 6 else [rule.unit]
        caps = PAIR_CAPS if len(units) > 1 else CAPS
        most_known = rule.max if rule.HasField("max") else 1.0
        cap = np.repeat([caps.get(unit, most_known) for unit in units], count // len(units))
        least = rule.min if rule.HasField("min") else -np.inf
        most = rule.max if rule.HasField("max") else np.inf
        default = np.array(rule.initial if len(rule.initial) == count else [field.default_value or 0] * count, dtype=float)
        if "0:" in rule.unit:  # 0 and 1 stand for something
            values = self._random.integers(0, 2, count).astype(float)
        elif (default > 0).all() and rule.unit != "s":
            values = np.minimum(default * np.exp(self._random.uniform(-1.2, 1.2, count)), cap)
        else:
            lowest = 0.02 if rule.unit == "s" else -cap
            values = self._random.uniform(np.maximum(least, lowest), np.minimum(most, cap))
        return np.clip(values, least, most)

    def _joints(self, rows: int, difference: bool = False, samples: bool = False) -> np.ndarray:
        if difference:
            return self._random.uniform(-0.4, 0.4, 7)
        reach = self.one([0.2, 0.5, 1.0])
        middle = self.one([self.q, HOME, HOME])
        goal = middle + self._random.uniform(-reach, reach, 7)
        if not self.chance(0.1):  # else beyond the range as well
            goal = np.clip(goal, self._range[0] + 0.05, self._range[1] - 0.05)
        if samples:
            return (self.q + _fraction(rows) * 0.1 * (goal - self.q)).ravel()
        steps = np.linspace(0, 1, rows + 1)[1:, None] if rows > 1 else np.ones((1, 1))
        return (self.q + steps * (goal - self.q)).ravel()

    def _positions(self, rows: int, samples: bool = False) -> np.ndarray:
        reach = self.one([0.08, 0.25, 0.5])
        goal = self.one([self.pose.translation, FrankaConstants.HOME_POSE.translation]) + self._random.uniform(-reach, reach, 3)
        began = self.pose.translation
        if samples:
            return (began + _fraction(rows) * 0.1 * (goal - began)).ravel()
        steps = np.linspace(0, 1, rows + 1)[1:, None] if rows > 1 else np.ones((1, 1))
        return (began + steps * (goal - began)).ravel()

    def _quaternions(self, rows: int, relative: bool) -> np.ndarray:
        rotation = np.eye(3) if relative else self.pose.rotation
        if rows <= 10:
            rotation = RigidTransform.rotation_from_axis_angle(self.one([0, 0.2, 1]) * self.direction()) @ rotation
        return np.tile(RigidTransform(rotation).quaternion, rows)

    def _sensor_values(self, message: Message) -> int:
        dimensions = self._dimensions(message, "weights" if "weights" in message.DESCRIPTOR.fields_by_name else "position_weights")
        return 1 if dimensions == 7 else dimensions  # of one sensor

    @staticmethod
    def _dimensions(message: Message, name: str) -> int:
        if message.DESCRIPTOR in [descriptor for _, descriptor in kinds("trajectory") if "Joint" in descriptor.name]:
            return 7
        flags = ("position_only", "orientation_only")
        single = any(flag in message.DESCRIPTOR.fields_by_name and getattr(message, flag) for flag in flags)
        return 3 if single or name != "weights" else 6


def is_led(controller: str) -> bool:
    """Whether under this kind of controller the arm goes where it is pulled, and to no reference."""
    descriptor = next(descriptor for _, descriptor in kinds("controller") if descriptor.name == controller)
    return bool(descriptor.GetOptions().Extensions[rules_pb2.kind].law == rules_pb2.KindRule.TORQUE_ALONE)


def _fraction(samples: int) -> np.ndarray:
    """A minimum-jerk rise from 0 to 1, (samples, 1)."""
    s = np.linspace(0, 1, samples)[:, None]
    return s**3 * (10 - 15 * s + 6 * s**2)


def _has_default(field: FieldDescriptor) -> bool:
    return bool(rule_of(field).initial) or (not is_repeated(field) and field.has_default_value)


def _has_rule(field: FieldDescriptor) -> bool:
    return rule_of(field).ByteSize() > 0


def _may_be_left_out(field: FieldDescriptor) -> bool:
    """Whether its being there means something."""
    flags = field.enum_type is not None or field.cpp_type == FieldDescriptor.CPPTYPE_BOOL
    return not (rule_of(field).required or _has_default(field) or flags or field.message_type is not None)


def _comes_first(field: FieldDescriptor) -> int:
    """Order of fields: those on which others depend come first."""
    return 0 if field.cpp_type == FieldDescriptor.CPPTYPE_BOOL else 1 if field.name == "duration" else 2
