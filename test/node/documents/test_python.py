"""The node in docs/python.md: a driver of one's own that publishes compensated wrenches."""

from pathlib import Path
import re
from types import SimpleNamespace

from geometry_msgs.msg import WrenchStamped
from moments import six_of, stamp_of
import pytest

from wrist_ft_comp.stream.compensator import Compensator

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / 'docs/python.md').read_text('utf-8')
STEP_NS = 5_000_000


class Sensor:
    """Is warm from its 100th reading on."""

    def __init__(self):
        self.readings = 0

    def read(self):
        self.readings += 1
        warm = 40.0 if self.readings > 100 else 20.0
        return 10**18 + STEP_NS * self.readings, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], warm


def test_the_documented_driver_publishes_compensated_wrenches(bench, make_model, monkeypatch):
    (block,) = (code for code in re.findall(r'```python\n(.*?)```', TEXT, re.S) if 'rclpy' in code)
    model = make_model({'force_y': (0.1, 0.0, 10.0)})
    stored = SimpleNamespace(model=model)
    monkeypatch.setattr('wrist_ft_comp.stored.model_file.load_model', lambda _: stored)
    names = {'sensor': Sensor()}
    exec(block, names)  # noqa: S102 -- the document's own words
    heard = bench.listen(WrenchStamped, 'wrench')
    bench.start(names['Driver'])
    twin, twin_s_sensor, expected = Compensator(1, model=model), Sensor(), {}
    for stamp_ns, raw, celsius in (twin_s_sensor.read() for _ in range(4000)):
        twin.add_temperature(0, stamp_ns, celsius)
        expected[stamp_ns] = twin.correct(stamp_ns, raw)
    removed = 0.0
    while removed < 0.05:
        message = heard.get(timeout=60.0)
        assert six_of(message) == pytest.approx(expected[stamp_of(message)], abs=1e-12)
        removed = 2.0 - message.wrench.force.y
