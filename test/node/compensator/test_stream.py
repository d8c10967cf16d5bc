import struct

from geometry_msgs.msg import WrenchStamped
from moments import SECOND, START
import numpy as np
import pytest

LOAD = np.array([1.5, -2.0, 30.0, 0.25, -0.5, 1.0])


def test_the_header_goes_out_byte_for_byte_in_either_order(wired, make_model, messages):
    node = wired(executor='events', model=make_model('m.yaml', {'force_x': (1.0, 0.0, 0.0)}))
    node.warm_up(30.0)
    heard, topic = [], node.topic('wrench')
    node.bench.helper.create_subscription(WrenchStamped, topic, heard.append, 100, raw=True)
    node.wait_until(lambda: node.node._output.get_subscription_count() > 1, 'both listeners')
    frames = ['', 'a', 'ab', 'tool0', 'wrist_3', 'wrist_ft_sensor/größe', 'f' * 301]
    sent = [
        messages.wrench(START + 10 * SECOND + k, LOAD, frame, little=little)
        for little in (True, False)
        for k, frame in enumerate(frames)
    ]
    for data in sent:
        node.put_bytes(data)
    stamps_ns = [message.header.stamp.nanosec for message in node.take(len(sent))]
    assert stamps_ns == 2 * list(range(len(frames)))
    node.wait_until(lambda: len(heard) == len(sent), 'all outputs as bytes')
    assert [data[:-48] for data in heard] == [data[:-48] for data in sent]
    for data in heard:
        order = '<' if data[1] else '>'
        values = struct.unpack_from(f'{order}6d', data, len(data) - 48)
        np.testing.assert_allclose(values, LOAD - [10.0, 0, 0, 0, 0, 0])


def test_the_drift_topic_carries_what_is_subtracted(rig, make_model):
    model = make_model('m.yaml', {'force_z': (2.0, 0.0, 0.0), 'torque_x': (-0.1, 0.0, 0.0)})
    node, drifts = rig(model=model, parameters={'max_drift_rate': 10}), []
    node.node.drift_topic.drift.publish = drifts.append
    node.ask_output(START, LOAD)
    for second in range(4):
        node.warm(START + second * SECOND, 21.0 + second)
    assert len(drifts) == 3
    for second, message in enumerate(drifts, start=1):
        assert message.header.stamp.sec == START // SECOND + second
        assert message.header.frame_id == 'tool0'
        assert message.wrench.force.z == pytest.approx(2.0 * second)
        assert message.wrench.torque.x == pytest.approx(-0.1 * second)


def test_wrenches_without_a_model_pass_or_stop(rig):
    node = rig(parameters={'uncalibrated': 'silent'})
    node.put(START, LOAD)
    assert node.set('uncalibrated', 'passthrough').successful
    assert node.ask_output(START + 1, LOAD) == tuple(LOAD)
    assert node.set('uncalibrated', 'silent').successful
    node.put(START + 2, LOAD)
    assert node.outputs.empty()
    assert node.node.counts.published == 1
