import gc

import pytest

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.node.compensator_node import CompensatorNode
from wrist_ft_comp.ros.topics import ROS_REFUSALS

IMU = ['-p', 'gravity.source:=imu']


def start(context, tmp_path, *arguments):
    words = ['--ros-args', '-p', f'data_directory:={tmp_path / "data"}', *arguments]
    return CompensatorNode(context=context, cli_args=words)


def refusal(context, tmp_path, *arguments):
    with pytest.raises((WristFtCompError, *ROS_REFUSALS)) as refused:
        start(context, tmp_path, *arguments)
    said = str(refused.value)
    # What was refused half-made goes now: participants that pile up make DDS hang in the end.
    del refused
    gc.collect()
    return said


#: What is given, and words of what is said.
WRONG = (
    ("temperature_topics:=['{bad}']", '{bad}'),
    ('temperature_topics:=[]', 'must name at least one topic; got none'),
    ("temperature_topics:=['heat', '/heat:temperature']", 'are one and the same'),
    ('temperature_topics:=[wrench_raw]', 'The topic wrench_raw cannot be used'),
    ('model_file:=/', '/ cannot be read: Is a directory'),
    ('use_sim_time:=5', "expecting type 'BOOL'"),
    ('max_drift:=[]', 'got None'),
    ('learning.mode:=on', 'one of off, propose, auto'),
    ('hardware_id:=1234', """set it at start-up with -p hardware_id:='"VALUE"'."""),
    ('qos_overrides./wrench.publisher.reliability:=bestest', 'bestest'),
    ('payload.active:=day-1', 'gravity.source is none, so nobody knows where down is'),
    (['-r', 'wrench:=wrench_raw'], 'are both /wrench_raw: the node would hear itself'),
    (['-r', 'wrench:=/diagnostics'], 'The topic /diagnostics cannot be used'),
    (['-r', 'wrench_raw:=/rosout'], 'The topic wrench_raw cannot be used'),
    ([*IMU, '-p', 'payload.active:=nail'], r'was learnt (there is none yet); got nail'),
)


@pytest.mark.filterwarnings('ignore:A zero depth')
def test_a_wrong_value_gets_its_sentence_and_locks_nothing(ros_context, tmp_path):
    for given, words in WRONG:
        arguments = ['-p', given] if isinstance(given, str) else given
        said = refusal(ros_context, tmp_path, *arguments)
        assert words in said
        assert '\n' not in said
        assert '/project/' not in said
    start(ros_context, tmp_path).destroy_node()


def test_a_mistyped_parameter_warns_and_those_of_other_nodes_do_not(ros_context, tmp_path, capfd):
    given = 'temprature_topics:=[heat]', 'joint_limits.joint_1.max_effort:=1', 'use_sim_time:=true'
    start(ros_context, tmp_path, *(word for one in given for word in ('-p', one))).destroy_node()
    said, meant = capfd.readouterr().err, 'Did you mean temperature_topics?'
    assert f'no parameter temprature_topics, so its value is ignored. {meant}' in said
    assert said.count('There is no parameter') == 1


def test_a_folder_that_cannot_be_written_is_named_at_start(rig):
    node = rig(parameters={'data_directory': '/proc/wrist_ft_comp'})
    said = '/proc/wrist_ft_comp cannot be written: No such file or directory. Mend its rights'
    assert said in node.diagnosis('model').message
    sentence = node.refusal('record', True)
    assert sentence.startswith('/proc/wrist_ft_comp cannot be written: ')
    assert sentence.endswith('Make room or choose another data_directory.')
