"""The wire form against rosbags, an independent implementation, and against rclpy itself."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from herringbone_sim.errors import RecordingError
from herringbone_sim.recording.cdr import CdrReader
from herringbone_sim.recording.messages import (
    ParameterEvent,
    decode_parameter_event,
    decode_samples,
    decode_string,
    encode_joint_state,
    encode_parameter_event,
    encode_samples,
    encode_string,
)
from herringbone_sim.recording.schemas import (
    FLOAT64_MULTI_ARRAY,
    JOINT_STATE,
    PARAMETER_EVENT,
    STRING,
    MessageType,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = (STRING, FLOAT64_MULTI_ARRAY, JOINT_STATE, PARAMETER_EVENT)
VALUES = {
    "flag": True,
    "count": -3,
    "K": 0.25,
    "name": "sp_L, Δ",
    "raw": b"\x01\xff",
    "flags": [True, False],
    "counts": [1, -2, 3],
    "gains": [0.5, 1.5],
    "words": ["a", "", "bcd"],
}


def foreign(message: object, kind: MessageType, little: bool = True) -> bytes:
    """The message as rosbags writes it."""
    return bytes(STORE.serialize_cdr(message, kind.name, little_endian=little))


def joint_state(m: int = 3) -> bytes:
    values = np.arange(float(m))
    return encode_joint_state(1_500_000_001, meshes(m), values, -values, values)


def meshes(m: int) -> tuple[str, ...]:
    return tuple(f"sp{i}_L" for i in range(m))


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.name)
def test_definitions_and_hashes_are_those_of_jazzy(kind):
    text, _ = STORE.generate_msgdef(kind.name, ros_version=2)
    assert kind.text == text
    assert kind.type_hash == STORE.hash_rihs01(kind.name)


@pytest.mark.parametrize("little", [True, False])
@pytest.mark.parametrize("text", ["", "a", 'Ω {"x": 1}'])
def test_string_of_rosbags_is_read(text, little):
    message = STORE.types[STRING.name](data=text)
    assert decode_string(foreign(message, STRING, little)) == text


def test_string_is_read_by_rosbags():
    assert STORE.deserialize_cdr(encode_string("Ω b"), STRING.name).data == "Ω b"


@pytest.mark.parametrize("n", [0, 1, 7])
@pytest.mark.parametrize("names", [("t",), ("t", "phase"), ("t", "x_sp_L", "F_sp_L")])
def test_samples_are_byte_for_byte_those_of_rosbags(n, names):
    rows = np.random.default_rng(n).normal(size=(n, len(names)))
    own = encode_samples(names, rows)
    message = STORE.deserialize_cdr(own, FLOAT64_MULTI_ARRAY.name)
    assert [dim.label for dim in message.layout.dim] == ["sample", ",".join(names)]
    assert [dim.size for dim in message.layout.dim] == [n, len(names)]
    np.testing.assert_array_equal(message.data.reshape(rows.shape), rows)
    for little in (True, False):
        raw = foreign(message, FLOAT64_MULTI_ARRAY, little)
        got_names, got = decode_samples(raw)
        assert got_names == names
        np.testing.assert_array_equal(got, rows)
        assert got.dtype.isnative
    assert own == foreign(message, FLOAT64_MULTI_ARRAY)


def test_samples_of_a_transposed_view_are_written_row_by_row():
    rows = np.arange(6.0).reshape(2, 3).T
    np.testing.assert_array_equal(decode_samples(encode_samples(("t", "K"), rows))[1], rows)


def test_samples_are_a_view_of_the_message():
    message = bytearray(encode_samples(("t",), np.zeros((4, 1))))
    _, rows = decode_samples(message)
    assert np.shares_memory(rows, np.frombuffer(message, np.uint8))


def test_an_offset_in_front_of_the_data_is_skipped():
    message = STORE.deserialize_cdr(
        encode_samples(("t",), np.zeros((2, 1))), FLOAT64_MULTI_ARRAY.name
    )
    message.layout.data_offset = 3
    message.data = np.array([9.0, 9.0, 9.0, 1.0, 2.0])
    raw = foreign(message, FLOAT64_MULTI_ARRAY)
    assert decode_samples(raw)[1].ravel().tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("size", "count", "dims", "said"),
    [(3, 6, 2, "mend the layout"), (2, 5, 2, "5 values"), (2, 6, 1, "2 dimensions")],
)
def test_another_layout_is_refused(size, count, dims, said):
    message = STORE.deserialize_cdr(
        encode_samples(("t", "K"), np.zeros((3, 2))), FLOAT64_MULTI_ARRAY.name
    )
    message.layout.dim[1].size = size
    message.layout.dim = message.layout.dim[:dims]
    message.data = np.zeros(count)
    raw = foreign(message, FLOAT64_MULTI_ARRAY)
    with pytest.raises(RecordingError, match=said):
        decode_samples(raw)


@pytest.mark.parametrize("m", [0, 1, 3])
def test_rosbags_reads_a_joint_state(m):
    message = STORE.deserialize_cdr(joint_state(m), JOINT_STATE.name)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_001)
    assert tuple(message.name) == meshes(m)
    np.testing.assert_array_equal(message.velocity, -np.arange(float(m)))
    np.testing.assert_array_equal(message.effort, np.arange(float(m)))


def test_joint_state_of_unequal_lengths_is_refused():
    values = np.zeros(2)
    with pytest.raises(RecordingError, match="as long as the 2 names, got 2, 1, 2"):
        encode_joint_state(0, ("a", "b"), values, values[:1], values)


@pytest.mark.parametrize("little", [True, False])
def test_parameter_event_goes_through_rosbags_and_back(little):
    event = ParameterEvent(2_000_000_003, "/herringbone_sim", VALUES)
    message = STORE.deserialize_cdr(encode_parameter_event(event), PARAMETER_EVENT.name)
    assert message.changed_parameters[2].value.double_value == 0.25
    raw = foreign(message, PARAMETER_EVENT, little)
    assert decode_parameter_event(raw) == event


def test_new_and_deleted_parameters_are_read_too():
    event = ParameterEvent(0, "/n", {"a": 1, "b": None})
    message = STORE.deserialize_cdr(encode_parameter_event(event), PARAMETER_EVENT.name)
    message.new_parameters = message.changed_parameters[:1]
    message.deleted_parameters = message.changed_parameters[:1]
    message.changed_parameters = message.changed_parameters[1:]
    raw = foreign(message, PARAMETER_EVENT)
    assert decode_parameter_event(raw).changed == {"a": None, "b": None}


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (np.float64(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),
        ((1, 2.5), [1.0, 2.5]),
        (np.array([1, 2]), [1, 2]),
        ([], []),
    ],
)
def test_parameter_values_of_numpy_and_tuples_are_taken(value, wanted):
    event = decode_parameter_event(encode_parameter_event(ParameterEvent(0, "/n", {"p": value})))
    assert event.changed["p"] == wanted
    assert type(event.changed["p"]) is type(wanted)


@pytest.mark.parametrize("value", [{"a": 1}, ["a", 1], [True, 2], object()])
def test_a_value_that_no_parameter_can_have_is_refused(value):
    with pytest.raises(RecordingError, match="a parameter must be"):
        encode_parameter_event(ParameterEvent(0, "/n", {"p": value}))


@pytest.mark.parametrize(
    ("decode", "message"),
    [
        (decode_string, encode_string("abcdefgh")),
        (decode_samples, encode_samples(("t", "K"), np.ones((3, 2)))),
        (decode_parameter_event, encode_parameter_event(ParameterEvent(1, "/n", VALUES))),
    ],
    ids=["string", "samples", "parameter_event"],
)
def test_a_message_cut_anywhere_is_refused(decode, message):
    for length in range(len(message) - 1):
        with pytest.raises(RecordingError):
            decode(message[:length])


def test_another_encapsulation_is_refused():
    with pytest.raises(RecordingError, match="plain CDR"):
        CdrReader(b"\x00\x07\x00\x00" + encode_string("a")[4:])


def test_rclpy_reads_all_types():
    serialization = importlib.import_module("rclpy.serialization")
    from rcl_interfaces.msg import ParameterEvent as RosEvent
    from sensor_msgs.msg import JointState as RosState
    from std_msgs.msg import Float64MultiArray, String

    rows = np.arange(6.0).reshape(3, 2)
    samples = serialization.deserialize_message(
        encode_samples(("t", "K"), rows), Float64MultiArray
    )
    assert samples.layout.dim[1].label == "t,K"
    assert list(samples.data) == rows.ravel().tolist()
    assert serialization.deserialize_message(encode_string("Ω"), String).data == "Ω"
    state = serialization.deserialize_message(joint_state(), RosState)
    assert list(state.name) == ["sp0_L", "sp1_L", "sp2_L"]
    assert list(state.velocity) == [-0.0, -1.0, -2.0]
    raw = encode_parameter_event(ParameterEvent(5, "/n", VALUES))
    event = serialization.deserialize_message(raw, RosEvent)
    assert list(event.changed_parameters[7].value.double_array_value) == [0.5, 1.5]
    assert decode_parameter_event(serialization.serialize_message(event)).changed == VALUES
