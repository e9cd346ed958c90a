"""Checks of arguments and messages, by the rules that wire/proto writes beside its fields.

The server checks the same again; here an error is found without a server, and at the line which made it.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message

from frankapy.exceptions import FrankaArmArgumentError
from frankapy.proto import rules_pb2

UNIT_NORM_TOLERANCE = 1e-3
_P = ParamSpec("_P")
_R = TypeVar("_R")
Floats = npt.NDArray[np.float64]


def number(name: str, value: Any) -> float:
    """Return `value` as a float; any real number is one, numpy's too.

    Raises FrankaArmArgumentError when it is none, or not finite.
    """
    array = _array(value)
    if array is None or array.ndim != 0:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected a number")
    if not np.isfinite(array):
        raise FrankaArmArgumentError(f"{name} is {_text(float(array))}: expected a finite number")
    return float(array)


def whole(name: str, value: Any) -> int:
    """Return `value` as an int of 0 to 4294967295. Raises FrankaArmArgumentError when it is none."""
    figure = number(name, value)
    if figure != int(figure) or not 0 <= figure < 2**32:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected a whole number, 0 or more{' (below 2^32)' if figure >= 2**32 else ''}")
    return int(value)


def flag(name: str, value: Any) -> bool:
    """Return whether `value` is true. Raises FrankaArmArgumentError where that is open, as of an array of several."""
    try:
        return bool(value)
    except (TypeError, ValueError):
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected True or False") from None


def checks_flags(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Give a function that first checks its arguments which are annotated as bool; it is called with `True` or `False`."""
    parameters = inspect.signature(function).parameters.values()
    flags = [(place, each.name) for place, each in enumerate(parameters) if each.annotation in (bool, "bool")]

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        given: list[Any] = list(args)
        for place, name in flags:
            if place < len(given):
                given[place] = flag(name, given[place])
            elif name in kwargs:
                kwargs[name] = flag(name, kwargs[name])
        return function(*given, **kwargs)

    return checked


def text(name: str, value: Any, longest: int) -> str:
    """Return a text of at most `longest` bytes. Raises FrankaArmArgumentError when `value` is none."""
    if not isinstance(value, str):
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected a text")
    try:
        size = len(value.encode())
    except UnicodeEncodeError as error:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected a text, but {error.reason}") from None
    if size > longest:
        raise FrankaArmArgumentError(f"{name} has {size} bytes: expected at most {longest}")
    return value


def vector(name: str, value: Any, size: int) -> Floats:
    """Return `value` as a new float64 array of `size` elements; lists, tuples and arrays will do.

    Raises FrankaArmArgumentError when it has another length, or elements that are no finite numbers.
    """
    array = _array(value)
    if array is None:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected {size} numbers")
    if array.shape != (size,):
        shape = f"{array.size} elements" if array.ndim == 1 else f"the shape {array.shape}"
        raise FrankaArmArgumentError(f"{name} has {shape}: expected {size} numbers")
    for i, element in enumerate(array):
        if not np.isfinite(element):
            raise FrankaArmArgumentError(f"{name}[{i}] is {_text(element)}: expected a finite number")
    return array


def table(name: str, value: Any, columns: int) -> Floats:
    """Return `value` as a new float64 array of shape (n, columns), n at least 1; one row may be given without brackets.

    Raises FrankaArmArgumentError when it has another shape, or elements that are no finite numbers.
    """
    array = _array(value)
    if array is None:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected rows of {columns} numbers")
    if array.shape == (columns,):
        array = array[None]
    if array.ndim != 2 or array.shape[1] != columns or not len(array):
        raise FrankaArmArgumentError(f"{name} has the shape {array.shape}: expected (n, {columns})")
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise FrankaArmArgumentError(f"{name}[{row}, {column}] is {_text(array[row, column])}: expected a finite number")
    return array


def array(name: str, value: Any) -> Floats:
    """Return `value`, of any shape, as a new float64 array, which need not be finite. Raises FrankaArmArgumentError for what is none."""
    values = _array(value)
    if values is None:
        raise FrankaArmArgumentError(f"{name} is {_short(value)}: expected numbers")
    return values


def numbers(name: str, value: Any) -> Floats:
    """Return `value`, of any shape, as a new flat float64 array.

    Raises FrankaArmArgumentError when an element is no finite number.
    """
    values = array(name, value)
    return vector(name, values.ravel(), values.size)


def _array(value: Any) -> Floats | None:
    """Return real numbers as a new float64 array; None for what is none: texts, complex numbers, None, what a mask hides."""
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "biufO" or np.ma.is_masked(value):
            return None
        if array.dtype.kind == "O" and any(isinstance(element, (str, bytes, type(None))) for element in array.flat):
            return None
        return np.array(array, dtype=float)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return None


def validate(message: Message) -> None:
    """Check a message and all messages in it (not inside an Any or a map) by the rules of their fields.

    Raises FrankaArmArgumentError which names message, field and element, what was given and what was expected.
    """
    for field, name, rule, repeated in _rules(message.DESCRIPTOR):
        value = getattr(message, field.name)
        if repeated:
            given = len(value) > 0
        else:
            given = message.HasField(field.name) if field.has_presence else value != field.default_value
        if field.cpp_type == FieldDescriptor.CPPTYPE_MESSAGE:
            if given:
                for part in value if repeated else [value]:
                    validate(part)
            elif rule.required:
                raise FrankaArmArgumentError(f"{name} is missing")
        elif field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
            if rule.required and not value:
                raise FrankaArmArgumentError(f"{name} is missing: expected a text")
        elif repeated:
            if given or (rule.required and not rule.initial):
                _check_elements(name, value, rule)
        elif given:
            _check_value(name, value, rule)
        elif rule.required:
            raise FrankaArmArgumentError(f"{name} is missing: expected a number{_in_brackets(rule)}")


@functools.cache
def _rules(descriptor: Descriptor) -> list[tuple[FieldDescriptor, str, rules_pb2.FieldRule, bool]]:
    """Return the fields of a message with their names for people, their rules, and whether they are lists."""
    return [
        (field, f"{descriptor.name}.{field.name}", rule_of(field), is_repeated(field))
        for field in descriptor.fields
        if field.message_type is None
        or not (field.message_type.full_name == "google.protobuf.Any" or field.message_type.GetOptions().map_entry)
    ]


def rule_of(field: FieldDescriptor) -> rules_pb2.FieldRule:
    """Return what wire/proto says of a field: unit, size, range, defaults."""
    return field.GetOptions().Extensions[rules_pb2.rule]  # type: ignore[index]  # the stubs take an extension for a field


def _check_elements(name: str, values: Any, rule: rules_pb2.FieldRule) -> None:
    wrong = len(values) != rule.size if rule.size else not len(values) or (rule.row and len(values) % rule.row)
    if wrong:
        expected = rule.size or (f"rows of {rule.row}" if rule.row else "at least 1")
        raise FrankaArmArgumentError(f"{name} has {len(values)} elements: expected {expected}{_in_brackets(rule)}")
    if rule.row and rule.max_rows and len(values) // rule.row > rule.max_rows:
        raise FrankaArmArgumentError(
            f"{name} has {len(values) // rule.row} rows: expected at most {rule.max_rows}"
        )
    array = np.fromiter(values, dtype=float, count=len(values))
    lower = rule.min if rule.HasField("min") else -np.inf
    upper = rule.max if rule.HasField("max") else np.inf
    for i in np.flatnonzero(~(np.isfinite(array) & (lower <= array) & (array <= upper)))[:1]:
        _check_value(f"{name}[{i}]", float(array[i]), rule)
    if rule.unit_norm:
        norms = np.linalg.norm(array.reshape(-1, rule.row or len(array)), axis=1)
        for row in np.flatnonzero(np.abs(norms - 1) > UNIT_NORM_TOLERANCE)[:1]:
            raise FrankaArmArgumentError(
                f"{f'row {row} of ' if rule.row else ''}{name} has the norm {norms[row]:.6g}: expected a unit quaternion"
                f"{_in_brackets(rule)}, 1 within {UNIT_NORM_TOLERANCE}"
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


def is_repeated(field: FieldDescriptor) -> bool:
    """Return whether a field is a list."""
    # `label` is going away in newer protobuf, `is_repeated` is not there in older.
    try:
        return bool(field.is_repeated)
    except AttributeError:
        return bool(field.label == FieldDescriptor.LABEL_REPEATED)  # type: ignore[attr-defined]


def _text(value: float) -> str:
    """Write a number as the server does: shortest digits, no ".0"."""
    text = repr(float(value))
    return text.removesuffix(".0")


def _short(value: Any) -> str:
    """Write anything, not all of what is long."""
    try:
        text = repr(value)
    except ValueError:  # integers of thousands of digits have none
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."
