import pytest

from wrist_ft_comp.files.model_file import FORMAT
from wrist_ft_comp.files.recordings import is_worth_keeping, looks_like_model, looks_like_recording

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
    path = place(name, f'# mine\nformat: {FORMAT}\nversion: 99\n')
    assert looks_like_model(path)
    assert not looks_like_recording(path)
    assert not is_worth_keeping(path)


@pytest.mark.parametrize(
    ('name', 'content'),
    [('a.csv', 'stamp_s\n'), ('a.mcap', 'x'), ('a.db3', 'x'), ('a.txt', TABLE)],
)
def test_a_recording_is_one_by_its_name_or_header(name, content, place):
    path = place(name, content)
    assert looks_like_recording(path)
    assert not looks_like_model(path)
    assert is_worth_keeping(path)


def test_a_folder_may_be_a_bag(tmp_path):
    assert looks_like_recording(tmp_path)
    assert not looks_like_model(tmp_path)
    assert not is_worth_keeping(tmp_path)


def test_what_is_not_there_is_no_model_and_overwrites_nothing(tmp_path, place):
    for path in (tmp_path / 'no.yaml', tmp_path / ('x' * 300), place('empty', '')):
        assert not looks_like_model(path)
        assert not looks_like_recording(path)
        assert not is_worth_keeping(path)
