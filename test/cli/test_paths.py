import pytest

from wrist_ft_comp.cli import paths
from wrist_ft_comp.errors import ModelFileError, RecordingError
from wrist_ft_comp.stored.model_file import KIND

TABLE = 'step,load_kpa,output_at_20_c\n0,0,1\n'


@pytest.fixture
def place(tmp_path):
    def write(name, content):
        path = tmp_path / name
        path.write_text(content)
        return path

    return write


@pytest.mark.parametrize('name', ['m.yaml', 'm', 'm.csv'])
def test_a_model_is_one_by_its_content(name, place):
    path = place(name, f'# mine\nformat: {KIND.says}\nversion: 99\n')
    paths.check_model(path)
    KIND.check_target(path)
    with pytest.raises(RecordingError, match='is a model file, where a recording was expected'):
        paths.check_recordings([path])


@pytest.mark.parametrize(
    ('name', 'content'),
    [('a.csv', 'stamp_s\n'), ('a.mcap', 'x'), ('a.db3', 'x'), ('a.txt', TABLE)],
)
def test_a_recording_is_one_by_its_name_or_header(name, content, place):
    path = place(name, content)
    paths.check_recordings([path])
    with pytest.raises(ModelFileError, match='is a recording, where a model file was expected'):
        paths.check_model(path)
    with pytest.raises(ModelFileError, match='exists and is no model file'):
        KIND.check_target(path)


def test_a_folder_may_be_a_bag_and_is_no_model(tmp_path):
    paths.check_recordings([tmp_path])
    with pytest.raises(ModelFileError, match='is a recording'):
        paths.check_model(tmp_path)
    with pytest.raises(ModelFileError, match='is a folder'):
        KIND.check_target(tmp_path)


def test_what_is_not_there_may_be_made(tmp_path, place):
    for path in (tmp_path / 'no', tmp_path / 'folder/no.yaml', place('empty', '')):
        paths.check_model(path)
        paths.check_recordings([path])
        KIND.check_target(path)
