"""Specific force of a bag by its /tf and /tf_static."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain, islice

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.bag import Bag
from wrist_ft_comp.signals import (
    FORCE_CHANNELS,
    IntArray,
    NANOSECONDS,
    ROTATION_CHANNEL,
    Samples,
    SensorNames,
    Topics,
)
from wrist_ft_comp.wire import cdr
from wrist_ft_comp.wire.tf_messages import decode_transforms
from wrist_ft_comp.wire.tf_tree import GAP_NS, GravityByTf

#: Length of a step; a transform is good for the steps until where a gap would begin.
_STEP_NS = NANOSECONDS // 50
_STEPS = np.arange(GAP_NS // _STEP_NS)


def gravity_samples(bag: Bag, topics: Topics) -> Iterator[Samples]:
    """Tell specific force in the wrench's frame 50 times a second; refused where TF tells none."""
    moving = bag.find(_topic(bag, '/tf'), cdr.TF, 'gravity')
    gravity = _with_static(bag, topics)
    due: IntArray = np.empty(0, np.int64)
    done, found = 0, False
    for batch in chain(bag.batches(moving), [[]]):
        stamps = _take(bag, gravity, [data for _, _, data in batch])
        steps = np.unique(np.concatenate([due[:0], *(each // _STEP_NS for each in stamps)]))
        due = np.union1d(due, np.add.outer(steps, _STEPS))
        settled_ns = gravity.settled_ns() if batch else None
        now = due * _STEP_NS <= (settled_ns or np.iinfo(np.int64).max) - _STEP_NS // 2
        steps, due = due[now & (due > done)], due[~now]
        done = max([done, *steps[-1:].tolist()])
        times_ns = steps * _STEP_NS + _STEP_NS // 2
        force, speed = gravity.read(times_ns)
        gravity.forget()
        known, turned = np.isfinite(force[:, 0]), np.isfinite(speed)
        found |= bool(known.any())
        yield Samples(FORCE_CHANNELS, times_ns[known], force[known])
        yield Samples((ROTATION_CHANNEL,), times_ns[turned], speed[turned, np.newaxis])
    if not found:
        raise RecordingError(
            f'{bag.name}: {gravity.missing()} Name another --gravity-frame; of a split bag, name '
            'the folder: /tf_static is in its first file.'
        )


def uppermost_frame(bag: Bag, topics: Topics) -> str:
    """Find the frame that most probably has z upwards: the one above all that hold the sensor."""
    gravity = _with_static(bag, topics)
    for batch in islice(bag.batches(bag.named(_topic(bag, '/tf'))), 1):
        _take(bag, gravity, [data for _, _, data in batch])
    return gravity.root()


def _with_static(bag: Bag, topics: Topics) -> GravityByTf:
    """Begin with the frame of the raw wrench and the static transforms of all of the bag."""
    sensor = sensor_of(bag, topics)
    if 'frame_id' not in sensor:
        raise RecordingError(
            f'{sensor["wrench_topic"][0]} of {bag.name} has no frame_id, so TF cannot say how the '
            'sensor is turned. Let the driver fill header.frame_id, or use an IMU.'
        )
    gravity = GravityByTf(topics.gravity_frame, sensor['frame_id'][0])
    static = bag.named(_topic(bag, '/tf_static'))
    for batch in bag.batches(static) if static else ():
        _take(bag, gravity, [data for _, _, data in batch], static=True)
    return gravity


def sensor_of(bag: Bag, topics: Topics) -> SensorNames:
    """Tell what the sensor of a bag is called."""
    wrench = bag.find(topics.wrench, cdr.WRENCH, 'raw wrench')[0]
    temperatures = [f'/{entry.strip("/")}' for entry in topics.temperatures]
    names = {'wrench_topic': [wrench.topic], 'temperature_topics': temperatures}
    data = bag.first(wrench) or b''
    with suppress(RecordingError):  # who decodes the wrench says what is wrong with it
        if frame_id := cdr.locate(data, cdr.WRENCH_DOUBLES).frame_id(data):
            names['frame_id'] = [frame_id]
    return names


def _topic(bag: Bag, name: str) -> str:
    """Find a topic of TF, also in a namespace if there is one only."""
    found = {each.topic for each in bag.connections if each.topic.endswith(name)}
    return found.pop() if len(found) == 1 else name


def _take(
    bag: Bag, gravity: GravityByTf, messages: Sequence[bytes], *, static: bool = False
) -> list[IntArray]:
    """Take transforms in; returns their stamps, ns."""
    stamps = []
    try:
        for each in decode_transforms(messages):
            gravity.add(each, static=static)
            stamps.append(each.stamps_ns)
    except RecordingError as error:
        raise RecordingError(f'A transform of {bag.name} is damaged. {error}') from error
    return stamps
