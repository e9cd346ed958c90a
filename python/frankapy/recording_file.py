"""The file of a recording, as franka-interface writes it: MCAP, all messages in chunks."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import TYPE_CHECKING

from frankapy.exceptions import FrankaArmArgumentError
from frankapy.progress import progress

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, Schema

_STATES = "/states"
_MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, when it was logged and sent


class RecordingFile:
    """What is in a file, read when it is made; one that was cut off is read as far as it goes, without what is damaged."""

    def __init__(self, path: str | Path) -> None:
        """Read it; raises FrankaArmArgumentError where it cannot be read, or is no MCAP file."""
        try:
            from mcap.exceptions import McapError
            from mcap.records import Chunk, Metadata
            from mcap.stream_reader import StreamReader
        except ImportError:
            raise FrankaArmArgumentError(
                "Recordings are read with the package mcap, which is not there: pip install 'frankapy[recordings]'"
            ) from None
        self.path = Path(path)
        self.about: dict[str, str] = {}
        self.complete = False
        self.damaged = 0  # chunks that cannot be read
        self.states: list[bytes] = []  # ArmState
        self.times: list[int] = []  # of the states, ns since 1970
        self.noted: list[tuple[int, int, str, str, int, bytes]] = []  # when logged and sent, topic, kind, sequence, message
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}  # topic, kind
        self._of_states: set[int] = set()
        try:
            size = self.path.stat().st_size
            stream = self.path.open("rb")
        except OSError as error:
            raise FrankaArmArgumentError(f"{path} cannot be read: {error.strerror}") from None
        with stream, progress(size, f"reading {self.path.name}", unit="B") as bar:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise FrankaArmArgumentError(f"{path} is no recording: it does not begin as an MCAP file does")
            stream.seek(0)
            whole = True
            try:
                for record in StreamReader(stream, emit_chunks=True, record_size_limit=None).records:
                    if isinstance(record, Chunk):
                        is_whole = self._took(record)
                        if not is_whole and stream.tell() < size:  # else it is where the file was cut off
                            self.damaged += 1
                            self._learn_channels()
                        bar.update(stream.tell() - bar.n)
                    elif isinstance(record, Metadata):
                        self.about |= record.metadata
                        self.complete |= record.name == "end"
            except (McapError, struct.error, EOFError, ValueError, OSError):
                whole = False
        self.complete &= whole and not self.damaged

    def _took(self, chunk: Chunk) -> bool:
        """Take what it has; return whether it is whole."""
        from mcap.exceptions import McapError

        try:
            self._take(chunk)
        except (McapError, struct.error, EOFError, ValueError, KeyError):
            return False
        except Exception as error:  # of zstandard, which may not be there
            if type(error).__name__ != "ZstdError":
                raise
            return False
        return True

    def _learn_channels(self) -> None:
        """Read at the end of the file what kinds of messages there are, as the chunk that says so may be damaged."""
        from mcap.exceptions import McapError
        from mcap.reader import make_reader

        try:
            with self.path.open("rb") as stream:
                summary = make_reader(stream).get_summary()
        except (McapError, struct.error, EOFError, ValueError, OSError):  # it was cut off as well
            return
        for schema in summary.schemas.values() if summary else ():
            self._know_schema(schema)
        for channel in summary.channels.values() if summary else ():
            self._know_channel(channel)

    def _know_schema(self, schema: Schema) -> None:
        self._schemas[schema.id] = schema.name.rsplit(".", 1)[-1]

    def _know_channel(self, channel: Channel) -> None:
        self._channels[channel.id] = channel.topic, self._schemas.get(channel.schema_id, "")
        if channel.topic == _STATES:
            self._of_states.add(channel.id)

    def _take(self, chunk: Chunk) -> None:
        """Add what a chunk has: thousands of messages, found without an object for each."""
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Channel, Schema
        from mcap.stream_reader import get_chunk_data_stream

        stream, size = get_chunk_data_stream(chunk)
        data = stream.read(size)
        at = 0
        while at < size:
            opcode, length = _RECORD.unpack_from(data, at)
            begin = at + _RECORD.size
            at = begin + length
            if at > size:
                raise ValueError("a record is longer than its chunk")
            if opcode == Opcode.MESSAGE:
                number, sequence, logged, sent = _MESSAGE.unpack_from(data, begin)
                message = data[begin + _MESSAGE.size : at]
                if number in self._of_states:
                    self.states.append(message)
                    self.times.append(logged)
                else:
                    self.noted.append((logged, sent, *self._channels[number], sequence, message))
            elif opcode == Opcode.SCHEMA:
                self._know_schema(Schema.read(ReadDataStream(io.BytesIO(data[begin:at]))))
            elif opcode == Opcode.CHANNEL:
                self._know_channel(Channel.read(ReadDataStream(io.BytesIO(data[begin:at]))))
