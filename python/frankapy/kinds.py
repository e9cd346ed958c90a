"""What skills are made of: the kinds of trajectory, controller and termination, what fits, and their messages, checked."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from google.protobuf import descriptor_pb2, descriptor_pool
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message

from frankapy import proto
from frankapy.exceptions import FrankaArmArgumentError
from frankapy.proto import controllers_pb2, endings_pb2, rules_pb2, terminations_pb2, trajectories_pb2
from frankapy.validation import is_repeated, number, numbers, rule_of, table, validate, vector

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_ANY = "google.protobuf.Any"
_FILES = {
    "trajectory": trajectories_pb2,
    "controller": controllers_pb2,
    "termination": terminations_pb2,
    "ending": endings_pb2,
}
_RULE = rules_pb2.KindRule
_MOTIONS = {
    _RULE.JOINTS: ["joint_position", "joint_velocity"],
    _RULE.POSES: ["cartesian_pose", "cartesian_velocity"],
}


@dataclass(frozen=True)
class Kind:
    """A kind of part, for people and programs; wire/proto says the same to the server."""

    role: str  # "trajectory", "controller", "termination" or "ending"
    name: str
    fields: dict[str, str]  # unit, size, range and default of each
    fits: dict[str, list[str]]  # controllers for a trajectory, trajectories for others, each with its robot controllers
    loaded: bool = False  # from a library, by the server

    def __str__(self) -> str:
        """Return name and fields, a line each."""
        title = self.name + " (loaded by the server)" * self.loaded
        return "\n".join([title, *(f"  {name:24}{text}" for name, text in self.fields.items())])


class Pose(Protocol):
    """What stands for position and quaternion: a RigidTransform, for one."""

    @property
    def translation(self) -> Any:
        """Return the position, m, (3,)."""

    @property
    def quaternion(self) -> Any:
        """Return the orientation, w, x, y, z."""


@dataclass(frozen=True)
class _Part:
    role: str
    descriptor: Descriptor
    rule: rules_pb2.KindRule | None  # not known of a kind from a library that does not say it
    loaded: bool

    @property
    def name(self) -> str:
        return self.descriptor.full_name if self.loaded else self.descriptor.name


def describe(role: str | None = None, loaded: proto.LoadedKinds | None = None) -> list[Kind]:
    """Return all kinds, or those of a role, and behind them those that a server has loaded.

    What one of these fits is as its message says, `option (frankapy.proto.kind)`; where that is missing it is not known.
    """
    found = [_Part(each, descriptor, _kind_rule(descriptor.name), False) for each, descriptor in kinds()]
    found += _loaded_parts(loaded) if loaded else []
    found.sort(key=lambda part: list(_FILES).index(part.role))
    return [
        Kind(
            part.role,
            part.name,
            {field.name: text_of(field, _rule_in_pool(field) if part.loaded else None) for field in part.descriptor.fields},
            _fits(part, found),
            part.loaded,
        )
        for part in found
        if role in (None, part.role)
    ]


def _loaded_parts(loaded: proto.LoadedKinds) -> list[_Part]:
    # A pool of their own: what the server has loaded need not be what this program has imported under the same name.
    pool = descriptor_pool.DescriptorPool()
    for file in loaded.files:
        for name in file.dependency:
            _add_known(pool, name)
        pool.Add(file)
    parts = []
    for each in loaded.kinds:
        descriptor = pool.FindMessageTypeByName(each.name)
        options: Any = descriptor_pb2.MessageOptions.FromString(descriptor.GetOptions().SerializeToString())
        rule = options.Extensions[rules_pb2.kind] if options.HasExtension(rules_pb2.kind) else None
        parts.append(_Part(each.role, descriptor, rule, True))
    return parts


def _add_known(pool: descriptor_pool.DescriptorPool, name: str) -> None:
    """Give a pool the file of that name that this package has, and what it imports."""
    try:
        file = descriptor_pool.Default().FindFileByName(name)
    except KeyError:
        return  # one of the server's
    for each in file.dependencies:
        _add_known(pool, each.name)
    pool.AddSerializedFile(file.serialized_pb)


def _rule_in_pool(field: FieldDescriptor) -> rules_pb2.FieldRule:
    """Return the rule of a field whose options are of another pool than ours."""
    options: Any = descriptor_pb2.FieldOptions.FromString(field.GetOptions().SerializeToString())
    return options.Extensions[rules_pb2.rule]


def robot_controllers(trajectory: str, controller: str) -> list[str]:
    """Return the robot controllers in which these two kinds run together, the one that "auto" takes first; none: they do not.

    A controller's parameters may leave fewer: one that is to exert a force along an axis runs in torque alone.
    """
    return _together(_kind_rule(trajectory), _kind_rule(controller))


def _together(emits: rules_pb2.KindRule | None, law: rules_pb2.KindRule | None) -> list[str]:
    if emits is None or law is None or len(emits.references) != 1:
        return []
    if not set(emits.efforts) <= set(law.efforts):
        return []
    (reference,) = emits.references
    motions = _MOTIONS[reference]
    follows = not law.references or reference in law.references
    if law.law == _RULE.ROBOTS_OWN:
        return motions
    if law.law == _RULE.TORQUE_ALONE:
        return ["torque"]
    if follows:
        return ["torque", *(f"torque_and_{motion}" for motion in motions)]
    # The robot makes joints of poses, which a controller of joints may follow; not the other way round.
    return [f"torque_and_{motion}" for motion in motions] if reference == _RULE.POSES else []


def check_fit(trajectory: Message, controller: Message, robot_controller: str = "auto") -> None:
    """Raise FrankaArmArgumentError with what would fit when these parts do not run together; parts of plug-ins the server knows."""
    motion, law = trajectory.DESCRIPTOR, controller.DESCRIPTOR
    if motion.full_name not in _full_names() or law.full_name not in _full_names():
        return
    fitting = robot_controllers(motion.name, law.name)
    if not fitting:
        others = ", ".join(other.name for _, other in kinds("controller") if robot_controllers(motion.name, other.name))
        raise FrankaArmArgumentError(f"{law.name} does not take what {motion.name} gives: use {others}, or another trajectory")
    if robot_controller.lower() not in ("auto", *fitting):
        raise FrankaArmArgumentError(
            f"the robot controller {robot_controller.upper()} does not fit {law.name} with {motion.name}: "
            f"use {', '.join(fitting).upper()}"
        )


@functools.cache
def _kind_rule(name: str) -> rules_pb2.KindRule:
    return getattr(proto, name).DESCRIPTOR.GetOptions().Extensions[rules_pb2.kind]


def _fits(part: _Part, parts: list[_Part]) -> dict[str, list[str]]:
    of_role = {role: [other for other in parts if other.role == role] for role in _FILES}
    if part.role == "trajectory":
        found = {other.name: _together(part.rule, other.rule) for other in of_role["controller"]}
    elif part.role == "controller":
        found = {other.name: _together(other.rule, part.rule) for other in of_role["trajectory"]}
    elif part.role == "ending":
        return {other.name: [] for other in of_role["termination"] if "then" in other.descriptor.fields_by_name}
    elif part.rule is None:
        return {}
    else:
        judges = set(part.rule.references) or set(_MOTIONS)
        known = [(other.name, other.rule) for other in of_role["trajectory"] if other.rule is not None]
        return {name: [] for name, rule in known if set(rule.references) <= judges}
    return {name: them for name, them in found.items() if them}


def kinds(role: str | None = None) -> Iterator[tuple[str, Descriptor]]:
    """Yield (role, message descriptor) of every kind; role: "trajectory", "controller", "termination", "ending" or None: all."""
    for each, module in _FILES.items():
        if role in (None, each):
            for descriptor in module.DESCRIPTOR.message_types_by_name.values():
                yield each, descriptor


@functools.cache
def _full_names() -> frozenset[str]:
    return frozenset(descriptor.full_name for _, descriptor in kinds())


def make(kind: str, /, *arguments: Any, **named: Any) -> Message:
    """Return the message of a kind with these fields.

    Raises FrankaArmArgumentError which names the field that is unknown, given twice, missing or against its rule.
    """
    descriptor = next((d for _, d in kinds() if d.name == kind), None)
    if descriptor is None:
        known = ", ".join(d.name for _, d in kinds())
        raise FrankaArmArgumentError(f"{kind} is no kind of part: known are {known}")
    message = getattr(proto, kind)()
    fields = list(descriptor.fields)
    if len(fields) == 1 and is_repeated(fields[0]) and holds_parts(fields[0]):
        for part in arguments:
            getattr(message, fields[0].name).add().Pack(_part(kind, part))
        arguments = ()
    for field, value in [*_by_position(kind, fields, list(arguments)), *_by_name(kind, fields, named)]:
        if getattr(message, field.name) if is_repeated(field) else message.HasField(field.name):
            raise FrankaArmArgumentError(f"{kind}.{field.name} is given twice")
        _set(message, field, value)
    validate(message)
    return message


def _by_position(kind: str, fields: list[FieldDescriptor], values: list[Any]) -> Iterator[tuple[FieldDescriptor, Any]]:
    left = list(fields)
    for value in values:
        if not left:
            raise FrankaArmArgumentError(f"{kind} has {len(fields)} fields: expected at most as many arguments")
        if _is_pose(value) or (isinstance(value, (list, tuple)) and value and all(map(_is_pose, value))):
            yield from _pose(kind, left, value)
            left = [field for field in left if field not in pose_fields(left)]
        else:
            field = left.pop(0)
            if value is not None:  # else it is not given
                yield field, value


def _by_name(kind: str, fields: list[FieldDescriptor], named: dict[str, Any]) -> Iterator[tuple[FieldDescriptor, Any]]:
    for name, value in named.items():
        field = next((field for field in fields if field.name == name), None)
        if name == "pose" and field is None:
            yield from _pose(kind, fields, value)
        elif field is None:
            known = ", ".join(field.name for field in fields) or "none"
            raise FrankaArmArgumentError(f"{kind} has no field {name}: expected {known}")
        elif value is not None:
            yield field, value


def pose_fields(fields: list[FieldDescriptor]) -> list[FieldDescriptor]:
    """Return those of the fields for which a pose stands: two, or the kind takes none."""
    return [field for field in fields if field.name in ("position", "translation", "quaternion")]


def _is_pose(value: Any) -> bool:
    return hasattr(value, "translation") and hasattr(value, "quaternion")


def _pose(kind: str, fields: list[FieldDescriptor], pose: Any) -> Iterator[tuple[FieldDescriptor, Any]]:
    wanted = pose_fields(fields)
    many = isinstance(pose, (list, tuple))
    if len(wanted) != 2 or (many and not rule_of(wanted[0]).row):
        raise FrankaArmArgumentError(f"{kind} takes no pose{'s' * many} here: expected {fields[0].name}")
    for field in wanted:
        parts = [each.quaternion if field.name == "quaternion" else each.translation for each in (pose if many else [pose])]
        yield field, parts if many else parts[0]


def _set(message: Message, field: FieldDescriptor, value: Any) -> None:
    name = f"{message.DESCRIPTOR.name}.{field.name}"
    rule = rule_of(field)
    if holds_parts(field) and not is_repeated(field):
        endings = [descriptor for _, descriptor in kinds("ending")]
        if not isinstance(value, Message) or value.DESCRIPTOR not in endings:
            words = " or ".join(descriptor.name for descriptor in endings)
            given = value.DESCRIPTOR.name if isinstance(value, Message) else repr(value)
            raise FrankaArmArgumentError(f"{name} is {given}: expected {words}, such as BackOff(0.01), or nothing")
        getattr(message, field.name).Pack(value)
    elif holds_parts(field):
        if not isinstance(value, (Message, Iterable)):
            raise FrankaArmArgumentError(f"{name} is {value!r}: expected parts")
        for part in [value] if isinstance(value, Message) else value:
            getattr(message, field.name).add().Pack(_part(name, part))
    elif is_repeated(field):
        if field.name == "axis" and isinstance(value, str):
            if value not in _AXES:
                raise FrankaArmArgumentError(f"{name} is {value!r}: expected x, y, z or {rule.size} numbers")
            value = _AXES[value]
        if rule.size and not rule.required and (not hasattr(value, "__len__") or getattr(value, "shape", None) == ()):
            value = [number(name, value)] * rule.size
        if rule.row:
            array = table(name, value, rule.row)
            if rule.max_rows and len(array) > rule.max_rows:
                raise FrankaArmArgumentError(f"{name} has {len(array)} rows: expected at most {rule.max_rows}")
            getattr(message, field.name).extend(array.ravel())
        else:
            getattr(message, field.name).extend(vector(name, value, rule.size) if rule.size else numbers(name, value))
    elif field.enum_type is not None:
        values = field.enum_type.values_by_name
        if str(value).upper() not in values:
            raise FrankaArmArgumentError(f"{name} is {value!r}: expected {', '.join(values).lower()}")
        setattr(message, field.name, values[str(value).upper()].number)
    elif field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
        if not isinstance(value, str):
            raise FrankaArmArgumentError(f"{name} is {value!r}: expected a text")
        setattr(message, field.name, value)
    elif field.cpp_type == FieldDescriptor.CPPTYPE_BOOL:
        setattr(message, field.name, bool(value))
    else:
        setattr(message, field.name, number(name, value))


def holds_parts(field: FieldDescriptor) -> bool:
    """Return whether a field takes parts."""
    return field.message_type is not None and field.message_type.full_name == _ANY


def _part(where: str, part: Any) -> Message:
    if not isinstance(part, Message):
        raise FrankaArmArgumentError(f"{where} got {part!r}: expected a part, such as Time(4)")
    return part


def text_of(field: FieldDescriptor, rule: rules_pb2.FieldRule | None = None) -> str:
    """Return unit, size, range and default of a field, for people; `rule`: other than its own."""
    rule = rule or rule_of(field)
    words = []
    if holds_parts(field):
        return "parts" if is_repeated(field) else "part, may be left out"
    if field.enum_type is not None:
        words.append(" | ".join(field.enum_type.values_by_name).lower())
    if rule.row:
        words.append(f"{f'up to {rule.max_rows} ' if rule.max_rows else ''}rows of {rule.row} numbers")
    elif rule.size:
        words.append(f"{rule.size} numbers")
    elif is_repeated(field):
        words.append("numbers")
    if rule.unit:
        words.append(rule.unit)
    if rule.HasField("min") or rule.HasField("max"):
        lower, upper = (f"{value:g}" if rule.HasField(name) else "" for name, value in (("min", rule.min), ("max", rule.max)))
        words.append(f"{lower} to {upper}" if lower and upper else f"at least {lower}" if lower else f"at most {upper}")
    if rule.required:
        words.append("must be given")
    elif rule.initial:
        words.append("default " + " ".join(f"{x:g}" for x in rule.initial))
    elif field.has_default_value:
        default = field.default_value
        if field.enum_type is not None:
            default = field.enum_type.values_by_number[default].name.lower()
        words.append(f"default {default}")
    else:
        words.append("may be left out")
    return ", ".join(words)
