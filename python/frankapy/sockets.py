"""ZeroMQ sockets that close when what they belong to is no longer there."""

from __future__ import annotations

import weakref

import zmq


def owned_socket(owner: object, kind: int, linger: int = 0) -> tuple[zmq.Socket[bytes], weakref.finalize[..., object]]:
    """Return a socket in a context of its own, and what closes both: when called, when `owner` goes, or when the program ends.

    `linger`: ms that closing waits for what is not sent yet. The socket must not be left to the garbage collector: which of
    socket and context it takes first is open, and a context waits for its sockets for ever.
    """
    context = zmq.Context()
    socket = context.socket(kind)
    socket.linger = linger
    return socket, weakref.finalize(owner, _close, socket, context)


def _close(socket: zmq.Socket[bytes], context: zmq.Context[zmq.Socket[bytes]]) -> None:
    socket.close()
    context.destroy()  # with what watches the socket
