"""Many protobuf messages of one type as NumPy arrays, without an object for each.

Messages that a program writes in a loop differ in their values, hardly ever in where these are. All that are alike in this
are read at once: the layout of one is found by walking over it, and holds for those that have the same tags and lengths.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # wire types
_SIGNED = (FieldDescriptor.TYPE_SINT32, FieldDescriptor.TYPE_SINT64)


@dataclasses.dataclass
class _Value:
    """Where a field is in a message."""

    name: str
    field: FieldDescriptor
    start: int
    end: int


def columns(descriptor: Descriptor, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
    """Return an array for each field that some message has, by its name; those of inner messages as "outer.inner".

    Numbers become (n,), packed numbers (n, k), strings (n,) of tuples. Where a message lacks a field there is NaN, 0 or ().
    Raises ValueError for bytes that are no message.
    """
    result: dict[str, np.ndarray] = {}
    sizes = np.fromiter((len(message) for message in messages), dtype=np.int64, count=len(messages))
    for size in np.unique(sizes).tolist():
        rows = np.flatnonzero(sizes == size)
        joined = np.frombuffer(b"".join(messages[row] for row in rows.tolist()), dtype=np.uint8).reshape(len(rows), size)
        while len(rows):
            values: list[_Value] = []
            frame = np.zeros(size, dtype=np.uint8)  # bits that make the layout
            _walk(descriptor, joined[0].tobytes(), 0, size, "", values, frame)
            alike = ((joined & frame) == (joined[0] & frame)).all(axis=1)
            _take(values, joined[alike], rows[alike], len(messages), result)
            joined, rows = joined[~alike], rows[~alike]
    return result


def _varint(data: bytes, at: int, frame: np.ndarray, fixed: bool) -> tuple[int, int]:
    """Return the number at a place, and where it ends. `fixed`: it is part of the layout."""
    value = shift = 0
    while True:
        if at >= len(data) or shift > 63:
            raise ValueError("the message is cut off")
        byte = data[at]
        frame[at] = 0xFF if fixed else 0x80
        value |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return value, at
        shift += 7


def _walk(
    descriptor: Descriptor, data: bytes, at: int, end: int, prefix: str, values: list[_Value], frame: np.ndarray
) -> None:
    while at < end:
        tag, at = _varint(data, at, frame, fixed=True)
        field = descriptor.fields_by_number.get(tag >> 3)
        kind, start = tag & 7, at
        if kind == _VARINT:
            _, at = _varint(data, at, frame, fixed=False)
        elif kind in (_FIXED64, _FIXED32):
            at += 8 if kind == _FIXED64 else 4
        elif kind == _BYTES:
            size, start = _varint(data, at, frame, fixed=True)
            at = start + size
        else:
            raise ValueError(f"no protobuf message: wire type {kind}")
        if at > end:
            raise ValueError("the message is cut off")
        if field is None:  # of a newer version
            continue
        if field.message_type is not None:
            _walk(field.message_type, data, start, at, f"{prefix}{field.name}.", values, frame)
        else:
            values.append(_Value(prefix + field.name, field, start, at))


def _take(values: list[_Value], joined: np.ndarray, rows: np.ndarray, count: int, result: dict[str, np.ndarray]) -> None:
    for value in values:
        field, part = value.field, joined[:, value.start : value.end]
        if field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
            texts = result.setdefault(value.name, _texts(count))
            for row, text in zip(rows, part, strict=True):
                texts[row] += (text.tobytes().decode(errors="replace"),)
        elif field.cpp_type == FieldDescriptor.CPPTYPE_DOUBLE:
            numbers = np.ascontiguousarray(part).view("<f8")
            width = numbers.shape[1] if field.is_packed else None
            _put(result, value.name, rows, numbers if width else numbers[:, 0], np.nan, count)
        else:
            number = np.zeros(len(rows), dtype=np.uint64)
            for i in range(part.shape[1]):
                number |= (part[:, i] & 0x7F).astype(np.uint64) << np.uint64(7 * i)
            if field.type in _SIGNED:
                number = (number >> np.uint64(1)) ^ (~(number & np.uint64(1)) + np.uint64(1))
            _put(result, value.name, rows, number.view(np.int64), 0, count)


def _texts(count: int) -> np.ndarray:
    texts = np.empty(count, dtype=object)
    texts[:] = [()] * count
    return texts


def _put(result: dict[str, np.ndarray], name: str, rows: np.ndarray, values: np.ndarray, nothing: float, count: int) -> None:
    shape = (count, *values.shape[1:])
    there = result.get(name)
    if there is None or there.shape[1:] < shape[1:]:
        wider = np.full(shape, nothing, dtype=values.dtype)
        if there is not None:
            wider[:, : there.shape[1]] = there
        result[name] = there = wider
    if there.ndim == 1:
        there[rows] = values
    else:
        there[rows, : values.shape[1]] = values
