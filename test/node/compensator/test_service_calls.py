"""``wrist_ft_comp node``: the command against running nodes, and its page against their faults."""

from io import StringIO
import json
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
from moments import SECOND, START
import pytest
from rclpy.task import Future
from rich.console import Console

from wrist_ft_comp.cli import node as command
from wrist_ft_comp.cli import service_calls as operator
from wrist_ft_comp.cli.main import main
from wrist_ft_comp.cli.terminal import coloured
from wrist_ft_comp.errors import NodeError
from wrist_ft_comp.ros.diagnostics import Status

LEVELS = [b'\0', b'\1', b'\2', b'\3']


@pytest.fixture
def operate(capfd):
    """Run the command for a node: exit code, output, and the sentence of a refusal."""

    def run(action, name, *options):
        capfd.readouterr()
        code = main(['node', action, '--name', name, *options])
        said = capfd.readouterr()
        refusal = [line for line in said.err.splitlines() if line.startswith('wrist_ft_comp: ')]
        return code, said.out, ''.join(refusal)

    return run


def test_a_recording_is_begun_and_ended_and_refusals_are_sentences(wired, operate):
    node = wired()
    code, out, _ = operate('record', node.namespace)
    assert (code, out.startswith('recording into ')) == (0, True)
    for second in range(5):
        node.warm(START + second * SECOND, 20.0 + second)
        node.ask_output(START + second * SECOND + 1, [1.0] * 6)
    assert operate('stop', node.namespace)[1].startswith('recorded ')
    code, _, refusal = operate('calibrate', node.namespace)
    assert code == 1
    assert node.node.answers['~/calibrate'] in refusal
    code, out, refusal = operate('rollback', f'{node.namespace}/wrist_ft_comp', '--json')
    assert (code, 'no earlier model' in refusal) == (1, True)
    assert json.loads(out)['error']['kind'] == 'node'


def test_a_missing_node_is_named_with_those_that_run(wired, operate, monkeypatch):
    node = wired()
    monkeypatch.setattr(operator, 'DISCOVERY_S', 1.0)
    code, _, refusal = operate('tare', 'nobody')
    assert code == 1
    assert f'running are: {node.namespace}/wrist_ft_comp' in refusal


def test_a_node_of_another_name_is_found_by_its_namespace_and_lists_its_services(wired, operate):
    node = wired(remap={'__node': 'left_ft'})
    assert operate('reset_tare', node.namespace)[1] == 'the tare is zero again\n'
    code, _, refusal = operate('callibrate', f'{node.namespace}/left_ft')
    assert code == 1
    assert 'left_ft has no service callibrate' in refusal
    assert 'adopt, calibrate, identify_payload, record, reset_tare, rollback, tare.' in refusal


@pytest.fixture
def asking(bench):
    operator_ = operator.Operator(bench.context)
    yield operator_
    operator_.executor.shutdown()
    operator_.node.destroy_node()


def test_one_of_several_nodes_has_to_be_named(asking, monkeypatch):
    names = [f'/{side}/wrist_ft_comp' for side in ('left', 'right')]
    monkeypatch.setattr(asking, 'running', lambda: names)
    with pytest.raises(NodeError, match='--name'):
        asking.find()
    assert asking.find('right') == names[1]


def test_a_busy_node_whose_first_answer_comes_late_is_known(asking, monkeypatch):
    asked = []

    def call_async(_):
        asked.append(Future())
        if len(asked) == 3:
            asked[0].set_result(None)
        return asked[-1]

    client = SimpleNamespace(service_is_ready=lambda: True, call_async=call_async)
    monkeypatch.setattr(asking.node, 'create_client', lambda *_: client)
    monkeypatch.setattr(operator, '_AGAIN_S', 0.01)
    monkeypatch.setattr(operator, 'DISCOVERY_S', 2.0)
    asking.introduce('/busy')
    assert len(asked) == 3


def test_the_status_is_one_page_of_text_or_json(wired, operate):
    node = wired()
    node.put(START, [1.0] * 6, frame='wrist_3_link')
    code, out, _ = operate('status', node.namespace)
    assert out.startswith(f'{node.namespace}/wrist_ft_comp')
    assert 'no model; record a warm-up' in out
    assert code == 1, 'nothing is compensated'
    statuses = json.loads(operate('status', node.namespace, '--json')[1])['statuses']
    assert statuses['model']['level'] == 'warning'
    assert statuses.keys() >= {'input', 'temperature', 'model', 'calibration', 'output'}


def ctrl_c(_):
    raise KeyboardInterrupt


@pytest.mark.parametrize(('silent', 'code', 'words'), [
    (lambda _: True, 1, 'has said nothing'), (ctrl_c, 130, 'wrist_ft_comp goes on with tare'),
])  # fmt: skip
def test_a_node_that_falls_silent_is_no_longer_waited_for(  # noqa: PLR0913, PLR0917
    silent, code, words, wired, operate, monkeypatch
):
    node = wired()
    monkeypatch.setattr(node.node.tare, 'poll', lambda: None)
    monkeypatch.setattr(operator.Watch, 'silent', property(silent))
    ended, _, refusal = operate('tare', node.namespace)
    assert (ended, words in refusal) == (code, True)


WORDS = st.text(st.characters(codec='utf-8', exclude_categories=['Cc', 'Cs']), max_size=300)
NAMES = st.sampled_from(['input', 'temperature', 'model', 'output', 'calibration', 'payload'])
VALUES = {
    'thermometer_1_age_s': 'never', 'thermometer_2_age_s': '0.1', 'thermometer_2_c': '21.00',
    'thermometer_2_calibrated_c': '20.1 to 35.0', 'recording_s': '754',
}  # fmt: skip
VALUES |= {
    f'{axis}_{name}': '-0.09579 N m'
    for axis in command.AXES
    for name in ('raw', 'compensated', 'drift', 'drift_deviation', 'tare')
}


@given(st.dictionaries(NAMES, st.tuples(st.sampled_from(LEVELS), WORDS)))
def test_a_page_fits_into_eighty_columns_whatever_is_wrong(said):
    heard = {name: Status(name, *pair, VALUES) for name, pair in said.items()}
    name = '/a/very/long/namespace/of/a/robot/wrist_ft_comp'
    watch = SimpleNamespace(name=name, statuses=heard, hardware_id='x' * 100, silent=True)
    page = list(command.status_page(watch))
    console = Console(file=StringIO(), width=200)
    console.print(*coloured(page), sep='\n')
    text = console.file.getvalue()
    lines = text.splitlines()
    long = max(map(len, ' '.join(text for _, text in said.values()).split()), default=0)
    assert max(map(len, lines)) <= max(80, 21 + long)
    levels = [said[name][0] for line in lines for name in said if line[8:].split(' ')[0] == name]
    assert len(levels) == len(said)
    assert levels == sorted(levels, reverse=True)
    assert ('20.1 to 35.0' in text) == ({'temperature', 'model'} <= said.keys())
    assert ('has run for 13 min' in text) == ('calibration' in said)
    assert text.count('-0.09579') == 30 * ('output' in said)
