"""Many protobuf messages of one type as NumPy arrays, without an object for each.

Messages that a program writes in a loop differ in their values, hardly ever in where these are. All that are alike in this
are read at once: the layout of one is found by walking over it, and holds for those that have the same tags and lengths.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # wire types
_SIGNED = (FieldDescriptor.TYPE_SINT32, FieldDescriptor.TYPE_SINT64)
_BLOCK = 1 << 20  # bytes that are read at once: few enough for a processor to keep them at hand
_Rows = np.ndarray | slice


@dataclasses.dataclass
class _Value:
    """Where a field is in a message."""

    name: str
    field: FieldDescriptor
    start: int
    end: int


@dataclasses.dataclass
class _Layout:
    """Where fields are, and what makes messages have them there: some bits of some bytes."""

    values: list[_Value]
    places: np.ndarray
    mask: np.ndarray
    bits: np.ndarray


def columns(descriptor: Descriptor, messages: Sequence[bytes]) -> dict[str, np.ndarray]:
    """Return an array for each field that some message has, by its name; those of inner messages as "outer.inner".

    Numbers become (n,), packed numbers (n, k), strings (n,) of tuples. Where a message lacks a field there is NaN, 0 or ().
    Raises ValueError for bytes that are no message.
    """
    result: dict[str, np.ndarray] = {}
    sizes = np.fromiter(map(len, messages), dtype=np.int64, count=len(messages))
    for size in np.unique(sizes).tolist():
        layouts: list[_Layout] = []
        for rows in _blocks(np.flatnonzero(sizes == size), size):
            joined = np.frombuffer(b"".join([messages[row] for row in rows.tolist()]), dtype=np.uint8).reshape(len(rows), size)
            for layout in layouts:
                joined, rows = _read(layout, joined, rows, len(messages), result)
            while len(rows):
                layouts.append(_layout(descriptor, joined[0]))
                joined, rows = _read(layouts[-1], joined, rows, len(messages), result)
    return result


def _blocks(rows: np.ndarray, size: int) -> Iterator[np.ndarray]:
    step = max(1, _BLOCK // max(1, size))
    for first in range(0, len(rows), step):
        yield rows[first : first + step]


def _layout(descriptor: Descriptor, message: np.ndarray) -> _Layout:
    values: list[_Value] = []
    frame = np.zeros(len(message), dtype=np.uint8)  # bits that make the layout
    _walk(descriptor, message.tobytes(), 0, len(message), "", values, frame)
    places = np.flatnonzero(frame)
    return _Layout(values, places, frame[places], message[places] & frame[places])


def _read(
    layout: _Layout, joined: np.ndarray, rows: np.ndarray, count: int, result: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Take what messages of this layout hold; return the others, with their rows."""
    if not len(rows):  # the layout before had them all
        return joined, rows
    alike = ((joined.take(layout.places, axis=1) & layout.mask) == layout.bits).all(axis=1)
    if alike.all():
        _take(layout.values, joined, rows, count, result)
        return joined[:0], rows[:0]
    if alike.any():
        _take(layout.values, joined[alike], rows[alike], count, result)
    return joined[~alike], rows[~alike]


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
    at: _Rows = rows
    if len(rows) == rows[-1] - rows[0] + 1:  # of neighbours numpy copies more quickly
        at = slice(int(rows[0]), int(rows[-1]) + 1)
    for value in values:
        field, part = value.field, joined[:, value.start : value.end]
        if field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
            texts = result.setdefault(value.name, _texts(count))
            for row, text in zip(rows, part, strict=True):
                texts[row] += (text.tobytes().decode(errors="replace"),)
        elif field.cpp_type == FieldDescriptor.CPPTYPE_DOUBLE:
            numbers = part.view("<f8")
            width = numbers.shape[1] if field.is_packed else None
            _put(result, value.name, at, numbers if width else numbers[:, 0], np.nan, count)
        else:
            number = np.zeros(len(rows), dtype=np.uint64)
            for i in range(part.shape[1]):
                number |= (part[:, i] & 0x7F).astype(np.uint64) << np.uint64(7 * i)
            if field.type in _SIGNED:
                number = (number >> np.uint64(1)) ^ (~(number & np.uint64(1)) + np.uint64(1))
            _put(result, value.name, at, number.view(np.int64), 0, count)


def _texts(count: int) -> np.ndarray:
    texts = np.empty(count, dtype=object)
    texts[:] = [()] * count
    return texts


def _put(result: dict[str, np.ndarray], name: str, rows: _Rows, values: np.ndarray, nothing: float, count: int) -> None:
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
