"""What is wrong on this computer, and what to do about it."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import resource
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from frankapy.connection import list_arms, server_address
from frankapy.exceptions import FrankaArmException
from frankapy.sim import FCI_PORT, program

OK, NOTE, WARN, BAD = "ok", "note", "warn", "bad"  # WARN: what only a real arm needs

_PACKAGES = {"numpy": ((1, 24), None), "protobuf": ((4, 25), (8,)), "pyzmq": ((25,), None)}
_REALTIME_PRIORITY = 80
_GROUP_ADVICE = (
    "sudo groupadd -f realtime && sudo usermod -aG realtime $USER && printf '@realtime - rtprio 99\\n"
    "@realtime - memlock unlimited\\n' | sudo tee /etc/security/limits.d/realtime.conf; then log in again"
)


@dataclass
class Finding:
    """One thing that was looked at."""

    level: str  # OK, NOTE, WARN or BAD
    what: str
    found: str
    advice: str = ""


def examine(server: str | None, robot: str | None) -> Iterator[Finding]:
    """Look at one thing after another; `robot` is the address of a real arm to look for."""
    yield from _software()
    yield from _computer()
    arms = []
    host, port = server_address(server)
    try:
        arms = list_arms(server)
        yield Finding(OK, "server", f"answers at {host}:{port}")
    except FrankaArmException as error:
        found, advice = _first_sentence(error.message)
        yield Finding(NOTE, "server", found[0].lower() + found[1:], advice)
    for arm in arms:
        found, advice = _first_sentence(arm.status)
        yield Finding(OK if arm.endpoint else BAD, f"arm {arm.name}", f"{arm.address}: {found}", advice)
    addresses = [robot] if robot else [arm.address for arm in arms if not arm.address.startswith("127.")]
    for address in addresses:
        yield from _network(address)


def _first_sentence(text: str) -> tuple[str, str]:
    sentence, _, rest = text.partition(". ")
    return sentence.removesuffix("."), rest


def _software() -> Iterator[Finding]:
    python = platform.python_version()
    good = sys.version_info >= (3, 10)
    yield Finding(OK if good else BAD, "Python", python, "" if good else "frankapy needs Python 3.10 or newer.")
    for name, (least, below) in _PACKAGES.items():
        version = importlib.metadata.version(name)
        numbers = tuple(int(n) for n in re.findall(r"\d+", version)[:3])
        good = numbers >= least and (below is None or numbers < below)
        wanted = f"{name}>={'.'.join(map(str, least))}" + (f",<{below[0]}" if below else "")
        yield Finding(OK if good else BAD, name, version, "" if good else f"pip install '{wanted}'")
    for name in ("franka-interface", "fci-sim"):
        try:
            yield Finding(OK, name, program(name))
        except FrankaArmException:
            # Elsewhere they need not be: the server may be on another computer.
            level = BAD if (Path(__file__).resolve().parents[2] / "CMakeLists.txt").exists() else NOTE
            yield Finding(level, name, "is not built", "Run `make build` in the repository; scripts alone do not need it.")


def _computer() -> Iterator[Finding]:
    version = platform.release()
    realtime = Path("/sys/kernel/realtime")
    is_realtime = (realtime.exists() and realtime.read_text().strip() == "1") or "PREEMPT_RT" in platform.version()
    yield Finding(
        OK if is_realtime else WARN,
        "kernel",
        f"{version}, {'PREEMPT_RT' if is_realtime else 'not a real-time one'}",
        ""
        if is_realtime
        else "Debian: sudo apt install linux-image-rt-amd64. Ubuntu: sudo pro enable realtime-kernel. "
        "Then restart. Without it packets to the arm are late at times, and at 20 in a row it stops.",
    )
    granted = _may_schedule_in_real_time()
    yield Finding(
        OK if granted else WARN,
        "scheduling",
        f"real-time priority {_REALTIME_PRIORITY} is {'permitted' if granted else 'not permitted'}",
        "" if granted else _GROUP_ADVICE,
    )
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    enough = soft == resource.RLIM_INFINITY or os.geteuid() == 0
    yield Finding(
        OK if enough else WARN,
        "locked memory",
        "unlimited" if enough else f"at most {soft // 1024} KiB",
        "" if enough else _GROUP_ADVICE,
    )
    governors = {
        path.read_text().strip() for path in Path("/sys/devices/system/cpu").glob("cpu*/cpufreq/scaling_governor")
    }
    good = governors <= {"performance"}
    yield Finding(
        OK if good else WARN,
        "processor",
        f"{os.cpu_count()} cores, frequency governor {', '.join(sorted(governors)) or 'not to be seen here'}",
        "" if good else "sudo cpupower frequency-set -g performance",
    )


def _may_schedule_in_real_time() -> bool:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_REALTIME_PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, *before)
    return True


def _network(address: str) -> Iterator[Finding]:
    what = f"robot {address}"
    try:
        socket.create_connection((address, FCI_PORT), timeout=2).close()
    except OSError as error:
        reason = error.strerror or "no answer"
        advice = {
            "Connection refused": "Somebody is there but serves no FCI: in Desk, open the brakes and activate FCI; is "
            "the feature installed?",
        }.get(
            reason,
            "Is the cable in the control unit (not in the arm's base), and this computer's address in the same network "
            "(say 172.16.0.1/24 for a robot at 172.16.0.2)? `ip address` and `ping` tell.",
        )
        yield Finding(BAD, what, f"port {FCI_PORT}: {reason}", advice)
        return
    yield Finding(OK, what, f"port {FCI_PORT} answers")
    interface = _interface_to(address)
    if interface:
        wireless = Path(f"/sys/class/net/{interface}/wireless").exists()
        advice = "Use a cable: a wireless network is too slow and too uneven for 1 kHz." if wireless else ""
        yield Finding(BAD if wireless else OK, "network", f"by {interface}", advice)
    if ping := shutil.which("ping"):
        done = subprocess.run(
            [ping, "-q", "-c", "20", "-i", "0.05", address], capture_output=True, text=True, check=False
        )
        if times := re.search(r"= [\d.]+/([\d.]+)/([\d.]+)/", done.stdout):
            mean, worst = map(float, times.groups())
            good = worst < 1.0
            advice = "" if good else "Connect directly, without switches; turn off power saving of the network card."
            yield Finding(OK if good else BAD, "round trip", f"{mean:.2f} ms, at worst {worst:.2f} ms", advice)


def _interface_to(address: str) -> str | None:
    ip = shutil.which("ip")
    if ip is None:
        return None
    done = subprocess.run([ip, "route", "get", address], capture_output=True, text=True, check=False)
    found = re.search(r"\bdev (\S+)", done.stdout)
    return found.group(1) if found else None
