"""No part of the node can end it: whatever one throws, the wrenches go on."""

from pathlib import Path
import re

from moments import ERROR, OK, SECOND, START
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.node import compensator_node
from wrist_ft_comp.ros.hub import Hub

ARCHITECTURE = Path(__file__).parents[3] / 'docs/architecture.md'
#: In an order in which a part that has stopped keeps nothing from those behind it.
PARTS = (
    'wrench_input', 'live', 'state_keeper', 'recorder', 'jobs',
    'drift_topic', 'tare', 'external', 'learning',
    'specific_force', 'inputs',
)  # fmt: skip
VERBS = (
    'on_wrench', 'on_cells', 'on_specific_force', 'check_parameters',
    'apply_parameters', 'poll', 'statuses', 'end',
)  # fmt: skip


class Sabotage(Exception):  # noqa: N818 -- no name of an error in the log but by accident
    """What no part expects."""


def sabotaged(*_, **__):
    raise Sabotage('by a test')


@pytest.mark.parametrize('verb', VERBS)
def test_parts_that_fail_one_after_the_other_in_any_verb_cost_no_wrench(rig, make_model, verb):
    model = make_model('m.yaml')
    node = rig(model=model, parameters={'gravity.source': 'imu'})
    node.warm_up(25.0)
    for second, part in enumerate(PARTS, start=3):
        victim = getattr(node.node, part)
        setattr(victim, verb, sabotaged)
        # As the hub takes it where a part has a use for the verb.
        node.node._hearing.setdefault(verb, []).append(victim)
        node.node.listen(victim, wanted=True)
        node.put_temperature(START + second * SECOND, 26.0)
        node.node.broadcast('on_specific_force', START + second * SECOND, (0.0, 0.0, 9.8), 0.0)
        assert len(node.ask_output(START + second * SECOND, [1.0] * 6)) == 6
        node.set('payload.mass', 1.0 + second)
        node._report()
        assert victim.stopped or verb == 'end', part
    assert node.node.counts.published == len(PARTS)
    node.node.destroy_node()


def test_a_part_that_failed_is_logged_once_and_its_services_refuse(rig, capfd):
    node = rig()
    node.node.tare.on_wrench = sabotaged
    answers = node.ask('tare')
    node.ask_output(START, [1.0] * 6)
    failed = node.answered(answers)
    assert not failed.success
    assert 'Sabotage: by a test' in failed.message
    again = node.call('reset_tare')
    assert (again.success, again.message) == (False, failed.message)
    found = node.diagnosis('tare')
    assert (found.level, found.message) == (ERROR, failed.message)
    node.ask_output(START + SECOND, [1.0] * 6)
    logged = capfd.readouterr().err
    assert logged.count('Traceback') == 1
    assert 'in sabotaged' in logged


def test_a_fault_on_the_way_of_the_wrench_costs_that_wrench_and_is_an_error(rig, capfd):
    node = rig()
    node.node.compensator.correct = sabotaged
    for second in range(3):
        node.put(START + second * SECOND, [1.0] * 6)
    assert node.outputs.empty()
    found = node.diagnosis('output')
    assert (found.level, 'lost by a fault of this program' in found.message) == (ERROR, True)
    assert capfd.readouterr().err.count('Traceback') == 1
    del node.node.compensator.correct
    assert len(node.ask_output(START + 4 * SECOND, [1.0] * 6)) == 6


@pytest.mark.parametrize(('error', 'calls'), [(SettingsError, 3), (Sabotage, 1)])
def test_a_refusal_is_no_fault_and_a_part_is_not_called_after_one(rig, capfd, error, calls):
    node, called = rig(), []

    def fail():
        called.append(True)
        raise error('not today')

    node.node.recorder.poll = fail
    for _ in range(3):
        node.node.housekeep()
    assert (len(called), bool(node.node.recorder.stopped)) == (calls, error is Sabotage)
    assert capfd.readouterr().err.count('[ERROR]') == 1


def test_the_part_in_the_documentation_runs_beside_the_others(rig, monkeypatch):
    (code,) = re.findall(r'```python\n(.+?)```', ARCHITECTURE.read_text('utf-8'), re.DOTALL)
    names = {}
    exec(compile(code, ARCHITECTURE.name, 'exec'), names)  # noqa: S102 -- our own document
    heartbeat, run = names['Heartbeat'](), Hub.run
    table = *compensator_node.PARAMETERS, *heartbeat.parameters
    monkeypatch.setattr(compensator_node, 'PARAMETERS', table)
    monkeypatch.setattr(Hub, 'run', lambda self, parts: run(self, [*parts, heartbeat]))
    node = rig(parameters={'heartbeat.word': 'awake'})
    for second in range(3):
        node.ask_output(START + second * SECOND, [1.0] * 6)
    status = node.diagnosis('heartbeat')
    assert (status.level, status.message, status.values) == (OK, 'awake', {'wrenches': '3'})
    assert node.set('heartbeat.word', 'alive').successful
    assert node.diagnosis('heartbeat').message == 'alive'
    assert node.call('count').message == '3 wrenches came'
