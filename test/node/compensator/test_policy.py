from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from rclpy.node import Node

from wrist_ft_comp.node.compensator_node import CompensatorNode

POLICY = Path(__file__).parents[3] / 'config/sros2_policy.xml'
#: Services that change something.
CHANGING = {'calibrate', 'identify_payload', 'record', 'tare', 'reset_tare', 'rollback',
            'adopt', 'set_parameters', 'set_parameters_atomically'}  # fmt: skip
#: What a list of rules may hold, as in version 0.2.0 of SROS2's schema.
LISTS = {
    'topics': ('topic', {'publish', 'subscribe'}),
    'services': ('service', {'request', 'reply'}),
}


@pytest.fixture(scope='module')
def policy():
    return ET.parse(POLICY).getroot()  # noqa: S314 -- our own file


def profile_of(policy, enclave):
    (allowed,) = policy.findall(f"enclaves/enclave[@path='/{enclave}']/profiles/profile")
    return allowed


def granted(profile, kind, right):
    """Full names that a profile grants a right on."""
    node = f'/{profile.get("node")}'
    allowed = (rules for rules in profile.findall(kind) if rules.get(right) == 'ALLOW')
    names = [rule.text for rules in allowed for rule in rules]
    return {
        name if name.startswith('/') else node + name[1:] if name[0] == '~' else f'/{name}'
        for name in names
    }


def test_the_policy_follows_the_schema(policy):
    assert (policy.tag, policy.attrib) == ('policy', {'version': '0.2.0'})
    for enclave in policy.iterfind('enclaves/*'):
        assert (enclave.tag, set(enclave.attrib)) == ('enclave', {'path'})
        for profile in enclave.iterfind('profiles/*'):
            assert (profile.tag, set(profile.attrib)) == ('profile', {'ns', 'node'})
            for rules in profile:
                item, rights = LISTS[rules.tag]
                assert set(rules.attrib) <= rights
                assert set(rules.attrib.values()) <= {'ALLOW', 'DENY'}
                assert all(rule.tag == item and rule.text for rule in rules)


def test_the_node_is_granted_what_it_has_and_nothing_more(bench, policy, tmp_path):
    given = {'data_directory': str(tmp_path), 'use_sim_time': True}
    node = bench.make(CompensatorNode, parameters=given)
    node.recorder.begin()  # which subscribes to the reference
    me = (node.get_name(), node.get_namespace())
    profile = profile_of(policy, 'wrist_ft_comp')

    def has(names_and_types):
        return {name for name, _ in names_and_types}

    allowed = {
        ('topics', 'publish'): has(node.get_publisher_names_and_types_by_node(*me)),
        ('topics', 'subscribe'): has(node.get_subscriber_names_and_types_by_node(*me)),
        ('services', 'reply'): has(node.get_service_names_and_types_by_node(*me)),
    }
    for (kind, right), names in allowed.items():
        assert names == granted(profile, kind, right), (kind, right)
    assert not granted(profile, 'services', 'request')


def test_only_the_operator_may_change_something(policy):
    node = profile_of(policy, 'wrist_ft_comp')
    offered = granted(node, 'services', 'reply')
    assert {f'/wrist_ft_comp/{name}' for name in CHANGING} <= offered
    reader = profile_of(policy, 'wrist_ft_comp_reader')
    assert not granted(reader, 'services', 'request')
    assert granted(reader, 'topics', 'publish') == {'/rosout', '/parameter_events'}
    operator = profile_of(policy, 'wrist_ft_comp_operator')
    assert granted(operator, 'services', 'request') == offered
    published = granted(node, 'topics', 'publish')
    for other in (reader, operator):
        assert granted(other, 'topics', 'subscribe') <= published | {'/clock'}


@pytest.mark.parametrize('enclave', ['wrist_ft_comp_reader', 'wrist_ft_comp_operator'])
def test_others_are_granted_what_any_node_has(bench, policy, enclave):
    node = bench.make(Node, node_name=enclave, use_global_arguments=False)
    profile, me = profile_of(policy, enclave), (enclave, '/')
    for kind, right, found in (
        ('services', 'reply', node.get_service_names_and_types_by_node(*me)),
        ('topics', 'publish', node.get_publisher_names_and_types_by_node(*me)),
    ):
        assert granted(profile, kind, right) == {name for name, _ in found}
