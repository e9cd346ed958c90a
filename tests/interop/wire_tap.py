"""Between an arm and its client: passes on what they say to each other, and notes the commands, or records everything."""

import contextlib
import multiprocessing
import os
import select
import socket
import struct

import numpy as np
from peer import free_address

ROBOT_PORT = 1337
CONNECT = struct.Struct("<IIIHH")  # command, id, size, version, UDP port
LARGEST = 4096  # bytes, of a datagram
PATIENCE = 30  # s
FINISHED = (313, 370)  # offsets in a command: motion_generation_finished, torque_command_finished (from version 7 on)


class WireTap:
    """Clients find the arm at `address`; one client at a time. A process of its own.

    `record`: keep the datagrams themselves, for recorded(); then it is not in a hurry, as for an arm in lockstep.
    """

    def __init__(self, arm: str, record: bool = False) -> None:
        self.address = free_address()
        self._arm = arm
        self._listener = socket.create_server((self.address, ROBOT_PORT))
        self._to_client = self._udp(ROBOT_PORT)
        self._to_arm = self._udp(0)
        # message_id of the state that each command answers, and whether it asks for the end of its motion.
        self._commands: list[tuple[int, bool]] = []
        self._record = record
        self._recorded: tuple[list[bytes], list[bytes]] = ([], [])
        context = multiprocessing.get_context("fork")
        self._results, self._requests = context.Pipe()
        self._stopped = context.Event()
        self._process = context.Process(target=self._run, daemon=True)
        self._process.start()

    def recorded(self) -> tuple[list[bytes], list[bytes]]:
        """Return commands and states since the last call; raises TimeoutError when no client is connected."""
        self._results.send(None)
        if not self._results.poll(PATIENCE):
            raise TimeoutError("nobody is connected through this tap")
        return self._results.recv()

    def gaps(self) -> tuple[np.ndarray, np.ndarray]:
        """Stop; return cycles without a command: from command to command of a motion, and from motion to motion."""
        self._stopped.set()
        commands = self._results.recv()
        self._process.join()
        for each in (self._listener, self._to_client, self._to_arm):
            each.close()
        ids = np.array([command[0] for command in commands])
        finished = np.array([command[1] for command in commands])
        missing = np.diff(ids) - 1
        return missing[~finished[:-1]], missing[finished[:-1] & ~finished[1:]]

    def _udp(self, port: int) -> socket.socket:
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        udp.bind((self.address, port))
        return udp

    def _run(self) -> None:
        if not self._record:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
        while not self._stopped.is_set():
            if select.select([self._listener], [], [], 0.1)[0]:
                client, where = self._listener.accept()
                arm = socket.create_connection((self._arm, ROBOT_PORT), source_address=(self.address, 0))
                with client, arm, contextlib.suppress(ConnectionError):
                    for each in (client, arm):
                        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._pass_on(client, arm, where[0])
        self._requests.send(self._commands)

    def _pass_on(self, client: socket.socket, arm: socket.socket, host: str) -> None:
        command, number, size, version, states_to = CONNECT.unpack(client.recv(CONNECT.size, socket.MSG_WAITALL))
        arm.sendall(CONNECT.pack(command, number, size, version, self._to_arm.getsockname()[1]))
        sockets = [self._to_arm, self._to_client, client, self._requests]
        while not self._stopped.is_set():
            ready = select.select([*sockets, arm], [], [], 0.1)[0]
            # Looked at after the others: an answer goes before the state that shows what it says.
            for each in select.select([arm], [], [], 0)[0] + [one for one in ready if one is not arm]:
                if each is self._to_arm:
                    datagram = self._to_arm.recv(LARGEST)
                    self._to_client.sendto(datagram, (host, states_to))
                    if self._record:
                        self._recorded[1].append(datagram)
                elif each is self._to_client:
                    datagram = self._to_client.recv(LARGEST)
                    self._to_arm.sendto(datagram, (self._arm, ROBOT_PORT))
                    if self._record:
                        self._recorded[0].append(datagram)
                    else:
                        finished = any(any(datagram[offset : offset + 1]) for offset in FINISHED)
                        self._commands.append((struct.unpack_from("<Q", datagram)[0], finished))
                elif each is self._requests:
                    each.recv()
                    each.send(self._recorded)
                    self._recorded = ([], [])
                else:
                    data = each.recv(1 << 16)
                    if not data:
                        return
                    (arm if each is client else client).sendall(data)
