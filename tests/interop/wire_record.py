"""What a simulated arm and its client say to each other by UDP: the arm's own record of it, read from a pipe."""

import contextlib
import fcntl
import os
import struct
import tempfile
import threading
from pathlib import Path

ROBOT_PORT = 1337
FILE_HEADER, PACKET_HEADER, IP_HEADER, UDP_HEADER = 24, 16, 20, 8  # bytes, of a pcap file and its packets
LARGEST_PIPE = 1 << 20  # bytes that a user may have: some 400 cycles
PERIOD = 0.005  # s, between readings; an arm that would be ahead by more than the pipe holds waits


class WireRecord:
    """Commands and states of an arm that is started with `--wire PATH`, as datagrams."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self.path = Path(self._folder.name) / "wire.pcap"
        os.mkfifo(self.path)
        self._pipe = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK)
        fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, LARGEST_PIPE)
        self._lock = threading.Lock()
        self._bytes = bytearray()
        self._begins = FILE_HEADER
        self._closed = threading.Event()
        self._reader = threading.Thread(target=self._read_on, daemon=True)
        self._reader.start()

    def __enter__(self) -> "WireRecord":
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._reader.join()
        os.close(self._pipe)
        self._folder.cleanup()

    def recorded(self) -> tuple[list[bytes], list[bytes]]:
        """Return commands and states since the last call, up to those of a cycle of which the arm has told already."""
        self._read()
        with self._lock:
            data, self._bytes = bytes(self._bytes), bytearray()
        commands, states = [], []
        at, self._begins = self._begins, 0
        while at < len(data):
            end = at + PACKET_HEADER + struct.unpack_from("<I", data, at + 8)[0]
            (sender,) = struct.unpack_from(">H", data, at + PACKET_HEADER + IP_HEADER)
            (states if sender == ROBOT_PORT else commands).append(data[at + PACKET_HEADER + IP_HEADER + UDP_HEADER : end])
            at = end
        return commands, states

    def _read_on(self) -> None:
        while not self._closed.wait(PERIOD):
            self._read()

    def _read(self) -> None:
        with self._lock, contextlib.suppress(BlockingIOError):
            self._bytes += os.read(self._pipe, LARGEST_PIPE)
