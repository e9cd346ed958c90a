"""Checks of arguments and messages, by the rules that wire/proto writes beside its fields.

The server checks the same again; here an error is found without a server, and at the line which made it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from frankapy.exceptions import FrankaArmArgumentError
from frankapy.proto import rules_pb2

UNIT_NORM_TOLERANCE = 1e-3


def number(name: str, value: Any) -> float:
    """Return `value` as a float; any real number is one, numpy's too.

    Raises FrankaArmArgumentError when it is none, or not finite.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = None
    if array is None or array.ndim != 0 or isinstance(value, (str, bytes)):
        raise FrankaArmArgumentError(f"{name} is {value!r}: expected a number")
    if not np.isfinite(array):
        raise FrankaArmArgumentError(f"{name} is {_text(float(array))}: expected a finite number")
    return float(array)


def vector(name: str, value: Any, size: int) -> np.ndarray:
    """Return `value` as a new float64 array of `size` elements; lists, tuples and arrays will do.

    Raises FrankaArmArgumentError when it has another length, or elements that are no finite numbers.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise FrankaArmArgumentError(f"{name} is {value!r}: expected {size} numbers") from None
    if array.shape != (size,):
        shape = f"{array.size} elements" if array.ndim == 1 else f"the shape {array.shape}"
        raise FrankaArmArgumentError(f"{name} has {shape}: expected {size} numbers")
    for i, element in enumerate(array):
        if not np.isfinite(element):
            raise FrankaArmArgumentError(f"{name}[{i}] is {_text(element)}: expected a finite number")
    return array


def validate(message: Message) -> None:
    """Check a message and all messages in it (not inside an Any) by the rules of their fields.

    Raises FrankaArmArgumentError which names message, field and element, what was given and what was expected.
    """
    for field in message.DESCRIPTOR.fields:
        rule = field.GetOptions().Extensions[rules_pb2.rule]
        name = f"{message.DESCRIPTOR.name}.{field.name}"
        repeated = _is_repeated(field)
        given = len(getattr(message, field.name)) > 0 if repeated else message.HasField(field.name)
        if field.cpp_type == FieldDescriptor.CPPTYPE_MESSAGE:
            if given:
                value = getattr(message, field.name)
                for part in value if repeated else [value]:
                    validate(part)
            elif rule.required:
                raise FrankaArmArgumentError(f"{name} is missing")
        elif field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
            continue
        elif repeated:
            if given or (rule.required and not rule.initial):
                _check_elements(name, getattr(message, field.name), rule)
        elif given:
            _check_value(name, getattr(message, field.name), rule)
        elif rule.required:
            raise FrankaArmArgumentError(f"{name} is missing: expected a number{_in_brackets(rule)}")


def _check_elements(name: str, values: Any, rule: rules_pb2.FieldRule) -> None:
    if rule.size and len(values) != rule.size:
        raise FrankaArmArgumentError(f"{name} has {len(values)} elements: expected {rule.size}{_in_brackets(rule)}")
    for i, value in enumerate(values):
        _check_value(f"{name}[{i}]", value, rule)
    if rule.unit_norm and abs((norm := math.hypot(*values)) - 1) > UNIT_NORM_TOLERANCE:
        raise FrankaArmArgumentError(
            f"{name} has the norm {norm:.6g}: expected a unit quaternion{_in_brackets(rule)}, "
            f"1 within {UNIT_NORM_TOLERANCE}"
        )


def _check_value(name: str, value: float, rule: rules_pb2.FieldRule) -> None:
    if not math.isfinite(value):
        raise FrankaArmArgumentError(f"{name} is {_text(value)}: expected a finite number{_in_brackets(rule)}")
    if (rule.HasField("min") and value < rule.min) or (rule.HasField("max") and value > rule.max):
        unit = f" {rule.unit}" if rule.unit else ""
        raise FrankaArmArgumentError(f"{name} is {_text(value)}{unit}: expected {_range(rule)}{unit}")


def _range(rule: rules_pb2.FieldRule) -> str:
    if rule.HasField("min") and rule.HasField("max"):
        return f"{_text(rule.min)} to {_text(rule.max)}"
    return f"at least {_text(rule.min)}" if rule.HasField("min") else f"at most {_text(rule.max)}"


def _in_brackets(rule: rules_pb2.FieldRule) -> str:
    return f" ({rule.unit})" if rule.unit else ""


def _is_repeated(field: FieldDescriptor) -> bool:
    # `label` is going away in newer protobuf, `is_repeated` is not there in older.
    try:
        return bool(field.is_repeated)
    except AttributeError:
        return bool(field.label == FieldDescriptor.LABEL_REPEATED)


def _text(value: float) -> str:
    """Write a number as the server does: shortest digits, no ".0"."""
    text = repr(float(value))
    return text.removesuffix(".0")
