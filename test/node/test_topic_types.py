import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.ros.topics import load_type


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('nowhere_msgs/msg/State', 'package nowhere_msgs with this type is not installed'),
        ('sensor_msgs/msg/Nothing', 'sensor_msgs with this type is not installed.*Nothing'),
        *((name, 'which is no message of ROS') for name in ('os/path', 'a.b/msg/State', '')),
    ],
)
def test_a_type_that_cannot_be_imported_is_a_sentence(name, words):
    with pytest.raises(SettingsError, match=words):
        load_type('/state', name)


@pytest.mark.usefixtures('ros_domain')
def test_a_package_whose_library_cannot_be_loaded_is_a_sentence(monkeypatch):
    def refuse(_):
        raise RuntimeError('Could not import: it is not there')

    monkeypatch.setattr('wrist_ft_comp.ros.topics.serialize_message', refuse)
    with pytest.raises(SettingsError, match=r'its libraries cannot be loaded \(Could not import'):
        load_type('/state', 'sensor_msgs/msg/BatteryState')
