"""What versions up to 0.2.0 wrote is refused in a sentence, and stays."""

import json

import pytest

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.learning import diary
from wrist_ft_comp.stored import model_file, payload_file, state_file

#: By the name of a file: its kind, and what reads it.
FILES = {
    'model.yaml': (model_file.KIND, model_file.load_model),
    'payloads.json': (payload_file.KIND, payload_file.load_payloads),
    'state.json': (state_file.KIND, state_file.load_state),
    'learning.json': (diary.MEMORY, lambda path: diary.load_memory(path.parent)),
    'diary.json': (diary.KIND, lambda path: diary.KIND.load(diary.Diary, path)),
}


@pytest.mark.parametrize('name', FILES)
def test_an_old_file_is_refused_and_stays(name, tmp_path):
    kind, load = FILES[name]
    path = tmp_path / name
    old = json.dumps({'format': kind.says, 'version': 1, 'since': 'then'})
    path.write_text(old)
    with pytest.raises(WristFtCompError) as refused:
        load(path)
    assert str(refused.value) == (
        f'{path} was written by an older version of wrist_ft_comp (format 1); this one reads '
        f'format {kind.version}. {kind.renewed_by}, or install that one.'
    )
    assert path.read_text() == old
