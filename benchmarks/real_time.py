"""What the node reaches in real time: full model, all published and recorded, in its own process.

    python benchmarks/real_time.py [--seconds 20] [--model full] [--effects TEXT ...]

For each text of effects, none by default, it prints the real-time factor that the node
publishes, its overruns, dropped blocks, samples lost, and the share of one core that its process
took.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node


def cpu_seconds(pid: int) -> float:
    """User and system time [s] that a process has taken."""
    with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seconds", type=float, default=20.0)
    arguments.add_argument("--model", default="full", choices=("full", "reduced"))
    arguments.add_argument("--effects", nargs="+", default=[""], help="as the node takes them")
    args = arguments.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    client, seen = Node("real_time_benchmark"), []
    client.create_subscription(DiagnosticArray, "/diagnostics", seen.append, 10)
    for effects in args.effects:
        seen.clear()
        measure(client, seen, args, effects)


def measure(
    client: Node, seen: list[DiagnosticArray], args: argparse.Namespace, effects: str
) -> None:
    """Run the node with effects and print what it reached."""
    with tempfile.TemporaryDirectory() as folder:
        options = [f"model:={args.model}", "record:=true", f"record_dir:={folder}"]
        options += [f"effects:='{effects}'"] if effects else []
        words = [word for option in options for word in ("-p", option)]
        command = [sys.executable, "-W", "ignore", "-m", "herringbone_sim", "run", "--ros-args"]
        node = subprocess.Popen(
            [*command, *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        while len(seen) < 3 or "compiling" in seen[-1].status[0].message:
            rclpy.spin_once(client, timeout_sec=0.2)
        seen.clear()
        began, used = time.monotonic(), cpu_seconds(node.pid)
        while time.monotonic() - began < args.seconds:
            rclpy.spin_once(client, timeout_sec=0.2)
        share = (cpu_seconds(node.pid) - used) / (time.monotonic() - began)
        node.send_signal(signal.SIGINT)
        said = node.communicate()[1]
    values = [{item.key: item.value for item in m.status[0].values} for m in seen]
    reached = [float(v["real_time_factor_reached"]) for v in values]
    print(f"effects            {effects or 'none'}")
    print(f"real-time factor   {statistics.median(reached):.3f} median, {min(reached):.3f} least")
    print(f"overruns           {values[-1]['overruns']}")
    print(f"dropped blocks     {values[-1]['dropped_blocks']}")
    print("recording          " + re.findall(r"\d+ samples written, \d+ lost", said)[-1])
    print(f"share of one core  {share:.0%}")


if __name__ == "__main__":
    main()
