"""franka-sim 1.1.7 at one address, with its motion checks on: `franka_sim_server.py ADDRESS`; its own command takes all."""

import sys

from franka_sim import FrankaSimServer

FrankaSimServer(host=sys.argv[1], enforce_motion_limits=True).start()
