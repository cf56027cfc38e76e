"""Finished runs in the hands of independent readers."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages
from recording_support import CHANNELS, NAMES, make_rows, write_run
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

N = 5000


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs"), N)


def test_rosbags_reads_bag_and_metadata(run):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(run) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        qos = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
        blocks = [
            store.deserialize_cdr(raw, connection.msgtype).data
            for connection, _, raw in reader.messages()
            if connection.topic == "/herringbone_sim/samples"
        ]
    rows = np.concatenate(blocks).reshape(-1, len(NAMES))
    np.testing.assert_array_equal(rows, make_rows(0, N))
    assert counts["/herringbone_sim/samples"] == len(blocks)
    assert counts["/parameter_events"] == counts["/herringbone_sim/state"] == 1
    assert qos["/herringbone_sim/channels"][0].durability == QosDurability.TRANSIENT_LOCAL


def test_rosbags_needs_no_type_store_of_its_own(run):
    with AnyReader([run]) as reader:
        by_topic = {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }
    assert json.loads(by_topic["/herringbone_sim/channels"].data) == CHANNELS
    assert by_topic["/herringbone_sim/state"].name == ["sp_L", "sp_R"]
    assert by_topic["/parameter_events"].changed_parameters[0].value.double_value == 0.5


def test_mcap_ros2_decodes_by_the_schemas_in_the_file(run):
    by_topic = {
        message.channel.topic: message.ros_msg
        for message in read_ros2_messages(str(run / "run_0.mcap"))
    }
    samples = by_topic["/herringbone_sim/samples"]
    last = np.array(samples.data).reshape(-1, len(NAMES))[-1]
    np.testing.assert_array_equal(last, make_rows(N - 1, N)[0])
    assert samples.layout.dim[1].label == ",".join(NAMES)
    assert list(by_topic["/herringbone_sim/state"].effort) == pytest.approx([1e3, 2e3])
    assert by_topic["/parameter_events"].changed_parameters[0].name == "K"


def test_rclpy_takes_every_message(run):
    serialization = importlib.import_module("rclpy.serialization")
    from rcl_interfaces.msg import ParameterEvent
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray, String

    types = {
        kind.__name__: kind for kind in (ParameterEvent, JointState, Float64MultiArray, String)
    }
    n = 0
    with Reader(run) as reader:
        for connection, _, raw in reader.messages():
            kind = types[connection.msgtype.rpartition("/")[2]]
            message = serialization.deserialize_message(bytes(raw), kind)
            n += message.layout.dim[0].size if kind is Float64MultiArray else 0
    assert n == N


@pytest.mark.parametrize("command", ["check", "convert"])
def test_rerun_opens_the_file(run, tmp_path, command):
    found = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    if found is None:
        pytest.skip("rerun is not installed")
    target = ["-o", str(tmp_path / "run.rrd")] if command == "convert" else []
    done = subprocess.run(
        [found, "mcap", command, str(run / "run_0.mcap"), *target],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    if command == "convert":
        assert (tmp_path / "run.rrd").stat().st_size > make_rows(0, N).nbytes / 2
    else:
        assert done.stdout.count("ok") == 4
